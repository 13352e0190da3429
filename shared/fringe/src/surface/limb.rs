//! The limb: where a curved surface turns away from a camera and ends in its picture.
//!
//! The bias of the footprint is taken off with derivatives of phase and brightness over 5 × 5 pixels. So near to a limb that these windows and the
//! blur reach over it, what lies beyond takes part, and a point is shifted inwards by some hundredths of a pixel. Such points are dropped. A flat
//! face that ends has hardly a bias, and keeps its points but for `edge_px`.
//!
//! Both conditions come from many pixels, so that the noise of a point hardly decides about itself: how near phases end or jump in the picture of
//! either camera, and whether that is a limb, by the turn of the normal. On a ball of ρ pixels the incidence has the sine s = r/ρ at r pixels from the
//! middle; with s₀ here and s₁ farther in by L pixels, ρ (1 − s₀) = L (1 − s₀)/(s₀ − s₁) pixels are left to the limb, and of a plane infinitely many.

use super::build::Selector;
use super::marks::{BENT, OTHER, OWN, SPLIT};
use super::normals::{normal, pixels_along};
use super::point::{STEEP_SHARE, Sample, rim_is_hidden};
use crate::math::simd::{best_level, vectorised};
use crate::sensor::Footprint;
use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

/// Half the side of the windows of the derivatives, px.
const WINDOW_PX: f64 = 2.5;

/// A pixel gets light from so many standard deviations of its footprint.
const SPREAD: f64 = 4.0;

/// Footprint of a camera whose own is not known, standard deviation, px: what most lenses stay below.
const USUAL_PX: f64 = 0.7;

/// Largest distance that is looked at, px.
const MOST_PX: usize = 8;

/// Over so many pixels inwards the turn of the normal is asked, which is hardly noise then.
const INWARDS_PX: f64 = 6.0;

/// Phases end at the limb if it is nearer than this, px: twice the usual reach, so that balls are far below it and flat faces far above.
const LIMB_PX: f64 = 10.0;

/// The same of a bowl, where phases only bend, px: coarse pixels bend at every crease.
const BOWL_PX: f64 = 5.0;

/// Least radius of a bowl, px: a crease of 23° and more turns the normal as much over [`INWARDS_PX`].
const LEAST_BOWL_PX: f64 = 15.0;

/// Where the surface turns back towards the eye.
#[derive(Clone, Copy)]
struct Way {
    /// On the side of the eye, as that of a ball; a bowl, whose wall goes on behind the edge that hides it, does on the other.
    uphill: bool,
    /// What has one of these marks may lie beyond a crease, and tells nothing.
    clear_of: u8,
    /// Smaller ones are none.
    least_radius_px: f64,
}

/// A ball ends in the picture: its limb is no crease.
const BALL: Way = Way { uphill: true, clear_of: 0, least_radius_px: 0.0 };

/// Shift of points near a limb, along the normal, in pixels on the surface: 6 µm at 0.21 mm per pixel.
const LIMB_ERROR: f64 = 0.03;

/// Square of the cosine of 30°: seen less steeply, a limb as near as [`reach_px`] would be that of a ball of a few pixels.
pub(super) const FRONTAL_COSINE2: f64 = 0.75;

/// How far a limb shifts points in the picture of a camera, px: half the window of the derivatives and the blur where it is widest.
pub(crate) fn reach_px(footprint: Option<Footprint>) -> f64 {
    let usual = Footprint { sigma_px: [USUAL_PX; 2], u_px: None, field_px2: 0.0 };
    let footprint = footprint.unwrap_or(usual);
    let ends = [0.0, 1.0].map(|field| footprint.variances_at_px2(field));
    let widest = ends.as_flattened().iter().fold(0.0_f64, |most, variance| most.max(*variance));
    (WINDOW_PX + SPREAD * widest.sqrt()).min(MOST_PX as f64)
}

