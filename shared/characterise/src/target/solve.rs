//! Least squares of a grey-value model over the pixels of a window.

use nalgebra::{Cholesky, SMatrix, SVector};

/// One pixel of a window: position relative to the window's origin, px, and grey value, DN.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub x: f64,
    pub y: f64,
    pub value: f64,
}

/// A model of N parameters, of which the first two are the position sought.
pub(crate) trait Model<const N: usize> {
    /// What all pixels share at one set of parameters.
    type Prepared;
    /// Computes what all pixels share.
    fn prepare(&self, parameters: &SVector<f64, N>) -> Self::Prepared;
    /// Value and derivative by each parameter.
    fn evaluate(&self, prepared: &Self::Prepared, x: f64, y: f64) -> (f64, [f64; N]);
}

/// Result of the least-squares fit.
#[derive(Debug, Clone)]
pub(crate) struct Fit<const N: usize> {
    pub parameters: SVector<f64, N>,
    /// Inverse normal matrix times the variance of the residuals.
    pub covariance: SMatrix<f64, N, N>,
    /// Standard deviation of the residuals over the degrees of freedom, DN.
    pub residual_dn: f64,
}

/// Grey values at which the sensor is clipped.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Range {
    empty_dn: f64,
    full_dn: f64,
}

/// With fewer pixels between empty and full than this part, an image has two levels by intent, not by too much light.
const BETWEEN: f64 = 0.04;

impl Range {
    /// The range of a window of pixels.
    pub fn of(samples: &[Sample], full_scale_dn: f64) -> Self {
        let between = samples.iter().filter(|s| s.value > 0.0 && s.value < full_scale_dn).count();
        if (between as f64) < BETWEEN * samples.len() as f64 {
            return Self { empty_dn: f64::NEG_INFINITY, full_dn: f64::INFINITY };
        }
        Self { empty_dn: 0.0, full_dn: full_scale_dn }
    }

    /// A full pixel gives only a lower limit of the light, an empty one only an upper limit.
    fn hides(&self, seen: f64, model: f64) -> bool {
        (seen >= self.full_dn && model >= self.full_dn) || (seen <= self.empty_dn && model <= self.empty_dn)
    }
}

/// When a fit ends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ending {
    /// Steps end when no parameter moves by more than this part of its standard deviation.
    pub settled_sigmas: f64,
    /// A fit that moves the position further than this, px, has found something else.
    pub leash_px: f64,
}

/// The end of a fit whose result counts: what is left adds less than 10⁻⁴ to the variance.
pub(crate) const SETTLED_SIGMAS: f64 = 0.01;
/// Without noise a standard deviation is no measure: smaller steps than this, px, end a fit too.
const SETTLED_PX: f64 = 2e-5;
const MAX_STEPS: usize = 30;

struct Normal<const N: usize> {
    matrix: SMatrix<f64, N, N>,
    vector: SVector<f64, N>,
    cost: f64,
    /// Number of pixels that were not clipped.
    count: usize,
}

impl<const N: usize> Normal<N> {
    /// Variance of the residuals.
    fn variance(&self) -> f64 {
        self.cost / self.count.saturating_sub(N).max(1) as f64
    }
}

/// Pixels whose products are added at once: the sums then stay in registers for four pixels.
const AT_ONCE: usize = 4;

