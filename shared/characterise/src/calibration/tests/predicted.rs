//! What the covariance predicts for the measurement against what seeded calibrations do.

use super::super::*;
use super::synthetic::World;
use fringe::geometry::triangulate::triangulate;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

const PAIRS: [[usize; 2]; 2] = [[0, 1], [2, 3]];

fn middle(volume: &Volume) -> Point3<f64> {
    volume.world_from_volume.translation.vector.into()
}

/// Over seeded calibrations, the measured length of bars scatters by the predicted uncertainty: exact pixels of the true
/// rig, triangulated by the calibrated one.
#[test]
fn sphere_spacings_scatter_as_predicted() {
    let world = World::new(12);
    let bars = [
        ([-60.0, 5.0, 0.0], [60.0, 5.0, 0.0]),
        ([10.0, -60.0, 40.0], [10.0, 60.0, 40.0]),
        ([0.0, -50.0, -10.0], [0.0, 35.0, 75.0]),
    ];
    let (mut sum, mut count) = (0.0, 0);
    let trials = 12;
    for seed in 0..trials {
        let found = calibrate(&world.observe(300 + seed, 1.0), &CalibrationSettings::default()).unwrap();
        // The world of the result is its first board.
        let move_in = world.boards[0].inverse();
        for (a, b) in bars {
            for pair in &PAIRS {
                let measured = [a, b].map(|end| {
                    let image_point = |d: usize| {
                        let pixel = world.cameras[d].project(&Point3::from(end)).unwrap();
                        (&found.devices[d].camera, pixel)
                    };
                    triangulate(image_point(pair[0]), image_point(pair[1])).unwrap().position_mm
                });
                let ends = [a, b].map(|end| move_in * Point3::from(end));
                let u = found.distance_u_mm([(pair, &ends[0]), (pair, &ends[1])]).unwrap();
                let error = (measured[1] - measured[0]).norm() - (ends[1] - ends[0]).norm();
                sum += (error / u).powi(2);
                count += 1;
            }
        }
    }
    // The six bars of a trial share its calibration; the 99 % interval of χ² with 12 degrees is the widest they can have.
    let mean = sum / f64::from(count);
    assert!((3.07 / 12.0..28.30 / 12.0).contains(&mean), "mean square {mean} of {count} normalised errors");
}

/// Distances do not depend on the gauge, so the uncertainty is the same computed in either.
#[test]
fn distances_have_the_same_uncertainty_in_both_gauges() {
    let found = calibrate(&World::new(8).observe(2, 1.0), &CalibrationSettings::default()).unwrap();
    let centre = middle(&found.volume().unwrap());
    let ends = [centre, centre + Vector3::new(30.0, 20.0, 10.0)];
    let u = found.distance_u_mm([(&PAIRS[0], &ends[0]), (&PAIRS[1], &ends[1])]).unwrap();
    let along = (ends[1] - ends[0]).normalize();
    let (mut row, mut places) = (Vec::new(), Vec::new());
    for ((pair, end), sign) in PAIRS.iter().zip(&ends).zip([-1.0, 1.0]) {
        let own = found.sensitivity(*pair, end).unwrap();
        row.extend(
            (0..2 * PARAMETERS.len())
                .map(|c| sign * (0..3).map(|a| along[a] * own.rows.at(a, c)).sum::<f64>()),
        );
        places.extend(own.places);
    }
    let mut square = 0.0;
    for (i, a) in row.iter().enumerate() {
        for (j, b) in row.iter().enumerate() {
            square += a * b * found.covariance.at(Gauge::FirstDevice, places[i], places[j]);
        }
    }
    assert!((square.sqrt() / u - 1.0).abs() < 1e-6, "{} beside {u}", square.sqrt());
}

