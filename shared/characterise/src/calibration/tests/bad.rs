//! Inputs that determine nothing, wrong points, boards read the other way round.

use super::super::model::rotation;
use super::super::start::remedy;
use super::super::*;
use super::synthetic::{World, board, image_point};
use fringe::synthetic::Noise;
use nalgebra::{Isometry3, Vector3};

fn fails(observations: &Observations) -> String {
    calibrate(observations, &CalibrationSettings::default()).unwrap_err().to_string()
}

#[test]
fn wrong_points_are_found_and_no_others() {
    let world = World::new(12);
    let mut observations = world.observe(5, 1.0);
    let clean = calibrate(&observations, &CalibrationSettings::default()).unwrap();
    assert!(clean.outliers.is_empty());
    let mut noise = Noise(9);
    let mut wrong = Vec::new();
    for number in (0..observations.views.len()).step_by(3) {
        let count = observations.views[number].image_points.len();
        let at = (noise.next_bits() as usize) % count;
        let error = if number % 2 == 0 { 0.2 } else { 25.0 };
        let image_point = &mut observations.views[number].image_points[at];
        image_point.pixel.x += error;
        wrong.push((number, image_point.index));
    }
    let found = calibrate(&observations, &CalibrationSettings::default()).unwrap();
    let listed: Vec<(usize, usize)> = found.outliers.iter().map(|o| (o.view, o.index)).collect();
    assert_eq!(listed, wrong);
}

#[test]
fn a_view_of_another_board_is_rejected_as_a_whole() {
    let world = World::new(12);
    let mut observations = world.observe(5, 1.0);
    let other = observations.views[13].image_points.clone();
    let view = &mut observations.views[7];
    // The points of another pose and device.
    for (image_point, wrong) in view.image_points.iter_mut().zip(other) {
        image_point.pixel = wrong.pixel;
    }
    let found = calibrate(&observations, &CalibrationSettings::default()).unwrap();
    assert!(found.outliers.iter().all(|o| o.view == 7));
    assert_eq!(found.outliers.len(), observations.views[7].image_points.len());
}

#[test]
fn boards_read_the_other_way_round_are_turned_back() {
    let world = World::new(8);
    let straight = world.observe(3, 1.0);
    let expected = calibrate(&straight, &CalibrationSettings::default()).unwrap();
    let mut observations = straight.clone();
    let mut noise = Noise(21);
    let mut turned = Vec::new();
    for (number, view) in observations.views.iter_mut().enumerate() {
        // One device knows which way is up; so the result must be the same to the last pose.
        view.may_be_turned = view.device != 2;
        if view.may_be_turned && noise.next_bits().is_multiple_of(2) {
            turned.push(number);
            for image_point in &mut view.image_points {
                image_point.index = 87 - image_point.index;
            }
        }
    }
    let found = calibrate(&observations, &CalibrationSettings::default()).unwrap();
    let listed: Vec<usize> = found.views.iter().filter(|v| v.turned).map(|v| v.view).collect();
    // This projector lights a single row of that board: points on a line have no homography.
    assert_eq!(found.unused_views, [35]);
    turned.retain(|view| *view != 35);
    assert_eq!(listed, turned);
    for (a, b) in found.boards.iter().zip(&expected.boards) {
        let (a, b) = (a.unwrap(), b.unwrap());
        assert!((a.translation.vector - b.translation.vector).norm() < 1e-5);
        assert!(a.rotation.rotation_to(&b.rotation).imag().norm() < 1e-6);
    }
}

/// When nobody knows which way is up, each pose may be the other way round as a whole, but all views of it agree.
#[test]
fn boards_without_any_mark_are_made_consistent() {
    let world = World::new(8);
    let mut observations = world.observe(3, 1.0);
    let expected = calibrate(&observations, &CalibrationSettings::default()).unwrap();
    let mut noise = Noise(22);
    for view in &mut observations.views {
        view.may_be_turned = true;
        if noise.next_bits().is_multiple_of(2) {
            for image_point in &mut view.image_points {
                image_point.index = 87 - image_point.index;
            }
        }
    }
    let found = calibrate(&observations, &CalibrationSettings::default()).unwrap();
    assert!(found.outliers.is_empty());
    for device in 1..6 {
        let [a, b] = [&found, &expected].map(|c| c.relative_pose(0, device).unwrap().right_from_left);
        // The bend of the board is symmetric, so the turned board is the same one.
        assert!((a.translation.vector - b.translation.vector).norm() < 1e-5, "device {device}");
    }
}

/// The advice names the axis about which the poses do not differ.
#[test]
fn the_remedy_names_the_missing_tilt() {
    let tilted = |x: f64, y: f64| {
        Isometry3::from_parts(Vector3::new(0.0, 0.0, 500.0).into(), rotation(Vector3::new(x, y, 0.0)))
    };
    let only_y: Vec<_> = [-0.4, 0.0, 0.4].iter().map(|a| tilted(0.0, *a)).collect();
    let advice = remedy(only_y.iter());
    assert!(advice.contains("about its x axis") && !advice.contains("y axis"), "{advice}");
    let only_x: Vec<_> = [-0.4, 0.0, 0.4].iter().map(|a| tilted(*a, 0.0)).collect();
    let advice = remedy(only_x.iter());
    assert!(advice.contains("about its y axis") && !advice.contains("x axis"), "{advice}");
}

#[test]
fn parallel_boards_are_refused_with_what_is_missing() {
    let mut world = World::new(10);
    let mut noise = Noise(4);
    world.boards = (0..10).map(|_| board(&mut noise, 0.0)).collect();
    let message = fails(&world.observe(1, 1.0));
    assert!(message.contains("tilt the board about its x axis") && message.contains("y axis"), "{message}");
}

#[test]
fn groups_without_a_common_pose_are_named() {
    let world = World::new(12);
    let mut observations = world.observe(1, 1.0);
    observations.views.retain(|v| (v.pose < 6) == matches!(v.device, 0 | 1 | 4));
    let message = fails(&observations);
    assert!(message.contains("[cam1, cam2, proj1] [cam3, cam4, proj2]"), "{message}");
}

#[test]
fn too_few_poses_are_refused() {
    let world = World::new(2);
    let message = fails(&world.observe(1, 1.0));
    assert!(message.contains("cam1: 2 usable views") && message.contains("needs 3"), "{message}");
}

#[test]
fn faulty_input_is_refused_without_a_panic() {
    let good = World::new(3).observe(1, 1.0);
    let breaks: [fn(&mut Observations); 10] = [
        |o| o.devices.clear(),
        |o| o.views.clear(),
        |o| o.devices[1].name = "cam1".into(),
        |o| o.devices[1].width_px = 0,
        |o| o.views[0].device = 99,
        |o| o.views[0].pose = 99,
        |o| o.views[0].image_points[0].index = 88,
        |o| o.views[0].image_points[0].pixel.x = f64::NAN,
        |o| o.views[0].image_points[0].covariance_px2.m12 = 1.0,
        |o| o.target_mm[5].z = 30.0,
    ];
    for (number, fault) in breaks.iter().enumerate() {
        let mut observations = good.clone();
        fault(&mut observations);
        assert!(calibrate(&observations, &CalibrationSettings::default()).is_err(), "fault {number}");
    }
    let mut twice = good.clone();
    twice.views[0].image_points.push(image_point(0, 1.0, 1.0));
    assert!(calibrate(&twice, &CalibrationSettings::default()).is_err());
    let settings = CalibrationSettings { outlier_limit: f64::NAN, ..Default::default() };
    assert!(calibrate(&good, &settings).is_err());
}
