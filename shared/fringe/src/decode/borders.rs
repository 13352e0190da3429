//! Which fringes follow each other in a decoded map: the next one, or others.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::block::state;
use super::continuity::whole;
use super::roles::AxisPlan;
use super::runs_on::{MEETS, meeting};
use crate::math::simd::vectorised;
use crate::phase::PhaseViewMut;
use fearless_simd::Level;
use std::f32::consts::TAU;

/// One of so many rows and columns is walked along to see which fringes are neighbours.
const LINES: usize = 8;
/// Masked pixels in between that are passed over.
const MOST_GAP: u32 = 8;
/// Steps since a valid pixel where there was none; more than the rows and columns of an image.
const NEVER: u32 = 1 << 30;
/// Fewest crossings to a fringe that is not the next.
const LEAST_CROSSINGS: i32 = 12;
/// So many pixels are looked at side by side.
const SIDE: usize = 16;

/// Where fringes follow each other in the decoded map, and where others do although the phase runs on: of each fringe, from the one before the
/// projector on, crossings to the next and thirds of crossings to another, without those by chance.
#[derive(Debug)]
pub(super) struct Borders {
    crossings: Vec<[i32; 2]>,
    /// The columns that are walked along, side by side, since the rows lie in one piece.
    columns: Vec<Walks>,
}

impl Borders {
    /// Room for the fringes of a projector, and for images of this width.
    pub fn of(plan: &AxisPlan, width: usize) -> Self {
        let fringes =
            if plan.period_px > 0.0 { (plan.extent_px / plan.period_px).ceil() as usize } else { 0 };
        Self {
            crossings: vec![[0; 2]; fringes + 4],
            columns: vec![Walks::START; width.div_ceil(LINES * SIDE)],
        }
    }

    /// Walks along some rows and columns; whether the way to a next fringe leads elsewhere about as often.
    pub fn are_strange(&mut self, map: &PhaseViewMut, level: Level) -> bool {
        self.crossings.fill([0; 2]);
        self.columns.fill(Walks::START);
        vectorised!(level, self.walk(map));
        self.crossings
            .iter()
            .any(|[next, other]| *other >= MEETS * LEAST_CROSSINGS && 2 * other > MEETS * next)
    }

    #[inline(always)]
    fn walk(&mut self, map: &PhaseViewMut) {
        let Self { crossings, columns } = self;
        let width = map.info.width_px as usize;
        for (row, (phase, valid)) in map.phase_rad.chunks(width).zip(map.valid.chunks(width)).enumerate() {
            if row.is_multiple_of(LINES) {
                along(phase, valid, crossings);
            }
            for (first, walks) in (0..width).step_by(LINES * SIDE).zip(columns.iter_mut()) {
                let here = Columns { map, start: row * width + first };
                walks.step(&picked(phase, first), &picked(valid, first), &here, crossings);
            }
        }
    }
}

/// Walks along a row.
#[inline(always)]
fn along(phase_rad: &[f32], valid: &[u8], crossings: &mut [[i32; 2]]) {
    let (mut last, mut gap) = (0.0, NEVER);
    let (row, all_valid) = (phase_rad, valid);
    for (first, (phase_rad, valid)) in (0..).step_by(SIDE).zip(phase_rad.chunks(SIDE).zip(valid.chunks(SIDE)))
    {
        let mut here = [0.0; SIDE];
        for (here, phase_rad) in here.iter_mut().zip(phase_rad) {
            *here = whole(phase_rad / TAU);
        }
        let known: u8 = valid.iter().map(|valid| u8::from(*valid == state::SURE)).sum();
        let here = &here[..valid.len()];
        if known == 0 {
            gap += here.len() as u32;
            continue;
        }
        let alike = here.iter().fold(true, |alike, here| alike & (*here == last));
        if alike && gap == 0 && known as usize == here.len() {
            continue;
        }
        for (at, (here, valid)) in (first..).zip(here.iter().zip(valid)) {
            gap += 1;
            if *valid == state::SURE {
                if gap <= MOST_GAP && *here != last {
                    cross(*here, last, crossings, || meeting(row, all_valid, at, (gap as usize, 1)));
                }
                (last, gap) = (*here, 0);
            }
        }
    }
}

/// The pixels of a row at which walks along columns are.
struct Columns<'a, 'b> {
    map: &'a PhaseViewMut<'b>,
    /// The first of them.
    start: usize,
}

impl Columns<'_, '_> {
    /// Whether the phase runs on to one of them from so many rows above.
    fn meeting(&self, number: usize, rows: u32) -> i32 {
        let place = self.start + number * LINES;
        meeting(self.map.phase_rad, self.map.valid, place, (rows as usize, self.map.info.width_px as usize))
    }
}

/// Where walks along some columns are.
#[derive(Debug, Clone, Copy)]
struct Walks {
    /// Fringe of the last valid pixel.
    last: [f32; SIDE],
    /// Steps since that pixel.
    gap: [u32; SIDE],
}

impl Walks {
    /// No valid pixel so far.
    const START: Self = Self { last: [0.0; SIDE], gap: [NEVER; SIDE] };

