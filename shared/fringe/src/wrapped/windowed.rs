//! Windowed Fourier filtering of a wrapped phase (Kemao, Appl. Opt. 43, 2695, 2004; WFF of exponential phase fields).
//!
//! The field B e^{iφ} is split by Gaussian windows into local frequencies; what is weaker than the noise is dropped, and the rest is put
//! together again: f' = Σ_{ξη} [ (f ⊗ g_{ξη}) thresholded ] ⊗ g_{ξη} Δξ Δη / 4π², g_{ξη} = g(x, y) e^{i(ξx + ηy)}, ‖g‖ = 1. The range of
//! frequencies is found from the differences of neighbouring phases. Masked pixels enter as zero and stay masked.

use super::{Wrapped, wrap_f32};
use crate::math::statistics::median;
use crate::math::{atan2, exp, sincos, wrap_rad};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// What the filter may decide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowedSettings {
    /// Standard deviation of the window, px.
    pub window_px: f64,
    /// Coefficients below so many standard deviations of their noise are dropped.
    pub threshold_sigmas: f64,
}

impl Default for WindowedSettings {
    fn default() -> Self {
        Self { window_px: 4.0, threshold_sigmas: 3.0 }
    }
}

/// Most frequencies along one axis: the whole circle at the default window.
const MOST_FREQUENCIES: usize = 32;
/// Window half-width in standard deviations: what lies beyond holds 1 % of the energy.
const REACH: f64 = 2.5;

/// Least share of the measured modulation in the filtered field. At a straight end of the mask a half of it is held; where it is
/// less, two phases are mixed, or there is too little to the sides.
const LEAST_HELD: f64 = 0.4;

/// Real and imaginary plane.
#[derive(Clone)]
struct Field {
    re: Vec<f32>,
    im: Vec<f32>,
}

impl Field {
    fn zeros(n: usize) -> Self {
        Self { re: vec![0.0; n], im: vec![0.0; n] }
    }
}

/// Filters the phase of a map; σ is what the kept coefficients let through. Mask and modulation stay as measured, and so does the phase
/// where little of the field is held: at steps of the phase and in the dark.
pub fn filter(map: &Wrapped, settings: &WindowedSettings) -> Wrapped {
    let (width, n) = (map.width_px as usize, map.len());
    let mut out = map.clone();
    let Some(noise) = median_noise(map) else { return out };
    let field = field(map);
    let along_x = frequencies(&differences(map, 1, width), settings.window_px);
    let along_y = frequencies(&differences(map, width, width), settings.window_px);
    // ‖g‖ = 1: the noise of a coefficient is that of the field, √2 σ for both parts.
    let threshold = (settings.threshold_sigmas * std::f64::consts::SQRT_2 * noise) as f32;
    let mut sum = Field::zeros(n);
    let mut kept = vec![0_u16; n];
    for xi in &along_x {
        let row_kernel = Kernel::new(*xi, settings.window_px);
        let rows = row_kernel.along_rows(&field, width);
        let mut back = Field::zeros(n);
        for eta in &along_y {
            let kernel = Kernel::new(*eta, settings.window_px);
            let mut coefficients = Field::zeros(n);
            kernel.add_along_columns(&rows, width, &mut coefficients);
            drop_weak(&mut coefficients, threshold, &mut kept);
            kernel.add_along_columns(&coefficients, width, &mut back);
        }
        let turned = row_kernel.along_rows(&back, width);
        sum.re.iter_mut().zip(&turned.re).for_each(|(a, b)| *a += b);
        sum.im.iter_mut().zip(&turned.im).for_each(|(a, b)| *a += b);
    }
    let cell = 1.0 / (settings.window_px * settings.window_px * TAU * TAU);
    for i in (0..n).filter(|i| map.valid[*i] == 1) {
        let (re, im) = (f64::from(sum.re[i]) * cell, f64::from(sum.im[i]) * cell);
        if kept[i] == 0 || (re * re + im * im).sqrt() < LEAST_HELD * f64::from(map.modulation[i]) {
            continue;
        }
        out.phase_rad[i] = wrap_f32(atan2(im, re));
        // White noise spreads evenly over the plane of frequencies; what was kept of its area passes.
        let passed = (f64::from(kept[i]) * cell).min(1.0).sqrt();
        out.sigma_rad[i] = map.sigma_rad[i] * passed as f32;
    }
    out
}

fn field(map: &Wrapped) -> Field {
    let mut field = Field::zeros(map.len());
    for i in (0..map.len()).filter(|i| map.valid[*i] == 1) {
        let (s, c) = sincos(f64::from(map.phase_rad[i]));
        field.re[i] = (f64::from(map.modulation[i]) * c) as f32;
        field.im[i] = (f64::from(map.modulation[i]) * s) as f32;
    }
    field
}

