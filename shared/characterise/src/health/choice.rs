//! Which causes changed: the simplest model that the residuals do not contradict.
//!
//! Of the seven causes some explain a drift nearly as well as others: a shift of 0.05 mm across the line of sight leaves 0.002 px of
//! what a turn of 0.006° makes. So each model (rotation, shift, focal length, and what joins them) is held against the estimate with
//! all causes free: χ² = δᵀ C⁻¹ δ of what the model cannot explain, with as many degrees of freedom as causes are held. Where models of the
//! same size remain that give other lengths, or where the remaining one leaves lengths open, the residuals cannot tell, and a
//! length standard must. A change of the baseline is never taken without one.
//!
//! Another model may be the true one although the chosen one is not contradicted, or was by chance. Each counts with Akaike's weight (Burnham and Anderson
//! 2002), exp(−½ (χ² + 2 k)) with k free causes, and the uncertainty of the chosen one holds how far the others lie from it. The evidence under
//! a prior would ask how large drifts are, which nobody knows: the wider it is, the less three causes of a shift count beside the one of a focal length.

use super::correct::ViewEstimate;
use super::state::{POSE, UNKNOWNS, stepped};
use crate::calibration::PARAMETERS;
use crate::chi_square;
use fringe::geometry::camera::Camera;
use fringe::math::exp;
use fringe::math::linear::{Dense, Factor, dot};
use nalgebra::Vector3;

/// Lengths that are this well known, relative to themselves, are known: 2 µm in 100 mm, as a good calibration leaves them.
pub const KNOWN_LENGTH: f64 = 2e-5;
/// Certified lengths show a change of the baseline that is so many times their standard uncertainty.
const SHOWN: f64 = 3.5;
/// Probability with which a true model is contradicted: a larger one is then taken, which costs little.
const CONTRADICTED: f64 = 0.05;

/// Models by what changes: rotation, shift, focal length; the simple ones first.
const MODELS: [[bool; 3]; 7] = [
    [false, false, true],
    [true, false, false],
    [false, true, false],
    [true, false, true],
    [false, true, true],
    [true, true, false],
    [true, true, true],
];
/// Covariance of a drift, row by row.
type Covariance = [[f64; UNKNOWNS]; UNKNOWNS];

/// Names of what changes.
const NAMES: [&str; 3] = ["rotation", "shift", "focal length"];

/// A view as a model explains its residuals.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewCorrection {
    /// What changes: rotation, shift, focal length.
    pub changes: [bool; 3],
    /// The view after the correction.
    pub camera: Camera,
    /// New state less old one: rotations about x, y, z (rad), shifts along them (mm), relative change of the focal length.
    pub drift: [f64; UNKNOWNS],
    /// Covariance of the drift, row by row.
    pub covariance: Covariance,
    /// χ² of what the model cannot explain.
    pub chi2: f64,
    /// One true model in twenty exceeds this.
    pub limit: f64,
    /// Relative standard uncertainty of lengths that the correction leaves, rms over the object.
    pub u_length: f64,
    /// The same of 100 mm anywhere that both views of a measuring pair see: the largest.
    pub u_volume: f64,
}

/// What the residuals tell of the models.
#[derive(Debug, Clone, PartialEq)]
pub enum Choice {
    /// One model, the simplest that is not contradicted.
    Clear(Box<ViewCorrection>),
    /// These explain the residuals alike, but lengths differ between them, or within one, by this part of themselves.
    LengthsOpen {
        /// Models of the same size, the best one first.
        models: Vec<ViewCorrection>,
        /// Relative difference of lengths.
        apart: f64,
    },
}

impl ViewCorrection {
    /// What changes, in words.
    pub fn name(&self) -> String {
        let parts: Vec<&str> =
            NAMES.iter().zip(self.changes).filter(|(_, changes)| *changes).map(|(name, _)| *name).collect();
        match parts.as_slice() {
            [first @ .., last] if !first.is_empty() => format!("{} and {last}", first.join(", ")),
            _ => parts.concat(),
        }
    }

    /// Whether the residuals do not contradict it.
    pub fn is_possible(&self) -> bool {
        self.chi2 <= self.limit
    }

    /// Standard uncertainties of the drift.
    pub fn u(&self) -> [f64; UNKNOWNS] {
        std::array::from_fn(|i| self.covariance[i][i].max(0.0).sqrt())
    }

    /// Covariance of the view's parameters that the correction adds, of the first `count` of [`PARAMETERS`], row by row.
    pub fn parameter_covariance(&self, count: usize) -> Vec<f64> {
        let by = |parameter: usize| -> [f64; UNKNOWNS] {
            let focal = self.camera.focal_px.get(parameter).copied().unwrap_or(0.0);
            let pose = |i: usize| PARAMETERS[parameter] == POSE[i];
            std::array::from_fn(|i| if i < 6 { f64::from(u8::from(pose(i))) } else { focal })
        };
        let product = |k: usize| {
            let (a, b) = (by(k / count), by(k % count));
            let row = |i: usize| a[i] * (0..UNKNOWNS).map(|j| self.covariance[i][j] * b[j]).sum::<f64>();
            (0..UNKNOWNS).map(row).sum()
        };
        (0..count * count).map(product).collect()
    }

    /// Akaike's criterion, up to what all models of an estimate have in common.
    fn akaike(&self) -> f64 {
        self.chi2 + 2.0 * causes(self.changes).count() as f64
    }

    fn size(&self) -> usize {
        self.changes.iter().filter(|changes| **changes).count()
    }
}

