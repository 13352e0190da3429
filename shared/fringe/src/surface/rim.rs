//! Where a surface ends in the picture.
//!
//! The footprint of a pixel at a rim sees less than a whole pixel of the surface, or a part of another one, and shifts its phase: by two thirds of a
//! pixel in the outermost one, by a seventh in the next. They are no points, nor does any window take them: the normals of their neighbours would turn
//! by 5 to 25°.

use super::Cause;
use super::broken::{self, is_readable};
use super::buffers::{PartCount, SurfaceBuilder};
use super::gaps::mark_row;
use super::normals::Link;
use super::point::View;
use super::raster::Raster;
use super::windows::HALF;
use crate::math::parallel::for_parts;
use crate::math::simd::{best_level, vectorised};
use rayon::prelude::*;

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
                    own[column..column + GROUP].iter().fold(false, |any, depth| any | !depth.is_nan())
                };
                // A rim has more than one end beside it.
                let found = |column: usize, counts: &[u16], _| {
                    if counts.iter().fold(0, |most, near| most.max(*near)) <= 1 {
                        return;
                    }
                    for (column, _) in (column..).zip(counts).filter(|(_, near)| **near > 1) {
                        let pixel = row * view.width + column;
                        let edge = view.rim_px(&samples.at(pixel), edge);
                        if samples.depths[pixel].is_finite() && at_rim(size, samples, gaps, pixel, link, edge)
                        {
                            causes[column] = Cause::Rim;
                            count.rims += 1;
                        }
                    }
                };
                vectorised!(*level, count_row(size, ends, edge, row, (asked, found)));
            }
        });
        let rows = raster.depths.par_chunks_mut(view.width).zip(keep.par_chunks_mut(view.width));
        rows.zip(causes.par_chunks(view.width)).with_min_len(ROWS).for_each(|((depths, gaps), causes)| {
            for ((depth, gap), cause) in depths.iter_mut().zip(gaps).zip(causes) {
                let dropped = *cause == Cause::Rim;
                *depth = if dropped { f64::NAN } else { *depth };
                *gap = if dropped { DROPPED } else { *gap };
            }
        });
        self.counts.iter().map(|count| count.rims).sum()
    }
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
    let (depths, sigmas) = (&samples.depths[..], &samples.sigmas[..]);
    for first in (0..width).step_by(GROUP) {
        let count = GROUP.min(width - first);
        let here = at + first;
        let own = &depths[here..here + count];
        let line = &mut line[first..first + count];
        // Where nothing is, nothing jumps, and a gap is none.
        for ((end, gap), depth) in line.iter_mut().zip(&gaps[here..here + count]).zip(own) {
            *end = u8::from(depth.is_nan()) & u8::from(*gap == 0);
        }
        if own.iter().all(|depth| depth.is_nan()) {
            continue;
        }
        // From the first one of each two; NaN fails the comparison.
        let jumps = |from: usize, to: usize, line: &mut [u8]| {
            let both = line.len();
            let (a, b) = (&depths[from..from + both], &depths[to..to + both]);
            let (sa, sb) = (&sigmas[from..from + both], &sigmas[to..to + both]);
            for (k, end) in line.iter_mut().enumerate() {
                let jump = (a[k] - b[k]).abs() > link.limit(a[k], sa[k] + sb[k], 1);
                *end |= u8::from(jump);
            }
        };
        if row > 0 {
            jumps(here, here - width, line);
        }
        if row + 1 < height {
            jumps(here, here + width, line);
        }
        let inside = count - usize::from(first + count == width);
        jumps(here, here + 1, &mut line[..inside]);
        let before = usize::from(first == 0);
        jumps(here + before - 1, here + before, &mut line[before..]);
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
        vectorised!(
            level,
            count_row(
                (width, height),
                missing,
                edge,
                row,
                (
                    |_| true,
                    |column: usize, counts: &[u16], all: usize| {
                        let most = specks(all);
                        for (rim, count) in rims[column..].iter_mut().zip(counts) {
                            *rim = u8::from(*count > most);
                        }
                    }
                )
            )
        );
    });
}

/// Pixels of a group.
const GROUP: usize = 32;