/// Phases bend where their second difference is more than this part of the sum of both central differences, each over two pixels: where a wall runs
/// behind an edge of the same height, phases neither end nor jump.
const BEND: f32 = 0.2;

/// Noise of so many standard deviations of a pixel is no bend: 4.1 of a second difference.
const BEND_SIGMAS: f32 = 10.0;

/// How far borders reach in a picture, px.
#[derive(Clone, Copy)]
pub(crate) struct Reach {
    /// That of a limb: see [`reach_px`].
    pub limb: f64,
    /// That of a rim: [`super::SurfaceSettings::edge_px`]; 0: bends are no rims.
    pub rim: usize,
}

/// Fewest rows of one parallel job.
const ROWS: usize = 16;

/// Marks the pixels of a raster (values and their uncertainties) nearer than the reach of a limb to a missing one (`missing` not zero) or to a jump by more than
/// `max_step`, and by the mark shifted by [`BENT`] those as near to a bend, by [`SPLIT`] those in the reach of a rim from one; beyond the picture nothing is
/// missed. `borders` is scratch of the same size.
pub(crate) fn mark_limbs(
    (width, values, sigmas): (usize, &[f32], &[f32]),
    (reach, max_step): (Reach, f32),
    missing: &[u8],
    borders: &mut [u8],
    (mark, marks): (u8, &mut [u8]),
) {
    if width == 0 {
        return;
    }
    let level = best_level();
    let size = (width, values.len() / width);
    borders.par_chunks_mut(width).enumerate().with_min_len(ROWS).for_each(|(row, line)| {
        vectorised!(level, border_row(size, (values, sigmas, missing), (row, max_step), line));
    });
    // A bend marks the last pixels of both sides.
    let (disc, rim, borders) = (Disc::new(reach.limb), Disc::new(reach.rim as f64 - 0.5), &*borders);
    marks.par_chunks_mut(width).enumerate().with_min_len(ROWS).for_each(|(row, line)| {
        vectorised!(level, disc.mark_row(size, (borders, ENDS), row, (mark, line)));
        vectorised!(level, disc.mark_row(size, (borders, BENDS), row, (mark << BENT, line)));
        if reach.rim > 0 {
            vectorised!(level, rim.mark_row(size, (borders, BENDS), row, (mark << SPLIT, line)));
        }
    });
}

/// A border where phases end …
const ENDS: u8 = 1;
/// … and one where they bend.
const BENDS: u8 = 2;

/// Marks the missing pixels of a row, those beside a jump, and those where the slope bends.
#[inline(always)]
fn border_row(
    (width, height): (usize, usize),
    (values, sigmas, missing): (&[f32], &[f32], &[u8]),
    (row, max_step): (usize, f32),
    line: &mut [u8],
) {
    let at = row * width;
    for (border, missing) in line.iter_mut().zip(&missing[at..at + width]) {
        *border = if *missing != 0 { ENDS } else { 0 };
    }
    let own = &values[at..at + width];
    // NaN fails the comparison.
    let jumps = |a: f32, b: f32| if (a - b).abs() > max_step { ENDS } else { 0 };
    for other in [row.checked_sub(1), (row + 1 < height).then_some(row + 1)].into_iter().flatten() {
        let other = &values[other * width..][..width];
        for ((border, own), other) in line.iter_mut().zip(own).zip(other) {
            *border |= jumps(*own, *other);
        }
    }
    for (border, pair) in line.iter_mut().zip(own.windows(2)) {
        *border |= jumps(pair[0], pair[1]);
    }
    for (border, pair) in line[1..].iter_mut().zip(own.windows(2)) {
        *border |= jumps(pair[0], pair[1]);
    }
    if row > 0 && row + 1 < height && width > 2 {
        let [above, below] = [row - 1, row + 1].map(|row| &values[row * width + 1..][..width - 2]);
        let beside = own.windows(3).zip(above.iter().zip(below)).zip(&sigmas[at + 1..]);
        for (border, ((own, (above, below)), sigma)) in line[1..width - 1].iter_mut().zip(beside) {
            let twice = 2.0 * own[1];
            let bend = (own[0] + own[2] - twice).abs().max((above + below - twice).abs());
            let slope = (own[2] - own[0]).abs() + (below - above).abs();
            *border |= if bend > BEND * slope + BEND_SIGMAS * sigma { BENDS } else { 0 };
        }
    }
}

