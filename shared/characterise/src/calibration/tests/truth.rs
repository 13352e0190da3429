//! Recovered parameters against the truth, in units of their predicted standard deviation.

use super::super::model::{DEVICE, Projector, Shape, compose, motion, moved, rotation_vector};
use super::super::*;
use super::synthetic::{WARP_MM, World};
use fringe::geometry::camera::LensKind;
use fringe::math::linear::{Dense, Factor, dot};
use nalgebra::Isometry3;

/// Differences found − true of all parameters, extrinsics relative to the first device.
pub(super) fn errors(world: &World, found: &Calibration) -> Vec<f64> {
    let relative = |cameras: &[&Camera], i: usize| {
        compose(&cameras[i].camera_from_world, &cameras[0].camera_from_world.inverse())
    };
    let truth: Vec<&Camera> = world.cameras.iter().collect();
    let ours: Vec<&Camera> = found.devices.iter().map(|d| &d.camera).collect();
    let mut errors = Vec::new();
    for (i, (a, b)) in ours.iter().zip(&truth).enumerate() {
        errors.extend((0..2).map(|j| a.focal_px[j] - b.focal_px[j]));
        errors.extend((0..2).map(|j| a.principal_point_px[j] - b.principal_point_px[j]));
        errors.push(a.skew - b.skew);
        errors.extend((0..3).map(|j| a.distortion.k[j] - b.distortion.k[j]));
        errors.extend((0..2).map(|j| a.distortion.p[j] - b.distortion.p[j]));
        let step: Isometry3<f64> = compose(&relative(&ours, i), &relative(&truth, i).inverse());
        errors.extend(rotation_vector(&step.rotation).iter());
        errors.extend(step.translation.vector.iter());
        errors.extend((0..3).map(|j| a.distortion.more_k[j] - b.distortion.more_k[j]));
        errors.extend((0..4).map(|j| a.distortion.prism[j] - b.distortion.prism[j]));
    }
    if let Some(warp) = found.warp {
        errors.extend([warp.x_mm - WARP_MM[0], warp.y_mm - WARP_MM[1]]);
    }
    errors
}

/// δᵀ Σ⁻¹ δ over the adjusted parameters, and their number.
pub(super) fn chi_square(errors: &[f64], covariance: &Covariance) -> (f64, usize) {
    let free: Vec<usize> =
        (0..errors.len()).filter(|i| covariance.at(Gauge::FirstDevice, *i, *i) > 0.0).collect();
    let matrix =
        Dense::from_fn(free.len(), free.len(), |i, j| covariance.at(Gauge::FirstDevice, free[i], free[j]));
    let own: Vec<f64> = free.iter().map(|i| errors[*i]).collect();
    (dot(&own, &Factor::new(&matrix).unwrap().solve(&own)), free.len())
}

/// χ² over seeded trials within its 95 % interval: predicted and true scatter are the same, correlations included.
fn scatter_is_as_predicted(poses: usize, trials: u64) {
    let world = World::new(poses);
    let (mut sum, mut freedom) = (0.0, 0);
    for seed in 0..trials {
        let found = calibrate(&world.observe(1000 + seed, 1.0), &CalibrationSettings::default()).unwrap();
        let (square, n) = chi_square(&errors(&world, &found), &found.covariance);
        sum += square;
        freedom += n;
    }
    let (mean, half) = (freedom as f64, 1.96 * (2.0 * freedom as f64).sqrt());
    assert!((sum - mean).abs() < half, "χ² {sum:.0} of {freedom} degrees, interval ± {half:.0}");
}

#[test]
fn the_scatter_of_15_trials_is_as_predicted() {
    scatter_is_as_predicted(20, 15);
}

#[test]
#[ignore = "a minute; the same with 100 trials: cargo test --release -p fringe-characterise 100_trials -- --ignored"]
fn the_scatter_of_100_trials_is_as_predicted() {
    scatter_is_as_predicted(20, 100);
}

#[test]
fn exact_pixels_give_the_exact_rig() {
    let world = World::new(20);
    let found = calibrate(&world.observe(0, 0.0), &CalibrationSettings::default()).unwrap();
    assert!(found.outliers.is_empty(), "{:?}", found.outliers.len());
    let errors = errors(&world, &found);
    for (device, own) in errors.chunks(DEVICE).take(6).enumerate() {
        for (name, error) in PARAMETERS.iter().zip(own) {
            assert!(error.abs() < 2e-6, "{name} of device {device} is off by {error:e}");
        }
    }
}

#[test]
fn jacobians_agree_with_differences() {
    let world = World::new(3);
    for kind in [LensKind::BrownConrady, LensKind::ThinPrism, LensKind::Fisheye] {
        jacobians_of(kind, &world);
    }
}

