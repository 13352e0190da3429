//! Known shifts: least squares for any of them, and the closed form of three.

use super::{Limits, Method, PixelPhase, Stack, WrapError, Wrapped, polar};
use crate::math::{cos, sin, sincos};
use nalgebra::{Matrix3, Vector3};

/// The least-squares fit of A, B cos φ and B sin φ to frames with known shifts, which is linear in the grey values.
///
/// Iᵢ = A + B cos φ cos δᵢ + B sin φ sin δᵢ gives x = (MᵀM)⁻¹ Mᵀ I with rows (1, cos δᵢ, sin δᵢ) of M (eq. 2.15). For even steps it
/// is eq. 2.16.
#[derive(Debug, Clone, PartialEq)]
pub struct LeastSquares {
    /// Weights of frame i in A, B cos φ, B sin φ.
    pub weights: Vec<[f64; 3]>,
    /// Variance of B cos φ, variance of B sin φ and their covariance, per unit variance of a grey value.
    pub covariance: [f64; 3],
}

impl LeastSquares {
    /// Prepares the weights; `None` where the shifts leave an unknown open.
    pub fn new(shifts_rad: &[f64]) -> Option<Self> {
        let row = |shift: &f64| {
            let (s, c) = sincos(*shift);
            Vector3::new(1.0, c, s)
        };
        let normal: Matrix3<f64> = shifts_rad.iter().map(|s| row(s) * row(s).transpose()).sum();
        // The inverse of a matrix with determinant below rounding is noise.
        let n = shifts_rad.len() as f64;
        if normal.determinant() <= 1e-12 * n * n * n {
            return None;
        }
        let inverse = normal.try_inverse()?;
        let weights = shifts_rad.iter().map(|shift| (inverse * row(shift)).into()).collect();
        Some(Self { weights, covariance: [inverse[(1, 1)], inverse[(2, 2)], inverse[(1, 2)]] })
    }

    /// A, B cos φ, B sin φ of the grey values of one pixel.
    pub fn fit(&self, values: &[f64]) -> [f64; 3] {
        let mut x = [0.0; 3];
        for (value, weights) in values.iter().zip(&self.weights) {
            for (x, weight) in x.iter_mut().zip(weights) {
                *x += weight * value;
            }
        }
        x
    }

    /// Standard deviation of the phase for unit noise and unit modulation in direction (cos φ, sin φ) = (c, s)/B.
    pub fn noise(&self, c: f64, s: f64) -> f64 {
        let [cc, ss, cs] = self.covariance;
        (cc * s * s + ss * c * c - 2.0 * cs * c * s).max(0.0).sqrt()
    }

    /// Its root mean square over all phases: √(2/N) for even steps.
    pub fn mean_noise(&self) -> f64 {
        (0.5 * (self.covariance[0] + self.covariance[1])).sqrt()
    }
}

/// Least squares with the stack's shifts.
pub(super) fn least_squares(stack: &Stack, limits: &Limits) -> Result<Wrapped, WrapError> {
    let method = Method::LeastSquares.name();
    let fit = LeastSquares::new(stack.shifts_rad).ok_or_else(|| match stack.frames.len() {
        got @ 0..=2 => WrapError::Frames { method, needed: "at least 3 frames", got },
        _ => WrapError::Shifts { method, needed: "needs three different shifts", got: stack.degrees() },
    })?;
    Ok(stack.map(limits, |values| {
        let [background_dn, c, s] = fit.fit(values);
        let (phase_rad, modulation_dn) = polar(s, c);
        let noise = fit.noise(c / modulation_dn, s / modulation_dn);
        let sigma_rad = noise * limits.noise_dn(background_dn) / modulation_dn;
        PixelPhase { phase_rad, modulation_dn, background_dn, sigma_rad }
    }))
}

/// Three frames with shifts δ₁ − α, δ₁, δ₁ + α (eq. 2.11, 2.12, whose frames stand in the other order):
/// tan θ = (1 − cos α)(I₂ − I₀) / (sin α (2 I₁ − I₀ − I₂)), θ = φ − δ₁.
pub(super) fn three_step(stack: &Stack, limits: &Limits) -> Result<Wrapped, WrapError> {
    let method = Method::ThreeStep.name();
    if stack.frames.len() != 3 {
        return Err(WrapError::Frames { method, needed: "exactly 3 frames", got: stack.frames.len() });
    }
    let needed = "needs three equal steps other than 0 and 180 degrees";
    let step_rad = stack
        .equal_step_rad()
        .filter(|a| sin(*a).abs() > 1e-3)
        .ok_or_else(|| WrapError::Shifts { method, needed, got: stack.degrees() })?;
    let (sin_a, cos_a) = (sin(step_rad), cos(step_rad));
    let middle_rad = stack.shifts_rad[1];
    Ok(stack.map(limits, |i| {
        let (n, d) = ((1.0 - cos_a) * (i[2] - i[0]), sin_a * (2.0 * i[1] - i[0] - i[2]));
        let (theta, length) = polar(n, d);
        // n = 2 B sin α (1 − cos α) sin θ, d = 2 B sin α (1 − cos α) cos θ; a negative factor turns both.
        let factor = 2.0 * sin_a * (1.0 - cos_a);
        let theta_rad = if factor < 0.0 { theta + std::f64::consts::PI } else { theta };
        let modulation_dn = length / factor.abs();
        let background_dn = (i[0] + i[2] - 2.0 * i[1] * cos_a) / (2.0 * (1.0 - cos_a));
        let (s, c) = (n / length, d / length);
        let (var_n, var_d) = (2.0 * (1.0 - cos_a) * (1.0 - cos_a), 6.0 * sin_a * sin_a);
        let noise = (var_n * c * c + var_d * s * s).sqrt() / factor.abs();
        let sigma_rad = noise * limits.noise_dn(background_dn) / modulation_dn;
        PixelPhase { phase_rad: theta_rad + middle_rad, modulation_dn, background_dn, sigma_rad }
    }))
}
