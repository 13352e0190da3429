//! Effect of blur, projector pixels, response and rounding of levels on a sine.

use crate::math::{exp, sin};
use std::f64::consts::PI;

/// Levels of a projector between black and white.
const LEVELS: f64 = 255.0;

/// Contrast that is left of harmonic h of a period: a Gaussian blur, and the light that is even over a projector pixel.
pub fn contrast(blur_px: f64, period_px: f64, harmonic: u32) -> f64 {
    let turns = f64::from(harmonic) / period_px;
    let blur = blur_px * turns;
    let pixel = sin(PI * turns) / (PI * turns);
    exp(-2.0 * PI * PI * blur * blur) * pixel.abs()
}

/// Amplitude of harmonic k of ((1 + cos x)/2)^γ, the first being 1: Π (γ − j + 1)/(γ + j) over j = 2 … k.
fn harmonic(gamma: f64, k: u32) -> f64 {
    (2..=k).map(|j| (gamma - f64::from(j) + 1.0) / (gamma + f64::from(j))).product()
}

/// Root mean square phase error that N even steps leave of the harmonics of a response level^γ, rad.
///
/// Σ I e^{iδ} takes the harmonics mN ± 1 for the fundamental, so that Δφ = Σ (b₍mN+1₎ − b₍mN−1₎) sin(mNφ) to first order, each
/// weakened by the blur beside the fundamental.
pub fn harmonic_error_rad(gamma: f64, blur_px: f64, period_px: f64, steps: u32) -> f64 {
    let left =
        |k: u32| harmonic(gamma, k) * contrast(blur_px, period_px, k) / contrast(blur_px, period_px, 1);
    let ripple = |m: u32| left(m * steps + 1) - left(m * steps - 1);
    (1..=4).map(|m| 0.5 * ripple(m) * ripple(m)).sum::<f64>().sqrt()
}

/// Root mean square phase error of levels that are rounded to 8 bits, rad: √(2/N) (1/√12)/(255/2), and what the blur averages of it
/// between the pixels, which are rounded each by itself.
pub fn rounding_error_rad(blur_px: f64, period_px: f64, steps: u32) -> f64 {
    let averaged = (1.0 / (2.0 * PI.sqrt() * blur_px)).min(1.0).sqrt();
    (2.0 / f64::from(steps) / 12.0).sqrt() / (0.5 * LEVELS) * averaged / contrast(blur_px, period_px, 1)
}

/// Error by response and rounding together, rad.
pub fn error_rad(gamma: f64, blur_px: f64, period_px: f64, steps: u32) -> f64 {
    let (a, b) =
        (harmonic_error_rad(gamma, blur_px, period_px, steps), rounding_error_rad(blur_px, period_px, steps));
    (a * a + b * b).sqrt()
}
