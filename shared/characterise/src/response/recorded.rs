//! Harmonics and phase error as recorded fringes show them.

use super::waveform::PhaseError;
use super::{ResponseError, Roi};
use fringe::frame::FrameView;
use fringe::math::{atan2, sincos, wrap_positive_rad, wrap_rad};
use serde::Serialize;
use std::f64::consts::TAU;

/// Parts of a fringe over which the error is averaged: fine enough for an error that repeats up to eight times a fringe.
const BINS: usize = 64;

/// A pixel counts when its modulation is at least this fraction of full scale.
const LEAST_MODULATION: f64 = 0.02;

/// Fewest pixels with modulation.
const LEAST_PIXELS: usize = 64;

/// What phase-stepped frames show of the waveform.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecordedWaveform {
    /// Number of steps recorded.
    pub steps_recorded: u32,
    /// Number of pixels used.
    pub pixels: usize,
    /// Amplitude of the 2nd to 5th harmonic relative to the first, averaged in phase over all pixels so that noise drops
    /// out. Absent where the steps are too few to separate the order from its alias (at least 2·order + 1 are needed).
    pub harmonics: [Option<f64>; 4],
    /// Error of the phase from every (recorded / N)-th frame against that from all frames, averaged over noise in 64 parts
    /// of the fringe. Absent unless the recorded steps are at least twice N and a multiple of it.
    pub phase_error: Option<PhaseError>,
    /// The same with the noise of single pixels, rad.
    pub phase_rms_with_noise_rad: Option<f64>,
}

/// Analyses the frames of one sine set, in order of their steps, within a region; `steps` is the N of the phase error.
///
/// # Errors
/// Fewer than three frames, unequal frames, a region outside, too few pixels with modulation.
pub fn analyse(
    frames: &[FrameView<'_>],
    roi: Option<Roi>,
    steps: u32,
) -> Result<RecordedWaveform, ResponseError> {
    let count = frames.len();
    let (Some(first), true) = (frames.first(), (3..=64).contains(&count)) else {
        return Err(ResponseError::Steps { steps: count as u32 });
    };
    let roi = roi.unwrap_or_else(|| Roi::centre(first.width_px, first.height_px));
    roi.check(first.width_px, first.height_px)?;
    let size = |f: &FrameView<'_>| (f.width_px, f.height_px, f.full_scale_dn);
    if let Some(number) = frames.iter().position(|f| size(f) != size(first)) {
        let text = |f: &FrameView<'_>| {
            format!("{} × {} px, full at {} DN", f.width_px, f.height_px, f.full_scale_dn)
        };
        let (found, expected) = (text(&frames[number]), text(first));
        return Err(ResponseError::Unequal { number, found, expected });
    }
    let crops: Vec<Vec<u16>> = frames.iter().map(|frame| roi.crop(frame)).collect();
    let least = LEAST_MODULATION * f64::from(first.full_scale_dn);
    let unit: Vec<(f64, f64)> = (0..count).map(|i| sincos(TAU * i as f64 / count as f64)).collect();
    let mut sums = Sums::new(count, steps);
    let mut pixel = vec![0.0; count];
    for index in 0..roi.pixels() as usize {
        if crops.iter().any(|crop| crop[index] >= first.full_scale_dn) {
            continue;
        }
        pixel.iter_mut().zip(&crops).for_each(|(value, crop)| *value = f64::from(crop[index]));
        sums.add(&pixel, &unit, least);
    }
    if sums.pixels < LEAST_PIXELS {
        return Err(ResponseError::NoFringes { found: sums.pixels, needed: LEAST_PIXELS });
    }
    Ok(sums.finish(count, steps))
}

struct Sums {
    pixels: usize,
    amplitude: f64,
    /// Harmonics 2 … 5, turned so that the fundamental has phase zero.
    turned: [(f64, f64); 4],
    /// Frames between those of the shorter phase, if it can be formed.
    stride: Option<usize>,
    /// Count and sum of errors by part of the fringe.
    bins: Vec<(usize, f64)>,
    squares: f64,
    errors: usize,
}

impl Sums {
    fn new(count: usize, steps: u32) -> Self {
        let steps = steps as usize;
        let fits = steps >= 3 && count.is_multiple_of(steps) && count >= 2 * steps;
        Self {
            pixels: 0,
            amplitude: 0.0,
            turned: [(0.0, 0.0); 4],
            stride: fits.then(|| count / steps),
            bins: vec![(0, 0.0); BINS],
            squares: 0.0,
            errors: 0,
        }
    }

    /// `unit` holds sine and cosine of each step.
    fn add(&mut self, pixel: &[f64], unit: &[(f64, f64)], least_dn: f64) {
        let n = pixel.len();
        // Frame i shows cos(φ − 2πi/n), so the sum over e^{+ih2πi/n} has the phase h φ.
        let sum = |order: usize| {
            pixel.iter().enumerate().fold((0.0, 0.0), |(re, im), (i, value)| {
                let (sin, cos) = unit[i * order % n];
                (re + value * cos, im + value * sin)
            })
        };
        let (re, im) = sum(1);
        let amplitude = (re * re + im * im).sqrt();
        if 2.0 * amplitude / (n as f64) < least_dn {
            return;
        }
        self.pixels += 1;
        self.amplitude += amplitude;
        let phase = atan2(im, re);
        for (order, turned) in (2..).zip(&mut self.turned) {
            let (re, im) = sum(order);
            let (sin, cos) = sincos(order as f64 * phase);
            turned.0 += re * cos + im * sin;
            turned.1 += im * cos - re * sin;
        }
        let Some(stride) = self.stride else { return };
        for offset in 0..stride {
            let (mut re, mut im) = (0.0, 0.0);
            for i in (offset..n).step_by(stride) {
                re += pixel[i] * unit[i].1;
                im += pixel[i] * unit[i].0;
            }
            let error = wrap_rad(atan2(im, re) - phase);
            // The error depends on where in the fringe the first of the few frames lies.
            let place = wrap_positive_rad(phase - TAU * offset as f64 / n as f64) / TAU;
            let bin = &mut self.bins[((place * BINS as f64) as usize).min(BINS - 1)];
            bin.0 += 1;
            bin.1 += error;
            self.squares += error * error;
            self.errors += 1;
        }
    }

    fn finish(&self, count: usize, steps: u32) -> RecordedWaveform {
        let harmonic = |i: usize| {
            let (re, im) = self.turned[i];
            (count > 2 * (i + 2)).then(|| (re * re + im * im).sqrt() / self.amplitude)
        };
        let means = || self.bins.iter().filter(|b| b.0 > 0).map(|(n, sum)| (*n as f64, sum / *n as f64));
        let weight: f64 = means().map(|(n, _)| n).sum();
        let periodic = self.stride.map(|_| PhaseError {
            steps,
            rms_rad: (means().map(|(n, mean)| n * mean * mean).sum::<f64>() / weight).sqrt(),
            peak_rad: means().fold(0.0, |m: f64, (_, mean)| m.max(mean.abs())),
        });
        RecordedWaveform {
            steps_recorded: count as u32,
            pixels: self.pixels,
            harmonics: std::array::from_fn(harmonic),
            phase_error: periodic,
            phase_rms_with_noise_rad: self.stride.map(|_| (self.squares / self.errors as f64).sqrt()),
        }
    }
}
