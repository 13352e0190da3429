//! What neighbours prove: orders that a pixel's own frames leave open, and single pixels whose order is wrong.
//!
//! The thesis (5.3) compares with neighbours and then removes spikes with an edge filter. Here nothing is filtered: a
//! phase changes by whole periods or is masked, and only on proof. A real step in depth keeps its pixels, since each of
//! them has neighbours on its own side.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::block::{BLOCK, state};
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Correction that means "mask it".
pub const MASK: i16 = i16::MIN;
/// Pixels around one that must be certain before they can speak against it.
const LEAST_WITNESSES: usize = 6;

/// A stretch of which some pixels were asked: its corrections are written.
pub const ASKED: u32 = u32::MAX;
/// Flags that are checked at once.
const GROUP: usize = 16;

/// Phase and state of the whole image, before any correction.
#[derive(Clone, Copy)]
pub struct Field<'a> {
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Absolute phase with the orders found so far, rad; NaN where invalid.
    pub phase_rad: &'a [f32],
    /// One value of [`state`] for each pixel.
    pub state: &'a [u8],
    /// Step (rows, columns) that probably crosses the fringes: cameras mostly stand as upright as the projector. Only a
    /// preference, no assumption: a vote is the same whatever way it comes.
    pub along: (isize, isize),
    /// How far to look, pixels.
    pub reach: usize,
    /// Whether single wrong pixels are sought.
    pub spikes: bool,
}