/// With poses that fill the volume, 4 µm at 120 mm everywhere is what the calibration is worth (the goal of the cell).
#[test]
fn the_volume_map_is_small_and_grows_with_its_terms() {
    let world = World::new(20);
    let found = calibrate(&world.observe(2, 1.0), &CalibrationSettings::default()).unwrap();
    // The working volume of the thesis' cell; the world of the result is its first board.
    let volume = Volume {
        world_from_volume: world.boards[0].inverse() * Isometry3::translation(0.0, 0.0, 15.0),
        half_mm: Vector3::new(70.0, 70.0, 45.0),
    };
    let own = found.volume().unwrap();
    assert!(
        (own.half_mm - volume.half_mm).amax() < 30.0 && (middle(&own) - middle(&volume)).norm() < 15.0,
        "{own:?}"
    );
    let centre = middle(&volume);
    let spacing = found.sphere_spacing_u_mm(&PAIRS, &volume, &SpacingSettings::default()).unwrap();
    assert!(
        spacing.rms_mm > 0.0 && spacing.rms_mm <= spacing.worst_mm && spacing.worst_mm < 4e-3,
        "{spacing:?}"
    );
    let more = SpacingSettings { u_centre_mm: 1e-3, u_pitch_relative: 1e-5, ..Default::default() };
    let more = found.sphere_spacing_u_mm(&PAIRS, &volume, &more).unwrap();
    let expected = (spacing.worst_mm.powi(2) + 2e-6 + 1.44e-6).sqrt();
    assert!((more.worst_mm - expected).abs() < 1e-12);
    for device in 0..6 {
        let u = found.projection_u_px(device, &centre).unwrap();
        assert!(u > 0.0 && u < found.devices[device].rms_reprojection_px, "{device}: {u}");
    }
    assert_eq!(found.projection_u_px(6, &centre), None);
    let point = found.point_uncertainty([0, 1], &centre, [0.02; 2]).unwrap();
    assert!(point.systematic_mm2.trace() > 0.0 && point.noise_mm2.trace() > point.systematic_mm2.trace());
}

#[test]
fn stereo_geometry_of_exact_points_is_exact_and_noise_shows_as_itself() {
    let world = World::new(8);
    let geometry = StereoGeometry::new(&world.cameras[0], &world.cameras[1]);
    let r = geometry.right_from_left.rotation.to_rotation_matrix().into_inner();
    let t = geometry.right_from_left.translation.vector;
    let (l, right) = (world.cameras[0].camera_from_world, world.cameras[1].camera_from_world);
    let expected = right.rotation.to_rotation_matrix().into_inner()
        * l.rotation.to_rotation_matrix().into_inner().transpose();
    assert!((r - expected).amax() < 1e-14);
    assert!((t - (right.translation.vector - expected * l.translation.vector)).amax() < 1e-11);
    let k = world.cameras[0].matrix();
    assert!(
        (geometry.fundamental * k
            - world.cameras[1].matrix().try_inverse().unwrap().transpose() * geometry.essential)
            .amax()
            < 1e-9
    );
    assert!((k * k.try_inverse().unwrap() - Matrix3::identity()).amax() < 1e-12);
    let point = Point3::new(20.0, -10.0, 30.0);
    let pixels = [0, 1].map(|i| world.cameras[i].project(&point).unwrap());
    assert!(geometry.epipolar_error_px(pixels[0], pixels[1]).unwrap().abs() < 1e-9);
    let found = calibrate(&world.observe(4, 1.0), &CalibrationSettings::default()).unwrap();
    let residuals = found.epipolar_residuals(0, 1).unwrap();
    assert!(residuals.count > 600 && (residuals.rms_px / 0.006 - 1.0).abs() < 0.1, "{residuals:?}");
    let pose = found.relative_pose(0, 1).unwrap();
    for i in 0..6 {
        let u = found.devices[1].standard_uncertainty[10 + i];
        assert!((pose.covariance[i][i].sqrt() / u - 1.0).abs() < 1e-9);
    }
}

/// Halves of good data differ as predicted; with a lens that the model lacks they do not.
#[test]
fn cross_validation_tells_a_wrong_model() {
    let world = World::new(24);
    let observations = world.observe(11, 1.0);
    let good = cross_validate(&observations, &CalibrationSettings::default()).unwrap();
    let n = good.degrees_of_freedom as f64;
    assert!((good.chi_square - n).abs() < 3.3 * (2.0 * n).sqrt(), "{} of {n}", good.chi_square);
    for device in &good.devices {
        assert!(device.rms_px < 3.0 * device.predicted_px, "{device:?}");
    }
    let lean = LensModel { radial_terms: 0, tangential: false, ..LensModel::default() };
    let settings =
        CalibrationSettings { camera: lean, projector: lean, outlier_limit: 1e6, ..Default::default() };
    let wrong = cross_validate(&observations, &settings).unwrap();
    assert!(wrong.chi_square > 2.0 * wrong.degrees_of_freedom as f64, "{}", wrong.chi_square);
}
