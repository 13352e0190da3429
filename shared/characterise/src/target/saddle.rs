//! Candidates for corners: saddles of the grey values that a ring around them confirms.
//!
//! The determinant of the Hessian finds saddles whatever their direction and light (its sign does not depend on either);
//! the ring then must show four sectors, light and dark in turn, whose borders lie opposite each other. Edges, blobs and most
//! of any clutter fail that.

use super::raster::{Grey, Raster, half_gaussian};
use fearless_simd::{Level, dispatch};
use fringe::math::{atan2, sincos};
use nalgebra::{Point2, Vector2};
use std::f64::consts::{PI, TAU};

/// Smoothing before derivatives are taken, px: the noise of 8 bits disappears, squares of six pixels remain.
const SMOOTHING_PX: f64 = 1.3;
/// Radii of the ring, px, tried in turn: the first for most, the second for small squares, the third for blurred ones.
const RADII_PX: [f64; 3] = [5.0, 3.4, 8.0];
const RING: usize = 32;
/// Two borders of an edge may miss a straight line by this, rad: perspective leaves them straight, noise and blur do not.
const STRAIGHT_RAD: f64 = 0.6;
/// Pixels of a row that are searched at once.
const STRETCH: usize = 32;
/// Candidates kept, the strongest: ten times the largest usual board, and few enough to compare all with all.
const MOST: usize = 2500;

/// A point that looks like a corner.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Saddle {
    pub pixel: Point2<f64>,
    /// Directions of the two edges; from the first to the second (turning from x to y) the square is light.
    pub axes: [Vector2<f64>; 2],
    /// Half difference of light and dark on the ring, DN.
    pub contrast_dn: f64,
}

/// All candidates, from top to bottom; second, the smoothed image in which they were found.
pub(crate) fn candidates(image: &impl Grey, min_contrast_dn: f64) -> (Vec<Saddle>, Raster) {
    let smooth = image.smoothed(&half_gaussian(SMOOTHING_PX));
    let mut found = dispatch!(Level::new(), _level => peaks(&smooth, min_contrast_dn));
    let directions: [_; RING] = std::array::from_fn(|i| {
        let (sin, cos) = sincos(TAU * i as f64 / RING as f64);
        Vector2::new(cos, sin)
    });
    found.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let mut saddles: Vec<Saddle> = found
        .iter()
        .filter_map(|(index, _)| {
            let pixel = refined(&smooth, index % smooth.width, index / smooth.width)?;
            RADII_PX
                .iter()
                .find_map(|radius| ring(&smooth, pixel, &directions.map(|d| d * *radius), min_contrast_dn))
        })
        .take(MOST)
        .collect();
    saddles.sort_by(|a, b| a.pixel.y.total_cmp(&b.pixel.y).then(a.pixel.x.total_cmp(&b.pixel.x)));
    (saddles, smooth)
}

/// Second derivatives xx, yy, xy in the middle of 3 × 3 pixels.
#[inline(always)]
fn second_derivatives([[a, b, c], [d, e, f], [g, h, i]]: [[f32; 3]; 3]) -> [f32; 3] {
    [f - 2.0 * e + d, h - 2.0 * e + b, 0.25 * (i - g - c + a)]
}

/// Second derivatives xx, yy, xy at an inner pixel.
fn hessian(image: &Raster, index: usize) -> [f32; 3] {
    let row = |start: usize| [0, 1, 2].map(|dx| image.values[start + dx]);
    second_derivatives([index - image.width, index, index + image.width].map(|middle| row(middle - 1)))
}

/// −det H of the inner pixels of a row.
#[inline(always)]
fn respond(smooth: &Raster, y: usize, out: &mut [f32]) {
    let (w, n) = (smooth.width, out.len());
    let pixels = |dy: usize, dx: usize| &smooth.values[(y + dy - 1) * w + dx..][..n];
    let [a, b, c] = [0, 1, 2].map(|dx| pixels(0, dx));
    let [d, e, f] = [0, 1, 2].map(|dx| pixels(1, dx));
    let [g, h, i] = [0, 1, 2].map(|dx| pixels(2, dx));
    for x in 0..n {
        let [xx, yy, xy] = second_derivatives([[a[x], b[x], c[x]], [d[x], e[x], f[x]], [g[x], h[x], i[x]]]);
        out[x] = xy * xy - xx * yy;
    }
}

/// Local maxima of −det H: index and value.
#[inline(always)]
fn peaks(smooth: &Raster, min_contrast_dn: f64) -> Vec<(usize, f32)> {
    let (w, h) = (smooth.width, smooth.height);
    // A corner of contrast A under total blur σ has Ixy = 2A/(πσ²): 0.1·A still sees one of σ = 2.5 px.
    let least = (0.1 * min_contrast_dn as f32).powi(2);
    // Five rows about the one that is searched, each in its turn; the first and the last of the image have no response.
    let mut response = vec![0.0_f32; 5 * w];
    for y in 1..4 {
        respond(smooth, y, &mut response[y * w + 1..(y + 1) * w - 1]);
    }
    let (mut found, mut highest) = (Vec::new(), vec![0.0; w]);
    for y in 2..h - 2 {
        let last = &mut response[(y + 2) % 5 * w..][..w];
        if y + 2 < h - 1 {
            respond(smooth, y + 2, &mut last[1..w - 1]);
        } else {
            last.fill(0.0);
        }
        let rows = std::array::from_fn(|dy| &response[(y + dy + 3) % 5 * w..][..w]);
        highest_of(&rows, &mut highest);
        for start in (2..w - 2).step_by(STRETCH) {
            let end = (start + STRETCH).min(w - 2);
            // Most stretches have nothing, and are left without a look at each pixel.
            if !has_peak(&rows[2][start..end], &highest[start - 2..end + 2], least) {
                continue;
            }
            for x in start..end {
                let here = rows[2][x];
                if here > least && is_peak(&rows, x, here) {
                    found.push((y * w + x, here));
                }
            }
        }
    }
    found
}

