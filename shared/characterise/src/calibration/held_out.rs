//! Held-out poses: how well a rig predicts the image points of a target in poses that were not used in its calibration.
//!
//! Residuals of an adjustment are too small where its parameters bend to the noise, and silent about errors that the
//! poses of the boards took over. Here only the six parameters of each held-out pose are solved; all devices together
//! must agree about it. What noise and covariance predict for the same residuals stands beside them: residuals well
//! beyond it show that the camera model or the target is wrong.

use super::adjust::{Weighted, approach, weighted};
use super::covariance::Gauge;
use super::finish::{reports, rms};
use super::homography::homography;
use super::model::{Board, DEVICE, LOCAL, POSE, Projector, Shape, State, WARP, compose};
use super::observations::{ImagePoint, Observations};
use super::problem::{Problem, Run, ViewRange};
use super::result::{Calibration, ViewReport};
use super::settings::CalibrationSettings;
use super::zhang;
use super::{CalibrationError, calibrate};
use fringe::geometry::camera::LensKind;
use fringe::math::linear::{Dense, Factor, dot};
use fringe::math::statistics::median;
use nalgebra::Isometry3;

/// Residuals of one device in poses that it was not calibrated from.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOutDevice {
    /// Name of the pose.
    pub name: String,
    /// Root mean squared distance between seen and predicted pixel over the points used, px.
    pub rms_px: f64,
    /// What the noise of the points and the covariance of the calibration predict for it, px.
    pub predicted_px: f64,
    /// Number of points used.
    pub points: usize,
    /// Number of points rejected as outliers.
    pub outliers: usize,
}

/// A rig and the poses that it was validated with.
#[derive(Debug, Clone, PartialEq)]
pub struct Fold {
    /// The calibration without these poses.
    pub calibration: Calibration,
    /// Their views; indices as in the observations.
    pub views: Vec<ViewReport>,
    /// Sum of the predicted squared distances of each view, px².
    predicted_px2: Vec<f64>,
}

/// All poses that were held out.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOut {
    /// In the order of the groups given.
    pub folds: Vec<Fold>,
    /// Per device, over all folds.
    pub devices: Vec<HeldOutDevice>,
}

/// Every n-th pose that was seen, n times in turn: each pose is held out once.
pub fn in_turn(observations: &Observations, turns: usize) -> Vec<Vec<usize>> {
    let mut poses: Vec<usize> = observations.views.iter().map(|v| v.pose).collect();
    poses.sort_unstable();
    poses.dedup();
    (0..turns).map(|turn| poses.iter().skip(turn).step_by(turns.max(1)).copied().collect()).collect()
}

/// Calibrates without each group of poses and validates the rig with them.
///
/// # Errors
/// As [`calibrate`], for the poses that are left in any of the groups.
pub fn hold_out(
    observations: &Observations,
    settings: &CalibrationSettings,
    groups: &[Vec<usize>],
) -> Result<HeldOut, CalibrationError> {
    let folds: Vec<Fold> =
        groups.iter().map(|group| fold(observations, settings, group)).collect::<Result<_, _>>()?;
    let names = observations.devices.iter().enumerate();
    let devices = names.map(|(number, device)| summary(number, &device.name, &folds)).collect();
    Ok(HeldOut { folds, devices })
}

fn summary(device: usize, name: &str, folds: &[Fold]) -> HeldOutDevice {
    let views = || {
        let all = folds.iter().flat_map(|f| f.views.iter().zip(&f.predicted_px2));
        all.filter(|(v, _)| v.device == device)
    };
    let residuals = || views().flat_map(|(v, _)| v.residuals.iter());
    let points = residuals().filter(|r| r.used).count();
    HeldOutDevice {
        name: name.to_owned(),
        rms_px: rms(residuals()),
        predicted_px: (views().map(|(_, square)| square).sum::<f64>() / points.max(1) as f64).sqrt(),
        points,
        outliers: residuals().count() - points,
    }
}