fn normal<const N: usize>(
    model: &impl Model<N>,
    at: &SVector<f64, N>,
    samples: &[Sample],
    range: Range,
) -> Normal<N> {
    let mut sums = Sums { matrix: [[0.0; N]; N], vector: [0.0; N], cost: 0.0 };
    let (mut slopes, mut residuals, mut filled) = ([[0.0; N]; AT_ONCE], [0.0; AT_ONCE], 0);
    let mut count = 0;
    let prepared = model.prepare(at);
    for sample in samples {
        let (value, slope) = model.evaluate(&prepared, sample.x, sample.y);
        if range.hides(sample.value, value) {
            continue;
        }
        slopes[filled] = slope;
        residuals[filled] = sample.value - value;
        filled += 1;
        count += 1;
        if filled == AT_ONCE {
            sums.add(&slopes, &residuals);
            filled = 0;
        }
    }
    slopes[filled..].fill([0.0; N]);
    residuals[filled..].fill(0.0);
    sums.add(&slopes, &residuals);
    // A parameter without influence is held.
    for i in 0..N {
        if sums.matrix[i][i] == 0.0 {
            sums.matrix[i][i] = 1.0;
        }
    }
    Normal { matrix: SMatrix::from(sums.matrix), vector: SVector::from(sums.vector), cost: sums.cost, count }
}

/// JᵀJ, Jᵀr and rᵀr.
struct Sums<const N: usize> {
    matrix: [[f64; N]; N],
    vector: [f64; N],
    cost: f64,
}

impl<const N: usize> Sums<N> {
    /// Both halves of the symmetric matrix: whole rows take less time than ragged ones.
    fn add(&mut self, [a, b, c, d]: &[[f64; N]; AT_ONCE], r: &[f64; AT_ONCE]) {
        for (i, row) in self.matrix.iter_mut().enumerate() {
            for (j, sum) in row.iter_mut().enumerate() {
                *sum += (a[i] * a[j] + b[i] * b[j]) + (c[i] * c[j] + d[i] * d[j]);
            }
        }
        for (i, sum) in self.vector.iter_mut().enumerate() {
            *sum += (a[i] * r[0] + b[i] * r[1]) + (c[i] * r[2] + d[i] * r[3]);
        }
        self.cost += (r[0] * r[0] + r[1] * r[1]) + (r[2] * r[2] + r[3] * r[3]);
    }
}

/// Levenberg–Marquardt from a start; `None` when it does not settle or the window does not determine the model.
pub(crate) fn fit<const N: usize>(
    model: &impl Model<N>,
    start: SVector<f64, N>,
    samples: &[Sample],
    range: Range,
    ending: Ending,
) -> Option<Fit<N>> {
    let mut at = start;
    let mut here = normal(model, &at, samples, range);
    let mut damping = 1e-3;
    for _ in 0..MAX_STEPS {
        let mut damped = here.matrix;
        for i in 0..N {
            damped[(i, i)] += damping * here.matrix[(i, i)] + 1e-12;
        }
        let step = Cholesky::new(damped)?.solve(&here.vector);
        let next = at + step;
        let there = normal(model, &next, samples, range);
        // δᵀHδ/s² bounds the square of each parameter's step in its own standard deviations; Hδ is the vector, but for damping.
        let settled = step[0].abs().max(step[1].abs()) < SETTLED_PX
            || step.dot(&here.vector) < ending.settled_sigmas * ending.settled_sigmas * here.variance();
        if !there.cost.is_finite() || there.cost > here.cost {
            // At the bottom the cost is flat to rounding: a tiny step that does not lower it ends the search.
            if settled {
                return finish(&at, &here);
            }
            damping *= 10.0;
            if damping > 1e8 {
                return None;
            }
            continue;
        }
        at = next;
        here = there;
        if (at[0] - start[0]).abs().max((at[1] - start[1]).abs()) > ending.leash_px {
            return None;
        }
        damping = (damping * 0.1).max(1e-9);
        if settled {
            return finish(&at, &here);
        }
    }
    None
}

fn finish<const N: usize>(at: &SVector<f64, N>, here: &Normal<N>) -> Option<Fit<N>> {
    if here.count < 2 * N {
        return None;
    }
    let variance = here.variance();
    let covariance = Cholesky::new(here.matrix)?.inverse() * variance;
    let finite = at.iter().chain(covariance.iter()).all(|v| v.is_finite());
    finite.then(|| Fit { parameters: *at, covariance, residual_dn: variance.sqrt() })
}
