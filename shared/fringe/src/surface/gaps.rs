//! Narrow gaps in a raster: a masked line or speck through a surface, beyond which the surface goes on.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::buffers::SurfaceBuilder;
use super::normals::Link;
use crate::math::parallel::for_parts;
use crate::math::simd::vectorised;

/// Widest gap that is bridged, px.
pub(crate) const GAP_PX: usize = 3;

/// Whether both sides of a gap around `at` on a line of `count` values belong together. `valid(i)` states whether there is a value,
/// `joined(i, j)` whether two of them lie on one surface.
#[inline]
pub(crate) fn bridges_line(
    at: usize,
    count: usize,
    valid: impl Fn(usize) -> bool,
    joined: impl Fn(usize, usize) -> bool,
) -> bool {
    let low = (1..=GAP_PX.min(at)).map(|d| at - d).find(|i| valid(*i));
    let high = (at + 1..(at + 1 + GAP_PX).min(count)).find(|i| valid(*i));
    match (low, high) {
        (Some(low), Some(high)) => high - low <= GAP_PX + 1 && joined(low, high),
        _ => false,
    }
}

impl SurfaceBuilder {
    /// Marks in `keep` the absent samples that lie in a narrow gap of a surface.
    pub(super) fn mark_gaps(&mut self, (width, height): (usize, usize), link: Link) {
        let Self { row_parts, keep, counts, raster, level, .. } = self;
        let joined = |a: usize, b: usize, distance| link.joins(&raster.at(a), &raster.at(b), distance);
        for_parts(row_parts, keep, counts, &|part, keep, _| {
            let first = row_parts[part] / width;
            for (row, line) in keep.chunks_mut(width).enumerate() {
                vectorised!(*level, mark_row((width, height), &raster.depths, first + row, line, &joined));
            }
        });
    }
}

/// Pixels that are looked at together.
const GROUP: usize = 16;

/// Marks the absent values (NaN) of a row that lie in a narrow gap. `joined(i, j, distance)` states whether two values belong together.
#[inline(always)]
pub(super) fn mark_row<T: Value>(
    (width, height): (usize, usize),
    values: &[T],
    row: usize,
    line: &mut [u8],
    joined: &impl Fn(usize, usize, usize) -> bool,
) {
    let rows = row.saturating_sub(GAP_PX)..(row + GAP_PX + 1).min(height);
    for (group, marks) in line.chunks_mut(GROUP).enumerate() {
        let first = group * GROUP;
        let places = first.saturating_sub(GAP_PX)..(first + marks.len() + GAP_PX).min(width);
        marks.fill(0);
        let own = &values[row * width + first..][..marks.len()];
        // Most groups are of one kind, and so are their surroundings.
        if own.iter().fold(true, |all, value| all & value.is_there()) {
            continue;
        }
        let beside = |r: usize| {
            values[r * width..][places.clone()].iter().fold(false, |any, value| any | value.is_there())
        };
        if !rows.clone().any(beside) {
            continue;
        }
        for (offset, mark) in marks.iter_mut().enumerate() {
            *mark = u8::from(in_gap((width, height), values, (first + offset, row), joined));
        }
    }
}

#[inline(never)]
fn in_gap<T: Value>(
    (width, height): (usize, usize),
    values: &[T],
    (column, row): (usize, usize),
    joined: &impl Fn(usize, usize, usize) -> bool,
) -> bool {
    let in_row = |i: usize| row * width + i;
    let in_column = |i: usize| i * width + column;
    let there = |pixel: usize| values[pixel].is_there();
    !there(in_row(column))
        && (bridges_line(column, width, |i| there(in_row(i)), |i, j| joined(in_row(i), in_row(j), j - i))
            || bridges_line(
                row,
                height,
                |i| there(in_column(i)),
                |i, j| joined(in_column(i), in_column(j), j - i),
            ))
}

/// A value of a raster that may be absent.
pub(super) trait Value: Copy {
    /// Whether it is no NaN.
    fn is_there(self) -> bool;
}

impl Value for f32 {
    #[inline(always)]
    fn is_there(self) -> bool {
        !self.is_nan()
    }
}

impl Value for f64 {
    #[inline(always)]
    fn is_there(self) -> bool {
        !self.is_nan()
    }
}
