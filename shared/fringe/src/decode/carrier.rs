//! Sums of sets that are no plain sines: of fringes times a carrier, and the phase noise of lines.
//!
//! # Carrier
//! Frame (i, j) shows (½ + ½ cos(φ − δᵢ))(½ + ½ cos(ψ − εⱼ)). Over the steps j, the carrier returns with the amplitude Dᵢ = P/4 (1 + cos(φ − δᵢ));
//! its phase ψ is the same in all of them. So ψ is taken from the sum of all frames, and Dᵢ is the part in phase with it: linear in the grey
//! values, without the bias that the length of a noisy phasor has where the fringe is dark. Light that other places sent has lost the
//! carrier and is left out; √(2/M) of M carrier steps stands beside √(2/N) in the uncertainty.
//!
//! # Lines
//! A line is bright in few frames and dark in most: shot noise is not spread evenly over the steps. The phase feels frame i by sin(φ − δᵢ), so
//! Var φ = (2/N)² Σ σᵢ² sin²(φ − δᵢ) / B²: the bright frame, in phase with the line, hardly matters.

use super::block::BLOCK;
use super::noise_model::NoiseModel;
use super::rasters::Rasters;
use super::sums::{BlockSums, Sums};
use crate::math::sincos;
use std::f64::consts::TAU;
use std::ops::Range;

impl Sums {
    /// The sums of the carrier's amplitudes at single pixels, at most [`BLOCK`].
    #[inline(never)]
    pub(super) fn demodulate(&self, rasters: &Rasters, places: &[usize], out: &mut BlockSums) {
        let (mut values, mut turn) = ([0.0_f32; BLOCK], [[0.0_f32; 2]; BLOCK]);
        let carrier = || self.carrier.iter().cycle();
        for (frame, step) in (0..self.weights.len()).zip(carrier()) {
            self.values_at(rasters, frame, places, &mut values);
            for (turn, value) in turn.iter_mut().zip(&values[..places.len()]) {
                turn[0] += value * step[0];
                turn[1] += value * step[1];
            }
        }
        let twice = 2.0 / self.carrier.len() as f32;
        for turn in &mut turn {
            let length = (turn[0] * turn[0] + turn[1] * turn[1]).sqrt();
            let scale = if length > 0.0 { twice / length } else { 0.0 };
            *turn = [turn[0] * scale, turn[1] * scale];
        }
        (out.sum, out.cos, out.sin) = ([0.0; BLOCK], [0.0; BLOCK], [0.0; BLOCK]);
        for ((frame, weights), step) in self.weights.iter().enumerate().zip(carrier()) {
            self.values_at(rasters, frame, places, &mut values);
            for (i, value) in values[..places.len()].iter().enumerate() {
                let amplitude = value * (step[0] * turn[i][0] + step[1] * turn[i][1]);
                out.sum[i] += value * weights[0];
                out.cos[i] += amplitude * weights[1];
                out.sin[i] += amplitude * weights[2];
            }
        }
    }

    /// Phase noise of lines, rad, with the noise of each frame where it is.
    #[inline(never)]
    pub(super) fn line_noise(
        &self,
        (rasters, noise): (&Rasters, &NoiseModel),
        range: &Range<usize>,
        sums: &BlockSums,
        sigma_rad: &mut [f32],
    ) {
        let places: [usize; BLOCK] = std::array::from_fn(|i| range.start + i);
        let places = &places[..range.len()];
        let (mut values, mut variance) = ([0.0_f32; BLOCK], [0.0_f32; BLOCK]);
        let (read, gain) = (noise.read_variance_dn2 as f32, noise.gain_dn as f32);
        for (frame, weights) in self.weights.iter().enumerate() {
            self.values_at(rasters, frame, places, &mut values);
            for (i, value) in values[..places.len()].iter().enumerate() {
                let across = sums.sin[i] * weights[1] - sums.cos[i] * weights[2];
                variance[i] += (read + gain * value) * across * across;
            }
        }
        // (2/N) Σ I e^{iδ} = B e^{iφ}: the factors 2/N cancel, the length of the sums stays.
        for (i, sigma) in sigma_rad.iter_mut().enumerate() {
            let length2 = sums.cos[i] * sums.cos[i] + sums.sin[i] * sums.sin[i];
            *sigma = if length2 > 0.0 { variance[i].sqrt() / length2 } else { f32::INFINITY };
        }
    }
}

/// Cosine and sine of the steps of a carrier.
pub(super) fn carrier_steps(steps: u32) -> Vec<[f32; 2]> {
    let step = |j| {
        let (s, c) = sincos(TAU * f64::from(j) / f64::from(steps));
        [c as f32, s as f32]
    };
    (0..steps).map(step).collect()
}
