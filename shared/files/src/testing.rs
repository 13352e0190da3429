//! Small rigs for the tests of this crate.

use fringe::geometry::camera::{Camera, Lens};
use fringe::geometry::rig::{Named, Pair, Rig};
use nalgebra::{Isometry3, Vector3};

/// A camera with digits that a short notation would lose.
pub(crate) fn camera(name: &str, width_px: u32, height_px: u32) -> Named {
    let camera = Camera {
        width_px,
        height_px,
        focal_px: [2330.1 / 3.0, 2331.7 / 3.0],
        principal_point_px: [f64::from(width_px) / 2.1, f64::from(height_px) / 1.9],
        skew: 1e-7 / 3.0,
        distortion: Lens::brown_conrady([-0.08 / 3.0, 0.05 / 7.0, 0.0], [2e-4 / 3.0, -1e-4 / 3.0]),
        camera_from_world: Isometry3::new(
            Vector3::new(1.0 / 3.0, -2.0 / 3.0, 500.0),
            Vector3::new(0.1, 0.2, 0.3),
        ),
    };
    Named { name: name.into(), camera }
}

/// Four cameras in two pairs, without projectors.
pub(crate) fn rig(width_px: u32, height_px: u32) -> Rig {
    let pair = |name: &str, left: &str, right: &str, projector: &str| Pair {
        name: name.into(),
        left: left.into(),
        right: right.into(),
        projector: projector.into(),
    };
    Rig {
        cameras: ["cam1", "cam2", "cam3", "cam4"].map(|name| camera(name, width_px, height_px)).into(),
        projectors: Vec::new(),
        pairs: vec![pair("pair1", "cam1", "cam2", "proj1"), pair("pair2", "cam3", "cam4", "proj2")],
        ..Rig::default()
    }
}
