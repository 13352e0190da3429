//! The grid that neighbours are searched in, and the box of the points that it covers.

use crate::cloud::Point;

/// Cells along one axis at most: three axes fill a 63-bit key.
const MAX_CELLS: f64 = 2_097_000.0;

/// Cells are larger than the radius by this part of it: rounding then parts no neighbours by more than one cell.
const WIDER: f64 = 1.0 + 1e-8;

/// Place of the origin, in cubes: none of a grid then has a number below zero, so that to cut off a fraction is to round down. The origin, a point
/// of the part, lies in the middle of a cube: no border runs along the face that it lies on, where noise would sort the points.
const FIRST: f64 = 4_194_304.5;

/// A box that holds points, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extent {
    low_mm: [f64; 3],
    high_mm: [f64; 3],
}

impl Default for Extent {
    fn default() -> Self {
        Self { low_mm: [f64::INFINITY; 3], high_mm: [f64::NEG_INFINITY; 3] }
    }
}

impl Extent {
    /// Of the finite points of a list.
    pub fn of(points: &[Point]) -> Self {
        let mut extent = Self::default();
        for point in points.iter().filter(|p| is_finite(p)) {
            for (axis, value) in point.position_mm.into_iter().enumerate() {
                // Plain comparisons, since all are numbers.
                let (low, high) = (&mut extent.low_mm[axis], &mut extent.high_mm[axis]);
                *low = if value < *low { value } else { *low };
                *high = if value > *high { value } else { *high };
            }
        }
        extent
    }

    /// Its lowest corner, mm; `None` where it holds no point.
    pub fn corner_mm(&self) -> Option<[f64; 3]> {
        let bounds = self.low_mm.iter().chain(&self.high_mm);
        bounds.into_iter().all(|bound| bound.is_finite()).then_some(self.low_mm)
    }

    /// The box that holds both.
    pub fn and(mut self, other: &Self) -> Self {
        for axis in 0..3 {
            self.low_mm[axis] = self.low_mm[axis].min(other.low_mm[axis]);
            self.high_mm[axis] = self.high_mm[axis].max(other.high_mm[axis]);
        }
        self
    }
}

/// Whether a point has a place.
#[inline]
pub(super) fn is_finite(point: &Point) -> bool {
    point.position_mm.iter().all(|v| v.is_finite())
}

/// Cubes that space is divided into, whatever lies there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lattice {
    origin_mm: [f64; 3],
    per_mm: f64,
}

impl Lattice {
    /// Cubes for points in a box, in which the origin lies. Points within the radius of each other are at most one cube apart.
    pub fn new(origin_mm: [f64; 3], radius_mm: f64, extent: &Extent) -> Self {
        let longest = (0..3).map(|axis| extent.high_mm[axis] - extent.low_mm[axis]).fold(0.0, f64::max);
        // Absurd extents get coarser cells instead of an overflow; the distances are checked anyway.
        let cell_mm = (radius_mm * WIDER).max(longest / MAX_CELLS).max(f64::MIN_POSITIVE);
        Self { origin_mm, per_mm: 1.0 / cell_mm }
    }

    /// Place along one axis, in cubes: a multiple of 2⁻³⁰ where it is none of an absurd extent.
    #[inline(always)]
    fn cubes(&self, position_mm: &[f64; 3], axis: usize) -> f64 {
        (position_mm[axis] - self.origin_mm[axis]) * self.per_mm + FIRST
    }
}

/// The cubes of a lattice that cover some points, with a key for each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    lattice: Lattice,
    /// Number of the cube before the first one along each axis.
    before: [f64; 3],
    bits: [u32; 3],
}

impl Grid {
    /// Over the points of a box; `None` where it holds none.
    pub fn over(lattice: Lattice, extent: &Extent) -> Option<Self> {
        let low = extent.corner_mm()?;
        let mut grid = Self { lattice, before: [0.0; 3], bits: [0; 3] };
        for axis in 0..3 {
            grid.before[axis] = f64::from(lattice.cubes(&low, axis) as u32) - 1.0;
            // Two more than there are: a free cell on either side, so that neighbours never wrap into another row.
            let cells = grid.cell(&extent.high_mm, axis) + 3;
            grid.bits[axis] = u64::BITS - cells.leading_zeros();
        }
        Some(grid)
    }

    /// Over a box, with its lowest corner as the origin.
    #[cfg(test)]
    pub fn of(extent: &Extent, radius_mm: f64) -> Option<Self> {
        Self::over(Lattice::new(extent.corner_mm()?, radius_mm, extent), extent)
    }

    /// Bits of a key.
    pub fn key_bits(&self) -> u32 {
        self.bits.iter().sum()
    }

    /// Key of the cell that holds a place of the box. Where the box is longer than numbers reach, cells are one.
    #[inline(always)]
    pub fn key(&self, position_mm: &[f64; 3]) -> u64 {
        self.joined([0, 1, 2].map(|axis| self.cell(position_mm, axis)))
    }

    /// Number of the cell that holds a place, from 1 on. The difference is exact, so that grids over one lattice have the same cells.
    #[inline(always)]
    fn cell(&self, position_mm: &[f64; 3], axis: usize) -> u64 {
        u64::from((self.lattice.cubes(position_mm, axis) - self.before[axis]) as u32)
    }

    #[inline(always)]
    fn joined(&self, [x, y, z]: [u64; 3]) -> u64 {
        (x << (self.bits[1] + self.bits[2])) | (y << self.bits[2]) | z
    }

    /// The key here of a cell that has this key in a grid over the same lattice, which lies within this one. Keys keep their order.
    pub fn key_from(&self, other: &Self, key: u64) -> u64 {
        let place = other.place(key);
        self.joined([0, 1, 2].map(|axis| place[axis] + (other.before[axis] - self.before[axis]) as u64))
    }

    /// Place of a cell in the grid along each axis, from 1 on.
    pub fn place(&self, key: u64) -> [u64; 3] {
        let [_, y, z] = self.bits;
        let lowest = |key: u64, bits: u32| key & ((1 << bits) - 1);
        [key >> (y + z), lowest(key >> z, y), lowest(key, z)]
    }

    /// Whether the cells of both are cubes of one lattice.
    pub fn shares_cells(&self, other: &Self) -> bool {
        self.lattice == other.lattice
    }

    /// Keys of the middle cells of the N rows (along z) around a cell, 9 or 25, less its own key.
    pub fn row_offsets<const N: usize>(&self) -> [i64; N] {
        let edge = N.isqrt() as i64;
        let away = |step: i64| step - edge / 2;
        std::array::from_fn(|slot| self.row_offset(away(slot as i64 / edge), away(slot as i64 % edge)))
    }

    /// Key of a cell so many cells further along x and y, less its own key.
    fn row_offset(&self, dx: i64, dy: i64) -> i64 {
        (dx << (self.bits[1] + self.bits[2])) + (dy << self.bits[2])
    }
}