fn jacobians_of(kind: LensKind, world: &World) {
    const FIRST: usize = DEVICE + model::WARP;
    let mut camera = world.cameras[1].clone();
    camera.skew = 0.4;
    camera.distortion.k[2] = 0.02;
    camera.distortion.kind = kind;
    if kind != LensKind::BrownConrady {
        camera.distortion.more_k[0] = 0.3;
    }
    if kind == LensKind::ThinPrism {
        camera.distortion.prism = [1e-3, -2e-3, 3e-3, 1e-3];
    }
    let board = model::Board::new(&world.observe(0, 0.0));
    let pose = world.boards[2];
    for index in [0, 37, 87] {
        let point = board.point(index, &Shape { warp_mm: WARP_MM, ..Shape::default() });
        let (pixel, rows) = Projector::new(&camera, &pose).rows(&point, board.rise[index]).unwrap();
        assert_eq!(Some(pixel), Projector::new(&camera, &pose).pixel(&point));
        let shifted = |column: usize, h: f64| {
            let mut step = [0.0; DEVICE];
            let mut local = [0.0; 6];
            let mut shape = Shape { warp_mm: WARP_MM, ..Shape::default() };
            match column {
                0..DEVICE => step[column] = h,
                DEVICE..FIRST => shape.warp_mm[column - DEVICE] += h,
                _ => local[column - FIRST] = h,
            }
            let (camera, pose) = (moved(&camera, &step), compose(&pose, &motion(&local)));
            Projector::new(&camera, &pose).pixel(&board.point(index, &shape)).unwrap()
        };
        for column in 0..model::LOCAL {
            let h = 1e-5;
            let numeric = (shifted(column, h) - shifted(column, -h)) / (2.0 * h);
            for (axis, row) in rows.iter().enumerate() {
                let (n, a) = (numeric[axis], row[column]);
                assert!((n - a).abs() < 1e-6 * (1.0 + a.abs()), "column {column}: {a} beside {n}");
            }
        }
    }
}

fn free() -> CalibrationSettings {
    CalibrationSettings { target: TargetShape::Free, ..Default::default() }
}

/// Intrinsics do not depend on the scale that the mean of the declared points sets; distances do, all alike.
#[test]
fn a_printed_target_is_measured_along() {
    let world = World::new(20).printed();
    let found = calibrate(&world.observe(0, 0.0), &free()).unwrap();
    let errors = errors(&world, &found);
    for (device, own) in errors.chunks(DEVICE).enumerate() {
        for (name, error) in PARAMETERS.iter().zip(own).take(13) {
            assert!(error.abs() < 2e-5, "{name} of device {device} is off by {error:e}");
        }
    }
    let centre = |camera: &Camera| camera.centre_mm();
    let ratio = |i: usize| {
        let ours = centre(&found.devices[i].camera) - centre(&found.devices[0].camera);
        ours.norm() / (centre(&world.cameras[i]) - centre(&world.cameras[0])).norm()
    };
    // Half of 0.1 % along one of two axes: the shorter one, along which less of the mean scale lies.
    assert!((ratio(1) - 1.0).abs() > 1e-4, "{}", ratio(1));
    assert!((1..6).all(|i| (ratio(i) / ratio(1) - 1.0).abs() < 1e-7));
    assert!(found.warp.is_none() && found.target_misfit == 0.0);
}

#[test]
fn a_printed_target_is_told_from_one_as_declared() {
    let world = World::new(12);
    let right = calibrate(&world.observe(3, 1.0), &CalibrationSettings::default()).unwrap();
    assert!((0.8..1.1).contains(&right.target_misfit), "{}", right.target_misfit);
    let printed = world.printed();
    let wrong = calibrate(&printed.observe(3, 1.0), &CalibrationSettings::default()).unwrap();
    assert!(wrong.target_misfit > 5.0, "{}", wrong.target_misfit);
    let along = calibrate(&printed.observe(3, 1.0), &free()).unwrap();
    for (a, b) in along.devices.iter().zip(&wrong.devices) {
        assert!(a.rms_reprojection_px < 0.5 * b.rms_reprojection_px, "{}", a.rms_reprojection_px);
        // Of 2000 rows the estimate has a standard deviation of 1/√4000; four of these for six devices.
        assert!((a.noise_factor - 1.0).abs() < 0.063, "{}: {}", a.name, a.noise_factor);
    }
}

/// Predicted and true scatter with all points of the target adjusted; the datum's scale is taken out by a target whose
/// points are as declared.
#[test]
fn the_scatter_with_free_points_is_as_predicted() {
    let mut world = World::new(8);
    let nominal: Vec<f64> = vec![0.0; DEVICE * 6];
    let (mut sum, mut freedom) = (0.0, 0);
    world.target_mm = (0..88).map(|i| world.bent(i)).collect();
    world.print_mm =
        (0..88).map(|i| nalgebra::Vector3::new(0.0, 0.0, -(world.bent(i) - world.target_mm[i]).z)).collect();
    for seed in 0..6 {
        let found = calibrate(&world.observe(2000 + seed, 1.0), &free()).unwrap();
        let errors = errors(&world, &found);
        assert_eq!(errors.len(), nominal.len());
        let (square, n) = chi_square(&errors, &found.covariance);
        sum += square;
        freedom += n;
    }
    let (mean, half) = (freedom as f64, 1.96 * (2.0 * freedom as f64).sqrt());
    assert!((sum - mean).abs() < half, "χ² {sum:.0} of {freedom} degrees, interval ± {half:.0}");
}
