//! The coarse stage for pixels side by side: where one run alone shows their phases, in the right row and in the left one, their places come
//! from comparisons of all of them with the cells in between. That is so nearly everywhere; other pixels are left to [`Row::find`].

use super::epipolar_rows::{Alone, Row};
use super::patch_lanes::set32;
use super::phase_run::{Clear, Run, column_behind};
use super::subpixel_lanes::{Bits, LANES, bits, set, whole};
use crate::math::simd::widened;
use fearless_simd::{
    Select, Simd, SimdBase, SimdFloat, SimdFrom, SimdMask, f32x8, f64x8, mask32x8, mask64x8,
};

type Singles = [f32; LANES];

/// Places of pixels in a row.
pub(super) struct Columns<S: Simd> {
    /// Whether the row alone shows the phase there; where not, the rest means nothing.
    pub found: Bits,
    /// Fractional columns of the cells.
    pub column: f64x8<S>,
    /// Cells per rad of the run.
    pub cells_per_rad: f64,
}

/// Whether a phase lies between two others.
#[inline(always)]
fn between<S: Simd>(phase: f64x8<S>, a: f64x8<S>, b: f64x8<S>) -> Bits {
    let (above_a, below_a) = (set(a.simd_le(phase)), set(phase.simd_le(a)));
    let (above_b, below_b) = (set(b.simd_le(phase)), set(phase.simd_le(b)));
    (above_a & below_b) | (above_b & below_a)
}

/// Part of the way from one phase to another. As in a run: neighbouring cells may show the same native pixel.
#[inline(always)]
fn fraction<S: Simd>(simd: S, phase: f64x8<S>, from: f64x8<S>, to: f64x8<S>) -> f64x8<S> {
    from.simd_eq(to).select(f64x8::simd_from(simd, 0.5), (phase - from) / (to - from))
}

/// Whether one run alone shows a phase, and its clear part alone.
#[inline(always)]
fn shown<S: Simd>(phase: f32x8<S>, alone: &Alone, clear: &Clear) -> Bits {
    let (above, below) = (alone.above.max(clear.above), alone.below.min(clear.below));
    set32(phase.simd_gt(above)) & set32(phase.simd_lt(below))
}

impl Row {
    /// The places of those phases that are asked and that lie, with all others between them, in the one run that alone shows them.
    #[inline(always)]
    pub fn columns<S: Simd>(&mut self, simd: S, phases: &Singles, asked: Bits) -> Columns<S> {
        let column = f64x8::simd_from(simd, 0.0);
        let none = Columns { found: 0, column, cells_per_rad: 0.0 };
        let Some(run) = self.runs.get_mut(self.alone.run) else { return none };
        let phase = f32x8::simd_from(simd, *phases);
        let found = asked & shown(phase, &self.alone, &run.clear);
        if found == 0 {
            return none;
        }
        // As if the phase grew with the column.
        let sense = if run.rising { 1.0 } else { -1.0 };
        let held = mask32x8::from_bitmask(simd, u64::from(found));
        let limit =
            |value: f32| -> Singles { held.select(phase * sense, f32x8::simd_from(simd, value)).into() };
        let nearest = limit(f32::INFINITY).into_iter().fold(f32::INFINITY, |a, b| if b < a { b } else { a });
        let farthest =
            limit(f32::NEG_INFINITY).into_iter().fold(f32::NEG_INFINITY, |a, b| if b > a { b } else { a });
        let wanted = held.select(phase * sense, f32x8::simd_from(simd, nearest));
        let first = run.clear.first as usize;
        let cells = &self.phase_rad[first..=run.clear.last as usize];
        let last = cells.len() - 2;
        let mut cell = (run.cursor as usize).clamp(first, first + last) - first;
        while cell > 0 && sense * cells[cell] >= nearest {
            cell -= 1;
        }
        while cell < last && sense * cells[cell + 1] < nearest {
            cell += 1;
        }
        // All begin in the bracket of the nearest one, and go on with each cell that lies before them.
        let all = |value: f32| f32x8::simd_from(simd, value);
        let (mut from, mut to, mut place) = (all(cells[cell]), all(cells[cell + 1]), all(cell as f32));
        let mut next = cell + 1;
        while next <= last && sense * cells[next] < farthest {
            let before = wanted.simd_gt(sense * cells[next]);
            from = before.select(all(cells[next]), from);
            to = before.select(all(cells[next + 1]), to);
            place = before.select(all(next as f32), place);
            next += 1;
        }
        run.cursor = (first + next - 1) as u32;
        let (from, to, phase) = (widened(simd, from), widened(simd, to), widened(simd, phase));
        let column = widened(simd, place) + first as f64 + fraction(simd, phase, from, to);
        Columns { found: found & between(phase, from, to), column, cells_per_rad: run.cells_per_rad }
    }

