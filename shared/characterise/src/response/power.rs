//! The response as a power law (eq. 3.1).

use super::{GreyLevel, ResponseError};
use fringe::math::{exp, ln, pow};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use serde::Serialize;

/// Interval in which the exponent is searched.
const GAMMA_RANGE: [f64; 2] = [0.05, 20.0];

/// `I_out = a I_inᵞ + b` (eq. 3.1), least squares in `I_out`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PowerLaw {
    /// Exponent γ of the response.
    pub gamma: f64,
    /// Standard uncertainty of γ, from the residuals with n − 3 degrees of freedom.
    pub u_gamma: f64,
    /// Gain a of the power law, DN.
    pub gain_dn: f64,
    /// Offset b of the power law, DN.
    pub offset_dn: f64,
    /// Root mean square of the residuals, DN.
    pub residual_rms_dn: f64,
}

impl PowerLaw {
    /// Fits: a and b are linear, so the search runs over γ alone, on a grid in ln γ and then by golden section.
    ///
    /// # Errors
    /// Levels that do not determine the three parameters.
    pub fn fit(levels: &[GreyLevel]) -> Result<Self, ResponseError> {
        let undetermined = || ResponseError::Undetermined { what: "the exponent of a power law" };
        if levels.len() < 4 {
            return Err(undetermined());
        }
        let squares = |log_gamma: f64| {
            let gamma = exp(log_gamma);
            linear(levels, gamma).map_or(f64::INFINITY, |ab| squares(levels, gamma, ab))
        };
        let ends = GAMMA_RANGE.map(ln);
        let gamma = exp(minimum(ends, 120, squares));
        let [a, b] = linear(levels, gamma).ok_or_else(undetermined)?;
        let sum = self::squares(levels, gamma, [a, b]);
        let normal: Matrix3<f64> = levels
            .iter()
            .map(|g| {
                let power = pow(g.level, gamma);
                let by_gamma = if g.level > 0.0 { a * power * ln(g.level) } else { 0.0 };
                let row = Vector3::new(by_gamma, power, 1.0);
                row * row.transpose()
            })
            .sum();
        let covariance = normal.try_inverse().ok_or_else(undetermined)?;
        let variance = covariance[(0, 0)] * sum / (levels.len() - 3) as f64;
        let fit = Self {
            gamma,
            u_gamma: variance.max(0.0).sqrt(),
            gain_dn: a,
            offset_dn: b,
            residual_rms_dn: (sum / levels.len() as f64).sqrt(),
        };
        let all = [fit.gamma, fit.u_gamma, fit.gain_dn, fit.offset_dn, fit.residual_rms_dn];
        if all.iter().all(|v| v.is_finite()) { Ok(fit) } else { Err(undetermined()) }
    }
}

/// a and b for a given γ.
fn linear(levels: &[GreyLevel], gamma: f64) -> Option<[f64; 2]> {
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for g in levels {
        let row = Vector2::new(pow(g.level, gamma), 1.0);
        normal += row * row.transpose();
        right += row * g.mean_dn;
    }
    normal.try_inverse().map(|inverse| (inverse * right).into())
}

fn squares(levels: &[GreyLevel], gamma: f64, [a, b]: [f64; 2]) -> f64 {
    levels
        .iter()
        .map(|g| {
            let residual = g.mean_dn - a * pow(g.level, gamma) - b;
            residual * residual
        })
        .sum()
}

/// Place of the smallest value: the best of a grid, then golden section between its neighbours.
fn minimum([low, high]: [f64; 2], cells: usize, value: impl Fn(f64) -> f64) -> f64 {
    let at = |i: usize| low + (high - low) * i as f64 / cells as f64;
    let best = (0..=cells).min_by(|a, b| value(at(*a)).total_cmp(&value(at(*b)))).unwrap_or(0);
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut left, mut right) = (at(best.saturating_sub(1)), at((best + 1).min(cells)));
    for _ in 0..60 {
        let (x, y) = (right - ratio * (right - left), left + ratio * (right - left));
        if value(x) < value(y) { right = y } else { left = x }
    }
    0.5 * (left + right)
}
