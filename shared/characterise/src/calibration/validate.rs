//! Cross-validation: two calibrations from independent halves of the poses, and whether they differ as predicted.
//!
//! Source: mrcal, "cross-validation": a low reprojection error shows only that the model fits the points used; when
//! the difference of two independent calibrations exceeds what their covariances predict, the model is wrong.

use super::covariance::Gauge;
use super::model::{DEVICE, FURTHER, INTRINSIC, WARP, compose, intrinsics, rotation_vector, world_rows};
use super::observations::Observations;
use super::result::Calibration;
use super::settings::{CalibrationSettings, WorldFrame};
use super::{CalibrationError, calibrate};
use crate::chi_square::tail;
use fringe::math::linear::{Dense, Factor, dot};
use nalgebra::{Point3, Vector3};

/// About this many points of the target are compared in each pose.
const POINTS: usize = 9;

/// Difference of the projections of one device.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceDifference {
    /// Name of the device.
    pub name: String,
    /// Root mean squared distance of both projections over the volume, px.
    pub rms_px: f64,
    /// What the covariances of both halves predict for it, px.
    pub predicted_px: f64,
}

/// Comparison of two halves of the poses.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossValidation {
    /// First half (poses 0, 2, 4 … of those seen), world in the first device.
    pub first: Calibration,
    /// Calibration of the second half of the poses.
    pub second: Calibration,
    /// Per device, after the best-fitting rigid motion between both worlds.
    pub devices: Vec<DeviceDifference>,
    /// δᵀ(Σ₁ + Σ₂)⁻¹δ of the devices' parameters.
    pub chi_square: f64,
    /// Its degrees of freedom; `chi_square` exceeds them by far when the model is wrong.
    pub degrees_of_freedom: usize,
}

impl CrossValidation {
    /// Probability of a χ² as large as this one or larger, where the covariances are right.
    pub fn probability(&self) -> f64 {
        tail(self.chi_square, self.degrees_of_freedom)
    }
}

/// Calibrates both halves of the poses and compares them.
///
/// # Errors
/// As [`calibrate`], for either half.
pub fn cross_validate(
    observations: &Observations,
    settings: &CalibrationSettings,
) -> Result<CrossValidation, CalibrationError> {
    observations.check()?;
    let settings = CalibrationSettings { world: WorldFrame::FirstDevice, ..settings.clone() };
    let mut poses: Vec<usize> = observations.views.iter().map(|v| v.pose).collect();
    poses.sort_unstable();
    poses.dedup();
    let half = |odd: usize| {
        let mut half = observations.clone();
        half.views.retain(|v| poses.binary_search(&v.pose).is_ok_and(|rank| rank % 2 == odd));
        calibrate(&half, &settings)
    };
    let (first, second) = (half(0)?, half(1)?);
    let sum = first.covariance.matrix(Gauge::FirstDevice).plus(second.covariance.matrix(Gauge::FirstDevice));
    let (chi_square, degrees_of_freedom) = chi_square(&difference(&first, &second), &sum);
    let devices = differences(&first, &second, &sum).unwrap_or_default();
    Ok(CrossValidation { first, second, devices, chi_square, degrees_of_freedom })
}

/// Parameters of the first calibration less those of the second, in the order of the covariance without the warp.
fn difference(first: &Calibration, second: &Calibration) -> Vec<f64> {
    let mut difference = Vec::new();
    for (a, b) in first.devices.iter().zip(&second.devices) {
        let (a, b) = (&a.camera, &b.camera);
        let (of_a, of_b) = (intrinsics(a), intrinsics(b));
        let mut own: [f64; DEVICE] = std::array::from_fn(|i| of_a[i] - of_b[i]);
        let step = compose(&a.camera_from_world, &b.camera_from_world.inverse());
        own[INTRINSIC..INTRINSIC + 3].copy_from_slice(rotation_vector(&step.rotation).as_slice());
        own[INTRINSIC + 3..FURTHER].copy_from_slice(step.translation.vector.as_slice());
        difference.extend(own);
    }
    difference
}

/// δᵀ Σ⁻¹ δ over the parameters that were adjusted, and their number.
fn chi_square(difference: &[f64], covariance: &Dense) -> (f64, usize) {
    let free: Vec<usize> = (0..difference.len()).filter(|i| covariance.at(*i, *i) > 0.0).collect();
    let matrix = Dense::from_fn(free.len(), free.len(), |i, j| covariance.at(free[i], free[j]));
    let own: Vec<f64> = free.iter().map(|i| difference[*i]).collect();
    let square = Factor::new(&matrix).map_or(f64::INFINITY, |factor| dot(&own, &factor.solve(&own)));
    (square, free.len())
}

/// Differences of the projections of the first half's target points, the motion of the world taken out:
/// Δq′ = (1 − G(GᵀG)⁻¹Gᵀ) Δq with G the derivative of all pixels by that motion.
fn differences(
    first: &Calibration,
    second: &Calibration,
    covariance: &Dense,
) -> Option<Vec<DeviceDifference>> {
    let every = first.target_mm.len().div_ceil(POINTS).max(1);
    let target = first.target_mm.iter().step_by(every);
    let boards = first.boards.iter().flatten();
    let points: Vec<Point3<f64>> = boards.flat_map(|b| target.clone().map(move |p| b * p)).collect();
    let middle = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.coords) / points.len().max(1) as f64;
    let (mut by_motion, mut by_parameter, mut errors, mut owner) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (number, (a, b)) in first.devices.iter().zip(&second.devices).enumerate() {
        for point in &points {
            let (rows, by_point) = world_rows(&a.camera, &point.coords)?;
            let error = a.camera.project(point)? - b.camera.project(point)?;
            let arm = point.coords - middle;
            for (i, row) in rows.iter().enumerate() {
                let slope: Vector3<f64> = by_point.row(i).transpose();
                let turn = arm.cross(&slope);
                by_motion.push([turn.x, turn.y, turn.z, slope.x, slope.y, slope.z]);
                by_parameter.push(*row);
                errors.push(error[i]);
                owner.push(number);
            }
        }
    }
    let g = Dense::from_fn(errors.len(), 6, |i, j| by_motion[i][j]);
    let gt = g.transposed();
    let inverse = Factor::new(&gt.times(&g)).ok()?.inverse();
    let projector = g.times(&inverse);
    let n = DEVICE * first.devices.len() + WARP;
    let mut j = Dense::zeros(errors.len(), n);
    for (row, (values, device)) in by_parameter.iter().zip(&owner).enumerate() {
        for (parameter, value) in values.iter().enumerate() {
            j.set(row, DEVICE * device + parameter, *value);
        }
    }
    let moved = projector.times(&gt.times(&j));
    let aligned = Dense::from_fn(errors.len(), n, |row, col| j.at(row, col) - moved.at(row, col));
    let motion = projector.apply(&gt.apply(&errors));
    let spread = aligned.times(covariance);
    let report = |(number, device): (usize, &super::CalibratedDevice)| {
        let own: Vec<usize> = (0..errors.len()).filter(|i| owner[*i] == number).collect();
        let count = (own.len() / 2).max(1) as f64;
        let seen: f64 = own.iter().map(|i| (errors[*i] - motion[*i]).powi(2)).sum();
        let predicted: f64 = own.iter().map(|i| dot(spread.row(*i), aligned.row(*i))).sum();
        DeviceDifference {
            name: device.name.clone(),
            rms_px: (seen / count).sqrt(),
            predicted_px: (predicted / count).sqrt(),
        }
    };
    Some(first.devices.iter().enumerate().map(report).collect())
}
