//! Harmonics and phase error of a sinusoid that a response distorts, as the response predicts them.

use super::ResponseError;
use fringe::math::{atan2, cos, sincos, wrap_rad};
use serde::Serialize;
use std::f64::consts::TAU;

/// Phases over one fringe: harmonics up to the 500th do not fold into the first ones.
const PHASES: usize = 1024;

/// Amplitudes of the 2nd to 5th harmonic relative to the first.
pub type Harmonics = [f64; 4];

/// Error of an N-step phase.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PhaseError {
    /// Number N of steps.
    pub steps: u32,
    /// Root mean square over one fringe, rad.
    pub rms_rad: f64,
    /// Largest magnitude over one fringe, rad.
    pub peak_rad: f64,
}

/// Harmonics of `light(½ + ½ cos φ)`; `light` takes a level 0 … 1.
pub fn harmonics(light: impl Fn(f64) -> f64) -> Harmonics {
    let values: Vec<f64> = (0..PHASES).map(|i| light(0.5 + 0.5 * cos(phase_rad(i)))).collect();
    let amplitude = |order: usize| {
        let (re, im) = values.iter().enumerate().fold((0.0, 0.0), |(re, im), (i, value)| {
            let (sin, cos) = sincos(phase_rad(i * order % PHASES));
            (re + value * cos, im - value * sin)
        });
        (re * re + im * im).sqrt()
    };
    let first = amplitude(1);
    std::array::from_fn(|i| amplitude(i + 2) / first)
}

/// Error of the N-step phase (steps of 2π/N) of a sinusoid that arrives as `light(level)`.
///
/// # Errors
/// [`ResponseError::Steps`].
pub fn phase_error(steps: u32, light: impl Fn(f64) -> f64) -> Result<PhaseError, ResponseError> {
    if !(3..=64).contains(&steps) {
        return Err(ResponseError::Steps { steps });
    }
    let shifts: Vec<f64> = (0..steps).map(|i| TAU * f64::from(i) / f64::from(steps)).collect();
    let error = |index: usize| {
        let truth = phase_rad(index);
        let (mut s, mut c) = (0.0, 0.0);
        for shift in &shifts {
            let value = light(0.5 + 0.5 * cos(truth - shift));
            let (sin, cos) = sincos(*shift);
            s += value * sin;
            c += value * cos;
        }
        wrap_rad(atan2(s, c) - truth)
    };
    let errors: Vec<f64> = (0..PHASES).map(error).collect();
    let squares: f64 = errors.iter().map(|e| e * e).sum();
    Ok(PhaseError {
        steps,
        rms_rad: (squares / PHASES as f64).sqrt(),
        peak_rad: errors.iter().fold(0.0, |m: f64, e| m.max(e.abs())),
    })
}

fn phase_rad(index: usize) -> f64 {
    TAU * index as f64 / PHASES as f64
}
