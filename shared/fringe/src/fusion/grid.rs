//! The grid that neighbours are searched in, and the box of the points that it covers.

use crate::cloud::Point;

/// Cells along one axis at most: three axes fill a 63-bit key.
const MAX_CELLS: f64 = 2_097_000.0;

/// Cells are larger than the radius by this part of it: rounding then parts no neighbours by more than one cell.
const WIDER: f64 = 1.0 + 1e-9;

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

/// A grid of cubes that covers all clouds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    origin_mm: [f64; 3],
    per_mm: f64,
    pub bits: [u32; 3],
}

impl Grid {
    /// A grid over points; `None` without any. Points within `radius_mm` of each other are at most one cell apart.
    pub fn over(extent: &Extent, radius_mm: f64) -> Option<Self> {
        let (low, high) = (extent.low_mm, extent.high_mm);
        if !(0..3).all(|axis| low[axis].is_finite() && high[axis].is_finite()) {
            return None;
        }
        let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        // Absurd extents get coarser cells instead of an overflow; the distances are checked anyway.
        let cell_mm = (radius_mm * WIDER).max(longest / MAX_CELLS).max(f64::MIN_POSITIVE);
        let per_mm = 1.0 / cell_mm;
        let mut bits = [1; 3];
        for axis in 0..3 {
            // Two more: a free cell on either side, so that neighbours never wrap into another row.
            let cells = ((high[axis] - low[axis]) * per_mm) as u64 + 4;
            bits[axis] = u64::BITS - cells.leading_zeros();
        }
        Some(Self { origin_mm: low, per_mm, bits })
    }

    /// Key of the cell that holds a place of the extent.
    pub fn key(&self, position_mm: &[f64; 3]) -> u64 {
        let cell =
            |axis: usize| u64::from(((position_mm[axis] - self.origin_mm[axis]) * self.per_mm) as u32) + 1;
        (cell(0) << (self.bits[1] + self.bits[2])) | (cell(1) << self.bits[2]) | cell(2)
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
