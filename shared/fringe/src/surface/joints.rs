//! Which samples lie on one surface with their neighbours.
//!
//! Nearly every pixel lies with all of its eight neighbours on one surface. The largest and the smallest of nine samples show that, and those of three
//! rows serve three pixels: neighbours are asked one by one only where something is missing.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::normals::Link;
use super::raster::Raster;
use super::windows::{LANES, taken};

/// There is a sample at all.
pub(super) const THERE: u8 = 1;
/// It lies on the same surface as the sample before it in the row …
pub(super) const BEFORE: u8 = 2;
/// … and as the one above it.
pub(super) const ABOVE: u8 = 4;
/// Too few of its eight neighbours lie on the same surface.
pub(super) const ALONE: u8 = 8;

/// Columns that the windows of neighbouring pixels have.
const COLUMNS: usize = LANES + 2;

/// What decides whether samples belong together.
#[derive(Clone, Copy)]
pub(super) struct Joints<'a> {
    pub samples: &'a Raster,
    /// Columns of the whole picture.
    pub width: usize,
    pub link: Link,
    /// Neighbours that a sample needs.
    pub wanted: u32,
}

impl Joints<'_> {
    /// Marks the pixels of whole rows from pixel `first` on; returns how many samples are alone.
    #[inline(always)]
    pub fn mark(&self, first: usize, marks: &mut [u8]) -> u32 {
        let (width, depths) = (self.width, &self.samples.depths);
        let height = depths.len() / width;
        let mut alone = 0;
        for (line, marks) in marks.chunks_mut(width).enumerate() {
            let (start, row) = (first + line * width, first / width + line);
            let inner = row > 0 && row + 1 < height;
            let mut column = 0;
            while column < width {
                let at = start + column;
                if !(inner && column > 0 && column + LANES < width) {
                    marks[column] = self.one(at);
                    alone += u32::from(marks[column] & ALONE != 0);
                    column += 1;
                    continue;
                }
                let own = taken::<_, LANES>(depths, at);
                let group = &mut marks[column..column + LANES];
                if !own.iter().fold(false, |any, depth| any | depth.is_finite()) {
                    group.fill(0);
                } else if self.whole(at) {
                    group.fill(THERE | BEFORE | ABOVE);
                } else {
                    group.copy_from_slice(&self.some(at));
                    alone += group.iter().map(|mark| u32::from(mark & ALONE != 0)).sum::<u32>();
                }
                column += LANES;
            }
        }
        alone
    }

    /// Whether all pixels from one on, whose neighbours lie in the picture, lie with all of them on one surface. It may say no where that is so.
    #[inline(always)]
    fn whole(&self, at: usize) -> bool {
        let Raster { depths, sigmas, .. } = self.samples;
        let row = |pixel: usize| taken::<_, COLUMNS>(depths, pixel - 1);
        let (above, own, below) = (row(at - self.width), row(at), row(at + self.width));
        let sigma = taken::<_, LANES>(sigmas, at);
        let (mut low, mut high, mut sum) = (own, own, own);
        for k in 0..COLUMNS {
            let (a, b) = (above[k], below[k]);
            low[k] = if a < low[k] { a } else { low[k] };
            low[k] = if b < low[k] { b } else { low[k] };
            high[k] = if a > high[k] { a } else { high[k] };
            high[k] = if b > high[k] { b } else { high[k] };
            sum[k] += a + b;
        }
        let mut whole = [0_u64; LANES];
        for l in 0..LANES {
            let (mut least, mut most) = (low[l], high[l]);
            for k in [l + 1, l + 2] {
                least = if low[k] < least { low[k] } else { least };
                most = if high[k] > most { high[k] } else { most };
            }
            // The sigma of a neighbour only widens the limit. An absent sample makes the sum NaN.
            let own = own[l + 1];
            let limit = self.link.max_step * own.abs() + 3.0 * f64::from(sigma[l]);
            let there = (sum[l] + sum[l + 1] + sum[l + 2]).is_finite();
            whole[l] = u64::from((most - own <= limit) & (own - least <= limit) & there);
        }
        whole == [1; LANES]
    }

    /// The marks of the pixels from one on, whose neighbours lie in the picture.
    #[inline(always)]
    fn some(&self, at: usize) -> [u8; LANES] {
        let Raster { depths, sigmas, .. } = self.samples;
        let width = self.width;
        let (own, own_sigma) = (taken::<_, LANES>(depths, at), taken::<_, LANES>(sigmas, at));
        // As wide as what is compared, which vectors are best at.
        let (mut count, mut marks) = ([0_u64; LANES], [0_u64; LANES]);
        for place in [
            at - width - 1,
            at - width,
            at - width + 1,
            at - 1,
            at + 1,
            at + width - 1,
            at + width,
            at + width + 1,
        ] {
            let (other, sigma) = (taken::<_, LANES>(depths, place), taken::<_, LANES>(sigmas, place));
            let mark = if place + 1 == at {
                BEFORE
            } else if place + width == at {
                ABOVE
            } else {
                0
            };
            for l in 0..LANES {
                // As `Link::joins`.
                let noise = 3.0 * f64::from(own_sigma[l] + sigma[l]);
                let joined = (own[l] - other[l]).abs() <= self.link.max_step * own[l].abs() + noise;
                count[l] += u64::from(joined);
                marks[l] |= if joined { u64::from(mark) } else { 0 };
            }
        }
        let mut out = [0; LANES];
        for (l, out) in out.iter_mut().enumerate() {
            *out = self.marked(own[l], count[l] as u32, marks[l] as u8);
        }
        out
    }

    /// The mark of any pixel.
    #[inline(never)]
    fn one(&self, pixel: usize) -> u8 {
        let (width, height) = (self.width, self.samples.len() / self.width);
        let (column, row) = (pixel % width, pixel / width);
        let own = self.samples.at(pixel);
        let (mut count, mut marks) = (0, 0);
        for line in row.saturating_sub(1)..(row + 2).min(height) {
            for place in column.saturating_sub(1)..(column + 2).min(width) {
                let other = line * width + place;
                if other == pixel || !self.link.joins(&own, &self.samples.at(other), 1) {
                    continue;
                }
                count += 1;
                marks |= if line == row && other + 1 == pixel { BEFORE } else { 0 };
                marks |= if line + 1 == row && place == column { ABOVE } else { 0 };
            }
        }
        self.marked(own.inverse_depth, count, marks)
    }

    #[inline(always)]
    fn marked(&self, depth: f64, count: u32, marks: u8) -> u8 {
        if !depth.is_finite() {
            return 0;
        }
        THERE | marks | if count < self.wanted { ALONE } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Sample;
    use super::*;
    use crate::math::simd::{levels, vectorised};
    use proptest::prelude::*;

    proptest! {
        /// Pixels side by side have the marks of each pixel by itself.
        #[test]
        fn marks_side_by_side_are_those_of_single_pixels(
            width in 1_usize..50,
            values in prop::collection::vec((0_u16..400, 0_u16..100), 60..1500),
            holes in 0_u16..60,
        ) {
            let sample = |(value, sigma): &(u16, u16)| {
                let step = if *value > 380 { 0.5 } else { 0.08 * f64::from(*value) / 400.0 };
                let inverse_depth = if *value < holes { f64::NAN } else { 1.0 + step };
                Sample { inverse_depth, sigma: 1e-4 * f32::from(*sigma), ..Sample::NONE }
            };
            let rows = values.len() / width;
            let samples: Vec<Sample> = values[..rows * width].iter().map(sample).collect();
            let raster = Raster::from(&samples[..]);
            let joints = Joints { samples: &raster, width, link: Link { max_step: 0.07 }, wanted: 3 };
            let single: Vec<u8> = (0..samples.len()).map(|pixel| joints.one(pixel)).collect();
            let wanted = single.iter().filter(|mark| *mark & ALONE != 0).count();
            for level in levels() {
                let mut marks = vec![0xff; samples.len()];
                let alone = vectorised!(level, joints.mark(0, &mut marks));
                prop_assert_eq!((&marks, alone as usize), (&single, wanted));
            }
        }
    }
}