fn fold(
    observations: &Observations,
    settings: &CalibrationSettings,
    held: &[usize],
) -> Result<Fold, CalibrationError> {
    let mut rest = observations.clone();
    rest.views.retain(|v| !held.contains(&v.pose));
    let calibration = calibrate(&rest, settings)?;
    let board = Board::new(observations);
    let cameras = calibration.devices.iter().map(|d| d.camera.clone()).collect();
    let placed_mm = observations.placed_mm();
    let adjusted = calibration.target_mm.iter().zip(&placed_mm);
    let offsets_mm = adjusted.map(|(a, b)| a - b).collect();
    let shape = Shape { warp_mm: [0.0; 2], offsets_mm, faces: board.declared.clone() };
    let mut state = State { cameras, boards: Vec::new(), shape };
    let fixed = vec![None; DEVICE];
    let mut columns = vec![fixed; observations.devices.len()];
    columns.push(vec![None; WARP]);
    let (mut views, mut image_points, mut origin) = (Vec::new(), Vec::new(), Vec::new());
    for pose in held {
        origin.extend(add_pose((&mut views, &mut image_points), &board, &mut state, observations, *pose));
    }
    let problem = Problem::new(&board, views, image_points, (columns, 0));
    let weighted = approach(&problem, state)
        .and_then(|state| weighted(&problem, state, settings))
        .ok_or_else(|| CalibrationError::NoConvergence { stage: "held-out poses".into(), iterations: 0 })?;
    let predicted_px2 = predicted(&calibration, &problem, &weighted);
    let mut views = reports(&problem, &weighted, &origin);
    for view in &mut views {
        view.pose = observations.views[view.view].pose;
    }
    Ok(Fold { calibration, views, predicted_px2 })
}

/// Adds the views of a pose, oriented alike; gives each one's number and whether it was turned.
///
/// Which way round the first view is read does not matter: a target that may be read turned meets itself.
fn add_pose(
    (views, image_points): (&mut Vec<ViewRange>, &mut Vec<ImagePoint>),
    board: &Board,
    state: &mut State,
    observations: &Observations,
    pose: usize,
) -> Vec<(usize, bool)> {
    let seen = |(number, view): (usize, &super::View)| {
        let camera = &state.cameras[view.device];
        let face = board.main_face(&view.image_points);
        let own = board.on_face(face, &view.image_points);
        let straight =
            (camera.distortion.kind == LensKind::Fisheye).then(|| zhang::straightened(camera, &own));
        let image_points = straight.as_ref().unwrap_or(&own);
        let board_pose = zhang::pose(camera, &homography(&board.points, image_points)?)?;
        let board_pose = match board.declared.get(face) {
            Some(target_from_face) => compose(&board_pose, &target_from_face.inverse()),
            None => board_pose,
        };
        Some((number, compose(&camera.camera_from_world.inverse(), &board_pose)))
    };
    let own: Vec<(usize, Isometry3<f64>)> =
        observations.views.iter().enumerate().filter(|(_, v)| v.pose == pose).filter_map(seen).collect();
    let view = |number: usize| &observations.views[number];
    let best = own.iter().max_by_key(|(n, _)| (!view(*n).may_be_turned, view(*n).image_points.len()));
    let Some((_, placed)) = best else { return Vec::new() };
    let opposite = board.turned();
    let mut added = Vec::new();
    for (number, _) in &own {
        let view = view(*number);
        let projector = Projector::new(&state.cameras[view.device], placed);
        let turned: Option<Vec<ImagePoint>> =
            opposite.as_ref().filter(|_| view.may_be_turned).map(|opposite| {
                view.image_points.iter().map(|s| ImagePoint { index: opposite[s.index], ..*s }).collect()
            });
        let off = |image_points: &[ImagePoint]| {
            let square = |s: &ImagePoint| {
                let pixel = projector.pixel(&board.point(s.index, &state.shape));
                pixel.map_or(f64::INFINITY, |p| (p - s.pixel).norm_squared())
            };
            median(&mut image_points.iter().map(square).collect::<Vec<f64>>()).unwrap_or(0.0)
        };
        let turned = turned.filter(|turned| off(turned) < off(&view.image_points));
        added.push((*number, turned.is_some()));
        let start = image_points.len();
        image_points.extend(turned.as_ref().unwrap_or(&view.image_points));
        let end = image_points.len();
        views.push(ViewRange { device: view.device, pose: state.boards.len(), start, end });
    }
    state.boards.push(Some(*placed));
    added
}

