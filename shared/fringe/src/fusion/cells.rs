//! Neighbour search: points sorted into the cells of a regular grid.
//!
//! The keys of the cells are sorted by a stable radix sort, so that equal input gives equal order; neighbours of all
//! points are then found in one sweep, since the cells around a moving cell move on with it.

use crate::cloud::Point;

/// Bits per pass of the radix sort.
const DIGIT_BITS: u32 = 11;

/// Cells along one axis at most: three axes fill a 63-bit key.
const MAX_CELLS: f64 = 2_097_000.0;

/// A grid of cubes that covers all clouds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    origin_mm: [f64; 3],
    cell_mm: f64,
    bits: [u32; 3],
}

/// A point as the search sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Site {
    pub position_mm: [f64; 3],
    pub normal: [f32; 3],
    pub sigma_mm: f32,
    /// Its number in the clouds, one after another.
    pub index: u32,
}

/// Sites sorted by cell.
#[derive(Debug, Clone, Default)]
pub(super) struct Cells {
    pub sites: Vec<Site>,
    keys: Vec<u64>,
    /// Start of each occupied cell in `sites`, with its key.
    occupied: Vec<(u64, u32)>,
    spare: Vec<(u64, u32)>,
    order: Vec<(u64, u32)>,
}

impl Grid {
    /// A grid over finite points; `None` without any.
    pub fn over<'a>(points: impl Iterator<Item = &'a Point>, cell_mm: f64) -> Option<Self> {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for point in points {
            for axis in 0..3 {
                low[axis] = low[axis].min(point.position_mm[axis]);
                high[axis] = high[axis].max(point.position_mm[axis]);
            }
        }
        if !(0..3).all(|axis| low[axis].is_finite() && high[axis].is_finite()) {
            return None;
        }
        let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        // Absurd extents get coarser cells instead of an overflow; the distances are checked anyway.
        let cell_mm = cell_mm.max(extent / MAX_CELLS).max(f64::MIN_POSITIVE);
        let mut bits = [1; 3];
        for axis in 0..3 {
            // Two more: a free cell on either side, so that neighbours never wrap into another row.
            let cells = ((high[axis] - low[axis]) / cell_mm) as u64 + 4;
            bits[axis] = u64::BITS - cells.leading_zeros();
        }
        Some(Self { origin_mm: low, cell_mm, bits })
    }

    fn key(&self, position_mm: &[f64; 3]) -> u64 {
        let cell = |axis: usize| ((position_mm[axis] - self.origin_mm[axis]) / self.cell_mm) as u64 + 1;
        (cell(0) << (self.bits[1] + self.bits[2])) | (cell(1) << self.bits[2]) | cell(2)
    }

    /// Keys of the middle cells of the nine rows (along z) around a cell, less its own key.
    fn row_offsets(&self) -> [i64; 9] {
        let mut offsets = [0; 9];
        for (slot, offset) in offsets.iter_mut().enumerate() {
            let (dx, dy) = (slot as i64 / 3 - 1, slot as i64 % 3 - 1);
            *offset = (dx << (self.bits[1] + self.bits[2])) + (dy << self.bits[2]);
        }
        offsets
    }
}

impl Cells {
    /// Sorts points; `first_index` numbers the first of them. Buffers are reused.
    pub fn fill(&mut self, grid: &Grid, points: &[Point], first_index: u32) {
        clear_and_reserve(&mut self.order, points.len());
        self.order.extend(points.iter().zip(0..).map(|(point, index)| (grid.key(&point.position_mm), index)));
        radix_sort(&mut self.order, &mut self.spare, grid.bits.iter().sum());
        clear_and_reserve(&mut self.sites, points.len());
        clear_and_reserve(&mut self.keys, points.len());
        clear_and_reserve(&mut self.occupied, points.len() + 1);
        for (key, index) in &self.order {
            if self.occupied.last().is_none_or(|(last, _)| last != key) {
                self.occupied.push((*key, self.sites.len() as u32));
            }
            let point = &points[*index as usize];
            self.keys.push(*key);
            self.sites.push(Site {
                position_mm: point.position_mm,
                normal: point.normal,
                sigma_mm: point.sigma_mm,
                index: first_index + index,
            });
        }
        self.occupied.push((u64::MAX, self.sites.len() as u32));
    }

