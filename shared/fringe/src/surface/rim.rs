//! Where a surface ends in the picture.
//!
//! The footprint of a pixel at a rim sees less than a whole pixel of the surface, or a part of another one, and shifts its phase: by two thirds of a
//! pixel in the outermost one, by a seventh in the next. They are no points, nor does any window take them: the normals of their neighbours would turn
//! by 6 to 24°.

use super::Cause;
use super::broken::{self, is_readable};
use super::buffers::{PartCount, SurfaceBuilder};
use super::gaps::mark_row;
use super::marks::ends_here;
use super::normals::Link;
use super::point::View;
use super::raster::Raster;
use super::windows::HALF;
use crate::math::parallel::for_parts;
use crate::math::simd::{best_level, vectorised};
use fearless_simd::{Simd, SimdBase, SimdInt, u8x32};
use rayon::prelude::*;
use std::ops::Range;

/// A window at a rim lacks more than this part of its samples; a speck that could not be matched lacks less.
const SPECK_SHARE: f64 = 0.1;

/// A single sample is a speck in any window: at a rim at least two of eight neighbours are missing, but for steps of a slanting one.
const SPECK_SAMPLES: f64 = 1.0;

/// Most missing samples of a window of so many that are specks.
fn specks(all: usize) -> u16 {
    (SPECK_SHARE * all as f64).max(SPECK_SAMPLES).floor() as u16
}

/// Mark of a sample that lay at a rim, among those of gaps: beyond it the surface does not go on.
pub(super) const DROPPED: u8 = 2;

/// Fewest rows of one parallel job.
const ROWS: usize = 16;

impl SurfaceBuilder {
    /// Drops the samples nearer than `edge_px` to where their surface ends; returns how many. Gaps must have been marked in `keep`, where
    /// they become [`DROPPED`].
    pub(super) fn drop_rims(&mut self, view: &View, link: Link) -> u32 {
        let edge = self.settings.edge_px as usize;
        if edge == 0 || view.width == 0 {
            return 0;
        }
        let Self { keep, ends, counts, row_parts, raster, causes, level, .. } = self;
        let (size, gaps, samples) = ((view.width, view.height), &*keep, &*raster);
        for_parts(row_parts, ends, counts, &|part, ends, _| {
            let first = row_parts[part] / view.width;
            for (row, line) in (first..).zip(ends.chunks_mut(view.width)) {
                vectorised!(*level, end_row(size, (samples, gaps), link, row, line));
            }
        });
        let ends = &*ends;
        for_parts(row_parts, causes, counts, &|part, causes, count| {
            *count = PartCount::default();
            let first = row_parts[part] / view.width;
            for (row, causes) in (first..).zip(causes.chunks_mut(view.width)) {
                let own = &samples.depths[row * view.width..][..view.width];
                let asked = |column: usize| {
                    let group = &own[column..(column + GROUP).min(view.width)];
                    group.iter().fold(false, |any, depth| any | !depth.is_nan())
                };
                // A rim has more than one end beside it.
                let found = |column: usize, counts: &[u8], _| {
                    for (column, _) in (column..).zip(counts).filter(|(_, near)| **near > 1) {
                        let pixel = row * view.width + column;
                        let edge = view.rim_px(&samples.at(pixel), edge);
                        if samples.depths[pixel].is_finite() && at_rim(size, samples, gaps, pixel, link, edge)
                        {
                            causes[column] = Cause::Rim;
                            count.add(Cause::Rim);
                        }
                    }
                };
                vectorised!(*level, |simd| count_row(simd, size, ends, edge, row, (asked, found)));
                if view.two_pictures {
                    count.rims += drop_silhouettes(own, &samples.limbs[row * view.width..], causes);
                }
            }
        });
        let rows = raster.depths.par_chunks_mut(view.width).zip(keep.par_chunks_mut(view.width));
        rows.zip(causes.par_chunks(view.width)).with_min_len(ROWS).for_each(|((depths, gaps), causes)| {
            for (column, _) in causes.iter().enumerate().filter(|(_, cause)| **cause == Cause::Rim) {
                (depths[column], gaps[column]) = (f64::NAN, DROPPED);
            }
        });
        self.counts.iter().map(|count| count.rims).sum()
    }
}