    /// The phases that are sought for pixels at columns of this row, their own or the row's means, and whether the search for each of them
    /// ends within a tolerance of the column (cells) and finds no other place. It may say no where that is so.
    #[inline(always)]
    pub fn sought_beside<S: Simd>(
        &self,
        simd: S,
        phases: &Singles,
        columns: f64x8<S>,
        tolerance: f64,
    ) -> (Singles, Bits) {
        if self.smoothed {
            self.means_beside(phases, columns.into(), tolerance)
        } else {
            (*phases, self.return_beside(simd, phases, columns, tolerance))
        }
    }

    /// The same where noise was averaged out of the row: the mean at a column is shown there.
    #[inline(always)]
    fn means_beside(&self, phases: &Singles, columns: [f64; LANES], tolerance: f64) -> (Singles, Bits) {
        let (mut sought, mut returned) = (*phases, [false; LANES]);
        let Some(Run { clear, .. }) = self.runs.get(self.alone.run) else { return (sought, 0) };
        for l in 0..LANES {
            let Some(mean) = self.mean_at(columns[l]) else { continue };
            sought[l] = mean;
            let cell = columns[l] as usize;
            if cell < clear.first as usize || cell >= clear.last as usize {
                continue;
            }
            let place = column_behind(&self.phase_rad, cell, mean);
            let near = place.is_some_and(|place| (place - columns[l]).abs() <= tolerance);
            returned[l] = near && clear.holds(mean) && self.alone.holds(mean);
        }
        (sought, bits(&returned))
    }

    #[inline(always)]
    fn return_beside<S: Simd>(&self, simd: S, phases: &Singles, columns: f64x8<S>, tolerance: f64) -> Bits {
        let Some(Run { clear, .. }) = self.runs.get(self.alone.run) else { return 0 };
        let (first, last) = (f64::from(clear.first), f64::from(clear.last));
        // The cell nearest to each, and those before and behind it.
        let nearest = (columns + 0.5).floor();
        let held = set(nearest.simd_gt(first)) & set(nearest.simd_lt(last));
        if held == 0 {
            return 0;
        }
        let inner = mask64x8::from_bitmask(simd, u64::from(held));
        let cells = whole(inner.select(nearest, f64x8::simd_from(simd, first + 1.0)));
        let mut three = [[0.0; LANES]; 3];
        for l in 0..LANES {
            let near = &self.phase_rad[cells[l] - 1..=cells[l] + 1];
            (three[0][l], three[1][l], three[2][l]) = (near[0], near[1], near[2]);
        }
        let [before, here, behind] = three.map(|phases| widened(simd, f32x8::simd_from(simd, phases)));
        let singles = f32x8::simd_from(simd, *phases);
        let phase = widened(simd, singles);
        let (back, on) = (between(phase, before, here), between(phase, here, behind));
        let returned = mask64x8::from_bitmask(simd, u64::from(back));
        let (from, to) = (returned.select(before, here), returned.select(here, behind));
        let [zero, one] = [0.0, 1.0].map(|value| f64x8::simd_from(simd, value));
        let place = nearest + fraction(simd, phase, from, to) - returned.select(one, zero);
        let near = set((place - columns).abs().simd_le(tolerance)) & (back | on);
        near & held & shown(singles, &self.alone, clear)
    }
}

#[cfg(test)]
mod tests {
    use super::super::epipolar_rows::StepLimits;
    use super::*;
    use crate::math::simd::{best_level, vectorised};
    use crate::synthetic::Noise;