/// The largest of five rows, column by column.
#[inline(always)]
fn highest_of(rows: &[&[f32]; 5], out: &mut [f32]) {
    let [a, b, c, d, e] = rows.map(|row| &row[..out.len()]);
    let larger = |a: f32, b: f32| if a > b { a } else { b };
    for x in 0..out.len() {
        out[x] = larger(larger(larger(a[x], b[x]), larger(c[x], d[x])), e[x]);
    }
}

/// Whether a stretch has a value beyond the least that no neighbour exceeds; `highest` begins two columns before it.
#[inline(always)]
fn has_peak(stretch: &[f32], highest: &[f32], least: f32) -> bool {
    let n = stretch.len();
    let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|shift| &highest[shift..][..n]);
    let mut peaks = 0;
    for x in 0..n {
        let here = stretch[x];
        let above = u32::from(here >= a[x]) & u32::from(here >= b[x]) & u32::from(here >= c[x]);
        peaks += above & u32::from(here >= d[x]) & u32::from(here >= e[x]) & u32::from(here > least);
    }
    peaks > 0
}

/// Largest of its 5 × 5 neighbours; of equal ones the first.
fn is_peak(rows: &[&[f32]; 5], x: usize, here: f32) -> bool {
    rows.iter().enumerate().all(|(dy, row)| {
        row[x - 2..x + 3]
            .iter()
            .enumerate()
            .all(|(dx, v)| *v < here || (dy, dx) == (2, 2) || (*v == here && (dy, dx) > (2, 2)))
    })
}

/// The stationary point of the quadratic around a pixel; `None` when it lies elsewhere.
fn refined(smooth: &Raster, x: usize, y: usize) -> Option<Point2<f64>> {
    let index = y * smooth.width + x;
    let [xx, yy, xy] = hessian(smooth, index).map(f64::from);
    let v = &smooth.values;
    let gx = 0.5 * f64::from(v[index + 1] - v[index - 1]);
    let gy = 0.5 * f64::from(v[index + smooth.width] - v[index - smooth.width]);
    let determinant = xx * yy - xy * xy;
    let step = Vector2::new(xy * gy - yy * gx, xy * gx - xx * gy) / determinant;
    (step.amax() <= 1.5).then(|| Point2::new(x as f64, y as f64) + step)
}

/// Looks at a ring of points, given from its centre: four sectors in turn, borders opposite each other.
fn ring(
    smooth: &Raster,
    centre: Point2<f64>,
    around_px: &[Vector2<f64>; RING],
    min_contrast_dn: f64,
) -> Option<Saddle> {
    let mut values = [0.0_f64; RING];
    for (value, away) in values.iter_mut().zip(around_px) {
        *value = f64::from(smooth.sample(centre + away)?);
    }
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let contrast_dn = 0.5 * (most - least);
    if contrast_dn < min_contrast_dn {
        return None;
    }
    let borders = borders(&values, 0.5 * (most + least), 0.4 * contrast_dn)?;
    let straight = |a: f64, b: f64| (b - a - PI).abs() < STRAIGHT_RAD;
    if !straight(borders[0], borders[2]) || !straight(borders[1], borders[3]) {
        return None;
    }
    let axis = |a: f64, b: f64| {
        let (sin, cos) = sincos(0.5 * (a + b - PI));
        Vector2::new(cos, sin)
    };
    let axes = [axis(borders[0], borders[2]), axis(borders[1], borders[3])];
    let angle = atan2(axes[0].perp(&axes[1]), axes[0].dot(&axes[1]));
    // Squares seen flatter than 15° give no position along the view.
    (angle.abs() > 0.26 && angle.abs() < PI - 0.26).then_some(Saddle { pixel: centre, axes, contrast_dn })
}

/// The four angles at which the ring crosses the middle, the first one from dark to light; each sector must leave the
/// middle by `margin`.
fn borders(values: &[f64; RING], middle: f64, margin: f64) -> Option<[f64; 4]> {
    let first = (0..RING).find(|i| values[*i] < middle && values[(i + 1) % RING] >= middle)?;
    let mut borders = [0.0; 4];
    let (mut count, mut reach) = (0, 0.0_f64);
    for step in 0..RING {
        let (here, next) =
            (values[(first + step) % RING] - middle, values[(first + step + 1) % RING] - middle);
        if (here < 0.0) != (next < 0.0) {
            if count == 4 || (count > 0 && reach < margin) {
                return None;
            }
            borders[count] = TAU * ((first + step) as f64 + here / (here - next)) / RING as f64;
            count += 1;
            reach = 0.0;
        }
        reach = reach.max(next.abs());
    }
    (count == 4 && reach >= margin).then_some(borders)
}
