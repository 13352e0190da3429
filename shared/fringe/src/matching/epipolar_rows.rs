//! The coarse stage on one rectified row: continuous runs of phase, searched by a monotone walk.
//!
//! A row falls into runs: neighbouring valid cells whose phase steps are small and of one sense. Within a run each
//! phase has one place (up to noise), so a cursor that walks with the left pixels finds it in amortised constant
//! time; and phases that two runs share are found as such, which makes ambiguity visible instead of silent.

use super::phase_run::{Clear, Run};
use crate::math::simd::vectorised;
use fearless_simd::Level;

/// Phases that one run alone shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Alone {
    /// All phases above this one …
    pub above: f32,
    /// … and below that one.
    pub below: f32,
    /// Number of the run.
    pub run: usize,
}

impl Alone {
    /// No phase at all.
    const NONE: Self = Self { above: f32::INFINITY, below: f32::NEG_INFINITY, run: 0 };

    /// Whether a phase is one of them.
    #[inline(always)]
    pub fn holds(&self, phase_rad: f32) -> bool {
        self.above < phase_rad && phase_rad < self.below
    }
}

/// Limits of the phase steps that separate two runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StepLimits {
    /// Largest step between neighbours of a run, rad.
    pub max_rad: f32,
    /// Largest step against the sense of a run, rad: noise may do that, surfaces may not.
    pub back_rad: f32,
}

/// One rectified row, prepared for the search. The buffers are reused from row to row.
#[derive(Debug, Clone)]
pub(super) struct Row {
    pub(super) phase_rad: Vec<f32>,
    pub(super) runs: Vec<Run>,
    hot: usize,
    pub(super) alone: Alone,
    /// Whether noise made averaging necessary anywhere in the row.
    pub(super) smoothed: bool,
    /// Running sums of a stretch.
    pub(super) sums: Vec<f64>,
    /// How each cell goes on from the one before it.
    steps: Vec<u8>,
}

/// A cell whose phase differs little from that of the one before it …
const JOINED: u8 = 1;
/// … whose phase is larger …
const RISES: u8 = 2;
/// … whose phase is smaller.
const FALLS: u8 = 4;

/// Cells that are walked over at once.
const STRIDE: usize = 8;

/// A mark on all of them.
const ALL_JOINED: u64 = u64::from_le_bytes([JOINED; STRIDE]);

impl Default for Row {
    fn default() -> Self {
        Self::with_capacity(0)
    }
}

impl Row {
    /// A row of at most `width` cells.
    pub fn with_capacity(width: usize) -> Self {
        // A run has at least two cells.
        Self {
            phase_rad: Vec::with_capacity(width),
            runs: Vec::with_capacity(width / 2 + 1),
            hot: 0,
            alone: Alone::NONE,
            smoothed: false,
            sums: Vec::with_capacity(width + 1),
            steps: Vec::with_capacity(width),
        }
    }

    /// Takes the phase of a row (NaN where not valid) and cuts it into runs.
    pub fn fill(&mut self, phase_rad: impl Iterator<Item = f32>, limits: StepLimits, level: Level) {
        self.phase_rad.clear();
        self.phase_rad.extend(phase_rad);
        let count = self.phase_rad.len();
        self.steps.clear();
        self.steps.resize(count, 0);
        vectorised!(level, mark_steps(&self.phase_rad, limits.max_rad, &mut self.steps));
        self.runs.clear();
        self.hot = 0;
        self.alone = Alone::NONE;
        self.smoothed = false;
        let mut start = 0;
        while start < count {
            let (end, senses) = self.stretch(start);
            if senses & (RISES | FALLS) == RISES | FALLS {
                self.smooth_stretch(start, end, level);
                self.cut(start, end, limits);
            } else {
                self.close_monotone(start, end - 1);
            }
            start = end;
            while self.next_steps(start).is_some_and(|steps| steps & ALL_JOINED == 0) {
                start += STRIDE;
            }
        }
        self.runs.sort_unstable_by(|a, b| a.low.total_cmp(&b.low).then(a.start.cmp(&b.start)));
        let mut high_so_far = f32::NEG_INFINITY;
        for run in &mut self.runs {
            high_so_far = high_so_far.max(run.high);
            run.high_so_far = high_so_far;
        }
    }

    /// End of the continuous stretch that begins at a cell, and all marks of its steps.
    fn stretch(&self, start: usize) -> (usize, u8) {
        let (mut end, mut all) = (start + 1, 0);
        while let Some(steps) = self.next_steps(end - 1)
            && steps & ALL_JOINED == ALL_JOINED
        {
            all |= steps;
            end += STRIDE;
        }
        let mut senses = all.to_le_bytes().iter().fold(0, |senses, steps| senses | steps);
        while end < self.steps.len() && self.steps[end] & JOINED != 0 {
            senses |= self.steps[end];
            end += 1;
        }
        (end, senses)
    }

