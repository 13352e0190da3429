//! Narrow gaps in a raster: a masked line or speck through a surface, beyond which the surface goes on.

use super::buffers::SurfaceBuilder;
use super::normals::Link;
use super::sample::Sample;
use crate::math::parallel::for_parts;

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
    pub(super) fn mark_gaps(&mut self, (width, height): (usize, usize), samples: &[Sample], link: Link) {
        let valid = |pixel: usize| samples[pixel].inverse_depth.is_finite();
        for_parts(&self.row_parts, &mut self.keep, &mut self.counts, &|part, keep, _| {
            let first = self.row_parts[part];
            for (offset, keep) in keep.iter_mut().enumerate() {
                let pixel = first + offset;
                let (column, row) = (pixel % width, pixel / width);
                let in_row = |i: usize| row * width + i;
                let in_column = |i: usize| i * width + column;
                let joined = |a: usize, b: usize, distance| link.joins(&samples[a], &samples[b], distance);
                *keep = u8::from(
                    !valid(pixel)
                        && (bridges_line(
                            column,
                            width,
                            |i| valid(in_row(i)),
                            |i, j| joined(in_row(i), in_row(j), j - i),
                        ) || bridges_line(
                            row,
                            height,
                            |i| valid(in_column(i)),
                            |i, j| joined(in_column(i), in_column(j), j - i),
                        )),
                );
            }
        });
    }
}
