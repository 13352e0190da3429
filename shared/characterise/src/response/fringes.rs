//! The response's exponent from phase-stepped fringes with a white and a black frame, without grey levels.
//!
//! Each pixel's fringes are first scaled by its own white and black frames, so shading, albedo and ambient light drop out; what is
//! left follows `a vᵞ + b` (eq. 3.1) with `v = ½ + ½ cos(φ − δᵢ)` and one γ, a, b for all pixels. Given these, the phase φ of
//! a pixel follows from its undistorted values, and the squares of what the model leaves, over all pixels and steps, are
//! minimised. Light that scatters from bright into dark fringes lifts b above 0 and lowers a + b below 1.

use super::ResponseError;
use super::waveform::PhaseError;
use crate::least_squares::minimise;
use fringe::frame::FrameView;
use fringe::math::{atan2, cos, pow, sincos};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use std::f64::consts::TAU;

/// Pixels that are evaluated at most, evenly taken: γ is then known to some 1e-4 of itself.
const MOST_PIXELS: usize = 20_000;

/// Fewest pixels with contrast.
const LEAST_PIXELS: usize = 500;

/// A pixel is lit when white exceeds black by this fraction of full scale.
const LEAST_CONTRAST: f64 = 0.1;

/// Rounds of the adjustment; some eight are enough.
const MOST_ROUNDS: usize = 60;

/// `I = a vᵞ + b` between black (0) and white (1), from fringes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FringeResponse {
    /// γ of the drawn sinusoid's light.
    pub gamma: f64,
    /// Standard uncertainty of γ from the residuals; pixels count as independent.
    pub u_gamma: f64,
    /// Gain a of the light.
    pub gain: f64,
    /// Offset b of the light.
    pub offset: f64,
    /// Root mean square of the residuals, fraction of white less black.
    pub residual_rms: f64,
    /// Number of pixels used.
    pub pixels: usize,
}

/// The frames of one sine set (steps of 2π/N) with white and black.
pub struct Fringes<'a> {
    /// In order of the steps.
    pub steps: &'a [FrameView<'a>],
    /// Frame with the projector at full level.
    pub white: FrameView<'a>,
    /// Frame with the projector at level zero.
    pub black: FrameView<'a>,
}

/// γ, b, a + b.
type Parameters = Vector3<f64>;

impl FringeResponse {
    /// Fits γ, a and b.
    ///
    /// # Errors
    /// Unequal frames, wrong number of steps, too few lit pixels that do not saturate, no minimum.
    pub fn fit(fringes: &Fringes<'_>, roi: Option<super::Roi>) -> Result<Self, ResponseError> {
        let steps = fringes.steps.len();
        if !(3..=64).contains(&steps) {
            return Err(ResponseError::Steps { steps: steps as u32 });
        }
        let pixels = scaled_pixels(fringes, roi)?;
        let found = pixels.len() / steps;
        if found < LEAST_PIXELS {
            return Err(ResponseError::NoFringes { found, needed: LEAST_PIXELS });
        }
        let unit: Vec<(f64, f64)> = (0..steps).map(|i| sincos(TAU * i as f64 / steps as f64)).collect();
        let residuals = |p: &Parameters| residuals(&pixels, &unit, p);
        adjust(&residuals, pixels.len(), found * (steps - 1)).map(|(p, u_gamma, rms)| Self {
            gamma: p[0],
            u_gamma,
            gain: p[2] - p[1],
            offset: p[1],
            residual_rms: rms,
            pixels: found,
        })
    }

    /// Light as a fraction of white less black for a level 0 … 1.
    pub fn light(&self, level: f64) -> f64 {
        self.offset + self.gain * pow(level.max(0.0), self.gamma)
    }

    /// The level whose light this is, 0 where the light is below b: takes the distortion out of a recorded value.
    pub fn level(&self, light: f64) -> f64 {
        pow(((light - self.offset) / self.gain).max(0.0), 1.0 / self.gamma)
    }

    /// Error of the N-step phase of fringes that are not corrected.
    ///
    /// # Errors
    /// As [`super::waveform::phase_error`].
    pub fn phase_error(&self, steps: u32) -> Result<PhaseError, ResponseError> {
        super::waveform::phase_error(steps, |level| self.light(level))
    }
}

