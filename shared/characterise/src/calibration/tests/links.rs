//! Projectors that are read where a camera found the points: the errors that both share count once.

use super::super::model::{Board, DEVICE, LOCAL, POSE, Projector, Shape, State, WARP};
use super::super::problem::{Problem, ViewRange, columns};
use super::super::*;
use super::synthetic::{WARP_MM, World};
use super::truth::{chi_square, errors};
use fringe::math::linear::{Dense, Factor, dot};
use nalgebra::{Matrix2, Translation3};

/// Standard deviation of the reading alone, px.
const READING_PX: f64 = 0.004;

/// What least squares without links sees: all pixels, and the covariance of each with each.
struct Whole {
    jacobian: Dense,
    residual: Vec<f64>,
    covariance: Dense,
}

fn whole(problem: &Problem, state: &State) -> Whole {
    let (n, rows) = (problem.unknowns, 2 * problem.image_points.len());
    let (mut jacobian, mut residual) = (Dense::zeros(rows, n + 2 * POSE), vec![0.0; rows]);
    let mut covariance = Dense::zeros(rows, rows);
    for view in &problem.views {
        let eye = Projector::new(&state.cameras[view.device], state.boards[view.pose].as_ref().unwrap());
        let own = problem.columns[view.device].iter().chain(&problem.columns[6]).copied();
        let pose = (0..POSE).map(|i| Some(n + POSE * view.pose + i));
        let places: Vec<Option<usize>> = own.chain(pose).collect();
        assert_eq!((places.len(), DEVICE + WARP + POSE), (LOCAL, LOCAL));
        for number in view.start..view.end {
            let image_point = &problem.image_points[number];
            let point = problem.board.point(image_point.index, &state.shape);
            let (pixel, local) = eye.rows(&point, problem.board.rise[image_point.index]).unwrap();
            let error = image_point.pixel - pixel;
            let mut put = |i: usize, other: usize, block: &Matrix2<f64>| {
                (0..2).for_each(|j| covariance.set(2 * number + i, 2 * other + j, block[(i, j)]));
            };
            for i in 0..2 {
                residual[2 * number + i] = error[i];
                put(i, number, &image_point.covariance_px2);
                if let Some(link) = &problem.links[number] {
                    put(
                        i,
                        link.image_point,
                        &(link.slopes * problem.image_points[link.image_point].covariance_px2),
                    );
                }
                for (column, value) in places.iter().zip(&local[i]) {
                    if let Some(column) = *column {
                        jacobian.set(2 * number + i, column, *value);
                    }
                }
            }
        }
    }
    // The camera's side of each block.
    for (number, link) in problem.links.iter().enumerate() {
        let Some(link) = link else { continue };
        for (i, j) in (0..4).map(|k| (k / 2, k % 2)) {
            let value = covariance.at(2 * number + i, 2 * link.image_point + j);
            covariance.set(2 * link.image_point + j, 2 * number + i, value);
        }
    }
    Whole { jacobian, residual, covariance }
}

