//! The last step of `finish`: corrections are applied, states become the validity mask, and everything is counted.

use super::block::sum;
use super::block::{BLOCK, Tally, state};
use super::bounce::Bounced;
use super::continuity::Continuity;
use super::identity::FrameOrder;
use super::neighbours::{ASKED, Field, MASK};
use super::noise_model::NoiseModel;
use super::report::DecodeReport;
use super::roles::AxisPlan;
use super::sensor_test::SensorTest;
use crate::math::simd::vectorised;
use crate::phase::PhaseViewMut;
use fearless_simd::Level;
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::ops::{AddAssign, RangeInclusive};
use std::sync::Arc;

/// Rows of one parallel job of the neighbour pass.
const ROWS: usize = 16;

/// Of which stretches of rows neighbours say something about the orders. What they say of each pixel, in whole periods, is in memory that is
/// lent: it is needed only until it is applied.
#[derive(Debug)]
pub struct Corrections {
    /// Of each stretch of [`BLOCK`] pixels of a row the number of its valid ones, or [`ASKED`].
    stretches: Vec<u32>,
    width: usize,
}

impl Corrections {
    /// Room for images of one size.
    pub fn new(width: usize, pixels: usize) -> Self {
        let rows = pixels.div_ceil(width.max(1));
        Self { stretches: vec![0; rows * width.div_ceil(BLOCK)], width }
    }

    /// Asks the neighbours, row by row; of the periods only those of stretches that were asked mean something.
    pub fn ask(&mut self, field: &Field, periods: &mut [i16], level: Level) {
        let parts = periods.par_chunks_mut(ROWS * self.width);
        let parts = parts.zip(self.stretches.par_chunks_mut(ROWS * self.width.div_ceil(BLOCK)));
        parts.enumerate().for_each(|(chunk, (lines, stretches))| {
            vectorised!(level, field.correct(chunk * ROWS, lines, stretches));
        });
    }

    /// Applies them; states become the validity mask.
    pub fn apply(&self, plan: &AxisPlan, periods: &[i16], out: &mut PhaseViewMut) -> Verdicts {
        // One pixel beyond the projector's edge is noise, more is a wrong order.
        let scale = std::f64::consts::TAU / plan.period_px;
        let inside = ((-1.5 * scale) as f32)..=(((plan.extent_px + 0.5) * scale) as f32);
        let chunk = ROWS * self.width;
        let planes = out.phase_rad.par_chunks_mut(chunk).zip(out.sigma_rad.par_chunks_mut(chunk));
        let planes = planes.zip(out.valid.par_chunks_mut(chunk)).zip(periods.par_chunks(chunk));
        let stretches = self.stretches.par_chunks(ROWS * self.width.div_ceil(BLOCK));
        let verdicts = planes.zip(stretches).map(|((((phase, sigma), valid), periods), stretches)| {
            self.apply_rows((periods, stretches), &inside, (phase, sigma, valid))
        });
        verdicts.reduce(Verdicts::default, sum)
    }

    fn apply_rows(
        &self,
        (periods, stretches): (&[i16], &[u32]),
        inside: &RangeInclusive<f32>,
        (phase, sigma, valid): (&mut [f32], &mut [f32], &mut [u8]),
    ) -> Verdicts {
        let mut verdicts = Verdicts::default();
        let per_row = self.width.div_ceil(BLOCK);
        for (number, stretch) in stretches.iter().enumerate() {
            if *stretch != ASKED {
                verdicts.valid += *stretch as usize;
                continue;
            }
            let column = number % per_row * BLOCK;
            let first = number / per_row * self.width + column;
            for i in first..first + BLOCK.min(self.width - column) {
                apply_one(periods[i], inside, (&mut phase[i], &mut sigma[i], &mut valid[i]), &mut verdicts);
            }
        }
        verdicts
    }
}

/// What became of the orders.
#[derive(Debug, Clone, Copy, Default)]
pub struct Verdicts {
    valid: usize,
    ambiguous: usize,
    resolved: usize,
    spikes_repaired: usize,
    spikes_masked: usize,
}

impl AddAssign for Verdicts {
    fn add_assign(&mut self, other: Self) {
        self.valid += other.valid;
        self.ambiguous += other.ambiguous;
        self.resolved += other.resolved;
        self.spikes_repaired += other.spikes_repaired;
        self.spikes_masked += other.spikes_masked;
    }
}

impl Verdicts {
    /// Where no neighbour was asked.
    pub fn of_mask(valid: &[u8]) -> Self {
        Self { valid: valid.iter().map(|v| usize::from(*v)).sum(), ..Self::default() }
    }

    /// Joins them with the counts of the masks.
    pub fn report(self, tally: Tally, noise: NoiseModel, ignored: Arc<[String]>) -> DecodeReport {
        DecodeReport {
            valid: self.valid,
            saturated: tally.saturated,
            recovered: tally.recovered,
            dark: tally.dark,
            noisy: tally.noisy,
            ambiguous: self.ambiguous,
            resolved: self.resolved,
            spikes_repaired: self.spikes_repaired,
            spikes_masked: self.spikes_masked,
            bounced: Bounced::default(),
            noise,
            footprint_px: None,
            footprint_assumed: false,
            footprint_left_px2: None,
            sensor: SensorTest::default(),
            motion: None,
            code_shift: None,
            linearity: None,
            continuity: Continuity::default(),
            findings: Vec::new(),
            order: FrameOrder::default(),
            ignored,
        }
    }
}

fn apply_one(
    correction: i16,
    inside: &RangeInclusive<f32>,
    (phase, sigma, valid): (&mut f32, &mut f32, &mut u8),
    verdicts: &mut Verdicts,
) {
    let was = *valid;
    if was == state::INVALID {
        return;
    }
    let moved = if correction == 0 { *phase } else { *phase + TAU * f32::from(correction) };
    let keep = correction != MASK && (correction == 0 || inside.contains(&moved));
    if keep {
        (*phase, *valid) = (moved, 1);
    } else {
        (*phase, *sigma, *valid) = (f32::NAN, f32::NAN, 0);
    }
    verdicts.valid += usize::from(keep);
    if was == state::SURE {
        verdicts.spikes_repaired += usize::from(keep && correction != 0);
        verdicts.spikes_masked += usize::from(!keep);
    } else {
        verdicts.ambiguous += 1;
        verdicts.resolved += usize::from(keep);
    }
}
