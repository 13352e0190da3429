//! The cells around cells that are asked for in the order of their keys.

use super::cells::Cells;
use super::grid::Grid;
use std::ops::Range;

/// The cells around one cell after another, in ascending order of their keys: N = 9 rows along z hold those up to one cell away, N = 25 those
/// up to two. Each row is followed from where it was found last, so that all questions together walk once along the cells.
#[derive(Debug, Clone)]
pub(super) struct Surroundings<const N: usize> {
    /// Keys of the middle cells of the rows, less the key of the cell.
    offsets: [i64; N],
    /// Where each row begins among the cells that hold points.
    cursors: [usize; N],
    /// Cells of a row to either side of its middle.
    reach: u64,
}

impl<const N: usize> Surroundings<N> {
    /// Before the first question.
    fn new(grid: &Grid) -> Self {
        Self { offsets: grid.row_offsets(), cursors: [0; N], reach: N.isqrt() as u64 / 2 }
    }

    /// Before a question about this key or larger ones.
    pub fn from(grid: &Grid, cells: &Cells, key: u64) -> Self {
        let mut around = Self::new(grid);
        for (cursor, offset) in around.cursors.iter_mut().zip(around.offsets) {
            let from = key.saturating_add_signed(offset).saturating_sub(around.reach);
            *cursor = cells.first_from(from);
        }
        around
    }

    /// Numbers of those cells that hold points in each row around a key that is no smaller than the last one. What lies beyond the first
    /// cell of a row has the key of a free cell, or none.
    pub fn rows(&mut self, cells: &Cells, key: u64) -> [Range<usize>; N] {
        let mut rows = [const { 0..0 }; N];
        for ((row, cursor), offset) in rows.iter_mut().zip(&mut self.cursors).zip(self.offsets) {
            let Some(middle) = key.checked_add_signed(offset) else { continue };
            let from = middle.saturating_sub(self.reach);
            // The last entries of `occupied` have the largest key: the walk ends there.
            while cells.occupied[*cursor].key < from {
                *cursor += 1;
            }
            // A row has so many cells at most: all are asked, since which is the last one no processor foresees.
            let ahead = &cells.occupied[*cursor..*cursor + N.isqrt()];
            let count = ahead.iter().map(|cell| usize::from(cell.key <= middle + self.reach)).sum::<usize>();
            *row = *cursor..*cursor + count;
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::super::cells::tests::{cloud, rows};
    use super::super::grid::Extent;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The rows around all cells, and around every second one, hold exactly the cells that comparing all with all finds.
        #[test]
        fn the_surroundings_equal_brute_force(
            places in rows(1..50),
            other in rows(1..50),
            every in 1_usize..3,
        ) {
            let (a, b) = (cloud(&places), cloud(&other));
            let grid = Grid::of(&Extent::of(&a).and(&Extent::of(&b)), 0.8).unwrap();
            let (mut asked, mut cells) = (Cells::default(), Cells::default());
            asked.fill(&grid, &a);
            cells.fill(&grid, &b);
            let (mut near, mut wide) = (Surroundings::<9>::new(&grid), Surroundings::<25>::new(&grid));
            for key in (0..asked.len()).map(|cell| asked.key(cell)).step_by(every) {
                let around = |reach: u64| -> Vec<usize> {
                    let apart = |other: u64| {
                        let place = |key: u64| grid.place(key);
                        let (here, there) = (place(key), place(other));
                        (0..3).map(|axis| here[axis].abs_diff(there[axis])).max()
                    };
                    (0..cells.len()).filter(|cell| apart(cells.key(*cell)) <= Some(reach)).collect()
                };
                let found: Vec<usize> = near.rows(&cells, key).into_iter().flatten().collect();
                prop_assert_eq!(found, around(1));
                let found: Vec<usize> = wide.rows(&cells, key).into_iter().flatten().collect();
                prop_assert_eq!(found, around(2));
            }
        }
    }
}