/// Least squares with the covariance matrix of all pixels as one, without any elimination, beside the sums by links.
#[test]
fn linked_sums_are_those_of_the_whole_covariance_matrix() {
    let world = World::new(2);
    let mut observations = world.read_by_cameras(3, 1.0);
    for view in &mut observations.views {
        view.image_points = view.image_points.iter().step_by(9).copied().collect();
    }
    let board = Board::new(&observations);
    let shape = Shape { warp_mm: [0.5 * WARP_MM[0], 0.0], ..Shape::default() };
    let centre = Translation3::from(board.centre);
    let boards: Vec<_> = world.boards.iter().map(|b| Some(b * centre)).collect();
    let state = State { cameras: world.cameras.clone(), boards, shape };
    let (mut views, mut image_points) = (Vec::new(), Vec::new());
    for view in &observations.views {
        let start = image_points.len();
        image_points.extend(&view.image_points);
        views.push(ViewRange { device: view.device, pose: view.pose, start, end: image_points.len() });
    }
    let problem =
        Problem::new(&board, views, image_points, columns(&[LensModel::default(); 6], TargetShape::Bent));
    assert!(problem.links.iter().flatten().count() > 20);
    let Whole { jacobian, residual, covariance } = whole(&problem, &state);
    let (n, rows) = (problem.unknowns, residual.len());
    let factor = Factor::new(&covariance).unwrap();
    let transposed = jacobian.transposed();
    let columns: Vec<Vec<f64>> = (0..transposed.rows).map(|c| factor.solve(transposed.row(c))).collect();
    let sums = problem.normal(&state, &vec![1.0; problem.image_points.len()]).unwrap();
    let cost = dot(&residual, &factor.solve(&residual));
    assert!((sums.cost / cost - 1.0).abs() < 1e-9, "{} beside {cost}", sums.cost);
    assert!((problem.cost(&state, &vec![1.0; rows / 2]) / cost - 1.0).abs() < 1e-9);
    let entry = |i: usize, j: usize| dot(&columns[i], transposed.row(j));
    let scale = |i: usize, j: usize| (entry(i, i) * entry(j, j)).sqrt();
    let check = |ours: f64, i: usize, j: usize| {
        assert!((ours - entry(i, j)).abs() < 1e-9 * scale(i, j), "({i}, {j}): {ours} beside {}", entry(i, j));
    };
    for (i, column) in columns.iter().enumerate().take(n) {
        (0..n).for_each(|j| check(sums.devices.at(i, j), i, j));
        let right = dot(column, &residual);
        assert!((sums.right[i] - right).abs() < 1e-9 * (entry(i, i) * cost).sqrt());
    }
    for (pose, block) in sums.poses.iter().enumerate() {
        let (block, first) = (block.as_ref().unwrap(), n + POSE * pose);
        for i in 0..POSE {
            (0..POSE).for_each(|j| check(block.matrix.at(i, j), first + i, first + j));
            (0..n).for_each(|j| check(block.coupling.at(j, i), first + i, j));
        }
    }
}

/// χ² over seeded trials, and its number of degrees.
fn scatter(trials: u64, change: impl Fn(&mut ImagePoint)) -> (f64, f64) {
    let world = World::new(12);
    let (mut sum, mut freedom) = (0.0, 0);
    for seed in 0..trials {
        let mut observations = world.read_by_cameras(3000 + seed, 1.0);
        observations.views.iter_mut().flat_map(|v| &mut v.image_points).for_each(&change);
        let found = calibrate(&observations, &CalibrationSettings::default()).unwrap();
        let (square, n) = chi_square(&errors(&world, &found), &found.covariance);
        sum += square;
        freedom += n;
    }
    (sum, freedom as f64)
}

/// Parameters scatter as predicted; with the same pixels taken as independent they do not.
#[test]
fn shared_errors_count_once() {
    let half = |freedom: f64| 1.96 * (2.0 * freedom).sqrt();
    let (sum, freedom) = scatter(8, |_| {});
    assert!((sum - freedom).abs() < half(freedom), "χ² {sum:.0} of {freedom}");
    let (sum, freedom) = scatter(12, |image_point| image_point.link = None);
    assert!((sum - freedom).abs() > half(freedom), "χ² {sum:.0} of {freedom}");
}

/// The reported residual of a projector stays that of its pixel, and held-out poses are predicted with the shared error.
#[test]
fn held_out_residuals_of_linked_projectors_are_as_predicted() {
    let observations = World::new(12).read_by_cameras(5, 1.0);
    let held = hold_out(&observations, &CalibrationSettings::default(), &in_turn(&observations, 3)).unwrap();
    for device in &held.devices {
        let ratio = device.rms_px / device.predicted_px;
        assert!((0.9..1.1).contains(&ratio), "{device:?}");
    }
    let whole = calibrate(&observations, &CalibrationSettings::default()).unwrap();
    for (number, device) in whole.devices.iter().enumerate() {
        assert!((0.9..1.1).contains(&device.noise_factor), "{}: {}", device.name, device.noise_factor);
        let image_points =
            observations.views.iter().filter(|v| v.device == number).flat_map(|v| &v.image_points);
        let variances: Vec<f64> = image_points.map(|s| s.covariance_px2.trace()).collect();
        let expected = (variances.iter().sum::<f64>() / variances.len() as f64).sqrt();
        assert!((device.rms_reprojection_px / expected - 1.0).abs() < 0.1, "{device:?} beside {expected}");
    }
}

