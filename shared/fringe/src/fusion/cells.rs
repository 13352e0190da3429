//! Neighbour search: points sorted into the cells of a regular grid, in which neighbours of all points are found in one sweep, since the cells
//! around a moving cell move on with it.

use super::buffers::clear_and_reserve;
use super::grid::Grid;
use super::runs::{Run, Runs};
use super::sites::Sites;
use super::surroundings::Surroundings;
use crate::cloud::Point;
use std::ops::Range;

/// Leading bits of a key that an index has a place for: about as many places as a cloud has cells, and small enough for a cache.
const INDEX_BITS: u32 = 16;

/// Entries behind the last cell, as many as the widest row of cells that is asked for at once.
const ENDS: usize = 5;

/// A cell that holds points, and where they begin.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cell {
    pub key: u64,
    /// Number of its first site.
    pub site: u32,
    /// Number of its first run of points.
    run: u32,
}

/// A cloud in the order of its cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cloud<'a> {
    /// Cells that hold points, by key; behind the last one [`ENDS`] times their end.
    cells: &'a [Cell],
    /// By key, those of a cell in the order of the cloud.
    runs: &'a [Run],
    points: &'a [Point],
}

impl<'a> Cloud<'a> {
    /// Number of its sites.
    pub fn sites(&self) -> usize {
        self.cells.last().map_or(0, |end| end.site as usize)
    }

    /// The points of the sites from one on.
    pub fn points_from(&self, site: usize) -> impl Iterator<Item = &'a Point> {
        let cell = self.cells.partition_point(|cell| cell.site as usize <= site).saturating_sub(1);
        let Cell { site: first, run, .. } = self.cells[cell];
        let (cloud, runs) = (self.points, &self.runs[run as usize..]);
        let mut before = site - first as usize;
        runs.iter().flat_map(move |run| {
            let left_out = before.min(run.count as usize);
            before -= left_out;
            &cloud[run.first as usize + left_out..][..run.count as usize - left_out]
        })
    }
}

/// Sites sorted by cell.
#[derive(Debug, Clone, Default)]
pub(super) struct Cells {
    pub sites: Sites,
    /// Cells that hold points, by key; behind the last one [`ENDS`] times their end.
    pub occupied: Vec<Cell>,
    /// The grid that the keys are of; none before the first use.
    grid: Option<Grid>,
    runs: Runs,
    /// Number of the first cell with these leading bits of the key, and one place more: what is asked for lies between two of them.
    index: Vec<u32>,
    /// Bits of a key behind the leading ones.
    shift: u32,
}

/// The runs of sites around a cell that were found so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Found {
    key: u64,
    runs: [Option<Range<usize>>; 9],
}

impl Cells {
    /// Sorts the finite points of a cloud. Buffers are reused.
    pub fn fill(&mut self, grid: &Grid, points: &[Point]) {
        self.runs.sort_cloud(grid, points);
        self.list_cells();
        self.sites.take(&Cloud { cells: &self.occupied, runs: self.runs.all(), points });
        self.number(grid);
    }

    /// Lists the cells that hold runs, which are sorted.
    fn list_cells(&mut self) {
        let runs = self.runs.all();
        clear_and_reserve(&mut self.occupied, runs.len() + ENDS);
        let mut site = 0;
        for (Run { key, count, .. }, run) in runs.iter().zip(0..) {
            if self.occupied.last().is_none_or(|cell| cell.key != *key) {
                self.occupied.push(Cell { key: *key, site, run });
            }
            site += count;
        }
        self.occupied.extend([Cell { key: u64::MAX, site, run: runs.len() as u32 }; ENDS]);
    }

    /// Forgets the sites of all cells.
    pub fn clear(&mut self) {
        self.grid = None;
        self.occupied.clear();
    }

    /// Gives the cells their keys in another grid, which covers this one; returns false where they are no cells of that grid.
    pub fn move_to(&mut self, grid: &Grid) -> bool {
        let Some(before) = self.grid.filter(|before| before.shares_cells(grid)) else { return false };
        let cells = self.len();
        for cell in &mut self.occupied[..cells] {
            cell.key = grid.key_from(&before, cell.key);
        }
        self.number(grid);
        true
    }

