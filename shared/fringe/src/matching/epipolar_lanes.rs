//! The coarse stage for pixels side by side: where one run alone shows their phases, in the right row and in the left one, their places come
//! from comparisons of all of them with the cells in between. That is so nearly everywhere; other pixels are left to [`Row::find`].

use super::epipolar_rows::Row;
use super::patch_lanes::set32;
use super::subpixel_lanes::{Bits, LANES, set, whole};
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

impl Row {
    /// The places of those phases that are asked and that lie, with all others between them, in the one run that alone shows them.
    #[inline(always)]
    pub fn columns<S: Simd>(&mut self, simd: S, phases: &Singles, asked: Bits) -> Columns<S> {
        let column = f64x8::simd_from(simd, 0.0);
        let none = Columns { found: 0, column, cells_per_rad: 0.0 };
        let Some(run) = self.runs.get_mut(self.alone.run).filter(|run| run.monotone) else { return none };
        let phase = f32x8::simd_from(simd, *phases);
        let found = asked & set32(phase.simd_gt(self.alone.above)) & set32(phase.simd_lt(self.alone.below));
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
        let first = run.start as usize;
        let cells = &self.phase_rad[first..=run.end as usize];
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

    /// Whether the search for each phase, which is that of a pixel at a column of this row, ends within a tolerance of it (cells) and finds no
    /// other place. It may say no where that is so.
    #[inline(always)]
    pub fn return_beside<S: Simd>(
        &self,
        simd: S,
        phases: &Singles,
        columns: f64x8<S>,
        tolerance: f64,
    ) -> Bits {
        let Some(run) = self.runs.get(self.alone.run).filter(|run| run.monotone && !self.smoothed) else {
            return 0;
        };
        let (first, last) = (f64::from(run.start), f64::from(run.end));
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
        near & held & set32(singles.simd_gt(self.alone.above)) & set32(singles.simd_lt(self.alone.below))
    }
}