impl Field<'_> {
    /// Corrections of the rows from `row` on, in whole periods, written only where a stretch of a row needs some; of each stretch of [`BLOCK`]
    /// pixels the number of its valid ones, or [`ASKED`] where some needed a closer look.
    #[inline(always)]
    pub fn correct(&self, row: usize, out: &mut [i16], stretches: &mut [u32]) {
        let mut flags = [0_u8; BLOCK];
        let lines = out.chunks_mut(self.width).zip(stretches.chunks_mut(self.width.div_ceil(BLOCK)));
        for (row, (line, stretches)) in (row..).zip(lines) {
            for ((first, line), stretch) in (0..).step_by(BLOCK).zip(line.chunks_mut(BLOCK)).zip(stretches) {
                let flags = &mut flags[..line.len()];
                self.flag(row, first, flags);
                if flags.iter().fold(0, |any, flag| any | flag) == 0 {
                    let states = &self.state[row * self.width + first..][..line.len()];
                    *stretch = states.iter().map(|state| u32::from(*state)).sum();
                    continue;
                }
                *stretch = ASKED;
                line.fill(0);
                for (group, flags) in flags.chunks(GROUP).enumerate() {
                    if flags.iter().fold(0, |any, flag| any | flag) == 0 {
                        continue;
                    }
                    for i in (0..flags.len()).filter(|i| flags[*i] != 0) {
                        let column = group * GROUP + i;
                        line[column] = self.decide(row, first + column);
                    }
                }
            }
        }
    }

    /// Marks the pixels of a row from `first` on that need a closer look: not certain, or more than π away from a neighbour.
    #[inline(always)]
    fn flag(&self, row: usize, first: usize, out: &mut [u8]) {
        let (start, end) = (row * self.width, first + out.len());
        let states = &self.state[start + first..start + end];
        if !self.spikes {
            for (flag, state) in out.iter_mut().zip(states) {
                *flag = u8::from(*state > state::SURE);
            }
            return;
        }
        let line = &self.phase_rad[start..start + self.width];
        // At the border of the image a pixel stands in for the neighbour that it lacks.
        let above = row.checked_sub(1).map_or(line, |r| &self.phase_rad[r * self.width..start]);
        let below = if row + 1 < self.height { &self.phase_rad[start + self.width..] } else { line };
        let (low, high) = (first.max(1), end.min(self.width - 1));
        if low < high {
            let count = high - low;
            let [left, here, right] = [low - 1, low, low + 1].map(|from| &line[from..from + count]);
            let [above, below] = [above, below].map(|other| &other[low..high]);
            let (states, flags) = (&states[low - first..][..count], &mut out[low - first..][..count]);
            for i in 0..count {
                let a = here[i];
                let torn = ((a - above[i]).abs() > PI)
                    | ((a - below[i]).abs() > PI)
                    | ((a - left[i]).abs() > PI)
                    | ((a - right[i]).abs() > PI);
                flags[i] = u8::from((states[i] > state::SURE) | torn);
            }
        }
        for column in [first, end - 1].into_iter().filter(|column| !(low..high).contains(column)) {
            let a = line[column];
            let (left, right) = (line[column.saturating_sub(1)], line[(column + 1).min(self.width - 1)]);
            let torn = [above[column], below[column], left, right].iter().any(|b| (a - b).abs() > PI);
            out[column - first] = u8::from(states[column - first] > state::SURE || torn);
        }
    }

    #[inline(never)]
    fn decide(&self, row: usize, column: usize) -> i16 {
        match self.state[row * self.width + column] {
            state::INVALID => 0,
            state::SURE => self.spike(row, column),
            level => self.vote(row, column, level),
        }
    }

    /// Asks the nearest certain pixels, first along the axis of the fringes, and across it only if one of them is silent.
    fn vote(&self, row: usize, column: usize, level: u8) -> i16 {
        let along = [self.ask(row, column, self.along, -1), self.ask(row, column, self.along, 1)];
        let (first, count) = match along {
            [Some(a), Some(b)] if a == b => return a,
            [Some(_), Some(_)] => return MASK,
            [a, b] => (a.or(b), usize::from(a.or(b).is_some())),
        };
        let across = (self.along.1, self.along.0);
        let votes = [self.ask(row, column, across, -1), self.ask(row, column, across, 1)];
        let Some(vote) = first.or(votes[0]).or(votes[1]) else { return MASK };
        if votes.iter().flatten().any(|other| *other != vote) {
            return MASK;
        }
        let needed = if level == state::WEAK && vote == 0 { 1 } else { 2 };
        if count + votes.iter().flatten().count() >= needed { vote } else { MASK }
    }

    /// Walks in one direction over pixels whose wrapped phase is continuous, as far as the first certain one; the
    /// whole periods between its phase and the one carried along are its vote.
    fn ask(&self, row: usize, column: usize, step: (isize, isize), sense: isize) -> Option<i16> {
        let (mut row, mut column) = (row, column);
        let start = self.phase_rad[row * self.width + column];
        let mut carried = start;
        for _ in 0..self.reach {
            row = row.checked_add_signed(sense * step.0).filter(|r| *r < self.height)?;
            column = column.checked_add_signed(sense * step.1).filter(|c| *c < self.width)?;
            let index = row * self.width + column;
            if self.state[index] == state::INVALID {
                return None;
            }
            let difference = self.phase_rad[index] - carried;
            let rest = difference - TAU * periods(difference);
            if rest.abs() > FRAC_PI_2 {
                return None;
            }
            carried += rest;
            if self.state[index] == state::SURE {
                let periods = periods(self.phase_rad[index] - carried);
                return (periods.abs() < 30_000.0).then_some(periods as i16);
            }
        }
        None
    }

    /// The eight certain neighbours against one certain pixel.
    ///
    /// The means of opposite neighbours predict the pixel on a smooth surface. If at least two such pairs, none of them
    /// torn but one, and all neighbours but one say the same k ≠ 0 whole periods, the order is corrected. If they agree
    /// that the pixel is far off but not by whole periods, it is masked.
    fn spike(&self, row: usize, column: usize) -> i16 {
        if row == 0 || column == 0 || row + 1 >= self.height || column + 1 >= self.width {
            return 0;
        }
        let centre = row * self.width + column;
        let phase = self.phase_rad[centre];
        let w = self.width;
        // Opposite pixels stand at i and 7 − i.
        let around = [
            centre - w - 1,
            centre - w,
            centre - w + 1,
            centre - 1,
            centre + 1,
            centre + w - 1,
            centre + w,
            centre + w + 1,
        ]
        .map(|n| (self.state[n] == state::SURE).then(|| self.phase_rad[n] - phase));
        let witnesses = around.iter().flatten().count();
        if witnesses < LEAST_WITNESSES {
            return 0;
        }
        let Some(offset) = paired_offset(&around) else { return 0 };
        let order = periods(offset);
        let whole = (offset - TAU * order).abs() <= FRAC_PI_4;
        let same = around.iter().flatten().filter(|d| periods(**d) == order).count();
        if whole && order != 0.0 && same + 1 >= witnesses && order.abs() < 30_000.0 {
            return order as i16;
        }
        let far = around.iter().flatten().filter(|d| d.abs() > PI).count();
        if !whole && far + 1 >= witnesses { MASK } else { 0 }
    }
}

/// Whole periods in a phase difference: the nearest integer by plain arithmetic, for up to 2²¹ of them.
fn periods(difference_rad: f32) -> f32 {
    (difference_rad / TAU + 12_582_912.0) - 12_582_912.0
}

/// Mean offset of the opposite pairs, if at least two agree and at most one is torn.
fn paired_offset(around: &[Option<f32>; 8]) -> Option<f32> {
    let mut offsets = [0.0_f32; 4];
    let (mut count, mut torn) = (0, 0);
    for i in 0..4 {
        if let (Some(a), Some(b)) = (around[i], around[7 - i]) {
            if (a - b).abs() > PI {
                torn += 1;
            } else {
                offsets[count] = 0.5 * (a + b);
                count += 1;
            }
        }
    }
    let offsets = &offsets[..count];
    let mean = offsets.iter().sum::<f32>() / count.max(1) as f32;
    let agree = offsets.iter().all(|o| (o - mean).abs() <= FRAC_PI_4);
    (count >= 2 && torn <= 1 && agree).then_some(mean)
}