/// Pixels of a row that are worked on at once.
const TILE: usize = 128;

/// Farther from a border than any limb reaches, rows.
const FAR: u8 = u8::MAX;

/// The pixels nearer than a distance.
struct Disc {
    /// Most rows up and down, and columns to either side.
    most: usize,
    /// Most rows up and down by the columns to either side, and the other way round.
    across: [u8; MOST_PX + 1],
}

impl Disc {
    fn new(reach_px: f64) -> Self {
        let (mut across, mut most) = ([0; MOST_PX + 1], 0);
        for (one, others) in across.iter_mut().enumerate() {
            let inside = |other: &usize| ((one * one + other * other) as f64) < reach_px * reach_px;
            if let Some(other) = (0..=MOST_PX).rev().find(inside) {
                (most, *others) = (one, other as u8);
            }
        }
        Self { most, across }
    }

    /// Marks the pixels of a row that are so near to a border of a kind: first the rows from each pixel to the nearest border in its column, then
    /// whether one of the columns beside has a border near enough.
    #[inline(always)]
    fn mark_row(
        &self,
        (width, height): (usize, usize),
        (borders, kind): (&[u8], u8),
        row: usize,
        (mark, line): (u8, &mut [u8]),
    ) {
        for first in (0..width).step_by(TILE) {
            let count = TILE.min(width - first);
            let columns = first.saturating_sub(MOST_PX)..(first + count + MOST_PX).min(width);
            let line = &mut line[first..first + count];
            // Most tiles are dark, or far from a border.
            let own = &borders[row * width + first..][..count];
            if own.iter().fold(kind, |all, border| all & border) != 0 {
                for near in line {
                    *near |= mark;
                }
                continue;
            }
            let mut around = 0;
            for other in row.saturating_sub(self.most)..(row + self.most + 1).min(height) {
                for border in &borders[other * width..][columns.clone()] {
                    around |= border;
                }
            }
            if around & kind == 0 {
                continue;
            }
            let mut rows = [FAR; TILE + 2 * MOST_PX];
            for away in (0..=self.most).rev() {
                for other in [row.checked_sub(away), Some(row + away)].into_iter().flatten() {
                    if other >= height {
                        continue;
                    }
                    let borders = &borders[other * width..][columns.clone()];
                    let rows = &mut rows[columns.start + MOST_PX - first..][..borders.len()];
                    for (rows, border) in rows.iter_mut().zip(borders) {
                        *rows = if *border & kind != 0 { away as u8 } else { *rows };
                    }
                }
            }
            for (beside, most) in self.across.iter().enumerate().take(self.most + 1) {
                for place in [MOST_PX - beside, MOST_PX + beside] {
                    for (near, rows) in line.iter_mut().zip(&rows[place..place + count]) {
                        *near |= if *rows <= *most { mark } else { 0 };
                    }
                }
            }
        }
    }
}

