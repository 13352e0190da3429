//! Errors of the calibration as unknowns beside the drift, known to their covariance.
//!
//! A residual is a·δ + f·θ + noise, δ the drift and θ the errors of all parameters of the view and its partners, drawn from the
//! calibration's covariance C = L Lᵀ. With θ = L z and z of unit variance the sums over all residuals give δ without z:
//!
//! ```text
//! J = Σ a aᵀ − X L (1 + Lᵀ F L)⁻¹ Lᵀ Xᵀ,   X = Σ a fᵀ,  F = Σ f fᵀ
//! ```
//!
//! This is generalised least squares (Aitken 1935): residuals that the calibration explains count less. With weights of the noise alone the
//! errors of the projectors, larger than those of the cameras, went into the drift.

use super::HealthError;
use super::parameters::COUNT;
use super::rows::Row;
use super::state::UNKNOWNS;
use crate::calibration::PARAMETERS;
use fringe::math::linear::{Dense, Factor, eigen};

/// Directions of the correlation matrix below this are rounding.
const LEAST_VARIANCE: f64 = 1e-12;

/// Covariance of the calibration of a view and its partners.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewCovariance {
    /// Whose parameters the blocks are: the number of a partner's device, or the number of devices for the view itself. Others count as exact.
    pub blocks: Vec<usize>,
    /// Names of the parameters of each block, as in [`PARAMETERS`]; any subset in any order.
    pub names: Vec<String>,
    /// Square, row by row, block after block.
    pub matrix: Vec<f64>,
}

/// The root L of a covariance, over the parameters of all partners' devices, then of the view.
pub(super) struct Root {
    /// Lᵀ: a direction of unit variance in each row.
    transposed: Dense,
}

impl Root {
    /// Of a calibration; `None` knows everything exactly.
    pub fn new(covariance: Option<&ViewCovariance>, devices: usize) -> Result<Self, HealthError> {
        let size = (devices + 1) * COUNT;
        let Some(covariance) = covariance else { return Ok(Self { transposed: Dense::zeros(0, size) }) };
        let mut places = Vec::new();
        for block in &covariance.blocks {
            for name in &covariance.names {
                let place = PARAMETERS.iter().position(|known| known == name);
                places.push(block * COUNT + place.ok_or_else(|| HealthError::Parameter(name.clone()))?);
            }
        }
        let n = places.len();
        if covariance.matrix.len() != n * n || places.iter().any(|place| *place >= size) {
            return Err(HealthError::Covariance { found: covariance.matrix.len(), needed: n * n });
        }
        // Units differ by orders of magnitude; correlations do not.
        let sd: Vec<f64> = (0..n).map(|i| covariance.matrix[i * n + i].max(0.0).sqrt()).collect();
        let over = |i: usize, j: usize| if sd[i] * sd[j] > 0.0 { 1.0 / (sd[i] * sd[j]) } else { 0.0 };
        let (values, vectors) =
            eigen(&Dense::from_fn(n, n, |i, j| covariance.matrix[i * n + j] * over(i, j)));
        let kept: Vec<usize> = (0..n).filter(|k| values[*k] > LEAST_VARIANCE).collect();
        let mut transposed = Dense::zeros(kept.len(), size);
        for (row, k) in kept.iter().enumerate() {
            for (i, place) in places.iter().enumerate() {
                transposed.add(row, *place, values[*k].sqrt() * vectors.at(*k, i) * sd[i]);
            }
        }
        Ok(Self { transposed })
    }
}

/// Weighted sums over the residuals of all partners.
pub(super) struct Sums {
    /// Σ a aᵀ, of the drift alone.
    drift: Dense,
    /// Σ a fᵀ, of the drift with the calibration's errors.
    cross: Dense,
    /// Σ f fᵀ, of the calibration's errors alone.
    errors: Dense,
    /// Σ a e, residuals along the drift.
    drift_right: Vec<f64>,
    /// Σ f e, residuals along the calibration's errors.
    errors_right: Vec<f64>,
}

impl Sums {
    /// Sums over nothing, for a number of devices.
    pub fn new(devices: usize) -> Self {
        let size = (devices + 1) * COUNT;
        Self {
            drift: Dense::zeros(UNKNOWNS, UNKNOWNS),
            cross: Dense::zeros(UNKNOWNS, size),
            errors: Dense::zeros(size, size),
            drift_right: vec![0.0; UNKNOWNS],
            errors_right: vec![0.0; size],
        }
    }