/// (I − black) / (white − black) of each usable pixel, step by step.
fn scaled_pixels(fringes: &Fringes<'_>, roi: Option<super::Roi>) -> Result<Vec<f64>, ResponseError> {
    let (white, black) = (&fringes.white, &fringes.black);
    let size = |f: &FrameView<'_>| (f.width_px, f.height_px, f.full_scale_dn);
    let all = [white, black].into_iter().chain(fringes.steps);
    if let Some((number, other)) = all.enumerate().find(|(_, f)| size(f) != size(white)) {
        let text = |f: &FrameView<'_>| {
            format!("{} × {} px, full at {} DN", f.width_px, f.height_px, f.full_scale_dn)
        };
        return Err(ResponseError::Unequal { number, found: text(other), expected: text(white) });
    }
    let (x, y, width, height) = match roi {
        Some(roi) => {
            roi.check(white.width_px, white.height_px)?;
            (roi.x, roi.y, roi.width_px, roi.height_px)
        }
        None => (0, 0, white.width_px, white.height_px),
    };
    let full = f32::from(white.full_scale_dn);
    let least = LEAST_CONTRAST as f32 * full;
    let usable = |index: &usize| {
        let (w, b) = (white.pixels.get(*index), black.pixels.get(*index));
        w - b >= least && w < full && fringes.steps.iter().all(|f| f.pixels.get(*index) < full)
    };
    let row = |row: u32| {
        let first = row as usize * white.width_px as usize + x as usize;
        first..first + width as usize
    };
    let lit: Vec<usize> = (y..y + height).flat_map(row).filter(usable).collect();
    let mut values = Vec::new();
    for index in lit.iter().step_by(lit.len().div_ceil(MOST_PIXELS).max(1)) {
        let (w, b) = (f64::from(white.pixels.get(*index)), f64::from(black.pixels.get(*index)));
        values.extend(fringes.steps.iter().map(|f| (f64::from(f.pixels.get(*index)) - b) / (w - b)));
    }
    Ok(values)
}

/// Measured less modelled, each pixel with the phase that its undistorted values have.
fn residuals(pixels: &[f64], unit: &[(f64, f64)], p: &Parameters) -> Vec<f64> {
    let (gamma, offset, gain) = (p[0], p[1], p[2] - p[1]);
    let mut out = Vec::with_capacity(pixels.len());
    for pixel in pixels.chunks_exact(unit.len()) {
        let (mut s, mut c) = (0.0, 0.0);
        for (value, (sin, cos)) in pixel.iter().zip(unit) {
            let level = pow(((value - offset) / gain).max(0.0), 1.0 / gamma);
            s += level * sin;
            c += level * cos;
        }
        let phase = atan2(s, c);
        let shift = TAU / unit.len() as f64;
        out.extend(pixel.iter().enumerate().map(|(i, value)| {
            let level = 0.5 + 0.5 * cos(phase - shift * i as f64);
            value - offset - gain * pow(level, gamma)
        }));
    }
    out
}

/// Least squares with differences for derivatives: γ, b, a + b; the standard uncertainty of γ; the rms.
fn adjust(
    residuals: &impl Fn(&Parameters) -> Vec<f64>,
    count: usize,
    freedom: usize,
) -> Result<(Parameters, f64, f64), ResponseError> {
    const STEP: f64 = 1e-4;
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let squares = |p: &Parameters| {
        let allowed = (0.1..=10.0).contains(&p[0]) && p[2] - p[1] > 0.1;
        allowed.then(|| residuals(p).iter().map(|v| v * v).sum::<f64>())
    };
    let linearise = |p: &Parameters| {
        let columns: Vec<Vec<f64>> = (0..3)
            .map(|k| {
                let step = Parameters::ith(k, STEP);
                let (up, down) = (residuals(&(p + step)), residuals(&(p - step)));
                up.iter().zip(&down).map(|(u, d)| (u - d) / (2.0 * STEP)).collect()
            })
            .collect();
        let now = residuals(p);
        let normal = Matrix3::from_fn(|i, j| dot(&columns[i], &columns[j]));
        (normal, Vector3::from_fn(|i, _| -dot(&columns[i], &now)))
    };
    let start = Parameters::new(1.2, 0.0, 1.0);
    let found = minimise(start, MOST_ROUNDS, squares, linearise, |step| step.norm() < 1e-7)
        .ok_or(ResponseError::Undetermined { what: "the exponent from these fringes" })?;
    let u_gamma = (found.inverse[(0, 0)] * found.sum / freedom as f64).max(0.0).sqrt();
    Ok((found.parameters, u_gamma, (found.sum / count as f64).sqrt()))
}