impl Selector<'_> {
    /// Whether a limb in the picture of either camera shifts a point, and its noise does not hide that.
    // Asked of few pixels, from rows that are compiled for each level of instructions.
    #[inline(never)]
    pub(super) fn at_limb(&self, pixel: usize, sample: &Sample, normal: &Vector3<f64>) -> bool {
        let marks = self.samples.limbs[pixel];
        if marks == 0 {
            return false;
        }
        let [x, y] = self.view.directions.at(pixel);
        let noise = self.view.noise_px(sample) * normal.dot(&Vector3::new(x, y, 1.0)).abs();
        if rim_is_hidden(noise, LIMB_ERROR / STEEP_SHARE, self.view.independence.interpolated) {
            return false;
        }
        let eyes = [(OWN, OTHER, Vector3::zeros()), (OTHER, OWN, self.view.other_mm)];
        eyes.into_iter().any(|(mark, second, eye)| {
            let limb = |way| self.limb_px((pixel, sample), normal, way, eye);
            // What both pictures show is a crease of the part; what lies beyond one in the own picture, on which the way inwards is measured, is another face.
            let hidden = marks & mark << BENT != 0 && marks & second << BENT == 0;
            let clear_of = (OWN | second) << BENT;
            let bowl = Way { uphill: false, clear_of, least_radius_px: LEAST_BOWL_PX };
            // A ball just before another surface ends in a jump that is no larger than a step of one surface: there phases bend.
            let before = Way { uphill: true, ..bowl };
            let bends = hidden && self.view.two_pictures;
            (marks & mark != 0 && limb(BALL).is_some_and(|px| px < LIMB_PX))
                || (bends && limb(before).is_some_and(|px| px < LIMB_PX))
                || (hidden && limb(bowl).is_some_and(|px| px < BOWL_PX))
        })
    }

    /// How many pixels of its picture a camera at `eye` sees from here to the limb of a ball or bowl that turns like the surface; `None` where it does
    /// not turn away, or not to be seen.
    fn limb_px(
        &self,
        (pixel, sample): (usize, &Sample),
        here: &Vector3<f64>,
        way: Way,
        eye: Vector3<f64>,
    ) -> Option<f64> {
        let to = self.to_eye(pixel, sample, &eye);
        let unit = to.normalize();
        let cosine = here.dot(&unit);
        if cosine * cosine > FRONTAL_COSINE2 {
            return None;
        }
        let uphill = unit - here * cosine;
        let view = self.view;
        let inner = self.place_along(pixel, &if way.uphill { uphill } else { -uphill })?;
        let other = self.samples.at(inner);
        if other.limbs & way.clear_of != 0 || !self.link.joins(sample, &other, INWARDS_PX as usize) {
            return None;
        }
        let half = self.settings.normal_window_px as usize / 2;
        let turned = normal(view, self.samples, inner, self.link, (half, false))?;
        let far = self.to_eye(inner, &other, &eye);
        let sine = |normal: &Vector3<f64>, to: &Vector3<f64>| {
            let cosine = normal.dot(to) / to.norm();
            (1.0 - cosine * cosine).max(0.0).sqrt()
        };
        let (here, inner) = (sine(here, &to), sine(&turned, &far));
        let seen = |to: &Vector3<f64>| Vector2::new(to.x, to.y) / to.z;
        let between = (seen(&to) - seen(&far)).norm() / view.pitch;
        let radius = between / (here - inner);
        (here > inner && radius > way.least_radius_px).then_some(radius * (1.0 - here))
    }

    /// From a point to the eye, by the depth of the point.
    fn to_eye(&self, pixel: usize, sample: &Sample, eye_mm: &Vector3<f64>) -> Vector3<f64> {
        let [x, y] = self.view.directions.at(pixel);
        eye_mm * sample.inverse_depth - Vector3::new(x, y, 1.0)
    }

    /// The pixel [`INWARDS_PX`] away along a direction on the surface.
    fn place_along(&self, pixel: usize, direction: &Vector3<f64>) -> Option<usize> {
        let view = self.view;
        let [x, y] = view.directions.at(pixel);
        let along = Vector2::new(direction.x - x * direction.z, direction.y - y * direction.z);
        let step = pixels_along(view, pixel, along);
        let step = step * (INWARDS_PX / step.norm());
        let column = (pixel % view.width) as f64 + step.x.round();
        let row = (pixel / view.width) as f64 + step.y.round();
        let inside = column >= 0.0 && row >= 0.0 && column < view.width as f64 && row < view.height as f64;
        inside.then(|| row as usize * view.width + column as usize)
    }
}

#[cfg(test)]
mod tests;
