//! A lamp or an exposure that changes too little to be told, and by more than smoothed points hide.
//!
//! It is no fault, but it shifts the phases by a ripple that neighbours share, and what it leaves of the frames passes for noise. Thousands of pixels
//! tell it to a twentieth of the noise of one of them, for it scales the fringes as well. They count by how rare their phase is, so that harmonics of the
//! projector do not look like a light.
//!
//! A room that gets brighter adds to the frames. What of that looks like a fringe leaves nothing in a pixel; the whole map shows it (`ripples`). The
//! rest of it stays in the frames, and counts as noise.

// The sums of a set live on the stack: a warm decoder allocates nothing.
#![allow(clippy::large_stack_arrays)]

use super::columns::{Column, times};
use super::rows::{Factors, Rows};
use super::samples::Samples;
use super::steadied::Steadied;
use super::subspace::deviation;
use crate::decode::between_steps::{Rarity, rarity};
use crate::decode::limits::MAX_STEPS;
use crate::decode::motion::LEAST_STEPS;
use crate::decode::spectrum::SIDE;
use crate::math::simd::vectorised;

/// A change below this part of the noise of a pixel in one frame is left: smoothed points are a few times as certain.
const LEAST: f64 = 0.05;
/// Standard deviations of what chance explains beyond which a change is one.
const CERTAIN: f64 = 5.0;

/// A slight change of the light.
pub(super) struct SlightLight {
    /// The columns under it.
    pub columns: [Column; 3],
    /// What takes it out of the frames.
    pub steadied: Steadied,
}

impl Samples<'_> {
    /// How the light scales the frames, where that is beyond doubt and not nothing; `rows` are those of all pixels alike.
    pub(super) fn slight_light(&self, rows: &Rows) -> Option<SlightLight> {
        if self.steps() < LEAST_STEPS {
            return None;
        }
        // Most lights are steady.
        self.scaled(rows)?;
        let rarity = rarity(self, &Steadied::NOTHING)?;
        self.scaled(&self.rows_of(&vectorised!(self.level, self.power_of_whole_fringes(&rarity)))?)
    }

    fn scaled(&self, rows: &Rows) -> Option<SlightLight> {
        let steps = self.steps();
        let Factors { scaled: factors, of_wave } = rows.factors()?;
        let nominal = &rows.nominal;
        let columns = nominal.map(|column| times(&column, &factors));
        let added = [rows.columns[0], nominal[1], nominal[2]];
        let [by_none, by_added, by_scaled] =
            [nominal, &added, &columns].map(|columns| rows.unexplained(columns));
        let noise = by_scaled / (self.count() as f64 * (steps as f64 - 3.0));
        let freedom = steps as f64 - 1.0;
        let certain = (freedom + CERTAIN * (2.0 * freedom).sqrt()) * noise;
        let deviation = deviation(&factors[..steps]);
        // What looks like a fringe has to be known as well as the rest.
        let is_known = of_wave.sqrt() < LEAST * (2.0 / steps as f64).sqrt();
        let is_scaled = by_none - by_scaled > certain && by_added - by_scaled > certain;
        (is_known && is_scaled && deviation > LEAST * noise.sqrt())
            .then(|| SlightLight { columns, steadied: Steadied::of_scaled(&factors, deviation) })
    }

    /// Σ over the pixels of the products of two frames, each phase counting alike.
    #[inline(always)]
    fn power_of_whole_fringes(&self, rarity: &Rarity) -> [Column; MAX_STEPS] {
        let mut power = [[0.0; MAX_STEPS]; MAX_STEPS];
        for (chosen, mean_dn, rows) in self.groups() {
            let weights = rarity.weights((chosen.len(), mean_dn, rows));
            for (i, own) in rows.iter().enumerate() {
                for (j, other) in rows.iter().enumerate().skip(i) {
                    let mut sums = [0.0; SIDE];
                    for l in 0..SIDE {
                        sums[l] = weights[l] * own[l] * other[l];
                    }
                    // By halves, so that the additions do not wait for each other.
                    for half in [SIDE / 2, SIDE / 4, SIDE / 8, SIDE / 16] {
                        for l in 0..half {
                            sums[l] += sums[l + half];
                        }
                    }
                    power[i][j] += sums[0];
                    power[j][i] = power[i][j];
                }
            }
        }
        power
    }
}
