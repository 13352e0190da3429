//! Lenses beyond Brown and Conrady's: found again from what they show, and chosen by what they predict.

use super::super::*;
use super::synthetic::board;
use fringe::geometry::camera::{Camera, Lens, LensKind};
use fringe::synthetic::Noise;
use nalgebra::{Isometry3, Matrix2, Point3, Vector2, Vector3};

const NOISE_PX: f64 = 0.02;

/// What a wide camera shows of a board of 12 × 9 points in `poses` poses; points outside of the image are not seen.
fn observed(lens: Lens, focal_px: f64, poses: usize) -> (Camera, Observations) {
    let camera = Camera {
        width_px: 1280,
        height_px: 1024,
        focal_px: [focal_px, focal_px * 1.001],
        principal_point_px: [646.0, 505.0],
        skew: 0.0,
        distortion: lens,
        camera_from_world: Isometry3::identity(),
    };
    let target_mm: Vec<Point3<f64>> =
        (0..108).map(|i| Point3::new(f64::from(i % 12) * 8.0, f64::from(i / 12) * 8.0, 0.0)).collect();
    let mut noise = Noise(11);
    let mut views = Vec::new();
    for pose in 0..poses {
        // Near, so that the board fills the image, here and there.
        let mut any = |half: f64| (2.0 * noise.unit() - 1.0) * half;
        let away = 50.0 * focal_px / 450.0;
        let (x, y) = (any(35.0), any(25.0));
        let shift = Vector3::new(x, y, away + any(0.2 * away));
        let placed = Isometry3::translation(shift.x, shift.y, shift.z) * board(&mut noise, 0.5);
        let mut image_points = Vec::new();
        for (index, point) in target_mm.iter().enumerate() {
            let Some(pixel) = camera.project(&(placed * point)) else { continue };
            let error = Vector2::new(noise.gauss(), noise.gauss()) * NOISE_PX;
            if camera.contains(pixel) && camera.ray(pixel).is_some() {
                let covariance_px2 = Matrix2::identity() * (NOISE_PX * NOISE_PX);
                image_points.push(ImagePoint { index, pixel: pixel + error, covariance_px2, link: None });
            }
        }
        views.push(View { device: 0, pose, image_points, may_be_turned: false });
    }
    let device = Device { name: "cam1".into(), kind: DeviceKind::Camera, width_px: 1280, height_px: 1024 };
    let poses = (0..poses).map(|i| format!("pose{}", i + 1)).collect();
    (camera, Observations { devices: vec![device], target_mm, faces: Vec::new(), poses, views })
}

fn lens(kind: LensKind) -> (Lens, f64) {
    match kind {
        LensKind::BrownConrady => (Lens::brown_conrady([-0.2, 0.06, 0.0], [3e-4, -2e-4]), 1100.0),
        LensKind::Rational => {
            let c = [0.9, 0.05, 0.0, 3e-4, -2e-4, 1.2, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0];
            (Lens::from_coefficients(kind, c), 700.0)
        }
        LensKind::ThinPrism => {
            let c = [0.9, 0.05, 0.0, 3e-4, -2e-4, 1.2, 0.25, 0.0, 4e-3, -1e-3, -5e-3, 2e-3];
            (Lens::from_coefficients(kind, c), 700.0)
        }
        LensKind::Fisheye => {
            let c = [0.02, -0.01, 0.003, 0.0, 0.0, -0.0004, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            (Lens::from_coefficients(kind, c), 430.0)
        }
    }
}

/// Where the found camera sees what the true one sees, rms over the image: the coefficients of a quotient follow each other, the rays
/// do not.
fn apart_px(truth: &Camera, found: &Camera) -> f64 {
    let mut squares = Vec::new();
    for x in 1..16 {
        for y in 1..12 {
            let pixel = nalgebra::Point2::new(80.0 * f64::from(x), 84.0 * f64::from(y));
            let Some(ideal) = truth.normalised_from_pixel(pixel) else { continue };
            squares.push((found.pixel_from_normalised(ideal) - pixel).norm_squared());
        }
    }
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn each_kind_of_lens_is_found_again() {
    for (family, kind) in [
        (LensFamily::BrownConrady, LensKind::BrownConrady),
        (LensFamily::Rational, LensKind::Rational),
        (LensFamily::ThinPrism, LensKind::ThinPrism),
        (LensFamily::Fisheye, LensKind::Fisheye),
    ] {
        let (lens, focal_px) = lens(kind);
        let (truth, observations) = observed(lens, focal_px, 24);
        let settings = CalibrationSettings {
            camera: LensModel::of(family),
            target: TargetShape::Flat,
            ..CalibrationSettings::default()
        };
        let found = calibrate(&observations, &settings).unwrap_or_else(|error| panic!("{kind:?}: {error}"));
        let device = &found.devices[0];
        assert_eq!(device.camera.distortion.kind, kind);
        let rms = device.rms_reprojection_px / std::f64::consts::SQRT_2 / NOISE_PX;
        assert!((0.95..1.03).contains(&rms), "{kind:?}: {rms} of the noise");
        let errors: Vec<f64> = (0..2)
            .map(|i| (device.camera.focal_px[i] - truth.focal_px[i]) / device.standard_uncertainty[i])
            .collect();
        assert!(errors.iter().all(|e| e.abs() < 4.0), "{kind:?}: focal lengths off by {errors:?} of their u");
        let apart = apart_px(&truth, &device.camera);
        assert!(apart < 0.5, "{kind:?}: {apart} px");
    }
}

#[test]
fn the_model_that_predicts_other_poses_best_is_chosen_and_no_richer_one() {
    let settings = CalibrationSettings { target: TargetShape::Flat, ..CalibrationSettings::default() };
    for kind in [LensKind::BrownConrady, LensKind::Rational, LensKind::ThinPrism, LensKind::Fisheye] {
        let (lens, focal_px) = lens(kind);
        let (_, observations) = observed(lens, focal_px, 14);
        let choice = choose_lens(&observations, &settings).unwrap();
        let chosen = &choice.tried[choice.chosen];
        assert_eq!(chosen.model.family.kind(), kind, "{choice:?}");
        assert_eq!(choice.tried.len(), 5);
    }
}
