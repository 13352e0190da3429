//! The coarse stage for pixels side by side: where one run alone shows their phases, in the right row and in the left one, their places come
//! from comparisons of all of them with the cells in between. That is so nearly everywhere; other pixels are left to [`Row::find`].

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::epipolar_rows::Row;
use super::subpixel_lanes::LANES;

type Singles = [f32; LANES];

/// Places of pixels in a row.
pub(super) struct Columns {
    /// Whether the row alone shows the phase there; where not, the rest means nothing.
    pub found: [bool; LANES],
    /// Fractional columns of the cells.
    pub column: [f64; LANES],
    /// Cells per rad of the run.
    pub cells_per_rad: f64,
}

impl Row {
    /// The places of those phases that are asked and that lie, with all others between them, in the one run that alone shows them.
    #[inline(always)]
    pub fn columns(&mut self, phases: &Singles, asked: [bool; LANES]) -> Columns {
        let mut out = Columns { found: [false; LANES], column: [0.0; LANES], cells_per_rad: 0.0 };
        let Some(run) = self.runs.get_mut(self.alone.run).filter(|run| run.monotone) else { return out };
        let (above, below) = (self.alone.above, self.alone.below);
        for (l, phase) in phases.iter().enumerate() {
            out.found[l] = asked[l] & (above < *phase) & (*phase < below);
        }
        // As if the phase grew with the column.
        let sense = if run.rising { 1.0 } else { -1.0 };
        let (mut nearest, mut farthest) = (f32::INFINITY, f32::NEG_INFINITY);
        for (l, phase) in phases.iter().enumerate() {
            let wanted = sense * phase;
            nearest = if out.found[l] & (wanted < nearest) { wanted } else { nearest };
            farthest = if out.found[l] & (wanted > farthest) { wanted } else { farthest };
        }
        if nearest > farthest {
            return out;
        }
        let mut wanted = [0.0; LANES];
        for l in 0..LANES {
            wanted[l] = if out.found[l] { sense * phases[l] } else { nearest };
        }
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
        let (mut from, mut to, mut place) =
            ([cells[cell]; LANES], [cells[cell + 1]; LANES], [cell as i32; LANES]);
        let mut next = cell + 1;
        while next <= last && sense * cells[next] < farthest {
            let (here, after) = (cells[next], cells[next + 1]);
            for l in 0..LANES {
                let before = sense * here < wanted[l];
                from[l] = if before { here } else { from[l] };
                to[l] = if before { after } else { to[l] };
                place[l] = if before { next as i32 } else { place[l] };
            }
            next += 1;
        }
        run.cursor = (first + next - 1) as u32;
        out.cells_per_rad = run.cells_per_rad;
        for l in 0..LANES {
            let (from, to, wanted) = (f64::from(from[l]), f64::from(to[l]), f64::from(phases[l]));
            let inside = ((from <= wanted) & (wanted <= to)) | ((to <= wanted) & (wanted <= from));
            // As in a run: neighbouring cells may show the same native pixel.
            let fraction = if from == to { 0.5 } else { (wanted - from) / (to - from) };
            out.column[l] = f64::from(first as i32 + place[l]) + fraction;
            out.found[l] &= inside;
        }
        out
    }

    /// Whether the search for each phase, which is that of a pixel at a column of this row, ends within a tolerance of it (cells) and finds no
    /// other place. It may say no where that is so.
    #[inline(always)]
    pub fn return_beside(&self, phases: &Singles, columns: &[f64; LANES], tolerance: f64) -> [bool; LANES] {
        let mut out = [false; LANES];
        let Some(run) = self.runs.get(self.alone.run).filter(|run| run.monotone && !self.smoothed) else {
            return out;
        };
        let (above, below) = (self.alone.above, self.alone.below);
        let (first, last) = (run.start as usize, run.end as usize);
        // The cell nearest to each, and those before and behind it.
        let (mut cells, mut three) = ([0; LANES], [[f32::NAN; LANES]; 3]);
        for l in 0..LANES {
            cells[l] = (columns[l] + 0.5) as i32;
        }
        for l in 0..LANES {
            let cell = cells[l] as usize;
            if first < cell && cell < last {
                let near = &self.phase_rad[cell - 1..=cell + 1];
                (three[0][l], three[1][l], three[2][l]) = (near[0], near[1], near[2]);
            }
        }
        for l in 0..LANES {
            let (before, here) = (f64::from(three[0][l]), f64::from(three[1][l]));
            let (behind, phase) = (f64::from(three[2][l]), f64::from(phases[l]));
            let between = |a: f64, b: f64| ((a <= phase) & (phase <= b)) | ((b <= phase) & (phase <= a));
            let (back, on) = (between(before, here), between(here, behind));
            let (from, to) = if back { (before, here) } else { (here, behind) };
            let fraction = if from == to { 0.5 } else { (phase - from) / (to - from) };
            let place = f64::from(cells[l]) + fraction - if back { 1.0 } else { 0.0 };
            let near = (place - columns[l]).abs() <= tolerance;
            out[l] = (above < phases[l]) & (phases[l] < below) & (back | on) & near;
        }
        out
    }
}
