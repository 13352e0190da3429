//! The finest detail of a cloud: over what length the height goes from 10 to 90 % across a straight edge.
//!
//! A view sees an edge through its footprint (point spread and pixel area), E(x) = ½ (1 + erf(x / √2 b)). Of a pair of cameras the other view
//! is read from a quadratic over four of its pixels, which widens the edge, and each view has half of the step. The smoothing of points fits
//! a quadratic over a window; across an edge its weights are those of one line of pixels, of Savitzky and Golay: three pixels
//! change nothing, five and seven widen. A step well above the noise is seen by the window's residuals, the window shrinks, and the
//! edge stays as sharp as the views are; a step that hides in the noise of single points is smoothed in full.
//!
//! Fringe period and number of steps are not part of it. This is so of edges along the epipolar lines, the base of the views; of one across them one view
//! sees the wall, and the other does not, which [`super::step_edge`] adds for a step of 1 mm.

use super::step_edge::Crossing;
use crate::geometry::camera::Camera;
use crate::math::erf;
use nalgebra::Point3;
use serde::Serialize;
use std::f64::consts::SQRT_2;

/// Pixels around a place between two pixels that the quadratic of the match is fitted to.
const MATCHED_PX: [f64; 4] = [-1.5, -0.5, 0.5, 1.5];
/// Places between two pixels over which the match is averaged.
const PLACES: u32 = 20;
/// Narrower footprints than this make no difference, px.
const LEAST_PX: f64 = 1e-3;
/// Height of the step whose edge across the base is stated, mm.
const STEP_HEIGHT_MM: f64 = 1.0;
/// First step of the search for the crossing, px.
const SEARCH_PX: f64 = 1.0 / 64.0;
/// Bisections of that step: below a millionth of a pixel.
const BISECTIONS: u32 = 16;

/// What a cloud resolves on a surface that faces the views, in the middle of what they see.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Resolution {
    /// Length of a pixel of the first view on the surface, mm.
    pub pixel_mm: f64,
    /// Width from 10 to 90 % of a step far above the noise whose edge runs along the base of the views, mm.
    pub step_mm: f64,
    /// The same of a step of 1 mm whose edge crosses the base, mm; `None` where it is not known from where the light comes.
    pub step_across_mm: Option<f64>,
    /// The same, along the base, of a step that hides in the noise of single points and is smoothed over the whole window, mm.
    pub hidden_step_mm: f64,
}

/// How an edge is seen.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Footprint of a pixel, blur and area together, standard deviation in pixels.
    pub footprint_px: f64,
    /// Whether the second view is a camera, whose phase is read between its pixels.
    pub matched: bool,
    /// Side of the smoothing window, px.
    pub smoothing_px: u32,
}

impl Seen {
    /// Widths from 10 to 90 % as lengths at a place that a camera sees. `crossing`: how views and light lie there, where that is known.
    pub fn resolution(&self, camera: &Camera, crossing: Option<Crossing>, at: &Point3<f64>) -> Resolution {
        let pixel_mm = (camera.centre_mm() - at).norm() / camera.focal_px[0];
        let alone = Self { smoothing_px: 1, ..*self };
        let across_px = crossing.and_then(|crossing| crossing.width_px(self, STEP_HEIGHT_MM / pixel_mm));
        Resolution {
            pixel_mm,
            step_mm: pixel_mm * alone.width_px(),
            step_across_mm: across_px.map(|px| pixel_mm * px),
            hidden_step_mm: pixel_mm * self.width_px(),
        }
    }

    /// Width of the response from 10 to 90 %, px; it is symmetric about the edge.
    pub fn width_px(&self) -> f64 {
        let mut outer = SEARCH_PX;
        // The response reaches 1 within some footprints and half a window.
        while self.response(outer) < 0.9 && outer < 1e3 {
            outer += SEARCH_PX;
        }
        let mut inner = outer - SEARCH_PX;
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (inner + outer);
            if self.response(middle) < 0.9 {
                inner = middle;
            } else {
                outer = middle;
            }
        }
        inner + outer
    }

    /// Share of the step at a distance from the edge, px: 0 on the one side, 1 on the other.
    fn response(&self, x_px: f64) -> f64 {
        let half = i32::try_from(self.smoothing_px / 2).unwrap_or(0);
        let weights = (-half..=half).map(|k| weight(half, k) * self.unsmoothed(x_px - f64::from(k)));
        weights.sum()
    }

    fn unsmoothed(&self, x_px: f64) -> f64 {
        if self.matched { 0.5 * (self.edge(x_px) + self.read(x_px)) } else { self.edge(x_px) }
    }

    /// The edge through the footprint.
    fn edge(&self, x_px: f64) -> f64 {
        0.5 * (1.0 + erf(x_px / (SQRT_2 * self.footprint_px.max(LEAST_PX))))
    }

    /// The edge as the match reads it.
    fn read(&self, x_px: f64) -> f64 {
        read_between(|x_px| self.edge(x_px), x_px)
    }
}

