//! Whether the orders of a map belong together: where the wrapped phase runs on, the absolute phase must not jump.
//!
//! A wrong order of single pixels is the neighbours' affair. Bits in the wrong order, a wrong stripe width or sense
//! give whole stripes a wrong order, each consistent in itself; what gives them away is that the phase jumps by
//! multiples of 2π about as often as it wraps. A part's own steps do so too, but only along its edges.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::block::sum;
use super::runs_on::{MEETS, meeting};
use crate::math::simd::vectorised;
use crate::phase::PhaseViewMut;
use fearless_simd::Level;
use rayon::prelude::*;
use std::f32::consts::{FRAC_PI_2, TAU};
use std::ops::AddAssign;

/// Fewest rows of one parallel job.
const ROWS: usize = 16;

/// One of so many rows and columns is looked at, or of more …
const STRIDE: usize = 4;
/// … of a part so large that one of more leaves so many valid pixels on them: some thousand wraps, of which jumps in twenty are certain.
const ENOUGH: usize = 1 << 15;
/// One of so many is always looked at, so that a small face of a large part is seen.
const MOST_STRIDE: usize = 32;
/// So many columns are looked at side by side, in a row those of one place and in the next row those beside them.
const SIDE: usize = 64;
/// Jumps per wrap from which a sequence is looked at more closely.
pub(super) const MANY: f64 = 0.04;
/// With fewer wraps and jumps the sequence is not checked.
const LEAST: usize = 50;

/// Neighbours along rows and columns whose wrapped phases differ by less than π/2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Continuity {
    /// Pairs between which the wrapped phase passes 2π.
    pub wraps: usize,
    /// Pairs between which the absolute phase jumps by one or more periods; where these are many, without those that meet by chance at rims.
    pub jumps: usize,
}

impl Continuity {
    /// Jumps per wrap; 0 with too few wraps.
    pub fn jump_fraction(&self) -> f64 {
        if self.wraps.max(self.jumps) < LEAST { 0.0 } else { self.jumps as f64 / self.wraps.max(1) as f64 }
    }

    /// Looks at the pairs along every few rows, and at as many from row to row, of a map with so many valid pixels.
    pub fn of(map: &PhaseViewMut, valid: usize, level: Level) -> Self {
        let (width, height) = (map.info.width_px as usize, map.info.height_px as usize);
        let stride = (valid / ENOUGH).clamp(STRIDE, MOST_STRIDE);
        let rows = (0..height).into_par_iter().with_min_len(ROWS);
        let parts = rows.map(|row| vectorised!(level, Self::of_row(map, width, row, stride)));
        let mut all = parts.reduce(Self::default, sum);
        if all.jump_fraction() > MANY {
            let meetings: i64 = (0..height).map(|row| meetings(map, width, row, stride)).sum();
            all.jumps = all.jumps.min((meetings.max(0) / i64::from(MEETS)) as usize);
        }
        all
    }

    /// A row with itself, if it is one of those, and stretches of it with the row above.
    #[inline(always)]
    fn of_row(map: &PhaseViewMut, width: usize, row: usize, stride: usize) -> Self {
        let (phase, valid) = (&map.phase_rad[..(row + 1) * width], &map.valid[..(row + 1) * width]);
        let (here, here_valid) = (&phase[row * width..], &valid[row * width..]);
        let mut all = Self::default();
        if row.is_multiple_of(stride) {
            let pairs = here.iter().zip(here_valid).zip(here[1..].iter().zip(&here_valid[1..]));
            all += Self::of_pairs(pairs);
        }
        if let Some(above) = row.checked_sub(1) {
            let (above, above_valid) =
                (&phase[above * width..row * width], &valid[above * width..row * width]);
            for first in (row % stride * SIDE..width).step_by(SIDE * stride) {
                let part = first..(first + SIDE).min(width);
                let (a, b) = (above[part.clone()].iter(), here[part.clone()].iter());
                let (a_valid, b_valid) = (&above_valid[part.clone()], &here_valid[part]);
                all += Self::of_pairs(a.zip(a_valid).zip(b.zip(b_valid)));
            }
        }
        all
    }

    #[inline(always)]
    fn of_pairs<'a>(pairs: impl Iterator<Item = ((&'a f32, &'a u8), (&'a f32, &'a u8))>) -> Self {
        let (mut wraps, mut jumps) = (0_u32, 0_u32);
        for ((a, a_valid), (b, b_valid)) in pairs {
            let difference = b - a;
            let periods = nearest(difference / TAU);
            let usable = (a_valid & b_valid != 0) & ((difference - periods * TAU).abs() < FRAC_PI_2);
            jumps += u32::from(usable & (periods != 0.0));
            // The wrapped phase passes 2π where both lie in different periods, the jump apart.
            wraps += u32::from(usable & (whole(b / TAU) - whole(a / TAU) != periods));
        }
        Self { wraps: wraps as usize, jumps: jumps as usize }
    }
}

/// The same pairs as of [`Continuity::of_row`] whose orders do not follow each other: thirds of those between which the phase runs on, without
/// those by chance.
fn meetings(map: &PhaseViewMut, width: usize, row: usize, stride: usize) -> i64 {
    let (phase, valid) = (&*map.phase_rad, &*map.valid);
    let jumps = |one: usize, other: usize| {
        valid[one] & valid[other] != 0 && nearest((phase[other] - phase[one]) / TAU) != 0.0
    };
    let places = row * width..(row + 1) * width;
    let mut all = 0;
    if row.is_multiple_of(stride) {
        let (phase, valid) = (&phase[places.clone()], &valid[places.clone()]);
        let jumping = (1..width).filter(|at| jumps(places.start + at - 1, places.start + at));
        all += jumping.map(|at| i64::from(meeting(phase, valid, at, (1, 1)))).sum::<i64>();
    }
    if row > 0 {
        let looked_at = |column: &usize| (column / SIDE) % stride == row % stride;
        let below = (0..width).filter(looked_at).map(|column| places.start + column);
        let jumping = below.filter(|at| jumps(at - width, *at));
        all += jumping.map(|at| i64::from(meeting(phase, valid, at, (1, width)))).sum::<i64>();
    }
    all
}

impl AddAssign for Continuity {
    fn add_assign(&mut self, other: Self) {
        self.wraps += other.wraps;
        self.jumps += other.jumps;
    }
}

/// Nearest integer by plain arithmetic, for up to 2²¹.
#[inline(always)]
fn nearest(value: f32) -> f32 {
    (value + 12_582_912.0) - 12_582_912.0
}

/// Largest integer that is not above a value.
#[inline(always)]
pub(super) fn whole(value: f32) -> f32 {
    let near = nearest(value);
    if near > value { near - 1.0 } else { near }
}
