//! The order of each pixel of a block from the frames of a micro set, and the coordinate that all of them give.

use super::block::{BLOCK, Planes, state};
use super::micro::{MICRO_STEPS, MOST_FURTHER, Micro};
use super::order::{Kernel, LOG_ODDS, Lanes};
use super::rasters::Rasters;
use std::f64::consts::TAU;
use std::ops::Range;

/// Logarithm of the odds from which one neighbour is enough.
const WEAK_ODDS: f64 = 3.0;
/// A coordinate may be adjusted by this share of a period.
const MOST_MOVE: f64 = 0.125;

impl Kernel<'_> {
    /// The coordinate of each pixel of a block, and what all frames add to it.
    #[inline(never)]
    pub(super) fn read_micro(&self, micro: &Micro, range: &Range<usize>, lanes: &mut Lanes) {
        let further = micro.further.len();
        let mut values = [0.0; MOST_FURTHER];
        for (i, at) in range.clone().enumerate() {
            lanes.finer[i] = (0.0, 1.0);
            let sums = &lanes.sums[0];
            let (c, s) = (f64::from(sums.cos[i]), f64::from(sums.sin[i]));
            let modulation = 2.0 / MICRO_STEPS as f64 * (c * c + s * s).sqrt();
            let x = lanes.phase_rad[0][i] * micro.period_px / TAU;
            lanes.coordinate_px[i] = x;
            if modulation < f64::from(self.least_modulation_dn) || modulation <= 0.0 {
                continue;
            }
            for (value, raster) in values.iter_mut().zip(micro.rasters()) {
                *value = f64::from(Rasters::value(self.rasters, raster, at));
            }
            let background = f64::from(sums.sum[i]) / MICRO_STEPS as f64;
            let (best, second) = micro.resolve(x, [background, modulation], &values[..further]);
            let noise = self.noise.read_variance_dn2 + self.noise.gain_dn * background;
            let freedom = further.saturating_sub(1).max(1) as f64;
            let odds = (second - best.squares_dn2) / (2.0 * noise.max(best.squares_dn2 / freedom));
            let doubt = if odds >= LOG_ODDS {
                state::SURE
            } else if odds >= WEAK_ODDS {
                state::WEAK
            } else {
                state::OPEN
            };
            lanes.doubt[i] = lanes.doubt[i].max(doubt);
            lanes.coordinate_px[i] = x + (best.order as f64 - 1.0) * micro.period_px;
            if best.move_px.abs() <= MOST_MOVE * micro.period_px {
                let three = micro.period_px / TAU
                    * self.sums[self.plan.sines[0]]
                        .unit_noise(MICRO_STEPS as f64, (c / (1.5 * modulation), s / (1.5 * modulation)))
                    / modulation;
                lanes.finer[i] = (best.move_px, (best.variance.sqrt() / three) as f32);
            }
        }
    }
}

impl Lanes {
    /// Moves the coordinates of a block to those of all frames.
    pub(super) fn refine(&mut self, out: &mut Planes) {
        let pixels = self.coordinate_px.iter_mut().zip(&self.finer).zip(&mut *out.sigma_rad);
        for ((x, (move_px, ratio)), sigma) in pixels.take(BLOCK) {
            *x += move_px;
            *sigma *= ratio;
        }
    }
}
