//! The runs of a cloud, sorted by the cells that they lie in.
//!
//! Their keys are sorted by a stable radix sort, so that equal input gives equal order.

use super::PIECE;
use super::buffers::clear_and_reserve;
use super::grid::{Grid, is_finite};
use crate::cloud::Point;
use rayon::prelude::*;

/// Bits per pass of the radix sort.
const DIGIT_BITS: u32 = 11;

/// Points that follow each other in the cloud and lie in one cell, as neighbours along an image row do.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Run {
    pub key: u64,
    /// Number of the first one in the cloud.
    pub first: u32,
    pub count: u32,
}

/// All runs of a cloud, with the memory that sorting them takes.
#[derive(Debug, Clone, Default)]
pub(super) struct Runs {
    /// By key, those of a cell in the order of the cloud.
    sorted: Vec<Run>,
    spare: Vec<Run>,
    /// What was found in each piece of the cloud, and how many runs that is.
    found: Vec<Run>,
    counts: Vec<usize>,
}

impl Runs {
    /// Finds and sorts those of the finite points of a cloud.
    pub fn sort_cloud(&mut self, grid: &Grid, points: &[Point]) {
        self.find(grid, points);
        radix_sort(&mut self.sorted, &mut self.spare, grid.key_bits());
    }

    /// By key, those of a cell in the order of the cloud.
    pub fn all(&self) -> &[Run] {
        &self.sorted
    }

    /// Finds the runs of a cloud, of each piece by itself.
    fn find(&mut self, grid: &Grid, points: &[Point]) {
        if self.found.len() < points.len() {
            clear_and_reserve(&mut self.found, points.len());
            self.found.resize(points.len(), Run::default());
        }
        clear_and_reserve(&mut self.counts, points.len().div_ceil(PIECE));
        self.counts.resize(points.len().div_ceil(PIECE), 0);
        let pieces = self.found.par_chunks_mut(PIECE).zip(points.par_chunks(PIECE)).zip(&mut self.counts);
        pieces.enumerate().for_each(|(piece, ((runs, points), count))| {
            *count = runs_of(grid, points, (piece * PIECE) as u32, runs);
        });
        clear_and_reserve(&mut self.sorted, self.counts.iter().sum());
        for (runs, count) in self.found.chunks(PIECE).zip(&self.counts) {
            self.sorted.extend_from_slice(&runs[..*count]);
        }
    }
}

/// Writes the runs of some points, the first of which has this number, and says how many there are.
fn runs_of(grid: &Grid, points: &[Point], first: u32, runs: &mut [Run]) -> usize {
    let (mut run, mut count) = (Run::default(), 0);
    for (point, number) in points.iter().zip(first..).filter(|(point, _)| is_finite(point)) {
        let key = grid.key(&point.position_mm);
        if run.key == key && run.first + run.count == number {
            run.count += 1;
            continue;
        }
        if run.count > 0 {
            runs[count] = run;
            count += 1;
        }
        run = Run { key, first: number, count: 1 };
    }
    if run.count > 0 {
        runs[count] = run;
        count += 1;
    }
    count
}

/// Stable sort by the lowest `bits` of the keys.
fn radix_sort(data: &mut Vec<Run>, spare: &mut Vec<Run>, bits: u32) {
    clear_and_reserve(spare, data.len());
    spare.resize(data.len(), Run::default());
    let mut shift = 0;
    while shift < bits {
        let mut starts = [0_u32; 1 << DIGIT_BITS];
        let digit = |key: u64| ((key >> shift) & ((1 << DIGIT_BITS) - 1)) as usize;
        for run in data.iter() {
            starts[digit(run.key)] += 1;
        }
        let mut total = 0;
        for start in &mut starts {
            total += std::mem::replace(start, total);
        }
        for run in data.iter() {
            let place = &mut starts[digit(run.key)];
            spare[*place as usize] = *run;
            *place += 1;
        }
        std::mem::swap(data, spare);
        shift += DIGIT_BITS;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_radix_sort_is_a_stable_sort(keys in prop::collection::vec(0_u64..1 << 30, 0..300)) {
            let run = |(key, first): (&u64, u32)| Run { key: key % 1_000_003, first, count: 1 };
            let mut data: Vec<Run> = keys.iter().zip(0..).map(run).collect();
            let mut expected = data.clone();
            expected.sort_by_key(|run| run.key);
            radix_sort(&mut data, &mut Vec::new(), 30);
            prop_assert_eq!(data, expected);
        }
    }
}
