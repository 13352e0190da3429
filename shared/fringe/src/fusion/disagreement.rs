//! Where two pairs disagree beyond what both state: light that bounces between faces, a view out of focus, a rig that is off.
//!
//! The distances d of the points of one cloud from the surface of the other have the variance u² that both clouds state, if all is
//! well. Cells of the search where Σ d² is beyond Σ u², by themselves and with the 26 cells around them, get the surplus: ½ (Σ d² − Σ u²) / n
//! is added to the variance of every point of both clouds in the cell, since the distance does not tell which of the two is wrong. Neighbours
//! share noise, for they were smoothed together, so that a block of 27 cells has few distances that are independent; light, a blurred view and
//! a rig reach further. Where a block is no clear case, the 98 cells around it, with noise of their own, have to disagree as well.
//! Cells in which nothing was compared, since only the other cloud has points there, its surface lies beyond their border, or they were not
//! looked at, are judged by those around them alone. What both pairs see alike is not seen here, nor what parts them by more than the radius.

use super::cells::{Cells, Grid};
use super::surroundings::Surroundings;
use std::cmp::Reverse;
use std::ops::Range;

/// Mean square of the distances over the stated one from which on a cell, its block and those around it disagree. The variance of distances is
/// 1.2 times the stated one, since that takes the points of a surface as independent: of a block, with some eight independent distances, noise
/// exceeds this in a tenth of the cases, and of those around it, with fourteen of their own, in one of twenty.
const LIKELY: f64 = 2.0;
/// The same of a block whatever those around it say: noise exceeds it in one of 20 000 blocks.
const CERTAIN: f64 = 5.0;
/// Fewer points of a block say nothing.
const LEAST: f64 = 16.0;

/// What the points of a cell show that have a surface of the other cloud beside them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Compared {
    count: f64,
    /// Sum of the squared distances, Σ d², mm².
    squares: f64,
    /// Sum of the stated variances, Σ u², mm².
    stated: f64,
}

/// Points of a cell of a cloud, and the variance that they get.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Raised {
    /// Number of the cloud, and of the cell in it.
    pub cell: (usize, usize),
    /// Surplus of the variance, mm².
    pub excess_mm2: f64,
}

impl Compared {
    /// Adds the distance of a point from the other surface, mm, and the variance that is stated of it, mm². Where none is stated there
    /// is nothing to compare with, and one beyond the radius, mm, says nothing of distances within it.
    #[inline(always)]
    pub fn add(&mut self, distance: f64, u2: f64, radius_mm: f64) {
        if u2 > 0.0 && u2 < radius_mm * radius_mm {
            self.count += 1.0;
            self.squares += distance * distance;
            self.stated += u2;
        }
    }

    fn disagrees(&self, ratio: f64) -> bool {
        self.squares > ratio * self.stated
    }
}

/// Two clouds, numbered, and what the cells of the first one show of the second.
#[derive(Debug, Clone, Copy)]
pub(super) struct Comparison<'a> {
    pub own: (usize, &'a Cells),
    pub other: (usize, &'a Cells),
    /// For each cell of the first cloud.
    pub compared: &'a [Compared],
    pub grid: &'a Grid,
}

/// The cells that decide whether one disagrees.
struct Around {
    near: Surroundings<9>,
    wide: Surroundings<25>,
}

impl Around {
    fn new(grid: &Grid) -> Self {
        Self { near: Surroundings::new(grid), wide: Surroundings::new(grid) }
    }
}

impl Comparison<'_> {
    /// Adds the cells of both clouds in which they disagree; `open` is memory for the keys of cells in which nothing was compared.
    pub fn find(&self, open: &mut Vec<u64>, raised: &mut Vec<Raised>) {
        open.clear();
        let (own, other) = (self.own.1, self.other.1);
        let mut around = Around::new(self.grid);
        let mut beside = Surroundings::<9>::new(self.grid);
        for (number, key) in own.keys().filter(|(number, _)| self.compared[*number].disagrees(LIKELY)) {
            let own_rows = around.near.rows(own, key);
            if self.disagreeing(key, &own_rows, &mut around.wide).is_some() {
                self.raise(key, &self.compared[number], raised);
            }
            for (own_row, other_row) in own_rows.iter().zip(beside.rows(other, key)) {
                let silent = own_row.clone().filter(|cell| self.compared[*cell].count < 1.0);
                open.extend(silent.map(|cell| own.key(cell)));
                let keys = other_row.map(|cell| other.key(cell));
                open.extend(keys.filter(|key| own_row.clone().all(|cell| own.key(cell) != *key)));
            }
        }
        open.sort_unstable();
        open.dedup();
        let mut around = Around::new(self.grid);
        for key in open.iter() {
            let own_rows = around.near.rows(own, *key);
            if let Some(block) = self.disagreeing(*key, &own_rows, &mut around.wide) {
                self.raise(*key, &block, raised);
            }
        }
    }

    /// What a cell and the 26 around it show together, where that is a disagreement.
    fn disagreeing(&self, key: u64, rows: &[Range<usize>], wide: &mut Surroundings<25>) -> Option<Compared> {
        let block = self.within(rows);
        if block.count < LEAST || !block.disagrees(LIKELY) {
            return None;
        }
        let mut confirmed = || {
            let Compared { count, squares, stated } = self.within(&wide.rows(self.own.1, key));
            let (count, squares, stated) =
                (count - block.count, squares - block.squares, stated - block.stated);
            count >= LEAST && Compared { count, squares, stated }.disagrees(LIKELY)
        };
        (block.disagrees(CERTAIN) || confirmed()).then_some(block)
    }

    /// What the cells of some rows show.
    fn within(&self, rows: &[Range<usize>]) -> Compared {
        let mut sum = Compared::default();
        for Compared { count, squares, stated } in rows.iter().flat_map(|row| &self.compared[row.clone()]) {
            sum.count += count;
            sum.squares += squares;
            sum.stated += stated;
        }
        sum
    }

    /// Adds the cells of both clouds at a key with the surplus of what was compared.
    fn raise(&self, key: u64, compared: &Compared, raised: &mut Vec<Raised>) {
        let excess_mm2 = 0.5 * (compared.squares - compared.stated) / compared.count;
        for (cloud, cells) in [self.own, self.other] {
            let cell = cells.find(key).map(|cell| (cloud, cell));
            raised.extend(cell.map(|cell| Raised { cell, excess_mm2 }));
        }
    }
}

/// Each cell once, with the largest surplus that any comparison gives.
pub(super) fn largest(raised: &mut Vec<Raised>) {
    raised.sort_unstable_by_key(|r| (r.cell, Reverse(r.excess_mm2.to_bits())));
    raised.dedup_by_key(|r| r.cell);
}

#[cfg(test)]
mod tests;
