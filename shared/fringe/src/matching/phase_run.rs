//! A run of phase within a rectified row, and the walk through it.

/// A part of a run in which no two neighbours change places, and the phases that the rest of the run does not show: a walk for one
/// of them ends in the same cell, wherever it begins, unless several cells show just this phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clear {
    /// First cell of the part.
    pub first: u32,
    /// Last cell of the part.
    pub last: u32,
    /// All its phases above this one …
    pub above: f32,
    /// … and below that one, rad.
    pub below: f32,
}

impl Clear {
    /// The longest such part of a run that begins at a cell, and the smallest and largest phase of the run; `cells` are its phases, of which the
    /// last one is larger than the first one where the run rises.
    pub fn of(cells: &[f32], start: usize, rising: bool) -> (Self, [f32; 2]) {
        let goes_on = |i: usize| if rising { cells[i - 1] <= cells[i] } else { cells[i - 1] >= cells[i] };
        let (mut first, mut last, mut begin) = (0, 0, 0);
        for cell in 1..cells.len() {
            if !goes_on(cell) {
                begin = cell;
            } else if cell - begin > last - first {
                (first, last) = (begin, cell);
            }
        }
        let least = |cells: &[f32]| cells.iter().copied().fold(f32::INFINITY, f32::min);
        let most = |cells: &[f32]| cells.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let (before, behind) = (&cells[..=first], &cells[last..]);
        let (lower, upper) = if rising { (before, behind) } else { (behind, before) };
        let (first, last) = ((start + first) as u32, (start + last) as u32);
        let (above, below) = (most(lower), least(upper));
        // A dip behind it, or a bump before it, may be the farthest of all.
        (Self { first, last, above, below }, [least(lower).min(below), most(upper).max(above)])
    }

    /// Whether a phase is among those of the part.
    #[inline(always)]
    pub fn holds(&self, phase_rad: f32) -> bool {
        self.above < phase_rad && phase_rad < self.below
    }
}

/// A continuous, monotone stretch of a row: a bracket lies between any two of its neighbouring cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// Smallest phase of the run, rad.
    pub low: f32,
    /// Largest phase of the run, rad.
    pub high: f32,
    /// Largest `high` of this and all earlier runs of the sorted row: ends the search.
    pub high_so_far: f32,
    /// First cell of the run.
    pub start: u32,
    /// Last cell of the run.
    pub end: u32,
    /// Where the last walk ended.
    pub cursor: u32,
    /// Whether the phase grows with the column.
    pub rising: bool,
    /// The part of it that all searches find the same way.
    pub clear: Clear,
    /// Cells per rad, in the mean.
    pub cells_per_rad: f64,
}

/// The column of a phase between a cell and the next one; `None` where they do not bracket it.
#[inline(always)]
pub fn column_behind(phase: &[f32], cell: usize, wanted: f32) -> Option<f64> {
    let [from, to, wanted] = [phase[cell], phase[cell + 1], wanted].map(f64::from);
    let inside = (from <= wanted && wanted <= to) || (to <= wanted && wanted <= from);
    // Neighbouring cells may show the same native pixel: any place between them is as good.
    let fraction = if from == to { 0.5 } else { (wanted - from) / (to - from) };
    inside.then_some(cell as f64 + fraction)
}

impl Run {
    /// Walks from the cursor, or from a column within the run, to the bracket of a phase and interpolates in it; `None` where only
    /// the noise of the ends reaches that far.
    #[inline(always)]
    pub fn walk(&mut self, phase: &[f32], wanted: f32, near: Option<f64>) -> Option<f64> {
        if let Some(near) = near
            && near >= f64::from(self.start)
            && near <= f64::from(self.end)
        {
            self.cursor = near as u32;
        }
        let (first, last) = (self.start as usize, self.end as usize - 1);
        let below = |cell: usize| if self.rising { phase[cell] < wanted } else { phase[cell] > wanted };
        let mut cell = (self.cursor as usize).clamp(first, last);
        while cell < last && below(cell + 1) {
            cell += 1;
        }
        while cell > first && !below(cell) && phase[cell] != wanted {
            cell -= 1;
        }
        self.cursor = cell as u32;
        column_behind(phase, cell, wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Smallest and largest phase are those of all cells, and a walk for a phase of the clear part ends in one place from wherever it begins,
        /// which is the only one.
        #[test]
        fn the_clear_part_is_found_from_everywhere(
            steps in prop::collection::vec(-0.2_f32..0.4, 1..30),
            falling in any::<bool>(),
            share in 0.001_f32..0.999,
        ) {
            let sense = if falling { -1.0 } else { 1.0 };
            let mut cells = vec![1.0];
            for step in steps {
                cells.push(cells[cells.len() - 1] + sense * step);
            }
            let rising = cells[cells.len() - 1] > cells[0];
            let (clear, [low, high]) = Clear::of(&cells, 7, rising);
            let brute = |pick: fn(f32, f32) -> f32| cells.iter().copied().reduce(pick).unwrap();
            prop_assert_eq!([low, high], [brute(f32::min), brute(f32::max)]);
            prop_assert!(clear.first >= 7 && clear.first < clear.last && (clear.last - 7) < cells.len() as u32);
            let wanted = clear.above + share * (clear.below - clear.above);
            prop_assume!(clear.holds(wanted) && !cells.contains(&wanted));
            let held = |pair: &[f32]| pair[0].min(pair[1]) <= wanted && wanted <= pair[0].max(pair[1]);
            let places: Vec<usize> = cells.windows(2).enumerate().filter(|(_, pair)| held(pair)).map(|(i, _)| i).collect();
            prop_assert_eq!(places.len(), 1);
            let mut row = vec![f32::NAN; 7];
            row.extend(&cells);
            let end = row.len() as u32 - 1;
            for cursor in 7..end {
                let (high_so_far, cells_per_rad, start) = (high, 1.0, 7);
                let mut run = Run { low, high, high_so_far, start, end, cursor, rising, clear, cells_per_rad };
                let place = run.walk(&row, wanted, None).unwrap();
                prop_assert_eq!(place as usize, places[0] + 7);
            }
        }
    }
}