/// Drops the samples of a row that lie at a silhouette where phases bend in one picture alone; returns how many that nothing else had dropped.
fn drop_silhouettes(depths: &[f64], marks: &[u8], causes: &mut [Cause]) -> u32 {
    let mut dropped = 0;
    for ((cause, marks), depth) in causes.iter_mut().zip(marks).zip(depths) {
        if ends_here(*marks) && depth.is_finite() && *cause != Cause::Rim {
            *cause = Cause::Rim;
            dropped += 1;
        }
    }
    dropped
}

/// Marks the pixels of a row that are missing, but for gaps, and those that are not joined to the one beside, above or below.
#[inline(always)]
fn end_row(
    (width, height): (usize, usize),
    (samples, gaps): (&Raster, &[u8]),
    link: Link,
    row: usize,
    line: &mut [u8],
) {
    let at = row * width;
    for first in (0..width).step_by(GROUP) {
        let count = GROUP.min(width - first);
        let here = at + first;
        let own = &samples.depths[here..here + count];
        let line = &mut line[first..first + count];
        for ((end, gap), depth) in line.iter_mut().zip(&gaps[here..here + count]).zip(own) {
            *end = u8::from(depth.is_nan()) & u8::from(*gap == 0);
        }
        // Nothing jumps from where nothing is.
        if own.iter().all(|depth| depth.is_nan()) {
            continue;
        }
        if row > 0 {
            mark_jumps(samples, link, (here, here - width), line);
        }
        if row + 1 < height {
            mark_jumps(samples, link, (here, here + width), line);
        }
        let inside = count - usize::from(first + count == width);
        mark_jumps(samples, link, (here, here + 1), &mut line[..inside]);
        let before = usize::from(first == 0);
        mark_jumps(samples, link, (here + before - 1, here + before), &mut line[before..]);
    }
}

/// Marks where samples from one place on are not joined to those from another.
#[inline(always)]
fn mark_jumps(samples: &Raster, link: Link, (from, to): (usize, usize), line: &mut [u8]) {
    let count = line.len();
    let [a, b] = [from, to].map(|first| &samples.depths[first..first + count]);
    let [sa, sb] = [from, to].map(|first| &samples.sigmas[first..first + count]);
    for (k, end) in line.iter_mut().enumerate() {
        // NaN fails the comparison.
        let jump = (a[k] - b[k]).abs() > link.limit(a[k], sa[k] + sb[k], 1);
        *end |= u8::from(jump);
    }
}

/// Marks the NaN of a raster, but for gaps of up to three pixels whose sides differ by less than `max_step` per pixel.
pub(crate) fn mark_missing((width, values): (usize, &[f32]), max_step: f32, missing: &mut [u8]) {
    if width == 0 {
        return;
    }
    let height = values.len() / width;
    let level = best_level();
    let joined = |a: usize, b: usize, d: usize| (values[a] - values[b]).abs() <= max_step * d as f32;
    missing.par_chunks_mut(width).enumerate().with_min_len(ROWS).for_each(|(row, line)| {
        vectorised!(level, |simd| mark_row(simd, (width, height), values, row, line, &joined));
        // What is missing and no gap.
        for (missing, value) in line.iter_mut().zip(&values[row * width..]) {
            *missing = u8::from(value.is_nan() && *missing == 0);
        }
    });
}

/// Marks the pixels of a raster of which more than specks are missing up to `edge` pixels away; beyond the picture nothing is missed.
pub(crate) fn mark_rims(width: usize, edge: usize, missing: &[u8], rims: &mut [u8]) {
    if edge == 0 || width == 0 {
        rims.fill(0);
        return;
    }
    let (level, height) = (best_level(), rims.len() / width);
    rims.par_chunks_mut(width).enumerate().with_min_len(ROWS).for_each(|(row, rims)| {
        let all = |_| true;
        let mark = |column: usize, counts: &[u8], all: usize| {
            let most = specks(all);
            for (rim, count) in rims[column..].iter_mut().zip(counts) {
                *rim = u8::from(u16::from(*count) > most);
            }
        };
        vectorised!(level, |simd| count_row(simd, (width, height), missing, edge, row, (all, mark)));
    });
}

