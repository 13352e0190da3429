//! Narrow gaps in a raster: a masked line or speck through a surface, beyond which the surface goes on. A shadow can be as narrow, but beyond it the
//! surface is another one, or lies elsewhere.

use super::buffers::SurfaceBuilder;
use super::normals::Link;
use super::raster::Raster;
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

/// A surface that goes on may come out beyond a gap so many pixels (as lengths on it) from where the slopes on both sides lead, and for each pixel of the
/// way by so much of the gentler slope: the footprint shifts what stands beside a gap by half a pixel.
const BESIDE_PX: f64 = 1.0;
const BESIDE_SHARE: f64 = 0.1;

/// So many standard deviations of what the slopes foretell are noise.
const NOISE: f64 = 3.0;

/// Slopes beside a gap are taken over so many pixels, without the one that stands at the gap.
const SLOPE_PX: usize = 2;

/// Whether a surface goes on between two samples so many pixels apart in a row or a column: its slopes on both sides lead across. `true` where there are
/// not enough samples beside them for slopes. `pitch`: length of a pixel, see [`super::View`].
fn goes_on(samples: &Raster, (width, pitch): (usize, f64), (a, b, distance): (usize, usize, usize)) -> bool {
    let step = (b - a) / distance;
    let beside = |steps: usize, forwards: bool| {
        let way = steps * step;
        let place = if forwards { b.checked_add(way) } else { a.checked_sub(way) }?;
        let same_line = step != 1 || place / width == a / width;
        samples.depths.get(place).copied().filter(|depth| same_line && depth.is_finite())
    };
    let sides = [false, true].map(|forwards| Some((beside(1, forwards)?, beside(1 + SLOPE_PX, forwards)?)));
    let [Some((near_a, far_a)), Some((near_b, far_b))] = sides else { return true };
    let (way, across) = ((distance + 2) as f64, near_b - near_a);
    let slopes = [(near_a - far_a) / SLOPE_PX as f64, (far_b - near_b) / SLOPE_PX as f64];
    // Of a quadratic the mean of both slopes is that of the way between them.
    let off = (across - way * 0.5 * (slopes[0] + slopes[1])).abs();
    let gentler = slopes[0].abs().min(slopes[1].abs());
    let shift = BESIDE_PX * pitch * near_a.abs() + BESIDE_SHARE * way * gentler;
    let sigma = f64::from(samples.sigmas[a].max(samples.sigmas[b]));
    // Of both ends, and of the mean slope over the way.
    let over = way / SLOPE_PX as f64;
    let noise = sigma * (2.0 + over * over).sqrt();
    off <= shift + NOISE * noise
}

impl SurfaceBuilder {
    /// Marks in `keep` the absent samples that lie in a narrow gap of a surface. `pitch`: length of a pixel, see [`super::View`].
    pub(super) fn mark_gaps(&mut self, (width, height): (usize, usize), link: Link, pitch: f64) {
        let Self { row_parts, keep, counts, raster, level, .. } = self;
        let joined = |a: usize, b: usize, distance| {
            link.joins(&raster.at(a), &raster.at(b), distance)
                && goes_on(raster, (width, pitch), (a, b, distance))
        };
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