/// Median of B σ over the valid pixels, DN; `None` without any.
fn median_noise(map: &Wrapped) -> Option<f64> {
    let valid = (0..map.len()).filter(|i| map.valid[*i] == 1);
    let mut noise: Vec<f32> = valid.map(|i| map.modulation[i] * map.sigma_rad[i]).collect();
    median(&mut noise).map(f64::from)
}

/// Wrapped differences of valid neighbours at `stride`, of every 7th pixel.
fn differences(map: &Wrapped, stride: usize, width: usize) -> Vec<f64> {
    let inside = |i: &usize| if stride == 1 { i % width + 1 < width } else { i + stride < map.len() };
    let both = |i: &usize| map.valid[*i] == 1 && map.valid[*i + stride] == 1;
    let pairs = (0..map.len()).step_by(7).filter(inside).filter(both);
    pairs.map(|i| wrap_rad(f64::from(map.phase_rad[i + stride]) - f64::from(map.phase_rad[i]))).collect()
}

/// Frequencies at steps of 1/window from the 2 % to the 98 % quantile, with two windows' widths to both sides.
fn frequencies(differences: &[f64], window_px: f64) -> Vec<f64> {
    let mut sorted = differences.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |p: f64| sorted.get((p * sorted.len() as f64) as usize).copied().unwrap_or(0.0);
    let step = 1.0 / window_px;
    let (low, high) = (at(0.02) - 2.0 * step, at(0.98) + 2.0 * step);
    let count = (((high - low) / step).ceil() as usize + 1).clamp(1, MOST_FREQUENCIES);
    let middle = 0.5 * (low + high);
    (0..count).map(|k| middle + (k as f64 - 0.5 * (count - 1) as f64) * step).collect()
}

/// g(t) e^{iξt} with Σ g² = 1.
struct Kernel {
    re: Vec<f32>,
    im: Vec<f32>,
}

impl Kernel {
    fn new(frequency: f64, window_px: f64) -> Self {
        let reach = (REACH * window_px).ceil() as i32;
        let gauss = |t: i32| exp(-0.5 * f64::from(t * t) / (window_px * window_px));
        let energy: f64 = (-reach..=reach).map(|t| gauss(t) * gauss(t)).sum();
        let taps = (-reach..=reach).map(|t| {
            let (s, c) = sincos(frequency * f64::from(t));
            let g = gauss(t) / energy.sqrt();
            ((g * c) as f32, (g * s) as f32)
        });
        let (re, im) = taps.unzip();
        Self { re, im }
    }

    fn reach(&self) -> usize {
        self.re.len() / 2
    }

    /// Convolution along rows; zeros beyond the ends.
    fn along_rows(&self, field: &Field, width: usize) -> Field {
        let mut out = Field::zeros(field.re.len());
        let reach = self.reach();
        let rows = out.re.par_chunks_mut(width).zip(out.im.par_chunks_mut(width)).enumerate();
        rows.for_each(|(y, (re, im))| {
            let row = y * width..(y + 1) * width;
            let (from_re, from_im) = (&field.re[row.clone()], &field.im[row]);
            for (k, (a, b)) in self.re.iter().zip(&self.im).enumerate() {
                // out[x] += tap(k) · in[x − (k − reach)]
                let (to, from) = if k >= reach { (k - reach, 0) } else { (0, reach - k) };
                let count = width.saturating_sub(to.max(from));
                let source = from_re[from.min(width)..].iter().zip(&from_im[from.min(width)..]);
                let target = re[to.min(width)..].iter_mut().zip(&mut im[to.min(width)..]);
                for ((re, im), (p, q)) in target.zip(source).take(count) {
                    *re += a * p - b * q;
                    *im += a * q + b * p;
                }
            }
        });
        out
    }

    /// Adds the convolution along columns; zeros beyond the ends.
    fn add_along_columns(&self, field: &Field, width: usize, out: &mut Field) {
        let height = field.re.len() / width.max(1);
        let reach = self.reach();
        let rows = out.re.par_chunks_mut(width).zip(out.im.par_chunks_mut(width)).enumerate();
        rows.for_each(|(y, (re, im))| {
            for (k, (a, b)) in self.re.iter().zip(&self.im).enumerate() {
                let Some(from) = (y + reach).checked_sub(k).filter(|from| *from < height) else { continue };
                let row = from * width..(from + 1) * width;
                let source = field.re[row.clone()].iter().zip(&field.im[row]);
                for ((re, im), (p, q)) in re.iter_mut().zip(im.iter_mut()).zip(source) {
                    *re += a * p - b * q;
                    *im += a * q + b * p;
                }
            }
        });
    }
}

/// Zeros where a coefficient is below the threshold; counts the others.
fn drop_weak(field: &mut Field, threshold: f32, kept: &mut [u16]) {
    let limit = threshold * threshold;
    for ((re, im), kept) in field.re.iter_mut().zip(&mut field.im).zip(kept) {
        if *re * *re + *im * *im < limit {
            (*re, *im) = (0.0, 0.0);
        } else {
            *kept += 1;
        }
    }
}