    /// How the eight cells behind one go on, if there are so many.
    #[inline(always)]
    fn next_steps(&self, cell: usize) -> Option<u64> {
        let mut bytes = [0; STRIDE];
        bytes.copy_from_slice(self.steps.get(cell + 1..cell + 1 + STRIDE)?);
        Some(u64::from_le_bytes(bytes))
    }

    /// Cuts a stretch where its sense changes.
    fn cut(&mut self, first: usize, end: usize, limits: StepLimits) {
        let mut start = first;
        for cell in first + 1..=end {
            if cell == end || !continues(&self.phase_rad, start, cell, limits) {
                self.close(start, cell - 1);
                start = cell;
            }
        }
    }

    /// The mean phase at a column where noise was averaged out of the row; `None` elsewhere.
    #[inline]
    pub fn mean_at(&self, column: f64) -> Option<f32> {
        let at = column as usize;
        if !self.smoothed || column < 0.0 || at + 1 >= self.phase_rad.len() {
            return None;
        }
        let (from, to) = (self.phase_rad[at], self.phase_rad[at + 1]);
        let mean = from + (to - from) * (column - at as f64) as f32;
        mean.is_finite().then_some(mean)
    }

    fn close(&mut self, start: usize, end: usize) {
        if end <= start {
            return;
        }
        let cells = &self.phase_rad[start..=end];
        let rising = cells[cells.len() - 1] > cells[0];
        let (clear, [low, high]) = Clear::of(cells, start, rising);
        self.push((start, end), (low, high), rising, clear);
    }

    /// A run whose smallest and largest phase are those of its ends.
    fn close_monotone(&mut self, start: usize, end: usize) {
        if end <= start {
            return;
        }
        let (from, to) = (self.phase_rad[start], self.phase_rad[end]);
        let (low, high) = (from.min(to), from.max(to));
        let clear = Clear { first: start as u32, last: end as u32, above: low, below: high };
        self.push((start, end), (low, high), to > from, clear);
    }

    fn push(&mut self, (start, end): (usize, usize), (low, high): (f32, f32), rising: bool, clear: Clear) {
        self.runs.push(Run {
            low,
            high,
            high_so_far: high,
            start: start as u32,
            end: end as u32,
            cursor: start as u32,
            rising,
            clear,
            cells_per_rad: (end - start) as f64 / f64::from(high - low),
        });
    }

    /// Calls `visit` with the fractional column of every place where the row takes this phase, one per run, and the cells per rad of
    /// the run.
    ///
    /// A run that contains the column `near` is searched from there, another one from where its last search ended.
    #[inline(always)]
    pub fn find(&mut self, phase_rad: f32, near: Option<f64>, mut visit: impl FnMut(f64, f64)) {
        // Most phases are shown by one run alone, and so are their neighbours.
        let alone = self.alone;
        if alone.holds(phase_rad) {
            let run = &mut self.runs[alone.run];
            if let Some(column) = run.walk(&self.phase_rad, phase_rad, near) {
                visit(column, run.cells_per_rad);
            }
            return;
        }
        self.find_all(phase_rad, near, &mut visit);
    }

    #[inline(never)]
    fn find_all(&mut self, phase_rad: f32, near: Option<f64>, visit: &mut dyn FnMut(f64, f64)) {
        let Some(last) = self.runs.len().checked_sub(1) else { return };
        // The number of runs that begin below the phase changes little from pixel to pixel: walk, do not search.
        let mut hot = self.hot.min(last);
        while hot < last && self.runs[hot + 1].low <= phase_rad {
            hot += 1;
        }
        while hot > 0 && self.runs[hot].low > phase_rad {
            hot -= 1;
        }
        self.hot = hot;
        let (mut found, mut count) = (0, 0);
        for (number, run) in self.runs[..=hot].iter_mut().enumerate().rev() {
            if run.high_so_far < phase_rad {
                break;
            }
            if run.low <= phase_rad && phase_rad <= run.high {
                (found, count) = (number, count + 1);
                if let Some(column) = run.walk(&self.phase_rad, phase_rad, near) {
                    visit(column, run.cells_per_rad);
                }
            }
        }
        self.alone = if count == 1 { self.alone(found, phase_rad) } else { Alone::NONE };
    }