/// A corner that a camera found elsewhere takes the light that was read there with it.
#[test]
fn light_at_a_wrong_corner_is_rejected_with_it() {
    let mut observations = World::new(8).read_by_cameras(6, 1.0);
    let number = observations.views.iter().position(|v| v.device == 4).unwrap();
    let (image_point, pose) = (observations.views[number].image_points[30], observations.views[number].pose);
    let link = image_point.link.unwrap();
    let off = nalgebra::Vector2::new(1.5, -1.0);
    observations.views[number].image_points[30].pixel += link.slopes * off;
    let seen = observations.views.iter_mut().find(|v| (v.device, v.pose) == (link.device, pose)).unwrap();
    seen.image_points.iter_mut().find(|s| s.index == image_point.index).unwrap().pixel += off;
    let found = calibrate(&observations, &CalibrationSettings::default()).unwrap();
    let rejected = found.outliers.iter().filter(|o| o.index == image_point.index).count();
    assert_eq!((rejected, found.outliers.len()), (2, 2), "{:?}", found.outliers);
}

#[test]
fn a_link_to_what_is_no_camera_is_refused() {
    let observations = World::new(4).read_by_cameras(7, 1.0);
    let number = observations.views.iter().position(|v| v.device == 4).unwrap();
    let refused = |change: fn(&mut Link)| {
        let mut wrong = observations.clone();
        change(wrong.views[number].image_points[3].link.as_mut().unwrap());
        wrong.check().unwrap_err().to_string()
    };
    assert!(refused(|l| l.device = 5).contains("a camera 5"));
    assert!(refused(|l| l.device = 77).contains("a camera 77"));
    assert!(refused(|l| l.slopes[(0, 1)] = f64::NAN).contains("point"));
    assert!(refused(|l| l.covariance_px2 = Matrix2::zeros()).contains("point"));
    let mut camera = observations.clone();
    let link = observations.views[number].image_points[3].link;
    camera.views[0].image_points[0].link = link;
    assert!(camera.check().is_err());
}

impl World {
    /// As [`Self::observe`], with each projector read by a camera of its own pair (0 for the first, 2 for the second).
    pub fn read_by_cameras(&self, seed: u64, scale: f64) -> Observations {
        let mut observations = self.observe(seed, scale);
        let exact = self.observe(seed, 0.0);
        let mut noise = fringe::synthetic::Noise(seed + 50_000);
        for number in 0..observations.views.len() {
            let (device, pose) = (observations.views[number].device, observations.views[number].pose);
            if observations.devices[device].kind != DeviceKind::Projector {
                continue;
            }
            let reader = 2 * (device - 4);
            let of = |all: &Observations| {
                all.views.iter().find(|v| (v.device, v.pose) == (reader, pose)).unwrap().image_points.clone()
            };
            let (found, truth) = (of(&observations), of(&exact));
            let mut image_points = Vec::new();
            for mut image_point in exact.views[number].image_points.iter().copied() {
                let at = found.iter().position(|s| s.index == image_point.index);
                let Some(at) = at else { continue };
                let slopes = self.slopes([reader, device], pose, image_point.index);
                let reading = nalgebra::Vector2::new(noise.gauss(), noise.gauss()) * (READING_PX * scale);
                image_point.pixel += slopes * (found[at].pixel - truth[at].pixel) + reading;
                let covariance_px2 = Matrix2::identity() * (READING_PX * READING_PX);
                image_point.covariance_px2 =
                    slopes * found[at].covariance_px2 * slopes.transpose() + covariance_px2;
                image_point.covariance_px2 =
                    (image_point.covariance_px2 + image_point.covariance_px2.transpose()) * 0.5;
                image_point.link = Some(Link { device: reader, slopes, covariance_px2 });
                image_points.push(image_point);
            }
            observations.views[number].image_points = image_points;
        }
        observations
    }

    /// Projector pixels per camera pixel on the board about a point.
    fn slopes(&self, [camera, projector]: [usize; 2], pose: usize, index: usize) -> Matrix2<f64> {
        let along = |device: usize| {
            let pixel = |x: f64, y: f64| {
                let point = self.bent(index) + nalgebra::Vector3::new(x, y, 0.0);
                self.cameras[device].project(&(self.boards[pose] * point)).unwrap().coords
            };
            let step = 1e-3;
            Matrix2::from_columns(&[
                (pixel(step, 0.0) - pixel(-step, 0.0)) / (2.0 * step),
                (pixel(0.0, step) - pixel(0.0, -step)) / (2.0 * step),
            ])
        };
        along(projector) * along(camera).try_inverse().unwrap()
    }
}