/// Expected sum of squared residuals of each view, px².
///
/// With the pose solved from the same points, residuals are n + JΔ − B V C (n + JΔ): B and J the derivatives by pose and
/// rig, C = BᵀW and V = (CB)⁻¹ with the weights W of the independent errors (see [`super::problem`]), n the noise of the
/// pixels with variance W⁻¹, Δ the error of the rig with its covariance.
fn predicted(calibration: &Calibration, problem: &Problem, weighted: &Weighted) -> Vec<f64> {
    let mut squares = vec![0.0; problem.views.len()];
    let covariance = calibration.covariance.matrix(Gauge::FirstDevice);
    for pose in 0..weighted.solved.state.boards.len() {
        let (normal, coupling) = solving(calibration, problem, weighted, pose);
        let Ok(inverse) = Factor::new(&normal).map(|f| f.inverse()) else { continue };
        let taken = inverse.times(&coupling);
        for row in &rows(calibration, problem, weighted, pose) {
            let mut answer: Vec<f64> = (0..covariance.rows)
                .map(|column| -(0..POSE).map(|i| row.pose[i] * taken.at(i, column)).sum::<f64>())
                .collect();
            for (column, value) in places(row.device, covariance.rows).zip(&row.rig) {
                answer[column] += value;
            }
            let noise = row.variance_px2 - dot(&row.pose, &inverse.apply(&row.pose));
            squares[row.view] += noise + dot(&answer, &covariance.apply(&answer));
        }
    }
    squares
}

/// Columns of the covariance that a device's rows touch.
fn places(device: usize, size: usize) -> impl Iterator<Item = usize> {
    (DEVICE * device..DEVICE * (device + 1)).chain(size - WARP..size)
}

/// By how much a device's errors exceed the given covariances.
fn variance(calibration: &Calibration, device: usize) -> f64 {
    calibration.devices[device].noise_factor.powi(2)
}

/// How the points that are used determine a pose: BᵀWB, and BᵀWJ in the columns of the covariance.
fn solving(calibration: &Calibration, problem: &Problem, weighted: &Weighted, pose: usize) -> (Dense, Dense) {
    let size = calibration.covariance.size();
    let (mut normal, mut coupling) = (Dense::zeros(POSE, POSE), Dense::zeros(POSE, size));
    let state = &weighted.solved.state;
    let mut add = |row: &[f64], run: &Run| {
        let linked = run.linked.into_iter().flat_map(|d| DEVICE * d..DEVICE * (d + 1));
        let scale = 1.0 / variance(calibration, run.device);
        for (i, slope) in row[DEVICE + WARP..LOCAL].iter().enumerate() {
            let scaled = scale * slope;
            (0..POSE).for_each(|j| normal.add(i, j, scaled * row[DEVICE + WARP + j]));
            let columns = places(run.device, size).zip(row).chain(linked.clone().zip(&row[LOCAL..]));
            columns.for_each(|(column, value)| coupling.add(i, column, scaled * value));
        }
    };
    let own = problem.views.iter().filter(|v| v.pose == pose);
    for run in own.flat_map(|view| problem.runs(view)) {
        let Some(eyes) = Problem::eyes(state, &run) else { continue };
        for number in (run.start..run.end).filter(|n| weighted.weights[*n] > 0.0) {
            let Some((_, rows)) = problem.equations(state, &eyes, number) else { continue };
            for row in &rows {
                add(row, &run);
            }
        }
    }
    (normal, coupling)
}

/// A row of a point that is used, as reported: the pixel itself, linked or not.
struct Row {
    view: usize,
    device: usize,
    /// Variance of the pixel's coordinate, px²: what is given times the devices' factors.
    variance_px2: f64,
    pose: [f64; POSE],
    rig: [f64; DEVICE + WARP],
}

fn rows(calibration: &Calibration, problem: &Problem, weighted: &Weighted, pose: usize) -> Vec<Row> {
    let state = &weighted.solved.state;
    let mut rows = Vec::new();
    let Some(board) = &state.boards[pose] else { return rows };
    for (number, view) in problem.views.iter().enumerate().filter(|(_, v)| v.pose == pose) {
        let projector = Projector::new(&state.cameras[view.device], board);
        for at in (view.start..view.end).filter(|n| weighted.weights[*n] > 0.0) {
            let image_point = &problem.image_points[at];
            let point = problem.board.point(image_point.index, &state.shape);
            let Some((_, both)) = projector.rows(&point, problem.board.rise[image_point.index]) else {
                continue;
            };
            let own = variance(calibration, view.device);
            let covariance_px2 =
                problem.links[at].as_ref().map_or(image_point.covariance_px2 * own, |link| {
                    let seen = problem.image_points[link.image_point].covariance_px2
                        * variance(calibration, link.device);
                    link.slopes * seen * link.slopes.transpose() + link.covariance_px2 * own
                });
            for (axis, local) in both.iter().enumerate() {
                rows.push(Row {
                    view: number,
                    device: view.device,
                    variance_px2: covariance_px2[(axis, axis)],
                    pose: std::array::from_fn(|i| local[DEVICE + WARP + i]),
                    rig: std::array::from_fn(|i| local[i]),
                });
            }
        }
    }
    rows
}