    const LIMITS: StepLimits = StepLimits { max_rad: 1.0, back_rad: 0.1 };

    fn places(row: &mut Row, phase: f32, near: Option<f64>) -> Vec<(f64, f64)> {
        let mut found = Vec::new();
        row.find(phase, near, |column, per_rad| found.push((column, per_rad)));
        found
    }

    /// What pixels side by side find: places and cells per rad in one row, and what is sought, with whether it returns, in the other.
    fn beside(
        row: &mut Row,
        phases: &Singles,
        columns: [f64; LANES],
    ) -> (Bits, [f64; LANES], f64, Singles, Bits) {
        vectorised!(best_level(), |simd| {
            let (sought, returned) = row.sought_beside(simd, phases, f64x8::simd_from(simd, columns), 2.0);
            let Columns { found, column, cells_per_rad } = row.columns(simd, &sought, Bits::MAX);
            (found, column.into(), cells_per_rad, sought, returned)
        })
    }

    /// Proves: whatever the noise of a row, pixels side by side find bit by bit what each finds by itself in a row that was never asked before,
    /// and most of them do where noise makes neighbours change places: at ends of the row, where no mean is wide, or all along it.
    #[test]
    fn pixels_side_by_side_find_what_each_finds_by_itself() {
        let (mut asked, mut found_all, mut returned_all) = ([0; 4], [0; 4], [0; 4]);
        for seed in 0..60_u64 {
            let kind = seed as usize % 4;
            // Quiet, a little noise, noise to be averaged out, noise with a dip in the surface.
            let noise_rad = [0.0, 0.008, 0.03, 0.03][kind];
            let mut noise = Noise(seed);
            let sense = if seed % 3 == 0 { -1.0 } else { 1.0 };
            let phase = |cell: usize| {
                let dip = if kind == 3 && (300..330).contains(&cell) { 0.8 } else { 0.0 };
                sense * (0.04 * cell as f64 - dip)
            };
            let cells: Vec<f32> =
                (0..600).map(|cell| (phase(cell) + noise_rad * noise.gauss()) as f32).collect();
            let mut row = Row::with_capacity(600);
            row.fill(cells.iter().copied(), LIMITS, best_level());
            let unasked = row.clone();
            for first in (0..592).step_by(8) {
                let columns: [f64; LANES] = std::array::from_fn(|l| (first + l) as f64 + 0.3);
                let phases: Singles =
                    columns.map(|c| (phase(c as usize) + 0.012 * sense + noise_rad * noise.gauss()) as f32);
                // One pixel the general way says which run is meant.
                let mean = |row: &Row, l: usize| row.mean_at(columns[l]).unwrap_or(phases[l]);
                let wanted = mean(&row, 0);
                places(&mut row, wanted, None);
                let (found, column, per_rad, sought, returned) = beside(&mut row, &phases, columns);
                for l in 0..LANES {
                    assert_eq!(
                        sought[l].to_bits(),
                        mean(&row, l).to_bits(),
                        "seed {seed}, cell {}",
                        first + l
                    );
                    asked[kind] += 1;
                    let mut alone = unasked.clone();
                    if found >> l & 1 != 0 {
                        found_all[kind] += 1;
                        let single = places(&mut alone, sought[l], None);
                        assert_eq!(single, [(column[l], per_rad)], "seed {seed}, cell {}", first + l);
                    }
                    if returned >> l & 1 != 0 {
                        returned_all[kind] += 1;
                        let single = places(&mut alone, sought[l], Some(columns[l]));
                        let [(place, _)] = single[..] else { panic!("seed {seed}: {single:?}") };
                        assert!((place - columns[l]).abs() <= 2.0, "seed {seed}: {place}, {}", columns[l]);
                    }
                }
            }
        }
        let shares = |counts: [i32; 4]| [0, 1, 2, 3].map(|i| f64::from(counts[i]) / f64::from(asked[i]));
        let (found, returned) = (shares(found_all), shares(returned_all));
        assert!(found[0] > 0.99 && found[2] > 0.95 && returned[2] > 0.95, "{found:?}, {returned:?}");
    }
}
