//! The cell of the thesis (section 5.3): two stereo pairs from orthogonal sides, 0.5 m from the part.

use fringe::geometry::camera::{Camera, Lens};
use fringe::geometry::rig::{Named, Pair, Rig};
use fringe::math::{cos, sin};
use fringe::pattern::{Axis, PatternSet};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

/// Middle of the measurement volume 140 × 140 × 90 mm, mm in the world frame.
pub const VOLUME_CENTRE_MM: [f64; 3] = [0.0, 0.0, 15.0];

/// Stand-off of cameras and projectors from the middle of the volume, mm.
pub const STAND_OFF_MM: f64 = 500.0;

/// Elevation of cameras and projectors over the horizontal, degrees.
pub const ELEVATION_DEG: f64 = 48.0;

/// Azimuth of the cameras to both sides of their projector, degrees.
pub const HALF_BASE_DEG: f64 = 12.0;

/// Camera columns for which the focal length is stated.
const BASE_WIDTH_PX: f64 = 1124.0;

/// Focal length at that width, px.
const FOCAL_PX: f64 = 2330.0;

/// A camera pose from its optical centre, looking at `target`, with a horizontal image x axis.
pub fn looking_at(centre_mm: Point3<f64>, target_mm: Point3<f64>) -> Isometry3<f64> {
    let forward = (target_mm - centre_mm).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rows = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
    Isometry3::from_parts((-(rotation * centre_mm.coords)).into(), rotation)
}

fn placed(azimuth_deg: f64, elevation_deg: f64) -> Isometry3<f64> {
    let target = Point3::from(VOLUME_CENTRE_MM);
    let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
    let out = Vector3::new(cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth), sin(elevation));
    looking_at(target + out * STAND_OFF_MM, target)
}

/// Small differences between the units, so that no test passes because two cameras are alike.
fn camera(index: usize, azimuth_deg: f64, width_px: u32, height_px: u32) -> Named {
    let scale = f64::from(width_px) / BASE_WIDTH_PX;
    let i = index as f64;
    Named {
        name: format!("cam{}", index + 1),
        camera: Camera {
            width_px,
            height_px,
            focal_px: [(FOCAL_PX + 1.5 * i) * scale, (FOCAL_PX - 0.8 + 1.5 * i) * scale],
            principal_point_px: [
                0.5 * (f64::from(width_px) - 1.0) + (3.2 - 2.1 * i) * scale,
                0.5 * (f64::from(height_px) - 1.0) + (1.7 * i - 2.4) * scale,
            ],
            skew: 0.0,
            distortion: Lens::brown_conrady([-0.08 + 0.004 * i, 0.05, 0.0], [2e-4, -1.5e-4 + 1e-4 * i]),
            camera_from_world: placed(azimuth_deg, ELEVATION_DEG),
        },
    }
}

fn projector(index: usize, azimuth_deg: f64) -> Named {
    let i = index as f64;
    Named {
        name: format!("proj{}", index + 1),
        camera: Camera {
            width_px: 608,
            height_px: 684,
            focal_px: [1500.0 + 2.0 * i, 1499.0 + 2.0 * i],
            principal_point_px: [303.5 + 1.8 - 3.0 * i, 341.5 - 2.6 + 1.9 * i],
            skew: 0.0,
            distortion: Lens::brown_conrady([-0.03, 0.01, 0.0], [1e-4, -1e-4]),
            camera_from_world: placed(azimuth_deg, ELEVATION_DEG),
        },
    }
}

/// The rig for cameras of a resolution: the field of view stays, so the focal length in pixels scales with the width.
/// The thesis used 1124 × 750 (binned) of 4496 × 3000.
pub fn rig(width_px: u32, height_px: u32) -> Rig {
    rig_of_sides(2, width_px, height_px)
}

/// A rig with one to four such sides, 90° apart: of each a projector between two cameras. Four are the outlook of the thesis
/// (section 7.2), which sees a part all around.
pub fn rig_of_sides(sides: usize, width_px: u32, height_px: u32) -> Rig {
    let azimuth_deg = |side: usize| 90.0 * side as f64;
    let one = |i: usize| {
        let to_side = if i.is_multiple_of(2) { -HALF_BASE_DEG } else { HALF_BASE_DEG };
        camera(i, azimuth_deg(i / 2) + to_side, width_px, height_px)
    };
    let pair = |i: usize| Pair {
        name: format!("pair{}", i + 1),
        left: format!("cam{}", 2 * i + 1),
        right: format!("cam{}", 2 * i + 2),
        projector: format!("proj{}", i + 1),
    };
    Rig {
        cameras: (0..2 * sides).map(one).collect(),
        projectors: (0..sides).map(|i| projector(i, azimuth_deg(i))).collect(),
        pairs: (0..sides).map(pair).collect(),
        ..Rig::default()
    }
}

/// The sequence of the demo: ten steps of 16 px, seven Gray bits of half a period, white, black; 19 frames.
pub fn sequence() -> Vec<PatternSet> {
    vec![
        PatternSet::sine(Axis::X, 16.0, 10),
        PatternSet::gray(Axis::X, 7, 8.0),
        PatternSet::White {},
        PatternSet::Black {},
    ]
}
