//! The error that harmonics of the fringes (gamma) leave in an N-step phase, found in the phase itself and removed.
//!
//! Harmonics of the orders kN ± 1 shift the measured phase by an error that repeats N times a fringe. No frame shows it by itself,
//! but over a part that is crossed by many fringes every true phase is equally frequent, so the measured one is not: with its
//! density ρ, φ = ∫ 2πρ dφₘ, which in Fourier coefficients cₙ = ⟨e^{−inφₘ}⟩ is φ = φₘ + Σₙ (2/n) Im(cₙ e^{inφₘ}), n = kN (histogram
//! equalisation: Wang, Nguyen, Barnes, Opt. Lasers Eng. 48, 2010, here restricted to the orders that a waveform can cause). Other orders
//! would be the part's own shape and are left alone.

use super::{Wrapped, wrap_f32};
use crate::math::sincos;
use rayon::prelude::*;

/// Multiples of N that are removed.
const MULTIPLES: usize = 3;
/// Fewest valid pixels: cₙ is then known to 0.01.
const LEAST_PIXELS: usize = 10_000;
/// An order is removed when it exceeds its own noise 1/√pixels by this factor.
const SIGNIFICANT: f64 = 4.0;
/// Pixels of one parallel job.
const CHUNK: usize = 16_384;

/// The periodic error of the phase.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseHarmonics {
    /// Number of steps N.
    pub steps: u32,
    /// cₙ of n = N, 2N, 3N; zero where not significant.
    pub density: Vec<(f64, f64)>,
    /// Number of valid pixels that the estimate uses.
    pub pixels: usize,
}

impl PhaseHarmonics {
    /// Finds the error of an N-step phase with even steps; `None` with too
    /// few pixels.
    pub fn find(map: &Wrapped, steps: u32) -> Option<Self> {
        let pixels = map.valid_count();
        if pixels < LEAST_PIXELS {
            return None;
        }
        let orders: Vec<f64> = (1..=MULTIPLES).map(|k| k as f64 * f64::from(steps)).collect();
        let parts: Vec<Vec<(f64, f64)>> = map
            .phase_rad
            .par_chunks(CHUNK)
            .zip(map.valid.par_chunks(CHUNK))
            .map(|(phases, valid)| moments(phases, valid, &orders))
            .collect();
        let noise = SIGNIFICANT / (pixels as f64).sqrt();
        let mean = |k: usize| {
            let sum = parts.iter().fold((0.0, 0.0), |sum, part| (sum.0 + part[k].0, sum.1 + part[k].1));
            let c = (sum.0 / pixels as f64, sum.1 / pixels as f64);
            if c.0 * c.0 + c.1 * c.1 > noise * noise { c } else { (0.0, 0.0) }
        };
        Some(Self { steps, density: (0..MULTIPLES).map(mean).collect(), pixels })
    }

    /// What is to be added to a measured phase, rad.
    pub fn correction_rad(&self, phase_rad: f64) -> f64 {
        let mut sum = 0.0;
        for (k, c) in self.density.iter().enumerate() {
            let n = (k + 1) as f64 * f64::from(self.steps);
            let (sin, cos) = sincos(n * phase_rad);
            sum += 2.0 / n * (c.0 * sin + c.1 * cos);
        }
        sum
    }

    /// Amplitude of the error, rad: of its strongest order.
    pub fn amplitude_rad(&self) -> f64 {
        let size = |(k, c): (usize, &(f64, f64))| {
            2.0 * (c.0 * c.0 + c.1 * c.1).sqrt() / ((k + 1) as f64 * f64::from(self.steps))
        };
        self.density.iter().enumerate().map(size).fold(0.0, f64::max)
    }

    /// Removes the error from a map; masked pixels stay masked.
    pub fn remove(&self, map: &mut Wrapped) {
        map.phase_rad.par_chunks_mut(CHUNK).zip(map.valid.par_chunks(CHUNK)).for_each(|(phases, valid)| {
            for (phase, _) in phases.iter_mut().zip(valid).filter(|(_, valid)| **valid == 1) {
                let measured = f64::from(*phase);
                *phase = wrap_f32(measured + self.correction_rad(measured));
            }
        });
    }
}

fn moments(phases: &[f32], valid: &[u8], orders: &[f64]) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 0.0); orders.len()];
    for (phase, _) in phases.iter().zip(valid).filter(|(_, valid)| **valid == 1) {
        for (sum, order) in sums.iter_mut().zip(orders) {
            let (sin, cos) = sincos(order * f64::from(*phase));
            sum.0 += cos;
            sum.1 -= sin;
        }
    }
    sums
}
