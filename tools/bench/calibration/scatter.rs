//! Parameters found against the truth, in units of their predicted standard deviations.

use anyhow::{Context, Result};
use characterise::calibration::{Calibration, DeviceKind, Gauge, PARAMETERS};
use fringe::geometry::camera::Camera;
use nalgebra::{DMatrix, DVector, Isometry3};
use serde::Serialize;
use std::ops::Range;

/// Parameters of one device.
const DEVICE: usize = PARAMETERS.len();
/// Groups of parameters that are reported together.
const GROUPS: [(&str, Range<usize>); 5] = [
    ("focal length", 0..2),
    ("principal point", 2..4),
    ("distortion", 5..10),
    ("relative rotation", 10..13),
    ("relative translation", 13..16),
];

/// Sums of squared errors over the trials.
#[derive(Debug, Default)]
pub struct Scatter {
    chi_square: f64,
    freedom: usize,
    trials: usize,
    /// Per group, cameras and projectors apart: sum of (error/u)², sum of error², count.
    groups: [[(f64, f64, usize); 2]; GROUPS.len()],
}

/// What the trials show.
#[derive(Debug, Serialize)]
pub struct ScatterReport {
    /// Number of trials summed.
    pub trials: usize,
    /// δᵀΣ⁻¹δ, all parameters of all trials, extrinsics relative to the first camera.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub degrees_of_freedom: usize,
    /// Half of its 95 % interval.
    pub half_interval: f64,
    /// Root mean squares by group.
    pub groups: Vec<GroupReport>,
}

/// Errors of one group of parameters.
#[derive(Debug, Serialize)]
pub struct GroupReport {
    /// Name of the group.
    pub name: &'static str,
    /// Of cameras or projectors.
    pub devices: &'static str,
    /// Root mean square of error over predicted standard deviation.
    pub in_standard_deviations: f64,
    /// Root mean square of the error itself: px, 1, rad or mm.
    pub rms_error: f64,
}

impl Scatter {
    /// Adds a calibration of devices whose truth is known.
    pub fn add(&mut self, found: &Calibration, truth: &[&Camera]) -> Result<()> {
        let errors = errors(found, truth);
        let at = |i: usize, j: usize| found.covariance.at(Gauge::FirstDevice, i, j);
        let free: Vec<usize> = (0..errors.len()).filter(|i| at(*i, *i) > 0.0).collect();
        // In units of standard deviations: entries of px², rad² and mm² differ by twelve powers of ten.
        let sd: Vec<f64> = free.iter().map(|i| at(*i, *i).sqrt()).collect();
        let matrix = DMatrix::from_fn(free.len(), free.len(), |i, j| at(free[i], free[j]) / (sd[i] * sd[j]));
        let own = DVector::from_iterator(free.len(), free.iter().zip(&sd).map(|(i, s)| errors[*i] / s));
        let factor = matrix.cholesky().context("the covariance of a calibration is singular")?;
        self.chi_square += own.dot(&factor.solve(&own));
        self.freedom += free.len();
        self.trials += 1;
        for (i, ratio) in free.iter().zip(own.iter()) {
            let kind = usize::from(found.devices[i / DEVICE].kind == DeviceKind::Projector);
            for ((_, range), sums) in GROUPS.iter().zip(&mut self.groups) {
                if range.contains(&(i % DEVICE)) {
                    let (squares, plain, count) = &mut sums[kind];
                    *squares += ratio * ratio;
                    *plain += errors[*i] * errors[*i];
                    *count += 1;
                }
            }
        }
        Ok(())
    }

    /// The sums as figures.
    pub fn report(&self) -> ScatterReport {
        let mut groups = Vec::new();
        for ((name, _), sums) in GROUPS.iter().zip(&self.groups) {
            for (devices, (squares, plain, count)) in ["cameras", "projectors"].into_iter().zip(sums) {
                let count = (*count).max(1) as f64;
                groups.push(GroupReport {
                    name,
                    devices,
                    in_standard_deviations: (squares / count).sqrt(),
                    rms_error: (plain / count).sqrt(),
                });
            }
        }
        ScatterReport {
            trials: self.trials,
            chi_square: self.chi_square,
            degrees_of_freedom: self.freedom,
            half_interval: 1.96 * (2.0 * self.freedom as f64).sqrt(),
            groups,
        }
    }
}

/// Found − true of all parameters in the order of the covariance, extrinsics relative to the first device.
fn errors(found: &Calibration, truth: &[&Camera]) -> Vec<f64> {
    let mut errors = Vec::with_capacity(DEVICE * truth.len());
    let ours: Vec<&Camera> = found.devices.iter().map(|d| &d.camera).collect();
    let relative = |all: &[&Camera], i: usize| -> Isometry3<f64> {
        all[i].camera_from_world * all[0].camera_from_world.inverse()
    };
    let flat = |c: &Camera| {
        [&c.focal_px[..], &c.principal_point_px, &[c.skew], &c.distortion.k, &c.distortion.p].concat()
    };
    for (i, (a, b)) in ours.iter().zip(truth).enumerate() {
        errors.extend(flat(a).iter().zip(flat(b)).map(|(x, y)| x - y));
        let step = relative(&ours, i) * relative(truth, i).inverse();
        errors.extend(step.rotation.scaled_axis().iter());
        errors.extend(step.translation.vector.iter());
        let (a, b) = (a.distortion, b.distortion);
        errors.extend(a.more_k.iter().zip(b.more_k).map(|(x, y)| x - y));
        errors.extend(a.prism.iter().zip(b.prism).map(|(x, y)| x - y));
    }
    errors
}