    /// Adds residuals of fixed devices and the view, all of one weight.
    pub fn add<const N: usize, const P: usize>(
        &mut self,
        devices: &[usize],
        kept: &[&Row<N, P>],
        weight: f64,
    ) {
        // Summed in a row's own order of the parameters first: to look for the place of each product took most of the time.
        let (mut cross, mut errors) = ([[0.0; P]; UNKNOWNS], [[0.0; P]; P]);
        let mut right = [0.0; P];
        for row in kept {
            for (i, a) in row.cause.iter().enumerate() {
                self.drift_right[i] += weight * a * row.error;
                row.cause.iter().enumerate().for_each(|(j, b)| self.drift.add(i, j, weight * a * b));
                add_times(&mut cross[i], weight * a, &row.file);
            }
            add_times(&mut right, weight * row.error, &row.file);
            for (line, f) in errors.iter_mut().zip(row.file) {
                add_times(line, weight * f, &row.file);
            }
        }
        let view = self.errors_right.len() / COUNT - 1;
        let place = |k: usize| devices.get(k / COUNT).unwrap_or(&view) * COUNT + k % COUNT;
        for k in 0..P {
            self.errors_right[place(k)] += right[k];
            cross.iter().enumerate().for_each(|(i, line)| self.cross.add(i, place(k), line[k]));
            errors[k].iter().enumerate().for_each(|(l, sum)| self.errors.add(place(k), place(l), *sum));
        }
    }

    /// Sums over nothing, for the same devices.
    pub fn empty(&self) -> Self {
        Self::new(self.errors_right.len() / COUNT - 1)
    }

    /// Sums over the residuals of both.
    pub fn plus(&self, other: &Self) -> Self {
        let plus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect();
        Self {
            drift: self.drift.plus(&other.drift),
            cross: self.cross.plus(&other.cross),
            errors: self.errors.plus(&other.errors),
            drift_right: plus(&self.drift_right, &other.drift_right),
            errors_right: plus(&self.errors_right, &other.errors_right),
        }
    }

    /// Sums over the residuals of both, those of the other one with a further drift of their own: the unknowns after those that they share.
    pub fn with_own_drift_of(&self, other: &Self) -> Self {
        let (both, n) = (self.plus(other), UNKNOWNS);
        let part = |i: usize, j: usize| if i.max(j) < n { &both.drift } else { &other.drift };
        Self {
            drift: Dense::from_fn(2 * n, 2 * n, |i, j| part(i, j).at(i % n, j % n)),
            cross: Dense::from_fn(2 * n, both.cross.cols, |i, j| {
                if i < n { both.cross.at(i, j) } else { other.cross.at(i - n, j) }
            }),
            drift_right: [both.drift_right.as_slice(), &other.drift_right].concat(),
            errors: both.errors,
            errors_right: both.errors_right,
        }
    }

    /// Information on the drift, and its product with the drift.
    pub fn without_errors(&self, root: &Root) -> Result<(Dense, Vec<f64>), HealthError> {
        let n = root.transposed.rows;
        if n == 0 {
            return Ok((self.drift.clone(), self.drift_right.clone()));
        }
        let inner = Dense::identity(n).plus(&root.transposed.sandwich(&self.errors));
        let inverse = Factor::new(&inner).map_err(|_| HealthError::Degenerate)?.inverse();
        let cross = self.cross.times(&root.transposed.transposed());
        let taken = cross.sandwich(&inverse);
        let size = self.drift.rows;
        let information = Dense::from_fn(size, size, |i, j| self.drift.at(i, j) - taken.at(i, j));
        let errors = inverse.apply(&root.transposed.apply(&self.errors_right));
        let right = self.drift_right.iter().zip(cross.apply(&errors)).map(|(a, b)| a - b).collect();
        Ok((information, right))
    }
}

/// Adds a multiple of a vector to sums.
fn add_times<const P: usize>(sums: &mut [f64; P], factor: f64, vector: &[f64; P]) {
    sums.iter_mut().zip(vector).for_each(|(sum, v)| *sum += factor * v);
}
