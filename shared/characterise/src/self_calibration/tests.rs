//! Pairs whose truth is known, seen over a relief, over a plane, and with optical axes that meet.

use super::*;
use fringe::synthetic::Noise;
use nalgebra::{Isometry3, Point3, Vector3};

const CAMERA_PX: [u32; 2] = [1280, 1024];
const PROJECTOR_PX: [u32; 2] = [1024, 768];

fn view([width_px, height_px]: [u32; 2], focal_px: f64, pose: Isometry3<f64>) -> Camera {
    Camera {
        width_px,
        height_px,
        focal_px: [focal_px; 2],
        principal_point_px: [0.5 * f64::from(width_px - 1), 0.5 * f64::from(height_px - 1)],
        skew: 0.0,
        distortion: fringe::geometry::camera::Lens::default(),
        camera_from_world: pose,
    }
}

/// What a camera sees of a body whose relief is `relief` mm high; every twentieth correspondence is wrong.
fn recorded(projector: Isometry3<f64>, relief_mm: f64, noise_px: f64) -> Vec<Correspondence> {
    let camera = view(CAMERA_PX, 1700.0, Isometry3::identity());
    let projector = view(PROJECTOR_PX, 1500.0, projector);
    let mut noise = Noise(4);
    let mut all = Vec::new();
    for i in 0..9000 {
        let (u, v) = (noise.unit() * 1279.0, noise.unit() * 1023.0);
        let ray = camera.ray(nalgebra::Point2::new(u, v)).unwrap();
        let (x, y) = ((u - 640.0) / 200.0, (v - 512.0) / 200.0);
        let depth = 600.0 + 20.0 * x + relief_mm * (fringe::math::cos(x) * fringe::math::cos(1.3 * y));
        let at: Point3<f64> = ray.origin_mm + ray.direction * depth;
        let Some(pixel) = projector.project(&at).filter(|p| projector.contains(*p)) else { continue };
        let wrong = if i % 20 == 0 { 60.0 } else { 0.0 };
        let error = Vector3::new(noise.gauss(), noise.gauss() + wrong, 0.0) * noise_px.max(1e-3);
        all.push(Correspondence {
            camera: nalgebra::Point2::new(u, v),
            projector: nalgebra::Point2::new(pixel.x + error.x, pixel.y + error.y),
            sigma_px: [noise_px.max(1e-3); 2],
        });
    }
    all
}

/// A projector beside the camera and above it, turned towards the object so that the optical axes pass each other.
fn aside() -> Isometry3<f64> {
    let turn = Isometry3::rotation(Vector3::new(0.1, 0.22, 0.03));
    turn * Isometry3::translation(-160.0, 90.0, 20.0)
}

#[test]
fn focal_lengths_and_pose_are_found_within_their_uncertainties() {
    let found = self_calibrate(&recorded(aside(), 60.0, 0.05), CAMERA_PX, PROJECTOR_PX).unwrap();
    for (focal, truth) in found.focal.iter().zip([1700.0, 1500.0]) {
        assert!((focal.px - truth).abs() < 4.0 * focal.u_noise_px, "{focal:?} beside {truth}");
        assert!(focal.u_noise_px < 0.02 * truth && focal.u_centres_px > focal.u_noise_px, "{focal:?}");
    }
    let truth = aside();
    let turned = found.projector.camera_from_world.rotation.angle_to(&truth.rotation);
    let direction = found.projector.camera_from_world.translation.vector.normalize();
    let off = direction.angle(&truth.translation.vector.normalize());
    assert!(turned < 0.01 && off < 0.01, "{turned} {off}");
    assert!((0.02..0.12).contains(&(found.outliers as f64 / found.used as f64)), "{found:?}");
    assert!((found.residual_px - 0.05).abs() < 0.02, "{found:?}");
}

#[test]
fn a_plane_is_refused() {
    let flat = recorded(aside(), 0.0, 0.05);
    // Constant depth along rays is a sphere: the plane is made by a homography of the pixels.
    let plane: Vec<Correspondence> = flat
        .iter()
        .map(|c| {
            let (x, y) = (c.camera.x, c.camera.y);
            let z = 1.0 + 1e-4 * x - 5e-5 * y;
            let wrong = c.projector - c.projector;
            Correspondence {
                projector: nalgebra::Point2::new(
                    (0.7 * x + 0.1 * y + 30.0) / z,
                    (0.05 * x + 0.6 * y + 20.0) / z,
                ) + wrong,
                ..*c
            }
        })
        .collect();
    let mut noise = Noise(9);
    let noisy: Vec<Correspondence> = plane
        .iter()
        .map(|c| Correspondence {
            projector: c.projector + nalgebra::Vector2::new(noise.gauss(), noise.gauss()) * 0.05,
            ..*c
        })
        .collect();
    let error = self_calibrate(&noisy, CAMERA_PX, PROJECTOR_PX).unwrap_err();
    assert!(matches!(error, SelfCalibrationError::Plane { .. }), "{error}");
}

/// Both optical axes in one plane through the baseline: two focal lengths cannot be told apart.
#[test]
fn axes_that_meet_leave_the_focal_lengths_open() {
    let turn = Isometry3::rotation(Vector3::new(0.0, 0.25, 0.0));
    let meeting = turn * Isometry3::translation(-160.0, 0.0, 0.0);
    let error = self_calibrate(&recorded(meeting, 60.0, 0.05), CAMERA_PX, PROJECTOR_PX);
    assert!(matches!(error, Err(SelfCalibrationError::Open { .. })), "{error:?}");
}

#[test]
fn few_or_random_correspondences_are_refused() {
    let all = recorded(aside(), 60.0, 0.05);
    assert_eq!(
        self_calibrate(&all[..100], CAMERA_PX, PROJECTOR_PX),
        Err(SelfCalibrationError::Few { found: 100 })
    );
    let mut noise = Noise(2);
    let random: Vec<Correspondence> = all
        .iter()
        .map(|c| Correspondence {
            projector: nalgebra::Point2::new(noise.unit() * 1000.0, noise.unit() * 700.0),
            ..*c
        })
        .collect();
    assert!(self_calibrate(&random, CAMERA_PX, PROJECTOR_PX).is_err());
}