    /// Goes on to the pixels of the next row and counts the borders that are crossed.
    #[inline(always)]
    fn step(
        &mut self,
        phase_rad: &[f32; SIDE],
        valid: &[u8; SIDE],
        columns: &Columns,
        crossings: &mut [[i32; 2]],
    ) {
        let (before, gaps) = (self.last, self.gap);
        let (mut here, mut crossed) = ([0.0; SIDE], [0_u32; SIDE]);
        for l in 0..SIDE {
            here[l] = whole(phase_rad[l] / TAU);
            let (known, gap) = (valid[l] == state::SURE, self.gap[l] + 1);
            crossed[l] = u32::from(known & (gap <= MOST_GAP) & (here[l] != before[l]));
            self.last[l] = if known { here[l] } else { before[l] };
            self.gap[l] = if known { 0 } else { gap };
        }
        if crossed.iter().fold(0, |any, crossed| any | crossed) != 0 {
            for l in (0..SIDE).filter(|l| crossed[*l] != 0) {
                cross(here[l], before[l], crossings, || columns.meeting(l, gaps[l] + 1));
            }
        }
    }
}

/// Counts the border between two fringes.
fn cross(here: f32, last: f32, crossings: &mut [[i32; 2]], meeting: impl FnOnce() -> i32) {
    if (here - last).abs() == 1.0 {
        count(crossings, here.min(last), 0, 1);
    } else {
        let thirds = meeting();
        // To which side the phase runs on is not known: the border is one of four.
        for fringe in [here, here - 1.0, last, last - 1.0] {
            count(crossings, fringe, 1, thirds);
        }
    }
}

fn count(crossings: &mut [[i32; 2]], fringe: f32, kind: usize, number: i32) {
    if let Some(crossings) = crossings.get_mut((fringe + 1.0).max(0.0) as usize) {
        crossings[kind] += number;
    }
}

/// Every [`LINES`]th value of a row from one on; zeros beyond its end, where nothing is valid.
#[inline(always)]
fn picked<T: Copy + Default>(row: &[T], first: usize) -> [T; SIDE] {
    let mut picked = [T::default(); SIDE];
    for (picked, value) in picked.iter_mut().zip(row[first..].iter().step_by(LINES)) {
        *picked = *value;
    }
    picked
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Key;
    use crate::math::simd::best_level;
    use crate::pattern::Axis;
    use crate::phase::{PhaseInfo, PhaseMap};

    /// Pixel by pixel, as it is told.
    fn walked(pixels: impl Iterator<Item = (f32, u8)>, crossings: &mut [[i32; 2]]) {
        let (phases, valid): (Vec<f32>, Vec<u8>) = pixels.unzip();
        let mut last: Option<(f32, usize)> = None;
        for (at, phase_rad) in phases.iter().enumerate().filter(|(at, _)| valid[*at] == state::SURE) {
            let here = (phase_rad / TAU).floor();
            if let Some((fringe, before)) = last
                && here != fringe
                && at - before <= MOST_GAP as usize
            {
                cross(here, fringe, crossings, || meeting(&phases, &valid, at, (at - before, 1)));
            }
            last = Some((here, at));
        }
    }

    #[test]
    fn rows_and_columns_side_by_side_are_those_walked_alone() {
        let key = Key::new(11);
        for (width, height) in [(300, 90), (37, 41), (5, 9)] {
            let info = PhaseInfo {
                width_px: width as u32,
                height_px: height as u32,
                axis: Axis::X,
                period_px: 16.0,
            };
            let mut map = PhaseMap::new(info);
            for i in 0..width * height {
                let (x, y, draw) = (i % width, i / width, key.open(i as u64));
                // Fringes with noise at their borders, holes of pixels and of stretches, jumps.
                let hole = draw < 0.05 || (x / 23 + y / 11) % 7 == 3;
                let jump = if (x / 60 + y / 30) % 3 == 1 { 13.0 } else { 0.0 };
                map.valid[i] = u8::from(!hole);
                map.phase_rad[i] = if hole {
                    f32::NAN
                } else {
                    (0.4 * x as f64 + 0.1 * y as f64 + 0.2 * draw + jump) as f32
                };
            }
            let mut expected = vec![[0; 2]; 44];
            let pixel = |i: usize| (map.phase_rad[i], map.valid[i]);
            for row in (0..height).step_by(LINES) {
                walked((0..width).map(|x| pixel(row * width + x)), &mut expected);
            }
            for column in (0..width).step_by(LINES) {
                walked((0..height).map(|y| pixel(y * width + column)), &mut expected);
            }
            let columns = vec![Walks::START; width.div_ceil(LINES * SIDE)];
            let mut borders = Borders { crossings: vec![[7; 2]; 44], columns };
            borders.are_strange(&map.view_mut(), best_level());
            assert_eq!(borders.crossings, expected);
            assert!(width < 100 || expected.iter().map(|both| both[0].min(both[1].abs())).sum::<i32>() > 10);
        }
    }
}