    /// Makes the index of the cells.
    fn number(&mut self, grid: &Grid) {
        self.grid = Some(*grid);
        let bits = grid.key_bits();
        self.shift = bits.saturating_sub(INDEX_BITS);
        let places = (1 << (bits - self.shift)) + 1;
        clear_and_reserve(&mut self.index, places);
        for (cell, number) in self.occupied[..self.len()].iter().zip(0..) {
            self.index.resize(self.index.len().max((cell.key >> self.shift) as usize + 1), number);
        }
        self.index.resize(places, self.len() as u32);
    }

    /// Number of the first cell whose key is no smaller.
    pub fn first_from(&self, key: u64) -> usize {
        let place = (key >> self.shift) as usize;
        let Some([start, end]) =
            self.index.get(place..place + 2).map(|ends| [ends[0] as usize, ends[1] as usize])
        else {
            return self.len();
        };
        start + self.occupied[start..end].partition_point(|cell| cell.key < key)
    }

    /// Number of cells that hold points.
    pub fn len(&self) -> usize {
        self.occupied.len().saturating_sub(ENDS)
    }

    /// Key of a cell that holds points.
    pub fn key(&self, cell: usize) -> u64 {
        self.occupied[cell].key
    }

    /// Number of the cell of a key, where it holds points.
    pub fn find(&self, key: u64) -> Option<usize> {
        let cell = self.first_from(key);
        (self.occupied[..self.len()].get(cell)?.key == key).then_some(cell)
    }

    /// Numbers in the cloud of the points of a cell.
    pub fn points(&self, cell: usize) -> impl Iterator<Item = usize> {
        let [start, end] = [cell, cell + 1].map(|c| self.occupied[c].run as usize);
        self.runs.all()[start..end]
            .iter()
            .flat_map(|run| run.first as usize..(run.first + run.count) as usize)
    }

    /// Calls `visit` with the sites in each cell around a position, run by run, until it says that it has enough; whether it did. `found`: the runs of the
    /// last question to the same cells, which is often about a neighbour in the same cell.
    pub fn around(
        &self,
        grid: &Grid,
        position_mm: &[f64; 3],
        found: &mut Found,
        mut visit: impl FnMut(&Sites, Range<usize>) -> bool,
    ) -> bool {
        let key = grid.key(position_mm);
        if found.key != key {
            *found = Found { key, ..Found::default() };
        }
        let offsets = grid.row_offsets::<9>();
        // The middle row is the most likely one to have enough.
        [4, 1, 3, 5, 7, 0, 2, 6, 8].into_iter().any(|row| {
            let find = || self.run(key.wrapping_add_signed(offsets[row]));
            let run = found.runs[row].get_or_insert_with(find).clone();
            !run.is_empty() && visit(&self.sites, run)
        })
    }

    /// The sites of a cell and of those beside it along z.
    fn run(&self, middle: u64) -> Range<usize> {
        let first = self.first_from(middle - 1);
        let last = first + self.occupied[first..].iter().take_while(|cell| cell.key <= middle + 1).count();
        self.occupied[first].site as usize..self.occupied[last].site as usize
    }

    /// Takes a point out of all searches, by its number in the cloud.
    pub fn remove(&mut self, grid: &Grid, position_mm: &[f64; 3], index: u32) {
        let key = grid.key(position_mm);
        let Some(cell) = self.find(key) else { return };
        let place = self.points(cell).position(|point| point == index as usize);
        if let Some(place) = place {
            self.sites.remove(self.occupied[cell].site as usize + place);
        }
    }

    /// Calls `visit` for some occupied cells of `self` with their sites and the nine runs of sites of `other` that may lie
    /// within one cell's length of them.
    pub fn sweep(
        &self,
        cells: Range<usize>,
        grid: &Grid,
        other: &Cells,
        mut visit: impl FnMut(Range<usize>, &[Range<usize>; 9]),
    ) {
        let Some(first) = self.occupied[cells.clone()].first() else { return };
        let mut around = Surroundings::<9>::from(grid, other, first.key);
        for pair in self.occupied[cells.start..=cells.end].windows(2) {
            let site = |cell: usize| other.occupied[cell].site as usize;
            let runs = around.rows(other, pair[0].key).map(|row| site(row.start)..site(row.end));
            visit(pair[0].site as usize..pair[1].site as usize, &runs);
        }
    }
}

