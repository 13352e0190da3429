//! Contrast over the position: best focus and depth of focus.

use super::FocusError;
use super::carrier::{Carrier, find, usual_region};
use crate::least_squares::minimise;
use crate::response::Roi;
use fringe::frame::FrameView;
use fringe::math::{exp, ln};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

/// Fewest different positions: three parameters and one degree of freedom.
const LEAST_POSITIONS: usize = 4;

/// A component below this fraction of the mean is no projected checkerboard.
const LEAST_CONTRAST: f64 = 0.005;

/// The largest of some 10⁵ components of white noise exceeds their median 4.5 times; a pattern must do clearly more.
const LEAST_RATIO: f64 = 8.0;

/// Rounds of the adjustment; some ten are enough.
const MOST_ROUNDS: usize = 100;

/// Contrast at one position.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FocusPoint {
    /// Position of the image, mm.
    pub position_mm: f64,
    /// Component of the image at the spatial frequency of the checkerboard.
    #[serde(flatten)]
    pub carrier: Carrier,
    /// Contrast over the largest of all images.
    pub normalised: f64,
}

/// `contrast = peak · exp(−(z − best)² / 2 width²)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FocusFit {
    /// Contrast at best focus.
    pub peak_contrast: f64,
    /// Place of the maximum, mm.
    pub best_focus_mm: f64,
    /// Its standard uncertainty from the residuals, mm.
    pub u_best_focus_mm: f64,
    /// Standard deviation of the curve, mm.
    pub width_mm: f64,
    /// Its standard uncertainty, mm.
    pub u_width_mm: f64,
    /// Root mean square of the residuals, contrast.
    pub residual_rms: f64,
}

impl FocusFit {
    /// Contrast at a position.
    pub fn contrast(&self, position_mm: f64) -> f64 {
        let z = (position_mm - self.best_focus_mm) / self.width_mm;
        self.peak_contrast * exp(-0.5 * z * z)
    }
}

/// Result of the focus evaluation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Focus {
    /// Evaluated region of the images.
    pub roi: Roi,
    /// Contrast of each image, in rising position.
    pub curve: Vec<FocusPoint>,
    /// Position of the image with the largest contrast, mm.
    pub sharpest_mm: f64,
    /// Fraction of the maximum that bounds the depth of focus.
    pub fraction: f64,
    /// Maximum of the fitted curve, mm; absent when it does not lie between the first and the last position.
    pub best_focus_mm: Option<f64>,
    /// Its standard uncertainty, mm.
    pub u_best_focus_mm: Option<f64>,
    /// Where the fitted curve falls to the fraction; each absent when it lies outside of the positions.
    pub near_mm: Option<f64>,
    /// As [`Self::near_mm`], at the far side.
    pub far_mm: Option<f64>,
    /// far − near, absent when one of them is.
    pub depth_of_focus_mm: Option<f64>,
    /// The same from the points alone, straight lines between them, relative to the largest.
    pub depth_by_points_mm: Option<f64>,
    /// Length of the range around the sharpest image in which all images stay above the fraction.
    pub depth_at_least_mm: f64,
    /// The fitted curve, if there is one.
    pub fit: Option<FocusFit>,
}

