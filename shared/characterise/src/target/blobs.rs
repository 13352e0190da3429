//! Candidates for circles: connected areas that differ from the light around them and fill their ellipse.

use super::raster::{Grey, Image, Raster, half_gaussian};
use nalgebra::{Matrix2, Point2};

/// Smoothing before the threshold, px.
const SMOOTHING_PX: f64 = 0.8;
/// The mean around a pixel is taken over squares of these sides, as parts of the image's shorter side, in turn: circles
/// must be smaller than the square, and light may change beyond it.
pub(crate) const NEIGHBOURHOODS: [f64; 3] = [0.08, 0.2, 0.035];
/// Fewest pixels of a circle.
const LEAST_PIXELS: usize = 9;
/// Largest ratio of the axes: a tilt of 75°.
const LONGEST: f64 = 4.0;
/// An area is an ellipse when its pixels are this much of 4π·√det(moments), within; a square has 0.95, a ring or a bar more or less.
const FULL: std::ops::Range<f64> = 0.88..1.08;

/// A connected area of pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Blob {
    pub pixel: Point2<f64>,
    /// Second central moments, px².
    pub moments: Matrix2<f64>,
}

/// Areas darker (or lighter) than their neighbourhood by `least_dn`, row by row.
pub(crate) fn candidates(image: &Image, dark: bool, part: f64, least_dn: f64) -> Vec<Blob> {
    let smooth = image.smoothed(&half_gaussian(SMOOTHING_PX));
    let side = image.width.min(image.height);
    let half = ((0.5 * part * side as f64) as usize).max(4);
    let around = box_mean(&smooth, half);
    let sign = if dark { 1.0 } else { -1.0 };
    let differs: Vec<bool> =
        smooth.values.iter().zip(&around).map(|(v, mean)| sign * (mean - v) > least_dn as f32).collect();
    let most = (2 * half + 1) * (2 * half + 1);
    areas(&differs, image.width, most).iter().filter_map(|area| ellipse(area, image)).collect()
}

/// Mean over squares of side 2·half + 1, cut at the border.
fn box_mean(image: &Raster, half: usize) -> Vec<f32> {
    let (w, h) = (image.width, image.height);
    let mut sums = vec![0.0_f64; (w + 1) * (h + 1)];
    for y in 0..h {
        let mut row = 0.0;
        for x in 0..w {
            row += f64::from(image.get(x, y));
            sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
        }
    }
    let mut means = Vec::with_capacity(w * h);
    for y in 0..h {
        let (top, bottom) = (y.saturating_sub(half) * (w + 1), (y + half + 1).min(h) * (w + 1));
        let rows = (bottom - top) / (w + 1);
        for x in 0..w {
            let (left, right) = (x.saturating_sub(half), (x + half + 1).min(w));
            let sum = sums[bottom + right] - sums[bottom + left] - sums[top + right] + sums[top + left];
            means.push((sum / ((right - left) * rows) as f64) as f32);
        }
    }
    means
}

/// Connected areas (four neighbours) of at most `most` pixels that do not touch the border.
fn areas(differs: &[bool], width: usize, most: usize) -> Vec<Vec<usize>> {
    let mut open = differs.to_vec();
    let height = differs.len() / width;
    let mut areas = Vec::new();
    let mut stack = Vec::new();
    for seed in 0..open.len() {
        if !open[seed] {
            continue;
        }
        open[seed] = false;
        stack.push(seed);
        let (mut area, mut border, mut count) = (Vec::new(), false, 0);
        while let Some(index) = stack.pop() {
            count += 1;
            if count <= most {
                area.push(index);
            }
            let (x, y) = (index % width, index / width);
            if x == 0 || y == 0 || x + 1 == width || y + 1 == height {
                border = true;
                continue;
            }
            for next in [index - 1, index + 1, index - width, index + width] {
                if std::mem::take(&mut open[next]) {
                    stack.push(next);
                }
            }
        }
        if !border && (LEAST_PIXELS..=most).contains(&count) {
            areas.push(area);
        }
    }
    areas
}

/// The ellipse of an area, if the area is one.
fn ellipse(area: &[usize], image: &Image) -> Option<Blob> {
    let count = area.len() as f64;
    let at = |index: &usize| Point2::new((index % image.width) as f64, (index / image.width) as f64);
    let sum = area.iter().map(|i| at(i).coords).fold(nalgebra::Vector2::zeros(), |a, b| a + b);
    let pixel = Point2::from(sum / count);
    // A pixel is a square of its own, with moments 1/12.
    let moments =
        area.iter().fold(Matrix2::zeros(), |m, i| m + (at(i) - pixel) * (at(i) - pixel).transpose()) / count
            + Matrix2::identity() / 12.0;
    let full = count / (4.0 * std::f64::consts::PI * moments.determinant().max(1e-12).sqrt());
    let (half, root) = (
        0.5 * moments.trace(),
        (0.25 * moments.trace() * moments.trace() - moments.determinant()).max(0.0).sqrt(),
    );
    let round = half + root <= LONGEST * LONGEST * (half - root);
    (FULL.contains(&full) && round).then_some(Blob { pixel, moments })
}
