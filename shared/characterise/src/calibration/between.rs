//! How far a rig moves from one set of poses to another: the jackknife over groups of poses.
//!
//! The covariance of an adjustment takes the errors of all points as independent. What the points of one pose share (a
//! board that bends under its own weight, light, focus) or what one point has in all poses (a poor print) makes it too
//! small, and no residual shows by how much. Calibrations that each lack one of G groups of poses do:
//! u² = (G − 1)/G Σ (θ₍₋g₎ − θ̄)². An error that all poses have in common, as a wrong pitch, stays hidden even here.
//!
//! Source: Efron, Tibshirani, "An Introduction to the Bootstrap", 1993, section 11.5; G − 1 degrees of freedom only, so that
//! with five groups u is itself uncertain by a third.

use super::held_out::HeldOut;
use super::model::{DEVICE, compose, intrinsics, rotation_vector};
use super::result::{CalibratedDevice, Calibration};
use fringe::geometry::camera::Camera;

/// Fewest groups of poses from which a scatter is estimated.
const LEAST_GROUPS: usize = 3;

/// Scatter of one device's parameters between sets of poses.
#[derive(Debug, Clone, PartialEq)]
pub struct BetweenPoses {
    /// Name of the device.
    pub name: String,
    /// Standard uncertainties by the jackknife, in the order of [`super::PARAMETERS`]; extrinsics relative to the first
    /// device.
    pub standard_uncertainty: [f64; DEVICE],
    /// Root mean square, over focal lengths and principal point, of these over the stated ones: near 1 when points err
    /// independently.
    pub over_stated: f64,
}

impl HeldOut {
    /// The scatter of each device over the folds; `None` for fewer than three folds.
    pub fn between_poses(&self, all: &Calibration) -> Option<Vec<BetweenPoses>> {
        (self.folds.len() >= LEAST_GROUPS).then(|| {
            all.devices.iter().enumerate().map(|(number, device)| self.device(all, number, device)).collect()
        })
    }

    fn device(&self, all: &Calibration, number: usize, device: &CalibratedDevice) -> BetweenPoses {
        let cameras = |calibration: &Calibration| -> [Camera; 2] {
            [number, 0].map(|d| calibration.devices[d].camera.clone())
        };
        let reference = cameras(all);
        let moves: Vec<[f64; DEVICE]> =
            self.folds.iter().map(|fold| difference(&cameras(&fold.calibration), &reference)).collect();
        let groups = moves.len() as f64;
        let standard_uncertainty: [f64; DEVICE] = std::array::from_fn(|i| {
            let mean = moves.iter().map(|m| m[i]).sum::<f64>() / groups;
            let squares: f64 = moves.iter().map(|m| (m[i] - mean).powi(2)).sum();
            ((groups - 1.0) / groups * squares).sqrt()
        });
        let ratios = standard_uncertainty.iter().zip(&device.standard_uncertainty).take(4);
        let over_stated =
            (ratios.map(|(u, stated)| (u / stated.max(1e-300)).powi(2)).sum::<f64>() / 4.0).sqrt();
        BetweenPoses { name: device.name.clone(), standard_uncertainty, over_stated }
    }
}

/// Parameters of a device less those of its reference; each comes with the first device of its rig.
fn difference([ours, first]: &[Camera; 2], [reference, reference_first]: &[Camera; 2]) -> [f64; DEVICE] {
    let relative = |camera: &Camera, first: &Camera| {
        compose(&camera.camera_from_world, &first.camera_from_world.inverse())
    };
    let step = compose(&relative(ours, first), &relative(reference, reference_first).inverse());
    let (turn, shift) = (rotation_vector(&step.rotation), step.translation.vector);
    let (a, b) = (intrinsics(ours), intrinsics(reference));
    std::array::from_fn(|i| match i {
        10..13 => turn[i - 10],
        13..16 => shift[i - 13],
        _ => a[i] - b[i],
    })
}
