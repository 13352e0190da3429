//! Methods that do not trust the projector's steps: Carré's four frames and Hariharan's five.

use super::{Limits, Method, PixelPhase, Stack, WrapError, Wrapped, polar};
use crate::math::{acos, atan, cos, sin};
use std::f64::consts::FRAC_PI_2;

/// Hariharan's method is exact for 90° and errs by the square of the deviation; beyond this it is the wrong one, rad.
const MOST_DEVIATION_RAD: f64 = 0.35;
/// Pixels that give the step: enough for a median.
const SAMPLES: usize = 20_000;

/// Carré's four frames with equal steps 2α. With θ = φ − mean shift:
/// I₀ … I₃ = A + B cos(θ + 3α), cos(θ + α), cos(θ − α), cos(θ − 3α); u = I₂ − I₁, v = I₃ − I₀,
/// a = 3u − v = 8B sin θ sin³α, b = u + v = 8B sin θ sin α cos²α, d = I₁ + I₂ − I₀ − I₃ = 8B cos θ cos α sin²α,
/// so tan θ = ±√(ab) / d with the sign of u, and tan²α = a/b.
///
/// α is free at every pixel. Where noise makes ab negative, near θ = 0 and π, its size is taken (Creath, 1988). Only the
/// mean shift, which is constant over the image, needs one α: the median of all pixels.
pub(super) fn carre(stack: &Stack, limits: &Limits) -> Result<Wrapped, WrapError> {
    let method = Method::Carre.name();
    if stack.frames.len() != 4 {
        return Err(WrapError::Frames { method, needed: "exactly 4 frames", got: stack.frames.len() });
    }
    let nominal_rad = equal(stack, method, "needs four equal steps below 180 degrees")?;
    let found = median(stack, limits, |i| {
        let (u, v) = (i[2] - i[1], i[3] - i[0]);
        let (a, b) = (3.0 * u - v, u + v);
        (a * b > 0.0).then(|| (atan((a / b).sqrt()), u.abs()))
    });
    let alpha_rad = found.ok_or(WrapError::NoStep { method })?;
    let turned = nominal_rad.signum();
    let middle_rad = stack.shifts_rad[0] + 3.0 * alpha_rad * turned;
    let (sin_a, cos_a) = (sin(alpha_rad), cos(alpha_rad));
    let scale = 8.0 * sin_a * sin_a * cos_a;
    // Variances of n = ±√(ab) and d per unit noise: ∂n/∂u = (3b + a)/2n, ∂n/∂v = (a − b)/2n up to sign, t = a/b.
    let t = (sin_a / cos_a) * (sin_a / cos_a);
    let (var_n, var_d) = (((3.0 + t) * (3.0 + t) + (t - 1.0) * (t - 1.0)) / (2.0 * t), 4.0);
    Ok(stack.map(limits, |i| {
        let (u, v) = (i[2] - i[1], i[3] - i[0]);
        let n = (((3.0 * u - v) * (u + v)).abs()).sqrt().copysign(u);
        let (theta_rad, length) = polar(n, i[1] + i[2] - i[0] - i[3]);
        let modulation_dn = length / scale;
        let (s, c) = (n / length, (i[1] + i[2] - i[0] - i[3]) / length);
        let noise = (var_n * c * c + var_d * s * s).sqrt() / scale;
        let background_dn = background(i, modulation_dn, theta_rad, alpha_rad);
        let sigma_rad = noise * limits.noise_dn(background_dn) / modulation_dn;
        PixelPhase { phase_rad: turned * theta_rad + middle_rad, modulation_dn, background_dn, sigma_rad }
    }))
}

/// A from the mean of the four frames: ¼ ΣI = A + B cos θ cos α cos 2α.
fn background(i: &[f64], modulation_dn: f64, theta_rad: f64, alpha_rad: f64) -> f64 {
    0.25 * i.iter().sum::<f64>() - modulation_dn * cos(theta_rad) * cos(alpha_rad) * cos(2.0 * alpha_rad)
}

