//! What neighbours prove: orders that a pixel's own frames leave open, and single pixels whose order is wrong.
//!
//! The thesis (5.3) compares with neighbours and then removes spikes with an edge filter. Here nothing is filtered: a
//! phase changes by whole periods or is masked, and only on proof. A real step in depth keeps its pixels, since each of
//! them has neighbours on its own side.

use super::order::state;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Correction that means "mask it".
pub const MASK: i16 = i16::MIN;
/// Pixels around one that must be certain before they can speak against it.
const LEAST_WITNESSES: usize = 6;

/// Phase and state of the whole image, before any correction.
#[derive(Clone, Copy)]
pub struct Field<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Absolute phase with the orders found so far, rad; NaN where invalid.
    pub phase_rad: &'a [f32],
    /// [`state`].
    pub state: &'a [u8],
    /// How far to look, pixels.
    pub reach: usize,
    /// Whether single wrong pixels are sought.
    pub spikes: bool,
}

impl Field<'_> {
    /// Corrections of the rows from `row` on, in whole periods.
    pub fn correct(&self, row: usize, out: &mut [i16]) {
        for (offset, line) in out.chunks_mut(self.width).enumerate() {
            self.flag(row + offset, line);
            for (column, correction) in line.iter_mut().enumerate() {
                if *correction != 0 {
                    *correction = self.decide(row + offset, column);
                }
            }
        }
    }

    /// Marks the pixels that need a closer look: not certain, or more than π away from a neighbour.
    fn flag(&self, row: usize, out: &mut [i16]) {
        let start = row * self.width;
        let line = &self.phase_rad[start..start + self.width];
        for (flag, state) in out.iter_mut().zip(&self.state[start..]) {
            *flag = i16::from(*state > state::SURE);
        }
        if !self.spikes {
            return;
        }
        if self.width > 1 {
            let last = self.width - 1;
            for ((flag, a), b) in out[..last].iter_mut().zip(line).zip(&line[1..]) {
                *flag |= i16::from((a - b).abs() > PI);
            }
            for ((flag, a), b) in out[1..].iter_mut().zip(&line[1..]).zip(line) {
                *flag |= i16::from((a - b).abs() > PI);
            }
        }
        let above = row.checked_sub(1).map(|r| &self.phase_rad[r * self.width..]);
        let below = (row + 1 < self.height).then(|| &self.phase_rad[start + self.width..]);
        for other in [above, below].into_iter().flatten() {
            for ((flag, a), b) in out.iter_mut().zip(line).zip(other) {
                *flag |= i16::from((a - b).abs() > PI);
            }
        }
    }

    fn decide(&self, row: usize, column: usize) -> i16 {
        match self.state[row * self.width + column] {
            state::INVALID => 0,
            state::SURE => self.spike(row, column),
            level => self.vote(row, column, level),
        }
    }

    /// Asks the nearest certain pixel in each of the four directions.
    fn vote(&self, row: usize, column: usize, level: u8) -> i16 {
        let votes = [(0, -1), (0, 1), (-1, 0), (1, 0)].map(|step| self.ask(row, column, step));
        let mut given = votes.into_iter().flatten();
        let Some(first) = given.next() else { return MASK };
        let mut count = 1;
        for vote in given {
            if vote != first {
                return MASK;
            }
            count += 1;
        }
        let needed = if level == state::WEAK && first == 0 { 1 } else { 2 };
        if count >= needed { first } else { MASK }
    }

    /// Walks in one direction over pixels whose wrapped phase is continuous, as far as the first certain one; the
    /// whole periods between its phase and the one carried along are its vote.
    fn ask(&self, row: usize, column: usize, step: (isize, isize)) -> Option<i16> {
        let (mut row, mut column) = (row, column);
        let start = self.phase_rad[row * self.width + column];
        let mut carried = start;
        for _ in 0..self.reach {
            row = row.checked_add_signed(step.0).filter(|r| *r < self.height)?;
            column = column.checked_add_signed(step.1).filter(|c| *c < self.width)?;
            let index = row * self.width + column;
            if self.state[index] == state::INVALID {
                return None;
            }
            let difference = self.phase_rad[index] - carried;
            let rest = difference - TAU * (difference / TAU).round();
            if rest.abs() > FRAC_PI_2 {
                return None;
            }
            carried += rest;
            if self.state[index] == state::SURE {
                let periods = ((self.phase_rad[index] - carried) / TAU).round();
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
        let periods = (offset / TAU).round();
        let whole = (offset - TAU * periods).abs() <= FRAC_PI_4;
        let same = around.iter().flatten().filter(|d| (**d / TAU).round() == periods).count();
        if whole && periods != 0.0 && same + 1 >= witnesses && periods.abs() < 30_000.0 {
            return periods as i16;
        }
        let far = around.iter().flatten().filter(|d| d.abs() > PI).count();
        if !whole && far + 1 >= witnesses { MASK } else { 0 }
    }
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
