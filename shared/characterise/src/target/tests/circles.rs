//! Grids of circles.

use super::super::{
    Ambiguity, Detection, TargetError, TargetKind, TargetSettings, TargetSpec, detect,
    projected_circle_center_bias,
};
use super::scene::Scene;
use fringe::geometry::camera::Lens;
use nalgebra::{Matrix3, Point2, Vector2};

const STRAIGHT: Lens = Lens::brown_conrady([0.0; 3], [0.0; 2]);

fn scene(kind: TargetKind, columns: u32, rows: u32, turn_rad: f64) -> Scene {
    Scene::new(kind, columns, rows, [0.4, -0.35, turn_rad], STRAIGHT)
}

fn found(scene: &Scene, seed: u64) -> Detection {
    let frame = scene.frame(&scene.clean(), seed);
    detect(&frame.view(), &scene.spec, &TargetSettings::default()).expect("detected")
}

/// Error of a centre after its bias, by the scene's homography and the radius found.
fn error(scene: &Scene, detection: &Detection, at: usize) -> Vector2<f64> {
    let point = &detection.points[at];
    let pose = scene.camera.camera_from_world;
    let (r, t) = (pose.rotation.to_rotation_matrix(), pose.translation.vector);
    let plane =
        Matrix3::from_columns(&[r.matrix().column(0).into_owned(), r.matrix().column(1).into_owned(), t]);
    let centre_mm = scene.spec.board_point_mm(point.index).xy();
    let radius_mm = detection.radius_per_pitch.expect("circles") * scene.spec.pitch_mm;
    let bias = projected_circle_center_bias(&(scene.camera.matrix() * plane), centre_mm, radius_mm)
        .expect("in front");
    point.pixel - scene.truth(point.index) - bias
}

#[test]
fn centres_reach_the_noise_limit_and_their_covariance_is_their_scatter() {
    let scene = scene(TargetKind::Circles, 8, 6, 0.3);
    let clean = scene.clean();
    let (mut sum, mut squares, mut mahalanobis, mut count) = (Vector2::zeros(), 0.0, 0.0, 0.0);
    for seed in 1..=10 {
        let frame = scene.frame(&clean, seed);
        let detection = detect(&frame.view(), &scene.spec, &TargetSettings::default()).expect("detected");
        assert_eq!((detection.points.len(), detection.ambiguity), (48, Ambiguity::HalfTurn));
        let radius = detection.radius_per_pitch.expect("circles");
        assert!((radius - 0.25).abs() < 0.002, "radius {radius} pitches");
        for at in 0..48 {
            let error = error(&scene, &detection, at);
            sum += error;
            squares += error.norm_squared();
            let inverse = detection.points[at].covariance_px2.try_inverse().expect("regular");
            mahalanobis += (error.transpose() * inverse * error)[0];
            count += 1.0;
        }
    }
    let (mean, sd) = (sum / count, (squares / count / 2.0_f64).sqrt());
    let ratio = (mahalanobis / count / 2.0).sqrt();
    assert!(mean.norm() < 0.002 && sd < 0.02, "mean {mean:?} px, standard deviation {sd} px");
    assert!((0.9..1.1).contains(&ratio), "scatter over prediction {ratio}");
}

#[test]
fn asymmetric_grids_with_an_odd_number_of_rows_are_numbered_for_sure() {
    for turn_rad in [0.1, 1.5, 3.0, -1.2] {
        for (columns, rows, ambiguity) in [(4, 9, Ambiguity::None), (4, 8, Ambiguity::HalfTurn)] {
            let scene = scene(TargetKind::AsymmetricCircles, columns, rows, turn_rad);
            let detection = found(&scene, 4);
            assert_eq!((detection.points.len(), detection.ambiguity), ((columns * rows) as usize, ambiguity));
            let near = |d: &Detection| (0..d.points.len()).all(|at| error(&scene, d, at).norm() < 0.15);
            let other = detection.half_turned();
            assert!(
                near(&detection) || other.is_some_and(|d| near(&d)),
                "{columns} x {rows} turned {turn_rad}"
            );
        }
    }
}

#[test]
fn a_hidden_circle_is_left_out_and_another_grid_is_named() {
    let mut scene = scene(TargetKind::Circles, 8, 6, 0.0);
    scene.hidden = Some((Point2::new(181.0, 139.0), 16.0));
    let detection = found(&scene, 2);
    assert!((40..48).contains(&detection.points.len()), "{} points", detection.points.len());
    let turned = detection.half_turned().expect("half a turn");
    let near = |d: &Detection| (0..d.points.len()).all(|at| error(&scene, d, at).norm() < 0.15);
    assert!(near(&detection) || near(&turned));
    let frame = scene.frame(&scene.clean(), 2);
    let other = TargetSpec { columns: 9, ..scene.spec.clone() };
    let error = detect(&frame.view(), &other, &TargetSettings::default()).expect_err("another");
    assert!(matches!(&error, TargetError::OtherSize { found, .. } if found[0] == (8, 6)), "{error}");
}