    /// The phases around one that a run shows and no other run does.
    fn alone(&self, run: usize, phase_rad: f32) -> Alone {
        let Run { low: mut above, high: mut below, .. } = self.runs[run];
        for (_, other) in self.runs.iter().enumerate().filter(|(number, _)| *number != run) {
            if other.high < phase_rad {
                above = above.max(other.high);
            } else {
                below = below.min(other.low);
            }
        }
        Alone { above, below, run }
    }
}

/// Marks how each cell but the first goes on from the one before it.
#[inline(always)]
fn mark_steps(phase_rad: &[f32], max_rad: f32, marks: &mut [u8]) {
    let Some(marks) = marks.get_mut(1..) else { return };
    for (mark, (value, before)) in marks.iter_mut().zip(phase_rad[1..].iter().zip(phase_rad)) {
        let step = value - before;
        // NaN on either side fails these comparisons.
        let joined = if step.abs() <= max_rad { JOINED } else { 0 };
        *mark = joined | if step > 0.0 { RISES } else { 0 } | if step < 0.0 { FALLS } else { 0 };
    }
}

/// Whether `cell` belongs to the run that began at `start` and reached the cell before.
fn continues(phase: &[f32], start: usize, cell: usize, limits: StepLimits) -> bool {
    let step = phase[cell] - phase[cell - 1];
    // NaN on either side fails the comparison.
    let joined = step.abs() <= limits.max_rad;
    if !joined {
        return false;
    }
    let progress = phase[cell - 1] - phase[start];
    let against = step * progress < 0.0;
    !(against && step.abs() > limits.back_rad && progress.abs() > limits.back_rad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: StepLimits = StepLimits { max_rad: 1.0, back_rad: 0.1 };

    fn row(phase: &[f32]) -> Row {
        let mut row = Row::with_capacity(phase.len());
        row.fill(phase.iter().copied(), LIMITS, crate::math::simd::best_level());
        row
    }

    fn places(row: &mut Row, phase: f32) -> Vec<f64> {
        let mut found = Vec::new();
        row.find(phase, None, |column, _| found.push(column));
        found.sort_by(f64::total_cmp);
        found
    }

    #[test]
    fn rising_and_falling_runs_are_found_and_edges_are_not_bridged() {
        let nan = f32::NAN;
        let mut row = row(&[0.0, 0.5, 1.0, nan, 2.0, 2.5, 9.0, 8.5, 8.0, 1.0, 0.75, 0.5]);
        assert_eq!(places(&mut row, 0.25), [0.5]);
        assert_eq!(places(&mut row, 1.5), [] as [f64; 0], "the mask edge is no bracket");
        assert_eq!(places(&mut row, 5.0), [] as [f64; 0], "the depth step is no bracket");
        assert_eq!(places(&mut row, 8.25), [7.5]);
        assert_eq!(places(&mut row, 0.625), [1.25, 10.5], "both places are reported");
    }

    #[test]
    fn rows_without_runs_find_nothing() {
        for phase in [&[][..], &[1.0], &[f32::NAN; 5], &[0.0, 5.0, 10.0]] {
            assert_eq!(places(&mut row(phase), 1.0), [] as [f64; 0]);
        }
    }

    #[test]
    fn a_constant_phase_is_one_place_at_most() {
        let mut row = row(&[3.0; 20]);
        assert!(places(&mut row, 3.0).len() <= 1);
        assert!(places(&mut row, 2.9).is_empty());
    }

    proptest! {
        /// The walk finds what an exhaustive search finds, whatever the order of the questions.
        #[test]
        fn the_walk_equals_the_exhaustive_search(
            steps in prop::collection::vec((0.01_f32..0.9, 0_u8..12), 2..200),
            questions in prop::collection::vec(-5.0_f32..120.0, 1..50),
            falling in any::<bool>(),
        ) {
            let sign = if falling { -1.0 } else { 1.0 };
            let mut phase = Vec::new();
            let mut value = if falling { 100.0 } else { 0.0 };
            for (step, kind) in &steps {
                value += sign * if *kind == 0 { step + 2.0 } else { *step };
                phase.push(if *kind == 1 { f32::NAN } else { value });
            }
            let mut row = row(&phase);
            for question in questions {
                let brute: Vec<f64> = phase.windows(2).enumerate().filter_map(|(cell, pair)| {
                    let (low, high) = (pair[0].min(pair[1]), pair[0].max(pair[1]));
                    let bracket = (pair[1] - pair[0]).abs() <= LIMITS.max_rad && low <= question && question < high;
                    bracket.then(|| cell as f64
                        + (f64::from(question) - f64::from(pair[0])) / (f64::from(pair[1]) - f64::from(pair[0])))
                }).collect();
                prop_assert_eq!(places(&mut row, question), brute);
            }
        }
    }
}
