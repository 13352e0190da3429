//! Least squares of a grey-value model over the pixels of a window.

use super::normal::{Model, Normal, Pixels, Range, normal};
use nalgebra::{Cholesky, Const, Matrix2, SVector};

/// Result of the least-squares fit.
#[derive(Debug, Clone)]
pub(crate) struct Fit<const N: usize> {
    pub parameters: SVector<f64, N>,
    /// Standard deviation of the residuals over the degrees of freedom, DN.
    pub residual_dn: f64,
    normal: Cholesky<f64, Const<N>>,
}

impl<const N: usize> Fit<N> {
    /// Covariances of one parameter with all: a column of the inverse normal matrix times the variance of the residuals.
    pub fn covariance(&self, of: usize) -> SVector<f64, N> {
        let unit = SVector::from_fn(|i, _| f64::from(u8::from(i == of)));
        self.normal.solve(&unit) * (self.residual_dn * self.residual_dn)
    }

    /// Covariance of the position.
    pub fn covariance_px2(&self) -> Matrix2<f64> {
        let [x, y] = [0, 1].map(|of| self.covariance(of));
        Matrix2::new(x[0], y[0], x[1], y[1])
    }
}

/// When a fit ends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ending {
    /// Steps end with the one that moves no parameter by more than this part of its standard deviation.
    pub settled_sigmas: f64,
    /// A fit that moves the position further than this, px, has found something else.
    pub leash_px: f64,
}

/// The end of a fit whose result counts: the step that is this small is still taken. What it leaves adds 4·10⁻⁵ to the
/// variance in the mean of 450 corners, 10⁻³ at most.
pub(crate) const SETTLED_SIGMAS: f64 = 0.2;
/// Without noise a standard deviation is no measure: smaller steps than this, px, end a fit too.
const SETTLED_PX: f64 = 2e-5;
const MAX_STEPS: usize = 30;
/// Damping of the first step, relative to the diagonal.
const FIRST_DAMPING: f64 = 1e-3;
/// A step with more damping than this is no step to the minimum.
const LINEAR: f64 = 1e-2;

/// Levenberg–Marquardt from a start; `None` when it does not settle or the window does not determine the model.
pub(crate) fn fit<const N: usize>(
    model: &impl Model<N>,
    start: SVector<f64, N>,
    pixels: &Pixels,
    range: Range,
    ending: Ending,
) -> Option<Fit<N>> {
    let mut at = start;
    let mut here = normal(model, &at, pixels, range);
    let is_near =
        |at: &SVector<f64, N>| (at[0] - start[0]).abs().max((at[1] - start[1]).abs()) <= ending.leash_px;
    let mut damping = FIRST_DAMPING;
    for _ in 0..MAX_STEPS {
        let mut damped = here.matrix;
        for i in 0..N {
            damped[(i, i)] += damping * here.matrix[(i, i)] + 1e-12;
        }
        let step = Cholesky::new(damped)?.solve(&here.vector);
        let next = at + step;
        // δᵀHδ/s² bounds the square of each parameter's step in its own standard deviations; Hδ is the vector, but for damping.
        let left = step.dot(&here.vector) / (ending.settled_sigmas * ending.settled_sigmas * here.variance());
        // So far within the noise the model is linear: the last step needs no look at the image.
        if left < 1.0 && damping < LINEAR {
            return is_near(&next).then(|| finish(&next, &here)).flatten();
        }
        let there = normal(model, &next, pixels, range);
        let settled = left < 1.0 || step[0].abs().max(step[1].abs()) < SETTLED_PX;
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
        if !is_near(&at) {
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
    let fit = Fit { parameters: *at, residual_dn: variance.sqrt(), normal: Cholesky::new(here.matrix)? };
    let finite = at.iter().chain(fit.covariance_px2().iter()).all(|v| v.is_finite());
    finite.then_some(fit)
}