/// Squared distance of two points, mm².
#[inline]
pub(super) fn distance2(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::grid::Extent;
    use super::*;
    use proptest::prelude::*;

    pub fn cloud(places: &[[f64; 3]]) -> Vec<Point> {
        let at = |position_mm: &[f64; 3]| Point { position_mm: *position_mm, ..bytemuck::Zeroable::zeroed() };
        places.iter().map(at).collect()
    }

    /// Places of up to so many runs of points, each along a row.
    pub fn rows(runs: Range<usize>) -> impl Strategy<Value = Vec<[f64; 3]>> {
        let row =
            |([x, y, z], count): ([f64; 3], u32)| (0..count).map(move |k| [x + 0.2 * f64::from(k), y, z]);
        prop::collection::vec((place(), 1_u32..6), runs)
            .prop_map(move |starts| starts.into_iter().flat_map(row).collect())
    }

    fn place() -> impl Strategy<Value = [f64; 3]> {
        [-5.0_f64..5.0, -3.0_f64..3.0, -0.5_f64..0.5]
    }

    /// Number in the cloud of the point of a site.
    fn number(cells: &Cells, site: usize) -> u32 {
        (0..cells.len()).flat_map(|cell| cells.points(cell)).nth(site).unwrap() as u32
    }

    /// Pairs (number in `own`, number in `other`) that a search visits and that are near.
    fn near(own: &Cells, at: usize, other: &Cells, run: Range<usize>, limit: f64) -> Vec<(u32, u32)> {
        let place = own.sites.position_mm(at);
        let inside = run.filter(|b| distance2(&other.sites.position_mm(*b), &place) <= limit);
        inside.map(|b| (number(own, at), number(other, b))).collect()
    }

    proptest! {
        /// The sweep, in parts, and the search about single places find exactly the neighbours that comparing all with all finds.
        #[test]
        fn the_searches_equal_brute_force(
            a in rows(1..40),
            b in rows(0..40),
            part in 1_usize..9,
            gone in 0_usize..80,
        ) {
            let (a, b) = (cloud(&a), cloud(&b));
            let (radius, limit) = (0.8, 0.64);
            let grid = Grid::of(&Extent::of(&a).and(&Extent::of(&b)), radius).unwrap();
            let (mut own, mut other) = (Cells::default(), Cells::default());
            own.fill(&grid, &a);
            other.fill(&grid, &b);
            if let Some(point) = b.get(gone) {
                other.remove(&grid, &point.position_mm, gone as u32);
            }
            let (mut swept, mut searched) = (Vec::new(), Vec::new());
            for first in (0..own.len()).step_by(part) {
                own.sweep(first..(first + part).min(own.len()), &grid, &other, |sites, runs| {
                    for at in sites {
                        for run in runs {
                            swept.extend(near(&own, at, &other, run.clone(), limit));
                        }
                    }
                });
            }
            let mut found = Found::default();
            for at in 0..a.len() {
                other.around(&grid, &own.sites.position_mm(at), &mut found, |_, run| {
                    searched.extend(near(&own, at, &other, run, limit));
                    false
                });
            }
            swept.sort_unstable();
            searched.sort_unstable();
            let mut brute = Vec::new();
            for (i, p) in a.iter().enumerate() {
                for (j, q) in b.iter().enumerate() {
                    if j != gone && distance2(&p.position_mm, &q.position_mm) <= limit {
                        brute.push((i as u32, j as u32));
                    }
                }
            }
            prop_assert_eq!(&swept, &brute);
            prop_assert_eq!(searched, brute);
        }

    }

    #[test]
    fn absurd_extents_do_not_overflow() {
        let points = cloud(&[[-1e300, 0.0, 0.0], [1e300, 1.0, 2.0]]);
        let grid = Grid::of(&Extent::of(&points), 1e-9).unwrap();
        let mut cells = Cells::default();
        cells.fill(&grid, &points);
        let mut visited = 0;
        cells.sweep(0..cells.len(), &grid, &cells, |sites, _| visited += sites.len());
        assert_eq!(visited, 2);
    }
}