/// Hariharan's five frames with steps α ≈ 90°: tan θ = 2 (I₃ − I₁) / (2 I₂ − I₀ − I₄), θ = φ − δ₂.
///
/// For other steps tan θ is measured as tan θ / sin α: an error of second order in the deviation from 90°.
pub(super) fn hariharan(stack: &Stack, limits: &Limits) -> Result<Wrapped, WrapError> {
    let method = Method::Hariharan.name();
    if stack.frames.len() != 5 {
        return Err(WrapError::Frames { method, needed: "exactly 5 frames", got: stack.frames.len() });
    }
    let needed = "needs five equal steps of 70 to 110 degrees";
    let nominal_rad = equal(stack, method, needed)?;
    if (nominal_rad.abs() - FRAC_PI_2).abs() > MOST_DEVIATION_RAD {
        return Err(WrapError::Shifts { method, needed, got: stack.degrees() });
    }
    let found = median(stack, limits, |i| {
        let (far, near) = (i[4] - i[0], i[3] - i[1]);
        let ratio = far / (2.0 * near);
        (ratio.abs() <= 1.0).then(|| (acos(ratio), near.abs()))
    });
    let step_rad = found.ok_or(WrapError::NoStep { method })?;
    let turned = nominal_rad.signum();
    // The middle of the frames is where the measured steps put it, not where they were meant to.
    let middle_rad = stack.shifts_rad[0] + 2.0 * step_rad * turned;
    let sin_a = sin(step_rad);
    Ok(stack.map(limits, |i| {
        let (n, d) = (2.0 * (i[3] - i[1]), 2.0 * i[2] - i[0] - i[4]);
        let (theta_rad, length) = polar(n, d);
        let (s, c) = (n / length, d / length);
        // n = 4 B sin α sin θ, d = 4 B sin²α cos θ.
        let size = ((s / sin_a) * (s / sin_a) + (c / (sin_a * sin_a)) * (c / (sin_a * sin_a))).sqrt();
        let modulation_dn = 0.25 * length * size;
        // For 90° the five cosines sum to -cos θ.
        let background_dn = (i.iter().sum::<f64>() + modulation_dn * c) / 5.0;
        let noise = (8.0 * c * c + 6.0 * s * s).sqrt() / 4.0;
        let sigma_rad = noise * limits.noise_dn(background_dn) / modulation_dn;
        PixelPhase { phase_rad: turned * theta_rad + middle_rad, modulation_dn, background_dn, sigma_rad }
    }))
}

/// The nominal step, which must be equal and below 180°.
fn equal(stack: &Stack, method: &'static str, needed: &'static str) -> Result<f64, WrapError> {
    stack
        .equal_step_rad()
        .filter(|step| step.abs() < std::f64::consts::PI - 1e-3)
        .ok_or_else(|| WrapError::Shifts { method, needed, got: stack.degrees() })
}

/// Median of an angle over pixels; the angle of a pixel counts where there is enough light: `angle` gives angle and
/// light, and only the brighter half of the pixels votes.
fn median(stack: &Stack, limits: &Limits, angle: impl Fn(&[f64]) -> Option<(f64, f64)>) -> Option<f64> {
    let mut values = vec![0.0; stack.frames.len()];
    let mut votes = Vec::new();
    for index in (0..stack.len()).step_by((stack.len() / SAMPLES).max(1)) {
        if stack.pixel(index, limits.clipped_dn, &mut values)
            && let Some((angle, light)) = angle(&values)
            && angle.is_finite()
            && light > limits.least_modulation_dn
        {
            votes.push((light, angle));
        }
    }
    votes.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.total_cmp(&b.1)));
    votes.truncate(votes.len().div_ceil(2));
    votes.sort_by(|a, b| a.1.total_cmp(&b.1));
    votes.get(votes.len() / 2).map(|vote| vote.1)
}