/// A value at a place, read from a quadratic over four pixels; mean over the places between two of them.
pub(super) fn read_between(value: impl Fn(f64) -> f64, x_px: f64) -> f64 {
    let mut sum = 0.0;
    for place in 0..PLACES {
        let at = (f64::from(place) + 0.5) / f64::from(PLACES) - 0.5;
        for pixel in MATCHED_PX {
            // Orthogonal polynomials 1, s and s² − 5/4 over the four pixels, their squares summing to 4, 5 and 4.
            let weight = 0.25 + at * pixel / 5.0 + (at * at - 1.25) * (pixel * pixel - 1.25) / 4.0;
            sum += weight * value(x_px + pixel - at);
        }
    }
    sum / f64::from(PLACES)
}

/// Weight of the pixel k of a line in the quadratic over 2 half + 1 of them, read at its middle.
fn weight(half: i32, k: i32) -> f64 {
    if half == 0 {
        return 1.0;
    }
    let side = f64::from(2 * half + 1);
    let mean_square = f64::from(half * (half + 1)) / 3.0;
    let off = |j: i32| f64::from(j * j) - mean_square;
    let squares: f64 = (-half..=half).map(|j| off(j) * off(j)).sum();
    1.0 / side - mean_square * off(k) / squares
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix6, Vector6};

    const PAIR: Seen = Seen { footprint_px: 0.577, matched: true, smoothing_px: 1 };

    #[test]
    fn a_footprint_alone_has_the_width_of_a_normal_distribution() {
        for footprint_px in [0.3, 0.577, 2.0] {
            let width = Seen { footprint_px, matched: false, ..PAIR }.width_px();
            assert!((width / (2.0 * 1.281_551_565_545 * footprint_px) - 1.0).abs() < 1e-5, "{width}");
        }
    }

    #[test]
    fn a_match_and_wide_windows_widen_and_three_pixels_do_not() {
        let width = |smoothing_px| Seen { smoothing_px, ..PAIR }.width_px();
        assert!((width(1) - 1.668).abs() < 0.005, "{}", width(1));
        assert!((width(3) - width(1)).abs() < 1e-6);
        assert!((width(5) - 2.120).abs() < 0.005, "{}", width(5));
        assert!((width(7) - 2.800).abs() < 0.005, "{}", width(7));
        assert!(Seen { matched: false, ..PAIR }.width_px() < width(1));
        // No footprint at all is no fault.
        let sharp = Seen { footprint_px: 0.0, matched: false, ..PAIR }.width_px();
        assert!(sharp.is_finite() && sharp < 0.1, "{sharp}");
    }

    /// The quadratic in the plane over an edge, by its normal equations.
    #[test]
    fn the_weights_of_a_line_are_those_of_the_window() {
        for half in [1_i32, 2, 3] {
            let window = Seen { smoothing_px: 2 * half as u32 + 1, ..PAIR };
            for x_px in [-1.7, -0.4, 0.0, 0.3, 2.2] {
                let (mut normal, mut moments) = (Matrix6::zeros(), Vector6::zeros());
                for v in -half..=half {
                    for u in -half..=half {
                        let (u, v) = (f64::from(u), f64::from(v));
                        let terms = Vector6::new(1.0, u, v, u * u, u * v, v * v);
                        normal += terms * terms.transpose();
                        moments += terms * window.unsmoothed(x_px + u);
                    }
                }
                let fit = normal.lu().solve(&moments).unwrap();
                assert!((fit[0] - window.response(x_px)).abs() < 1e-9, "{half} {x_px}");
            }
        }
    }

    /// The reading of the match by a fit over four drawn samples.
    #[test]
    fn the_reading_between_pixels_is_the_least_squares_quadratic() {
        let x_px = 0.37;
        let mut sum = 0.0;
        for place in 0..PLACES {
            let at = (f64::from(place) + 0.5) / f64::from(PLACES) - 0.5;
            let (mut normal, mut moments) = (nalgebra::Matrix3::zeros(), nalgebra::Vector3::zeros());
            for pixel in MATCHED_PX {
                let terms = nalgebra::Vector3::new(1.0, pixel, pixel * pixel);
                normal += terms * terms.transpose();
                moments += terms * PAIR.edge(x_px + pixel - at);
            }
            let fit = normal.lu().solve(&moments).unwrap();
            sum += fit[0] + at * fit[1] + at * at * fit[2];
        }
        assert!((sum / f64::from(PLACES) - PAIR.read(x_px)).abs() < 1e-9);
    }
}
