//! Pixels that are clipped in some sine frames, decoded from the others.
//!
//! Any three steps that stand apart determine background, modulation and phase; how well, their least-squares fit states. Harmonics
//! that even steps cancel come through, so that the phase of a projector that is not linear is worse than its σ.

use super::block::Planes;
use super::limits::{MAX_SINES, MAX_STEPS};
use super::order::{Kernel, Lanes};
use super::rasters::Rasters;
use crate::wrapped::LeastSquares;
use std::ops::Range;

/// Steps that multiply the noise by more are too near to each other.
const MOST_NOISE: f64 = 3.0;

/// What the frames that are not clipped give of one set: A, B cos φ, B sin φ, and the phase noise for unit noise.
struct Found {
    fit: [f64; 3],
    noise: f64,
}

impl Kernel<'_> {
    /// Decodes the clipped pixels of a block where all sets allow it; how many.
    #[inline(never)]
    pub(super) fn use_clipped(&self, range: &Range<usize>, lanes: &mut Lanes, out: &mut Planes) -> usize {
        if self.plan.micro.is_some() {
            return 0;
        }
        let mut count = 0;
        for i in 0..range.len() {
            if lanes.clipped[i] != 0 && self.use_clipped_pixel(range.start + i, i, lanes, out).is_some() {
                lanes.clipped[i] = 0;
                count += 1;
            }
        }
        count
    }

    fn use_clipped_pixel(&self, at: usize, i: usize, lanes: &mut Lanes, out: &mut Planes) -> Option<()> {
        let mut found: [Option<Found>; MAX_SINES] = [const { None }; MAX_SINES];
        for (found, slot) in found.iter_mut().zip(&self.plan.sines) {
            *found = Some(self.unclipped(*slot, at)?);
        }
        let mut least = f32::INFINITY;
        for (j, (found, slot)) in found.iter().flatten().zip(&self.plan.sines).enumerate() {
            let n = f64::from(self.steps[*slot]);
            let [a, c, s] = found.fit;
            let sums = &mut lanes.sums[j];
            (sums.sum[i], sums.cos[i], sums.sin[i]) =
                ((n * a) as f32, (0.5 * n * c) as f32, (0.5 * n * s) as f32);
            let modulation = (c * c + s * s).sqrt();
            least = least.min(modulation as f32);
            if j == 0 {
                let variance = self.noise.read_variance_dn2 + self.noise.gain_dn * a.max(0.0);
                out.modulation[i] = modulation as f32;
                out.sigma_rad[i] = (found.noise * variance.max(0.0).sqrt() / modulation) as f32;
            }
        }
        lanes.least_modulation[i] = least;
        Some(())
    }

    /// The fit to the frames of a set that are not clipped; `None` where they leave the phase open.
    fn unclipped(&self, slot: usize, at: usize) -> Option<Found> {
        let sums = &self.sums[slot];
        if sums.shifts_rad.is_empty() || sums.replaced.is_some() {
            return None;
        }
        let clipped_dn = match self.rasters {
            Rasters::Bytes(_) => self.clipping.clipped_dn.min(255),
            Rasters::Words(_) => self.clipping.clipped_dn,
        };
        let (mut values, mut shifts, mut count) = ([0.0; MAX_STEPS], [0.0; MAX_STEPS], 0);
        for (raster, shift) in sums.rasters().zip(&sums.shifts_rad) {
            let value = self.rasters.value(raster, at);
            if value < clipped_dn {
                (values[count], shifts[count]) = (f64::from(value), *shift);
                count += 1;
            }
        }
        if count < 3 {
            return None;
        }
        let fit = LeastSquares::new(&shifts[..count])?;
        let [a, c, s] = fit.fit(&values[..count]);
        let length = (c * c + s * s).sqrt();
        let noise = fit.noise(c / length, s / length);
        (noise <= MOST_NOISE).then_some(Found { fit: [a, c, s], noise })
    }
}
