//! The last step of `finish`: corrections are applied, states become the validity mask, and everything is counted.

use super::block::{BLOCK, CHUNK, Tally, state};
use super::continuity::Continuity;
use super::identity::FrameOrder;
use super::neighbours::{Field, MASK};
use super::report::{DecodeReport, NoiseModel};
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

/// Asks the neighbours, row by row.
pub fn correct_rows(field: &Field, correction: &mut [i16], level: Level) {
    correction
        .par_chunks_mut(ROWS * field.width)
        .enumerate()
        .for_each(|(chunk, lines)| vectorised!(level, field.correct(chunk * ROWS, lines)));
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
            noise,
            footprint_px: None,
            sensor: SensorTest::default(),
            motion: None,
            continuity: Continuity::default(),
            findings: Vec::new(),
            order: FrameOrder::default(),
            ignored,
        }
    }
}

/// Sum of two counts, for a parallel reduction.
pub fn sum<T: AddAssign>(mut a: T, b: T) -> T {
    a += b;
    a
}

/// Applies the corrections; states become the validity mask.
pub fn apply(plan: &AxisPlan, correction: &[i16], out: &mut PhaseViewMut, level: Level) -> Verdicts {
    // One pixel beyond the projector's edge is noise, more is a wrong order.
    let scale = std::f64::consts::TAU / plan.period_px;
    let inside = ((-1.5 * scale) as f32)..=(((plan.extent_px + 0.5) * scale) as f32);
    let planes = out.phase_rad.par_chunks_mut(CHUNK).zip(out.sigma_rad.par_chunks_mut(CHUNK));
    let planes = planes.zip(out.valid.par_chunks_mut(CHUNK)).zip(correction.par_chunks(CHUNK));
    let verdicts = planes.map(|(((phase, sigma), valid), correction)| {
        vectorised!(level, apply_chunk(correction, &inside, (phase, sigma, valid)))
    });
    verdicts.reduce(Verdicts::default, sum)
}

#[inline(always)]
fn apply_chunk(
    correction: &[i16],
    inside: &RangeInclusive<f32>,
    (phase, sigma, valid): (&mut [f32], &mut [f32], &mut [u8]),
) -> Verdicts {
    let mut verdicts = Verdicts::default();
    for first in (0..valid.len()).step_by(BLOCK) {
        let part = first..(first + BLOCK).min(valid.len());
        let untouched = correction[part.clone()].iter().fold(0, |any, c| any | c) == 0
            && valid[part.clone()].iter().fold(0, |most: u8, state| most.max(*state)) <= state::SURE;
        if untouched {
            verdicts.valid += valid[part].iter().map(|v| u32::from(*v)).sum::<u32>() as usize;
            continue;
        }
        for i in part {
            apply_one(correction[i], inside, (&mut phase[i], &mut sigma[i], &mut valid[i]), &mut verdicts);
        }
    }
    verdicts
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