/// Counts what is missing in the windows of the pixels of a row: `found` gets the column of the first of some, their counts, and the pixels of such a
/// window. Of whole groups of pixels that are not asked nothing counts.
#[inline(always)]
fn count_row(
    (width, height): (usize, usize),
    missing: &[u8],
    edge: usize,
    row: usize,
    (asked, mut found): (impl Fn(usize) -> bool, impl FnMut(usize, &[u16], usize)),
) {
    let span = |at: usize, end: usize| at.saturating_sub(edge)..(at + edge + 1).min(end);
    let lines = span(row, height);
    let mut column = 0;
    while column < width {
        if column >= edge && column + GROUP + edge <= width {
            let mut counts = [0_u16; GROUP];
            // Most groups have nothing missing around them, and are dark or whole.
            let around = |line: usize| &missing[line * width + column - edge..][..GROUP + 2 * edge];
            let any = |line: usize| around(line).iter().fold(0, |any, missing| any | missing) != 0;
            let counted = if asked(column) && lines.clone().any(any) { lines.clone() } else { 0..0 };
            for line in counted {
                for place in 0..=2 * edge {
                    let values = &missing[line * width + column + place - edge..][..GROUP];
                    for (count, value) in counts.iter_mut().zip(values) {
                        *count += u16::from(*value);
                    }
                }
            }
            found(column, &counts, (2 * edge + 1) * lines.len());
            column += GROUP;
            continue;
        }
        let places = span(column, width);
        let counted = lines.clone().flat_map(|line| &missing[line * width..][places.clone()]);
        let count = counted.map(|missing| u16::from(*missing)).sum();
        found(column, &[count], places.len() * lines.len());
        column += 1;
    }
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
mod tests {
    use super::super::{Sample, SurfaceSettings};
    use super::*;
    use crate::cloud::Point;
    use crate::rectify::Directions;
    use bytemuck::Zeroable;
    use nalgebra::Vector3;

    const LINK: Link = Link { max_step: 0.01 };

    fn samples(picture: &[&str]) -> (usize, Vec<Sample>) {
        let depth = |c: u8| if c == b'.' { f64::NAN } else { 0.002 + 0.001 * f64::from(c - b'0') };
        let sample = |c| Sample { inverse_depth: depth(c), sigma: 0.0, modulation: 1.0, ..Sample::NONE };
        (picture[0].len(), picture.iter().flat_map(|line| line.bytes()).map(sample).collect())
    }

    /// A silhouette, a step to another surface and a speck; the border of the picture is none of them.
    #[test]
    fn rims_go_and_specks_and_borders_stay() {
        let picture =
            ["1111111....", "1111111....", "11.11112222", "11111112222", "11111112222", "11111112222"];
        let (width, samples) = samples(&picture);
        let at = |column, row| {
            at_rim(
                (width, picture.len()),
                &samples[..].into(),
                &vec![0; samples.len()],
                row * width + column,
                LINK,
                2,
            )
        };
        assert!((0..5).all(|column| !at(column, 4)), "three pixels away, beside the border");
        assert!([5, 6, 7, 8].iter().all(|column| at(*column, 4)), "on both sides of a step");
        assert!(!at(1, 1) && !at(2, 3), "one sample is a speck");
    }

    /// One missing neighbour is a speck in the smallest window too; the three of a silhouette are a rim.
    #[test]
    fn one_missing_neighbour_is_no_rim() {
        let picture = ["1111...", "1111...", "1.11...", "1111...", "1111..."];
        let (width, samples) = samples(&picture);
        let at = |column, row| {
            at_rim(
                (width, picture.len()),
                &samples[..].into(),
                &vec![0; samples.len()],
                row * width + column,
                LINK,
                1,
            )
        };
        assert!(!at(0, 2) && !at(1, 1) && !at(2, 3));
        assert!(at(3, 1) && at(3, 2));
    }

    #[test]
    fn marks_agree_with_the_test_of_one_pixel() {
        let (width, height) = (23, 17);
        let inside = |i: usize| {
            let (x, y) = ((i % width) as f64 - 10.0, (i / width) as f64 - 8.0);
            x * x + y * y < 42.0 && !i.is_multiple_of(61)
        };
        let values: Vec<f32> = (0..width * height).map(|i| if inside(i) { 1.0 } else { f32::NAN }).collect();
        let sample = |i| {
            if inside(i) {
                Sample { inverse_depth: 0.002, sigma: 0.0, modulation: 1.0, ..Sample::NONE }
            } else {
                Sample::NONE
            }
        };
        let samples: Vec<Sample> = (0..width * height).map(sample).collect();
        let raster = Raster::from(&samples[..]);
        let mut rims = vec![0; width * height];
        let (mut missing, none) = (vec![0; width * height], vec![0; width * height]);
        mark_missing((width, &values), -1.0, &mut missing);
        for edge in [1, 2, 3] {
            mark_rims(width, edge, &missing, &mut rims);
            for pixel in (0..width * height).filter(|i| inside(*i)) {
                assert_eq!(
                    rims[pixel] != 0,
                    at_rim((width, height), &raster, &none, pixel, LINK, edge),
                    "{pixel}"
                );
            }
        }
        mark_rims(width, 0, &missing, &mut rims);
        assert!(rims.iter().all(|rim| *rim == 0));
    }

    const SIDE: usize = 40;
    const PITCH: f64 = 0.001;
    /// Inverse depth of the middle, and what a length of one pixel on the surface changes it by.
    const MIDDLE: f64 = 0.002;
    const UNIT: f64 = MIDDLE * PITCH;

    /// Causes and points of a slanting plane of which each column stands off by so many pixels, or is dark.
    fn built(off_px: impl Fn(usize) -> Option<f64>) -> (Vec<Cause>, Vec<Point>) {
        let at = |i: usize| [i % SIDE, i / SIDE].map(|v| (v as f64 - 20.0) * PITCH);
        let directions = Directions::kept(SIDE, (0..SIDE * SIDE).map(at).collect());
        let sample = |i: usize| {
            let Some(off) = off_px(i % SIDE) else { return Sample::NONE };
            let inverse_depth = MIDDLE * (1.0 + 0.5 * at(i)[0] - 0.2 * at(i)[1]) + off * UNIT;
            let sigma = (0.07 * UNIT) as f32;
            Sample { inverse_depth, sigma, modulation: 1.0, ..Sample::without(Cause::Point) }
        };
        let samples: Vec<Sample> = (0..SIDE * SIDE).map(sample).collect();
        let mut builder = SurfaceBuilder::new(SIDE, SIDE, SurfaceSettings::default());
        builder.load(&samples);
        let mut points = vec![Point::zeroed(); samples.len()];
        let view = View::along_the_axes([SIDE, SIDE], &directions, PITCH);
        let report = builder.build(&view, 0, &mut points);
        points.truncate(report.points as usize);
        let rims = builder.causes().iter().filter(|cause| **cause == Cause::Rim).count();
        assert_eq!(report.rims as usize, rims);
        (builder.causes().to_vec(), points)
    }

    /// Proves: the pixels at a rim, which stand off, are no points, and turn the normals of their neighbours by nothing.
    #[test]
    fn what_stands_off_at_a_rim_turns_no_normal() {
        let (causes, points) = built(|column| match column {
            0..10 => None,
            10 => Some(2.5),
            11 => Some(0.55),
            _ => Some(0.0),
        });
        for (pixel, cause) in causes.iter().enumerate() {
            let wanted = match pixel % SIDE {
                0..10 => Cause::Dark,
                10 | 11 => Cause::Rim,
                _ => Cause::Point,
            };
            assert_eq!(*cause, wanted, "{pixel}");
        }
        let normal = |point: &Point| Vector3::from(point.normal.map(f64::from));
        let inside = normal(points.iter().find(|point| point.pixel as usize == 20 * SIDE + 30).unwrap());
        let turn = points.iter().map(|point| normal(point).cross(&inside).norm()).fold(0.0, f64::max);
        assert!(points.len() == SIDE * 28 && turn < 1e-3, "{} points, {turn} rad", points.len());
    }

    /// Proves: a narrow shadow beyond which another surface begins has rims on both sides; a dark line across a face has none.
    #[test]
    fn a_shadow_has_rims_and_a_dark_line_has_none() {
        for width in 1..=3 {
            for step_px in [0.0, 4.0, -4.0] {
                let beyond = 20 + width;
                let (causes, _) = built(|column| {
                    (!(20..beyond).contains(&column)).then_some(if column < 20 { 0.0 } else { step_px })
                });
                let is_rim = |column: usize| step_px != 0.0 && (18..beyond + 2).contains(&column);
                for (pixel, cause) in causes.iter().enumerate() {
                    let wanted = match pixel % SIDE {
                        column if (20..beyond).contains(&column) => Cause::Dark,
                        column if is_rim(column) => Cause::Rim,
                        _ => Cause::Point,
                    };
                    assert_eq!(*cause, wanted, "{width} px, {step_px} px off: {pixel}");
                }
            }
        }
    }
}