impl ViewEstimate {
    /// All models, the simple ones first; those that the matches do not determine are left out.
    pub fn models(&self) -> Vec<ViewCorrection> {
        MODELS.iter().filter_map(|changes| self.model(*changes)).collect()
    }

    /// The simplest model that is not contradicted, or those that lengths must tell apart; `None` where all are contradicted.
    pub fn choose(&self) -> Option<Choice> {
        let models = self.models();
        let possible = || models.iter().filter(|model| model.is_possible());
        let size = possible().map(ViewCorrection::size).min()?;
        let mut alike: Vec<ViewCorrection> =
            possible().filter(|model| model.size() == size).cloned().collect();
        alike.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        let best = alike.first()?.clone();
        let apart = |other: &ViewCorrection| {
            let difference = difference(other, &best);
            let rms = |form: &Dense| dot(&difference, &form.apply(&difference)).max(0.0).sqrt();
            self.object.iter().map(rms).fold(0.0, f64::max)
        };
        // A longer or shorter baseline scales lengths, and other causes may look like it: no residual proves it, nor a length that would not
        // show it.
        let change = self.baseline_change(&best);
        let shown = self.u_scale.is_some_and(|u| u <= KNOWN_LENGTH.max(change / SHOWN));
        let unproven = if shown { 0.0 } else { change };
        let apart = alike.iter().map(apart).fold(best.u_length.max(unproven), f64::max);
        Some(if apart > KNOWN_LENGTH {
            Choice::LengthsOpen { models: alike, apart }
        } else {
            Choice::Clear(Box::new(self.with_doubt(&best, &models)))
        })
    }

    /// A model with the others' distance from it in its uncertainty, each with its weight: one true model in twenty is contradicted by chance, so that
    /// those count as well.
    fn with_doubt(&self, best: &ViewCorrection, models: &[ViewCorrection]) -> ViewCorrection {
        let least = models.iter().map(ViewCorrection::akaike).fold(f64::INFINITY, f64::min);
        let weight = |model: &ViewCorrection| exp(-0.5 * (model.akaike() - least));
        let sum: f64 = models.iter().map(weight).sum();
        let mut covariance = best.covariance;
        for model in models {
            let (share, difference) = (weight(model) / sum, difference(model, best));
            for (row, a) in covariance.iter_mut().zip(difference) {
                row.iter_mut().zip(difference).for_each(|(c, b)| *c += share * a * b);
            }
        }
        let (u_length, u_volume) = (self.u_length(&covariance), self.u_volume(&covariance));
        ViewCorrection { covariance, u_length, u_volume, ..best.clone() }
    }

    /// Relative standard uncertainty of lengths, rms over the object.
    fn u_length(&self, covariance: &Covariance) -> f64 {
        let trace = |form: &Dense| {
            let row = |i: usize| (0..UNKNOWNS).map(|j| form.at(i, j) * covariance[j][i]).sum::<f64>();
            (0..UNKNOWNS).map(row).sum::<f64>().max(0.0).sqrt()
        };
        self.object.iter().map(trace).fold(0.0, f64::max)
    }

    /// Relative standard uncertainty of lengths anywhere in the volume: the largest.
    fn u_volume(&self, covariance: &Covariance) -> f64 {
        let variance = |by: &[f64; UNKNOWNS]| -> f64 {
            by.iter().zip(covariance).map(|(a, row)| a * dot(row, by)).sum()
        };
        self.volume.iter().map(variance).fold(0.0, f64::max).sqrt()
    }

    /// By how much of itself the baseline to a measuring partner changes.
    fn baseline_change(&self, model: &ViewCorrection) -> f64 {
        let shift = Vector3::from_column_slice(&model.drift[3..6]);
        let part = |baseline: &Vector3<f64>| shift.dot(baseline).abs() / baseline.norm_squared().max(1e-12);
        self.baselines_mm.iter().map(part).fold(0.0, f64::max)
    }

    /// The estimate with some causes held at the rig file's state.
    fn model(&self, changes: [bool; 3]) -> Option<ViewCorrection> {
        let free: Vec<usize> = causes(changes).collect();
        let n = free.len();
        let inner = Dense::from_fn(n, n, |i, j| self.weight.at(free[i], free[j]));
        let whole = self.weight.apply(&self.drift);
        let right: Vec<f64> = free.iter().map(|i| whole[*i]).collect();
        let factor = Factor::new(&inner).ok()?;
        let found = factor.solve(&right);
        let chi2 = (dot(&self.drift, &whole) - dot(&found, &right)).max(0.0);
        let inverse = factor.inverse();
        let (mut drift, mut covariance) = ([0.0; UNKNOWNS], [[0.0; UNKNOWNS]; UNKNOWNS]);
        for (i, at) in free.iter().enumerate() {
            drift[*at] = found[i];
            for (j, other) in free.iter().enumerate() {
                covariance[*at][*other] = inverse.at(i, j);
            }
        }
        let held = UNKNOWNS - n;
        Some(ViewCorrection {
            changes,
            camera: stepped(&self.start, &drift),
            drift,
            covariance,
            chi2,
            limit: if held > 0 { chi_square::limit(CONTRADICTED, held) } else { 1e-6 },
            u_length: self.u_length(&covariance),
            u_volume: self.u_volume(&covariance),
        })
    }
}

/// Numbers of the causes that are free where these change.
fn causes(changes: [bool; 3]) -> impl Iterator<Item = usize> {
    (0..UNKNOWNS).filter(move |i| changes[i / 3])
}

/// Drift of a model less that of another one.
fn difference(a: &ViewCorrection, b: &ViewCorrection) -> [f64; UNKNOWNS] {
    std::array::from_fn(|i| a.drift[i] - b.drift[i])
}
