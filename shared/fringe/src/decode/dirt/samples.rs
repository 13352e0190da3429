//! The pixels that a set's frames are judged by: gathered once, some side by side, so that what is asked of them are loops over vectors.

// The sums of a set live on the stack: a warm decoder allocates nothing.
#![allow(clippy::large_stack_arrays)]

use super::columns::{Column, nominal_columns, solver};
use crate::decode::limits::MAX_STEPS;
use crate::decode::noise_estimate::gcd;
use crate::decode::roles::{SineKind, SinePlan};
use crate::decode::spectrum::{SIDE, Side};
use crate::math::simd::vectorised;
use fearless_simd::Level;

/// What the inspection needs to know of the pixels.
#[derive(Debug, Clone, Copy)]
pub struct Look<'a> {
    /// Pixels that are asked.
    pub positions: &'a [usize],
    /// Columns of the image, px.
    pub width: usize,
    /// Pixels of the image.
    pub pixels: usize,
    /// Their grey values in the frames of the set, step after step, DN.
    pub values: &'a [u16],
    /// Pixels with less modulation are dark, DN.
    pub least_modulation_dn: f64,
    /// Grey value from which a pixel is clipped, DN.
    pub clipped_dn: u16,
}

/// Most pixels that are asked.
const MOST: usize = 8192;
/// Fewer pixels say nothing.
const LEAST: usize = 500;
/// So many give each of 64 parts of the fringe 25 of them, more than chance leaves empty; with fewer, all positions are asked.
const ENOUGH: usize = 1600;

/// The pixels of a set that are lit and not clipped, [`SIDE`] of them side by side.
pub(in crate::decode) struct Samples<'a> {
    pub(super) plan: &'a SinePlan,
    pub(super) look: &'a Look<'a>,
    /// Of each group of pixels: their mean grey values, DN, then what the frames show over that, frame after frame; zeros beyond the last pixel.
    groups: &'a [Side],
    /// Numbers of their positions.
    chosen: &'a [u32],
    /// Instructions that may be used.
    pub(super) level: Level,
}

impl<'a> Samples<'a> {
    /// Gathers the usable pixels; `None` when they are too few, or when the frames show no plain sine.
    pub(in crate::decode) fn new(
        plan: &'a SinePlan,
        look: &'a Look<'a>,
        (chosen, groups): (&'a mut Vec<u32>, &'a mut [Side]),
        level: Level,
    ) -> Option<Self> {
        if plan.kind != SineKind::Plain || !(3..=MAX_STEPS).contains(&(plan.steps as usize)) {
            return None;
        }
        let weights = solver(&nominal_columns(plan), plan.steps as usize)?;
        let mut every = look.positions.len().div_ceil(MOST).max(1);
        // Prime to the width, so that the pixels do not stand in columns.
        while gcd(every, look.width) != 1 {
            every += 1;
        }
        // Then all, for a part that fills little of the picture.
        for (every, enough) in [(every, ENOUGH), (1, LEAST)] {
            vectorised!(
                level,
                gather(look, &weights[1..], every, (plan.steps as usize, &mut *chosen, &mut *groups))
            );
            if chosen.len() >= enough {
                return Some(Self { plan, look, groups, chosen, level });
            }
        }
        None
    }

    /// Number of frames of the set.
    pub(super) fn steps(&self) -> usize {
        self.plan.steps as usize
    }

    /// Number of the pixels.
    pub(super) fn count(&self) -> usize {
        self.chosen.len()
    }

    /// How the set is decoded.
    pub(in crate::decode) fn plan(&self) -> &'a SinePlan {
        self.plan
    }

    /// Instructions that the loops over them may use.
    pub(in crate::decode) fn level(&self) -> Level {
        self.level
    }

    /// Nominal steps of the frames, rad.
    pub(super) fn shifts_rad(&self) -> &[f64] {
        &self.plan.shifts_rad
    }

    /// Columns and rows of the image, px.
    pub(super) fn size_px(&self) -> (usize, usize) {
        let width = self.look.width.max(1);
        (width, (self.look.pixels / width).max(1))
    }

    /// Groups of pixels: the numbers of their positions, their mean grey values in DN, and the values of the frames over them.
    #[inline(always)]
    pub(in crate::decode) fn groups(&self) -> impl Iterator<Item = (&'a [u32], &'a Side, &'a [Side])> {
        let groups = self.groups.chunks_exact(self.steps() + 1);
        self.chosen.chunks(SIDE).zip(groups).map(|(chosen, rows)| (chosen, &rows[0], &rows[1..]))
    }

    /// Calls `take(place, values)` for the usable pixels, grey values in DN.
    pub(super) fn each_dn(&self, mut take: impl FnMut(usize, &[f64])) {
        let mut values = [0.0; MAX_STEPS];
        for (chosen, mean, rows) in self.groups() {
            for (lane, position) in chosen.iter().enumerate() {
                for (value, row) in values.iter_mut().zip(rows) {
                    *value = row[lane] * mean[lane];
                }
                take(self.look.positions[*position as usize], &values[..rows.len()]);
            }
        }
    }
}

/// Fills the usable ones of every so many positions into groups. `weights` are those of the frames in C and S for the nominal steps.
#[inline(always)]
fn gather(
    look: &Look,
    weights: &[Column],
    every: usize,
    (steps, chosen, groups): (usize, &mut Vec<u32>, &mut [Side]),
) {
    let (count, most) = (look.positions.len(), groups.len() / (steps + 1) * SIDE);
    let least_dn2 = 4.0 * look.least_modulation_dn * look.least_modulation_dn;
    let mut values = [[0.0; SIDE]; MAX_STEPS];
    chosen.clear();
    for first in (0..count).step_by(SIDE * every) {
        let (mut sum, mut c, mut s) = ([0.0; SIDE], [0.0; SIDE], [0.0; SIDE]);
        let mut brightest = [0_u16; SIDE];
        for (step, values) in values[..steps].iter_mut().enumerate() {
            let mut frame = [0_u16; SIDE];
            let asked = look.values[step * count + first..(step + 1) * count].iter().step_by(every);
            frame.iter_mut().zip(asked).for_each(|(dn, value)| *dn = *value);
            for l in 0..SIDE {
                values[l] = f64::from(frame[l]);
                sum[l] += values[l];
                c[l] += weights[0][step] * values[l];
                s[l] += weights[1][step] * values[l];
                brightest[l] = if frame[l] > brightest[l] { frame[l] } else { brightest[l] };
            }
        }
        for l in 0..SIDE {
            let is_lit = c[l] * c[l] + s[l] * s[l] >= least_dn2 && sum[l] > 0.0;
            if !is_lit || brightest[l] >= look.clipped_dn || chosen.len() >= most {
                continue;
            }
            let (group, lane) = (chosen.len() / SIDE * (steps + 1), chosen.len() % SIDE);
            let scale = steps as f64 / sum[l];
            groups[group][lane] = sum[l] / steps as f64;
            for (row, values) in groups[group + 1..].iter_mut().zip(&values[..steps]) {
                row[lane] = values[l] * scale;
            }
            chosen.push((first + l * every) as u32);
        }
    }
    let (group, lane) = (chosen.len() / SIDE * (steps + 1), chosen.len() % SIDE);
    if lane > 0 {
        groups[group..=group + steps].iter_mut().for_each(|row| row[lane..].fill(0.0));
    }
}
