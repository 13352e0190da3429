//! Poses that had no say, and lengths measured in them, against what is predicted.

use super::super::*;
use super::synthetic::World;

/// The model is right: residuals in held-out poses are as large as predicted, and larger than those adjusted.
#[test]
fn held_out_residuals_of_a_right_model_are_as_predicted() {
    let observations = World::new(12).observe(5, 1.0);
    let settings = CalibrationSettings::default();
    let groups = in_turn(&observations, 3);
    assert_eq!(groups.iter().map(Vec::len).sum::<usize>(), 12);
    let held = hold_out(&observations, &settings, &groups).unwrap();
    let whole = calibrate(&observations, &settings).unwrap();
    for (device, adjusted) in held.devices.iter().zip(&whole.devices) {
        let ratio = device.rms_px / device.predicted_px;
        // Of 1056 points, a standard deviation of 2 % by noise; errors of three calibrations add a few per cent.
        assert!((0.9..1.1).contains(&ratio), "{device:?}");
        assert!(device.rms_px > adjusted.rms_reprojection_px, "{device:?} beside {adjusted:?}");
        assert_eq!(device.points, adjusted.points);
    }
    let poses: Vec<usize> = held.folds.iter().flat_map(|f| f.views.iter().map(|v| v.pose)).collect();
    assert_eq!(poses.len(), whole.views.len());
}

/// A camera whose radial distortion is denied: the held-out residuals exceed the prediction by far.
#[test]
fn a_wrong_model_shows_in_held_out_poses() {
    let observations = World::new(12).observe(5, 1.0);
    let lean = LensModel { radial_terms: 0, tangential: false, ..LensModel::default() };
    let settings =
        CalibrationSettings { camera: lean, projector: lean, outlier_limit: 1e6, ..Default::default() };
    let held = hold_out(&observations, &settings, &in_turn(&observations, 3)).unwrap();
    let worst = held.devices.iter().map(|d| d.rms_px / d.predicted_px).fold(0.0, f64::max);
    assert!(worst > 1.2, "{:?}", held.devices);
}

/// Groups of poses of a right model scatter as stated, those seen on a print that was taken for the declared board by far more.
#[test]
fn poses_that_share_errors_disagree() {
    let over_stated = |world: World| {
        let (observations, settings) = (world.observe(9, 1.0), CalibrationSettings::default());
        let whole = calibrate(&observations, &settings).unwrap();
        let held = hold_out(&observations, &settings, &in_turn(&observations, 4)).unwrap();
        let between = held.between_poses(&whole).unwrap();
        assert!(between[0].standard_uncertainty[10..].iter().all(|u| *u < 1e-9), "the first device is held");
        assert!(between[1].standard_uncertainty[13] > 0.0 && between.len() == 6);
        (between.iter().map(|b| b.over_stated.powi(2)).sum::<f64>() / 6.0).sqrt()
    };
    let (right, printed) = (over_stated(World::new(12)), over_stated(World::new(12).printed()));
    // Six devices of three degrees each, correlated: χ² of a dozen degrees at 99.9 % is 0.17 to 2.7 times its mean; a jackknife
    // of few poses errs upwards.
    assert!((0.4..1.9).contains(&right), "{right}");
    assert!(printed > 1.5 * right, "{printed} beside {right}");
    let few = hold_out(&World::new(8).observe(9, 1.0), &CalibrationSettings::default(), &[vec![0], vec![1]]);
    let whole = calibrate(&World::new(8).observe(9, 1.0), &CalibrationSettings::default()).unwrap();
    assert!(few.unwrap().between_poses(&whole).is_none());
}

/// Views that may be read turned are oriented in a held-out pose as in an adjusted one.
#[test]
fn held_out_views_that_are_read_turned_are_turned_back() {
    let mut observations = World::new(9).observe(6, 1.0);
    let last = observations.target_mm.len() - 1;
    for (number, view) in observations.views.iter_mut().enumerate() {
        view.may_be_turned = true;
        if number % 3 == 1 {
            view.image_points.iter_mut().for_each(|s| s.index = last - s.index);
        }
    }
    let held = hold_out(&observations, &CalibrationSettings::default(), &in_turn(&observations, 3)).unwrap();
    for device in &held.devices {
        assert!(device.rms_px < 1.2 * device.predicted_px && device.outliers == 0, "{device:?}");
    }
}