/// Pixels of a group.
const GROUP: usize = 32;

/// Pixels that are read on either side of a group: no window reaches farther.
const BESIDE: usize = GROUP / 2;

/// Counts what is missing in the windows of the pixels of a row, up to 255: `found` gets the column of the first of some, their counts, and the pixels
/// of such a window. Of whole groups of pixels that are not asked nothing counts.
#[inline(always)]
fn count_row<S: Simd>(
    simd: S,
    (width, height): (usize, usize),
    missing: &[u8],
    edge: usize,
    row: usize,
    (asked, mut found): (impl Fn(usize) -> bool, impl FnMut(usize, &[u8], usize)),
) {
    let span = |at: usize, end: usize| at.saturating_sub(edge)..(at + edge + 1).min(end);
    let lines = span(row, height);
    for column in (0..width).step_by(GROUP) {
        let count = GROUP.min(width - column);
        let mut counts = [0; GROUP];
        let sums = if asked(column) { sums(simd, width, missing, &lines, column) } else { [0; 2 * GROUP] };
        // Most groups have nothing missing around them, and are dark or whole.
        if sums.iter().fold(0, |any, sum| any | sum) != 0 {
            let mut all = u8x32::splat(simd, 0);
            for place in BESIDE - edge..=BESIDE + edge {
                all = all.saturating_add(u8x32::from_slice(simd, &sums[place..place + GROUP]));
            }
            all.store_slice(&mut counts);
        }
        if column >= edge && column + GROUP + edge <= width {
            found(column, &counts, (2 * edge + 1) * lines.len());
            continue;
        }
        for (column, count) in (column..).zip(counts[..count].chunks(1)) {
            found(column, count, span(column, width).len() * lines.len());
        }
    }
}

/// How many pixels of some lines are missing in the columns of a group and in those beside it.
#[inline(always)]
fn sums<S: Simd>(
    simd: S,
    width: usize,
    missing: &[u8],
    lines: &Range<usize>,
    column: usize,
) -> [u8; 2 * GROUP] {
    let columns = column.saturating_sub(BESIDE)..(column + GROUP + BESIDE).min(width);
    let (mut low, mut high) = (u8x32::splat(simd, 0), u8x32::splat(simd, 0));
    let mut add = |values: &[u8]| {
        low += u8x32::from_slice(simd, &values[..GROUP]);
        high += u8x32::from_slice(simd, &values[GROUP..2 * GROUP]);
    };
    for line in lines.clone() {
        let values = &missing[line * width..][columns.clone()];
        if values.len() == 2 * GROUP {
            add(values);
            continue;
        }
        let mut padded = [0; 2 * GROUP];
        padded[columns.start + BESIDE - column..][..values.len()].copy_from_slice(values);
        add(&padded);
    }
    let mut sums = [0; 2 * GROUP];
    low.store_slice(&mut sums[..GROUP]);
    high.store_slice(&mut sums[GROUP..]);
    sums
}

/// Whether more than specks are missing among the samples up to `edge` pixels away; beyond the picture and in narrow gaps
/// (`gaps` not zero) nothing is missed.
pub(super) fn at_rim(
    (width, height): (usize, usize),
    samples: &Raster,
    gaps: &[u8],
    pixel: usize,
    link: Link,
    edge: usize,
) -> bool {
    if edge == HALF && is_readable((width, height), pixel) {
        let missing = broken::missing(width, samples, gaps, pixel, link);
        return missing > specks((2 * HALF + 1) * (2 * HALF + 1));
    }
    let (column, row) = (pixel % width, pixel / width);
    let centre = &samples.at(pixel);
    let (mut all, mut missing) = (0, 0);
    for line in row.saturating_sub(edge)..(row + edge + 1).min(height) {
        for place in column.saturating_sub(edge)..(column + edge + 1).min(width) {
            let distance = line.abs_diff(row).max(place.abs_diff(column));
            all += 1;
            let at = line * width + place;
            missing += u16::from(gaps[at] == 0 && !link.joins(centre, &samples.at(at), distance));
        }
    }
    missing > specks(all)
}

#[cfg(test)]
mod tests;
