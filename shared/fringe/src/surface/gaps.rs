//! Narrow gaps in a raster: a masked line or speck through a surface, beyond which the surface goes on.

use super::buffers::SurfaceBuilder;
use super::normals::Link;
use crate::math::parallel::for_parts;
use crate::math::simd::vectorised;
use crate::surface::LANES;
use fearless_simd::{Simd, SimdBase, SimdMask, f32x8, f64x8};

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
                vectorised!(*level, |simd| mark_row(
                    simd,
                    (width, height),
                    &raster.depths,
                    first + row,
                    line,
                    &joined
                ));
            }
        });
    }
}

/// Pixels that are looked at together.
const GROUP: usize = 16;

/// A bit for each pixel of a group and of what stands within a gap beside it, the leftmost one lowest.
type Bits = u32;

/// Marks the absent values (NaN) of a row that lie in a narrow gap. `joined(i, j, distance)` states whether two values belong together.
#[inline(always)]
pub(super) fn mark_row<S: Simd, T: Value>(
    simd: S,
    (width, height): (usize, usize),
    values: &[T],
    row: usize,
    line: &mut [u8],
    joined: &impl Fn(usize, usize, usize) -> bool,
) {
    line.fill(0);
    for first in (0..width).step_by(GROUP) {
        let count = GROUP.min(width - first);
        let own = there(simd, values, row * width + first, count);
        let absent = !own & ((1 << count) - 1);
        // Most groups are of one kind. One without a value is wider than a gap, or ends with the picture.
        if absent == 0 {
            continue;
        }
        let mut enclosed = 0;
        if own != 0 {
            enclosed = enclosed_in_row((first, count), own, &values[row * width..][..width]);
        }
        let (mut above, mut below) = (0, 0);
        for other in row + 1..(row + 1 + GAP_PX).min(height) {
            below |= there(simd, values, other * width + first, count);
        }
        if below & absent != 0 {
            for other in row.saturating_sub(GAP_PX)..row {
                above |= there(simd, values, other * width + first, count);
            }
        }
        let mut asked = absent & (enclosed | (above & below));
        while asked != 0 {
            let column = first + asked.trailing_zeros() as usize;
            line[column] = u8::from(in_gap((width, height), values, (column, row), joined));
            asked &= asked - 1;
        }
    }
}

/// Which values of a group are there.
#[inline(always)]
fn there<S: Simd, T: Value>(simd: S, values: &[T], first: usize, count: usize) -> Bits {
    let values = &values[first..first + count];
    if count == GROUP {
        return T::there(simd, &values[..LANES]) | (T::there(simd, &values[LANES..]) << LANES);
    }
    let mut bits = 0;
    for (offset, value) in values.iter().enumerate() {
        bits |= Bits::from(value.is_there()) << offset;
    }
    bits
}

/// Which pixels of a group have a value of their row on either side, as near as a gap is wide.
#[inline(always)]
fn enclosed_in_row<T: Value>((first, count): (usize, usize), own: Bits, line: &[T]) -> Bits {
    let beside = |column: usize| Bits::from(line.get(column).is_some_and(|value| value.is_there()));
    // The first pixel of the group stands at this bit.
    let mut all = own << GAP_PX;
    for away in 1..=GAP_PX {
        all |= beside(first.wrapping_sub(away)) << (GAP_PX - away);
        all |= beside(first + count - 1 + away) << (GAP_PX + count - 1 + away);
    }
    let (mut left, mut right) = (0, 0);
    for away in 1..=GAP_PX {
        left |= all << away;
        right |= all >> away;
    }
    (left & right) >> GAP_PX
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

    /// Which of eight are no NaN.
    fn there<S: Simd>(simd: S, values: &[Self]) -> Bits;
}

impl Value for f32 {
    #[inline(always)]
    fn is_there(self) -> bool {
        !self.is_nan()
    }

    #[inline(always)]
    fn there<S: Simd>(simd: S, values: &[Self]) -> Bits {
        let values = f32x8::from_slice(simd, values);
        values.simd_eq(values).to_bitmask() as Bits
    }
}

impl Value for f64 {
    #[inline(always)]
    fn is_there(self) -> bool {
        !self.is_nan()
    }

    #[inline(always)]
    fn there<S: Simd>(simd: S, values: &[Self]) -> Bits {
        let values = f64x8::from_slice(simd, values);
        values.simd_eq(values).to_bitmask() as Bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Key;
    use crate::math::simd::best_level;

    /// Whole groups are passed over by what they and their surroundings are: the same as pixel by pixel.
    #[test]
    fn groups_are_passed_over_only_where_no_pixel_is_in_a_gap() {
        let key = Key::new(5);
        for (case, (width, height)) in [(1, 9), (15, 9), (17, 12), (33, 20), (67, 24)].into_iter().enumerate()
        {
            for missing in [0.02, 0.2, 0.5, 0.9, 0.98] {
                // Alone, and in blocks of 5 × 3 pixels.
                for [wide, high] in [[1, 1], [5, 3]] {
                    let value = |pixel: usize| {
                        let block = pixel % width / wide + 1000 * (pixel / width / high);
                        let share = key.open((case * 1_000_000 + block) as u64);
                        if share < missing { f32::NAN } else { (1.0 + 0.1 * share) as f32 }
                    };
                    let values: Vec<f32> = (0..width * height).map(value).collect();
                    let joined = |a: usize, b: usize, distance: usize| {
                        (values[a] - values[b]).abs() <= 0.02 * distance as f32
                    };
                    let mut line = vec![7; width];
                    for row in 0..height {
                        let level = best_level();
                        vectorised!(level, |simd| mark_row(
                            simd,
                            (width, height),
                            &values,
                            row,
                            &mut line,
                            &joined
                        ));
                        for (column, mark) in line.iter().enumerate() {
                            let in_gap = in_gap((width, height), &values, (column, row), &joined);
                            assert_eq!(
                                *mark,
                                u8::from(in_gap),
                                "{width} × {height}, {missing}: {column}, {row}"
                            );
                        }
                    }
                }
            }
        }
    }
}