/// Too few poses are left: the message is that of the calibration.
#[test]
fn a_group_that_leaves_too_little_is_refused() {
    let observations = World::new(4).observe(7, 1.0);
    let all = vec![vec![0, 1, 2, 3]];
    assert!(matches!(
        hold_out(&observations, &CalibrationSettings::default(), &all),
        Err(CalibrationError::Empty)
    ));
    assert!(hold_out(&observations, &CalibrationSettings::default(), &[vec![0, 1]]).is_err());
}

/// The diagonal of the board measured in held-out poses: its errors have the size of their predicted uncertainty.
#[test]
fn lengths_in_held_out_poses_err_as_predicted() {
    let world = World::new(12);
    let observations = world.observe(8, 1.0);
    let held = hold_out(&observations, &CalibrationSettings::default(), &in_turn(&observations, 3)).unwrap();
    let truth = (world.bent(87) - world.bent(0)).norm();
    let (mut sum, mut count) = (0.0, 0);
    for fold in &held.folds {
        for left in fold.views.iter().filter(|v| v.device == 0) {
            let Some(right) = fold.views.iter().find(|v| v.device == 1 && v.pose == left.pose) else {
                continue;
            };
            let Some(found) = fold.calibration.measured_length([0, 1], [left, right], [0, 87]) else {
                continue;
            };
            sum += ((found.length_mm - truth) / found.u_mm).powi(2);
            count += 1;
        }
    }
    // χ² with ten degrees at 99 %: 2.16 … 25.2; correlated within a fold, so rather wide.
    let mean = sum / f64::from(count);
    assert!(count >= 8 && (0.2..2.6).contains(&mean), "mean square {mean} of {count} lengths");
}

/// Each map has the shape of the volume; its values are those of the functions that fill it, and NaN where no device looks.
#[test]
fn maps_hold_what_single_points_say() {
    let found = calibrate(&World::new(8).observe(2, 1.0), &CalibrationSettings::default()).unwrap();
    let volume = found.volume().unwrap();
    let grid = MapGrid { across: 5, planes: 3 };
    let maps = found.projection_maps(1, &volume, &grid);
    assert_eq!(maps.len(), 3);
    assert_eq!((maps[0].z_mm, maps[1].z_mm, maps[2].z_mm), (-volume.half_mm.z, 0.0, volume.half_mm.z));
    let middle = &maps[1];
    let rows = middle.values.len() / middle.columns;
    assert!(middle.columns.max(rows) == 5 && middle.columns * rows == middle.values.len());
    if middle.columns % 2 == 1 && rows % 2 == 1 {
        let centre = volume.world_from_volume.translation.vector.into();
        assert_eq!(middle.values[middle.values.len() / 2], found.projection_u_px(1, &centre).unwrap());
    }
    let spacing = SpacingSettings { spacing_mm: 40.0, ..SpacingSettings::default() };
    let bars = found.spacing_maps([0, 1], &volume, &grid, &spacing);
    let known = found.sphere_spacing_u_mm(&[[0, 1]], &volume, &spacing).unwrap();
    let seen: Vec<f64> =
        bars.iter().flat_map(|m| m.values.iter().copied()).filter(|v| v.is_finite()).collect();
    // The grid of bars of the one and that of the other differ, the volume is the same.
    assert!(!seen.is_empty() && seen.iter().all(|u| *u > 0.2 * known.rms_mm && *u < 1.5 * known.worst_mm));
    let far = Volume { half_mm: volume.half_mm * 100.0, ..volume };
    assert!(found.point_maps([0, 1], 2, &far, &grid)[1].values[0].is_nan());
}
