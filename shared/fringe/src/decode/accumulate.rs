//! What happens to a frame when it lands: three sums per sine set, or a copy.

use super::roles::SinePlan;
use crate::frame::Pixels;
use crate::math::sincos;
use crate::wrapped::LeastSquares;
use rayon::prelude::*;
use std::ops::Range;

/// Pixels of one parallel job; fixed, so that the work is cut the same way on every machine.
const CHUNK: usize = 16_384;

/// Running sums of one sine set, one value per pixel: Σ I, Σ I cos δ, Σ I sin δ with δᵢ = ±(2πi/N + first step).
///
/// With I = A + B cos(φ − δ): Σ I = N A, Σ I cos δ = N/2 · B cos φ, Σ I sin δ = N/2 · B sin φ (thesis eq. 2.16). For uneven
/// steps the weights of the frames are those of the least-squares fit, so that the sums mean the same.
/// Single precision: N ≤ 64 values of at most 16 bits have an exact sum, and the others err by about 1e-7 of it.
#[derive(Debug)]
pub struct Sums {
    /// Σ I of each pixel, DN; row by row.
    pub sum: Vec<f32>,
    /// Σ I cos δ, DN.
    pub cos: Vec<f32>,
    /// Σ I sin δ, DN.
    pub sin: Vec<f32>,
    /// Weights of a frame in the three sums: 1, cos δ, sin δ for even steps.
    weights: Vec<[f32; 3]>,
    /// The fit of uneven steps; none for even ones.
    pub uneven: Option<LeastSquares>,
    /// Noise of a phase that another method found, rad; none where the sums are those of the frames.
    pub sigma_rad: Option<Vec<f32>>,
}

impl Sums {
    /// Allocates the sums of one set.
    pub fn new(plan: &SinePlan, pixels: usize) -> Self {
        let even = |shift: &f64| {
            let (s, c) = sincos(*shift);
            [1.0, c as f32, s as f32]
        };
        let n = f64::from(plan.steps);
        let scaled = |w: &[f64; 3]| [(w[0] * n) as f32, (w[1] * 0.5 * n) as f32, (w[2] * 0.5 * n) as f32];
        // The pattern was checked: its shifts determine three unknowns.
        let uneven = if plan.even { None } else { LeastSquares::new(&plan.shifts_rad) };
        let weights = match &uneven {
            Some(fit) => fit.weights.iter().map(scaled).collect(),
            None => plan.shifts_rad.iter().map(even).collect(),
        };
        Self {
            sum: vec![0.0; pixels],
            cos: vec![0.0; pixels],
            sin: vec![0.0; pixels],
            weights,
            uneven,
            sigma_rad: None,
        }
    }

    /// Replaces √(2/N) σ_I / B by what uneven steps or another method make of it.
    pub fn other_noise(&self, range: &Range<usize>, steps: f32, sigma_rad: &mut [f32]) {
        if let Some(given) = &self.sigma_rad {
            sigma_rad.copy_from_slice(&given[range.clone()]);
        } else if let Some(fit) = &self.uneven {
            let even = 1.0 / (2.0 / steps).sqrt();
            for (sigma, i) in sigma_rad.iter_mut().zip(range.clone()) {
                let (c, s) = (f64::from(self.cos[i]), f64::from(self.sin[i]));
                let length = (c * c + s * s).sqrt().max(f64::MIN_POSITIVE);
                *sigma *= even * fit.noise(c / length, s / length) as f32;
            }
        }
    }

    /// Adds one frame and marks its clipped pixels. The first step overwrites what an earlier cycle left.
    pub fn add(&mut self, step: usize, pixels: Pixels, clipped_dn: u16, saturated: &mut [u8]) {
        match pixels {
            Pixels::Mono8(values) => self.add_values(step, values, clipped_dn.min(255) as u8, saturated),
            Pixels::Mono16(values) => self.add_values(step, values, clipped_dn, saturated),
        }
    }

    fn add_values<T>(&mut self, step: usize, values: &[T], clipped: T, saturated: &mut [u8])
    where
        T: Copy + PartialOrd + Into<f32> + Sync + Send,
    {
        let [weight, cos_weight, sin_weight] = self.weights[step];
        let sums = self
            .sum
            .par_chunks_mut(CHUNK)
            .zip(self.cos.par_chunks_mut(CHUNK))
            .zip(self.sin.par_chunks_mut(CHUNK));
        sums.zip(saturated.par_chunks_mut(CHUNK)).zip(values.par_chunks(CHUNK)).for_each(
            |((((sum, cos), sin), saturated), values)| {
                for (flag, value) in saturated.iter_mut().zip(values) {
                    *flag |= u8::from(*value >= clipped);
                }
                let lanes = sum.iter_mut().zip(cos).zip(sin).zip(values);
                if step == 0 {
                    for (((sum, cos), sin), value) in lanes {
                        let value: f32 = (*value).into();
                        *sum = value * weight;
                        *cos = value * cos_weight;
                        *sin = value * sin_weight;
                    }
                } else {
                    for (((sum, cos), sin), value) in lanes {
                        let value: f32 = (*value).into();
                        *sum += value * weight;
                        *cos += value * cos_weight;
                        *sin += value * sin_weight;
                    }
                }
            },
        );
    }
}

/// Frames that are kept as they came: bits, white, black. The full scale decides how wide a value is stored.
#[derive(Debug)]
pub enum Rasters {
    /// Full scale up to 255.
    Bytes(Vec<u8>),
    /// Full scale above 255.
    Words(Vec<u16>),
}

impl Rasters {
    /// Allocates memory for `count` frames.
    pub fn new(count: usize, pixels: usize, full_scale_dn: u16) -> Self {
        if full_scale_dn <= 255 {
            Self::Bytes(vec![0; count * pixels])
        } else {
            Self::Words(vec![0; count * pixels])
        }
    }

    /// Whether one frame is darker than another at most of the valid pixels. Every 16th pixel is asked.
    pub fn mostly_below(&self, one: usize, other: usize, valid: &[u8]) -> bool {
        let (mut below, mut asked) = (0_usize, 0_usize);
        for index in (0..valid.len()).step_by(16).filter(|index| valid[*index] == 1) {
            let (a, b) = self.pair(one, other, valid.len(), index);
            below += usize::from(a < b);
            asked += 1;
        }
        2 * below > asked
    }

    /// Grey values of one pixel in two kept frames.
    pub fn pair(&self, one: usize, other: usize, pixels: usize, index: usize) -> (u16, u16) {
        match self {
            Self::Bytes(kept) => (kept[one * pixels + index].into(), kept[other * pixels + index].into()),
            Self::Words(kept) => (kept[one * pixels + index], kept[other * pixels + index]),
        }
    }

    /// Copies a frame whose values do not exceed full scale.
    pub fn keep(&mut self, index: usize, pixels: Pixels) {
        let range = index * pixels.len()..(index + 1) * pixels.len();
        match (self, pixels) {
            (Self::Bytes(kept), Pixels::Mono8(values)) => kept[range].copy_from_slice(values),
            (Self::Words(kept), Pixels::Mono16(values)) => kept[range].copy_from_slice(values),
            (Self::Bytes(kept), Pixels::Mono16(values)) => {
                kept[range].iter_mut().zip(values).for_each(|(kept, value)| *kept = *value as u8);
            }
            (Self::Words(kept), Pixels::Mono8(values)) => {
                kept[range].iter_mut().zip(values).for_each(|(kept, value)| *kept = u16::from(*value));
            }
        }
    }
}