    /// Calls `visit` for each occupied cell of `self` with its sites and the nine runs of sites of `other` that may lie
    /// within one cell's length of them.
    pub fn sweep(&self, grid: &Grid, other: &Cells, mut visit: impl FnMut(&[Site], [&[Site]; 9])) {
        let offsets = grid.row_offsets();
        let mut cursors = [0_usize; 9];
        for pair in self.occupied.windows(2) {
            let [(key, start), (_, end)] = [pair[0], pair[1]];
            let mut runs: [&[Site]; 9] = [&[]; 9];
            for ((cursor, offset), run) in cursors.iter_mut().zip(offsets).zip(&mut runs) {
                let middle = key.wrapping_add_signed(offset);
                // The last entry of `occupied` has the largest key: the walk ends there.
                while other.occupied[*cursor].0 < middle - 1 {
                    *cursor += 1;
                }
                let mut last = *cursor;
                while other.occupied[last].0 <= middle + 1 {
                    last += 1;
                }
                *run = &other.sites[other.occupied[*cursor].1 as usize..other.occupied[last].1 as usize];
            }
            visit(&self.sites[start as usize..end as usize], runs);
        }
    }
}

/// Empties a list and reserves memory for `entries` elements, and a quarter more where it has to grow: the next cloud of the same
/// part is a little larger or smaller.
pub(super) fn clear_and_reserve<T>(list: &mut Vec<T>, entries: usize) {
    list.clear();
    if list.capacity() < entries {
        list.reserve_exact(entries + entries / 4);
    }
}

/// Stable sort by the lowest `bits` of the keys.
fn radix_sort(data: &mut Vec<(u64, u32)>, spare: &mut Vec<(u64, u32)>, bits: u32) {
    clear_and_reserve(spare, data.len());
    spare.resize(data.len(), (0, 0));
    let mut shift = 0;
    while shift < bits {
        let mut starts = [0_u32; 1 << DIGIT_BITS];
        let digit = |key: u64| ((key >> shift) & ((1 << DIGIT_BITS) - 1)) as usize;
        for (key, _) in data.iter() {
            starts[digit(*key)] += 1;
        }
        let mut total = 0;
        for start in &mut starts {
            total += std::mem::replace(start, total);
        }
        for entry in data.iter() {
            let place = &mut starts[digit(entry.0)];
            spare[*place as usize] = *entry;
            *place += 1;
        }
        std::mem::swap(data, spare);
        shift += DIGIT_BITS;
    }
}

/// Squared distance of two points, mm².
#[inline]
pub(super) fn distance2(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cloud(places: &[[f64; 3]]) -> Vec<Point> {
        let at = |position_mm: &[f64; 3]| Point { position_mm: *position_mm, ..bytemuck::Zeroable::zeroed() };
        places.iter().map(at).collect()
    }

    fn place() -> impl Strategy<Value = [f64; 3]> {
        [-5.0_f64..5.0, -3.0_f64..3.0, -0.5_f64..0.5]
    }

    proptest! {
        /// The sweep finds exactly the neighbours that comparing all with all finds.
        #[test]
        fn the_sweep_equals_brute_force(
            a in prop::collection::vec(place(), 1..80),
            b in prop::collection::vec(place(), 0..80),
        ) {
            let (a, b) = (cloud(&a), cloud(&b));
            let radius = 0.8;
            let grid = Grid::over(a.iter().chain(&b), radius).unwrap();
            let (mut own, mut other) = (Cells::default(), Cells::default());
            own.fill(&grid, &a, 0);
            other.fill(&grid, &b, 100);
            let mut found = Vec::new();
            own.sweep(&grid, &other, |sites, runs| {
                for site in sites {
                    let near = runs.iter().copied().flatten();
                    let near = near.filter(|o| distance2(&o.position_mm, &site.position_mm) <= radius * radius);
                    found.extend(near.map(|o| (site.index, o.index)));
                }
            });
            found.sort_unstable();
            let mut brute = Vec::new();
            for (i, p) in a.iter().enumerate() {
                for (j, q) in b.iter().enumerate() {
                    if distance2(&p.position_mm, &q.position_mm) <= radius * radius {
                        brute.push((i as u32, 100 + j as u32));
                    }
                }
            }
            prop_assert_eq!(found, brute);
        }

        #[test]
        fn the_radix_sort_is_a_stable_sort(keys in prop::collection::vec(0_u64..1 << 30, 0..300)) {
            let mut data: Vec<(u64, u32)> = keys.iter().map(|k| k % 1_000_003).zip(0..).collect();
            let mut expected = data.clone();
            expected.sort_by_key(|entry| entry.0);
            radix_sort(&mut data, &mut Vec::new(), 30);
            prop_assert_eq!(data, expected);
        }
    }

    #[test]
    fn absurd_extents_do_not_overflow() {
        let points = cloud(&[[-1e300, 0.0, 0.0], [1e300, 1.0, 2.0]]);
        let grid = Grid::over(points.iter(), 1e-9).unwrap();
        let mut cells = Cells::default();
        cells.fill(&grid, &points, 0);
        let mut visited = 0;
        cells.sweep(&grid, &cells, |sites, _| visited += sites.len());
        assert_eq!(visited, 2);
    }
}