/// Evaluates images at positions in mm; `fraction` bounds the depth of focus.
///
/// # Errors
/// Too few positions, a region that does not fit, no pattern in any image, saturation, a fraction beyond 0 … 1.
pub fn evaluate(
    pictures: &[(f64, FrameView<'_>)],
    roi: Option<Roi>,
    fraction: f64,
) -> Result<Focus, FocusError> {
    if !(fraction > 0.0 && fraction < 1.0) {
        return Err(FocusError::Fraction(fraction));
    }
    let mut sorted: Vec<&(f64, FrameView<'_>)> = pictures.iter().collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let different = sorted.windows(2).filter(|pair| pair[0].0 != pair[1].0).count() + 1;
    let (Some((_, first)), true) = (sorted.first(), different >= LEAST_POSITIONS) else {
        let found = if sorted.is_empty() { 0 } else { different };
        return Err(FocusError::TooFewPositions { found, needed: LEAST_POSITIONS });
    };
    let roi = roi.unwrap_or_else(|| usual_region(first.width_px, first.height_px));
    let known = reference(&sorted, &roi)?;
    let found = sorted
        .iter()
        .map(|(_, frame)| find(frame, &roi, Some(&known)))
        .collect::<Result<Vec<Carrier>, _>>()?;
    let top = found.iter().fold(0.0, |m: f64, c| m.max(c.contrast));
    let curve: Vec<FocusPoint> = sorted
        .iter()
        .zip(found)
        .map(|((position_mm, _), carrier)| FocusPoint {
            position_mm: *position_mm,
            carrier,
            normalised: carrier.contrast / top,
        })
        .collect();
    Ok(summarise(roi, curve, fraction))
}

/// The carrier of the image that shows it best.
fn reference(pictures: &[&(f64, FrameView<'_>)], roi: &Roi) -> Result<Carrier, FocusError> {
    let mut best: Option<Carrier> = None;
    for (_, frame) in pictures {
        let found = find(frame, roi, None)?;
        if best.is_none_or(|b| found.contrast > b.contrast) {
            best = Some(found);
        }
    }
    let clear = |c: &Carrier| c.contrast >= LEAST_CONTRAST && c.peak_to_median >= LEAST_RATIO;
    best.filter(clear).ok_or_else(|| FocusError::NoPattern {
        roi: roi.to_string(),
        contrast: best.map_or(0.0, |b| b.contrast),
        ratio: best.map_or(0.0, |b| b.peak_to_median),
        least_contrast: LEAST_CONTRAST,
        least_ratio: LEAST_RATIO,
    })
}

fn summarise(roi: Roi, curve: Vec<FocusPoint>, fraction: f64) -> Focus {
    let points: Vec<(f64, f64)> = curve.iter().map(|p| (p.position_mm, p.carrier.contrast)).collect();
    let top = (0..points.len()).max_by(|a, b| points[*a].1.total_cmp(&points[*b].1)).unwrap_or(0);
    let (first, last) = (points[0].0, points[points.len() - 1].0);
    let within = |z: &f64| (first..=last).contains(z);
    let fit = fit(&points, top);
    let inside = fit.filter(|f| f.best_focus_mm > first && f.best_focus_mm < last);
    let half = inside.map(|f| f.width_mm * (-2.0 * ln(fraction)).sqrt());
    let near_mm = inside.zip(half).map(|(f, half)| f.best_focus_mm - half).filter(within);
    let far_mm = inside.zip(half).map(|(f, half)| f.best_focus_mm + half).filter(within);
    let limit = fraction * points[top].1;
    let low = crossing(points[..=top].iter().rev(), limit);
    let high = crossing(points[top..].iter(), limit);
    Focus {
        roi,
        sharpest_mm: points[top].0,
        fraction,
        best_focus_mm: inside.map(|f| f.best_focus_mm),
        u_best_focus_mm: inside.map(|f| f.u_best_focus_mm),
        near_mm,
        far_mm,
        depth_of_focus_mm: near_mm.zip(far_mm).map(|(near, far)| far - near),
        depth_by_points_mm: low.1.zip(high.1).map(|(near, far)| far - near),
        depth_at_least_mm: high.0 - low.0,
        fit,
        curve,
    }
}

/// Walks from the top outwards: the last position above the limit, and where the line to the next one meets the limit.
fn crossing<'a>(mut points: impl Iterator<Item = &'a (f64, f64)>, limit: f64) -> (f64, Option<f64>) {
    let mut before = points.next().copied().unwrap_or_default();
    for point in points {
        if point.1 < limit {
            let part = (before.1 - limit) / (before.1 - point.1);
            return (before.0, Some(before.0 + part * (point.0 - before.0)));
        }
        before = *point;
    }
    (before.0, None)
}

/// Least squares of peak, place and width; the start and the end of the search scale with the points.
fn fit(points: &[(f64, f64)], top: usize) -> Option<FocusFit> {
    let span = points[points.len() - 1].0 - points[0].0;
    let model = |p: &Vector3<f64>, z: f64| {
        let u = (z - p[1]) / p[2];
        let bell = exp(-0.5 * u * u);
        (p[0] * bell, Vector3::new(bell, p[0] * bell * u / p[2], p[0] * bell * u * u / p[2]))
    };
    let squares = |p: &Vector3<f64>| {
        // A width of many spans is a flat curve: nothing to be found there.
        let allowed = p[0] > 0.0 && p[2] > 0.0 && p[2] < 1e3 * span;
        allowed.then(|| points.iter().map(|(z, c)| (c - model(p, *z).0).powi(2)).sum::<f64>())
    };
    let linearise = |p: &Vector3<f64>| {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (z, c) in points {
            let (value, row) = model(p, *z);
            normal += row * row.transpose();
            right += row * (c - value);
        }
        (normal, right)
    };
    let start = Vector3::new(points[top].1, points[top].0, 0.25 * span);
    let settled = |step: &Vector3<f64>| step[1].abs() + step[2].abs() < 1e-9 * span;
    let found = minimise(start, MOST_ROUNDS, squares, linearise, settled)?;
    let covariance = found.inverse * (found.sum / (points.len() - 3) as f64);
    let u = |i: usize| covariance[(i, i)].max(0.0).sqrt();
    Some(FocusFit {
        peak_contrast: found.parameters[0],
        best_focus_mm: found.parameters[1],
        u_best_focus_mm: u(1),
        width_mm: found.parameters[2],
        u_width_mm: u(2),
        residual_rms: (found.sum / points.len() as f64).sqrt(),
    })
}
