//! Where a surface ends in the picture.

use super::broken::{self, is_readable};
use super::gaps::mark_row;
use super::normals::Link;
use super::raster::Raster;
use super::windows::HALF;
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

/// Fewest rows of one parallel job.
const ROWS: usize = 16;

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
        vectorised!(level, count_row((width, height), missing, edge, row, rims));
    });
}

/// Pixels of a group.
const GROUP: usize = 32;

/// Marks the pixels of a row in whose window more than specks are missing.
#[inline(always)]
fn count_row((width, height): (usize, usize), missing: &[u8], edge: usize, row: usize, rims: &mut [u8]) {
    let span = |at: usize, end: usize| at.saturating_sub(edge)..(at + edge + 1).min(end);
    let lines = span(row, height);
    let most = specks((2 * edge + 1) * lines.len());
    let mut column = 0;
    while column < width {
        if column >= edge && column + GROUP + edge <= width {
            let mut counts = [0_u16; GROUP];
            for line in lines.clone() {
                for place in 0..=2 * edge {
                    let values = &missing[line * width + column + place - edge..][..GROUP];
                    for (count, value) in counts.iter_mut().zip(values) {
                        *count += u16::from(*value);
                    }
                }
            }
            for (rim, count) in rims[column..column + GROUP].iter_mut().zip(counts) {
                *rim = u8::from(count > most);
            }
            column += GROUP;
            continue;
        }
        let places = span(column, width);
        let counted = lines.clone().flat_map(|line| &missing[line * width..][places.clone()]);
        let count: u16 = counted.map(|missing| u16::from(*missing)).sum();
        rims[column] = u8::from(count > specks(places.len() * lines.len()));
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
    use super::super::Sample;
    use super::*;

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
}
