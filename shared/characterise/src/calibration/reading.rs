//! Where a projector's light meets a point of the target: the phase read at a sub-pixel place.
//!
//! The thesis takes the phase of the nearest pixel (2.3.3), which is its mapping error, and near the edges of a
//! checkerboard a pixel's phase is that of a shifted footprint. Here a quadratic is fitted to the phase of the bright
//! squares about the corner, their rims left out, and read at the corner.
//!
//! A pixel shows the mean of B e^{iφ} over its footprint of variance σ²: its phase is φ + σ² (∇ln B · ∇φ + ½ ∇²φ). On a target at an angle
//! the light B falls in one direction everywhere, so that this does not average out; it is taken off.

use super::observations::{ImagePoint, Link};
use fringe::math::statistics::sigma_by_median;
use fringe::phase::PhaseView;
use nalgebra::{Matrix2, Matrix3, Matrix6, Point2, RowVector2, Vector2, Vector3, Vector6};
use std::f64::consts::TAU;

/// Bright is what has this fraction of the brightest modulation about the point.
const BRIGHT: f32 = 0.6;
/// Fewest bright pixels that carry a quadratic of six parameters.
const LEAST_PIXELS: usize = 24;
/// Residuals beyond so many robust standard deviations leave the fit.
const OUTLIER: f64 = 4.0;

/// No pixel is read better than this, px²: exact phases must not weigh without limit.
const ROUNDING_PX2: f64 = 1e-14;

/// The projector's pixel at a place of a camera's image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProjectorReading {
    /// Pixel of the projector, px.
    pub pixel: Point2<f64>,
    /// How it changes with the place, projector pixels per camera pixel.
    pub slopes: Matrix2<f64>,
    /// Covariance of the reading, px², for a place that is known exactly.
    pub covariance_px2: Matrix2<f64>,
}

impl ProjectorReading {
    /// As an image point of point `index`, for a place where camera `device` found the point with this covariance, px²: light is read
    /// where the point was found, not where it is.
    pub fn image_point(&self, index: usize, device: usize, found_px2: &Matrix2<f64>) -> ImagePoint {
        let Self { pixel, slopes, covariance_px2 } = *self;
        let link = Some(Link { device, slopes, covariance_px2 });
        let covariance_px2 = slopes * found_px2 * slopes.transpose() + covariance_px2;
        // Rounding must not make it look unsymmetrical.
        let covariance_px2 = (covariance_px2 + covariance_px2.transpose()) * 0.5;
        ImagePoint { index, pixel, covariance_px2, link }
    }
}

/// Reads both phase maps of a camera at a place.
///
/// `radius_px` is the reach of the fit in camera pixels, best the distance of neighbouring corners; `blur_px` the standard deviation of
/// what a pixel averages, 0 where it is not known. `None` where too few bright pixels or none on one side of the place are at hand.
pub fn projector_pixel(
    x: &PhaseView,
    y: &PhaseView,
    place: Point2<f64>,
    radius_px: f64,
    blur_px: f64,
) -> Option<ProjectorReading> {
    let u = coordinate(x, place, radius_px, blur_px)?;
    let v = coordinate(y, place, radius_px, blur_px)?;
    Some(ProjectorReading {
        pixel: Point2::new(u.value, v.value),
        slopes: Matrix2::from_rows(&[u.slope, v.slope]),
        covariance_px2: Matrix2::from_diagonal(
            &Vector2::new(u.variance, v.variance).add_scalar(ROUNDING_PX2),
        ),
    })
}

/// One coordinate of the projector, px, at a place.
struct Reading {
    value: f64,
    variance: f64,
    /// Change of the value per camera pixel.
    slope: RowVector2<f64>,
}

fn coordinate(map: &PhaseView, place: Point2<f64>, radius_px: f64, blur_px: f64) -> Option<Reading> {
    let mut pixels = bright_pixels(map, place, radius_px);
    let first = fit(&pixels, radius_px)?;
    let mut residuals: Vec<f64> = pixels.iter().map(|p| first.residual(p)).collect();
    let limit = OUTLIER * sigma_by_median(&mut residuals)?;
    pixels.retain(|p| first.residual(p).abs() <= limit.max(1e-9));
    let last = fit(&pixels, radius_px)?;
    let period = map.info.period_px / TAU;
    let blur = blur_px / radius_px;
    let shift_rad = if blur.is_finite() { blur * blur * last.shift(light_slope(&pixels)) } else { 0.0 };
    Some(Reading {
        value: (last.terms[0] - shift_rad) * period,
        variance: last.variance * period * period,
        slope: RowVector2::new(last.terms[1], last.terms[2]) * (period / radius_px),
    })
}

/// A pixel about the place: offsets over the radius, and its phase.
struct Pixel {
    x: f64,
    y: f64,
    phase_rad: f64,
    modulation: f64,
}

fn bright_pixels(map: &PhaseView, place: Point2<f64>, radius_px: f64) -> Vec<Pixel> {
    let (width, height) = (i64::from(map.info.width_px), i64::from(map.info.height_px));
    let reach = radius_px.ceil().clamp(2.0, 200.0) as i64;
    let (column, row) = (place.x.round() as i64, place.y.round() as i64);
    let index = |c: i64, r: i64| (r * width + c) as usize;
    let inside = |c: i64, r: i64| (1..width - 1).contains(&c) && (1..height - 1).contains(&r);
    let all =
        || (row - reach..=row + reach).flat_map(|r| (column - reach..=column + reach).map(move |c| (c, r)));
    let lit = |c: i64, r: i64| inside(c, r) && map.valid[index(c, r)] == 1;
    let most =
        all().filter(|(c, r)| lit(*c, *r)).map(|(c, r)| map.modulation[index(c, r)]).fold(0.0, f32::max);
    let bright = |c: i64, r: i64| lit(c, r) && map.modulation[index(c, r)] >= BRIGHT * most;
    all()
        .filter(|(c, r)| (-1..=1).all(|dy| (-1..=1).all(|dx| bright(c + dx, r + dy))))
        .map(|(c, r)| Pixel {
            x: (c as f64 - place.x) / radius_px,
            y: (r as f64 - place.y) / radius_px,
            phase_rad: f64::from(map.phase_rad[index(c, r)]),
            modulation: f64::from(map.modulation[index(c, r)]),
        })
        .filter(|p| p.x * p.x + p.y * p.y <= 1.0)
        .collect()
}

/// Value, slopes and curvatures at the place, and the variance of the value.
struct Quadratic {
    terms: Vector6<f64>,
    variance: f64,
}

impl Quadratic {
    /// What a footprint of variance 1 adds to the phase at the place, in light of this relative slope.
    fn shift(&self, light: Vector2<f64>) -> f64 {
        let t = &self.terms;
        light.x * t[1] + light.y * t[2] + t[3] + t[5]
    }

    fn residual(&self, pixel: &Pixel) -> f64 {
        pixel.phase_rad - self.terms.dot(&basis(pixel))
    }
}

/// Relative slope of the light, ∇ln B, from a plane through the modulation; none where the pixels lie on a line.
fn light_slope(pixels: &[Pixel]) -> Vector2<f64> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for pixel in pixels {
        let row = Vector3::new(1.0, pixel.x, pixel.y);
        normal += row * row.transpose();
        right += row * pixel.modulation;
    }
    let plane = normal.try_inverse().map_or(Vector3::zeros(), |inverse| inverse * right);
    let slope = plane.yz() / plane.x;
    if slope.iter().all(|v| v.is_finite()) { slope } else { Vector2::zeros() }
}

fn basis(p: &Pixel) -> Vector6<f64> {
    Vector6::new(1.0, p.x, p.y, p.x * p.x, p.x * p.y, p.y * p.y)
}

fn fit(pixels: &[Pixel], radius_px: f64) -> Option<Quadratic> {
    if pixels.len() < LEAST_PIXELS || !radius_px.is_finite() {
        return None;
    }
    let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
    // About the mean phase: the sums keep their digits.
    let mean = pixels.iter().map(|p| p.phase_rad).sum::<f64>() / pixels.len() as f64;
    for pixel in pixels {
        let row = basis(pixel);
        normal += row * row.transpose();
        right += row * (pixel.phase_rad - mean);
    }
    let inverse = normal.try_inverse()?;
    let mut terms = inverse * right;
    terms[0] += mean;
    let mut fit = Quadratic { terms, variance: 0.0 };
    let sum: f64 = pixels.iter().map(|p| fit.residual(p).powi(2)).sum();
    fit.variance = inverse[(0, 0)] * sum / (pixels.len() - 6) as f64;
    // A value that hangs far outside of its pixels is an extrapolation, not a reading.
    (inverse[(0, 0)] < 1.0 && fit.variance.is_finite()).then_some(fit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::math::{atan2, exp, sincos};
    use fringe::pattern::Axis;
    use fringe::phase::{PhaseInfo, PhaseMap};

    /// A curved phase on a checkerboard whose dark squares are noisy nonsense.
    fn board(axis: Axis) -> PhaseMap {
        let info = PhaseInfo { width_px: 80, height_px: 60, axis, period_px: 16.0 };
        let mut map = PhaseMap::new(info);
        for index in 0..info.len() {
            let (x, y) = ((index % 80) as f64, (index / 80) as f64);
            let white = (x < 40.25) == (y < 30.75);
            map.valid[index] = 1;
            map.sigma_rad[index] = 0.01;
            map.modulation[index] = if white { 80.0 } else { 9.0 };
            let nonsense = if white { 0.0 } else { 0.4 };
            map.phase_rad[index] = (truth(x, y) + nonsense) as f32;
        }
        map
    }

    fn truth(x: f64, y: f64) -> f64 {
        30.0 + 0.21 * x - 0.05 * y + 4e-4 * x * x - 3e-4 * x * y
    }

    #[test]
    fn the_phase_at_a_corner_is_that_of_the_white_squares() {
        let place = Point2::new(40.25, 30.75);
        let (x, y) = (board(Axis::X), board(Axis::Y));
        let read = projector_pixel(&x.view(), &y.view(), place, 16.0, 0.0).unwrap();
        let (expected, pixel) = (truth(place.x, place.y) * 16.0 / TAU, read.pixel);
        assert!((pixel.x - expected).abs() < 1e-4 && (pixel.y - expected).abs() < 1e-4, "{pixel} {expected}");
        assert!(read.covariance_px2[(0, 0)] < 1e-6);
        // A corner that is off by 0.1 px is lit by what lies 0.1 px away: 0.21 and 0.05 rad/px and the curvature there.
        let carried = read.image_point(0, 0, &(Matrix2::identity() * 0.01)).covariance_px2;
        let step =
            |d: Vector2<f64>| (truth(place.x + d.x, place.y + d.y) - truth(place.x, place.y)) * 16.0 / TAU;
        let slope = Vector2::new(step(Vector2::x() * 1e-4), step(Vector2::y() * 1e-4)) * 1e4;
        assert!((read.slopes.row(0).transpose() - slope).norm() < 1e-2 * slope.norm());
        assert!((carried[(0, 1)] / (0.01 * slope.norm_squared()) - 1.0).abs() < 1e-2, "{carried} {slope}");
    }

    /// The board in light that falls along y, each pixel the mean of B e^{iφ} over a Gaussian footprint, summed on a grid.
    fn blurred_board(axis: Axis, blur_px: f64) -> PhaseMap {
        let mut map = board(axis);
        for index in 0..map.info.len() {
            let (x, y) = ((index % 80) as f64, (index / 80) as f64);
            let (mut sum, mut across) = (0.0, 0.0);
            let start = truth(x, y);
            for place in 0..625 {
                let [dx, dy] = [place % 25, place / 25].map(|i| (f64::from(i) - 12.0) / 3.0 * blur_px);
                let weight = exp(-0.5 * (dx * dx + dy * dy) / (blur_px * blur_px));
                let (sin, cos) = sincos(truth(x + dx, y + dy) - start);
                let light = weight * exp(-0.01 * (y + dy));
                (sum, across) = (sum + light * cos, across + light * sin);
            }
            map.phase_rad[index] += atan2(across, sum) as f32;
            map.modulation[index] *= exp(-0.01 * y) as f32;
        }
        map
    }

    /// Proves: light that falls in one direction and curvature shift what a pixel shows, and the reading tells the light at the place.
    #[test]
    fn what_the_footprint_adds_is_taken_off() {
        let (place, blur_px) = (Point2::new(40.25, 30.75), 0.6);
        let (x, y) = (blurred_board(Axis::X, blur_px), blurred_board(Axis::Y, blur_px));
        let expected = truth(place.x, place.y) * 16.0 / TAU;
        let off = |blur_px| {
            let read = projector_pixel(&x.view(), &y.view(), place, 16.0, blur_px).unwrap();
            (read.pixel.x - expected).abs().max((read.pixel.y - expected).abs())
        };
        // σ² (∂ ln B/∂y ∂φ/∂y + ½ ∇²φ) = 0.36 (0.01 · 0.048 + 4e-4) rad at the place.
        let shift_px = 0.36 * (0.01 * (0.05 + 3e-4 * 40.25) + 4e-4) * 16.0 / TAU;
        assert!((off(0.0) / shift_px - 1.0).abs() < 0.05, "{} {shift_px}", off(0.0));
        assert!(off(blur_px) < 0.05 * shift_px, "{} {shift_px}", off(blur_px));
        assert!(off(f64::NAN) == off(0.0));
    }

    #[test]
    fn too_little_light_gives_no_pixel() {
        let (mut x, y) = (board(Axis::X), board(Axis::Y));
        x.valid.fill(0);
        assert!(projector_pixel(&x.view(), &y.view(), Point2::new(40.0, 30.0), 16.0, 0.6).is_none());
        assert!(projector_pixel(&y.view(), &y.view(), Point2::new(-500.0, 1e9), 16.0, 0.6).is_none());
        assert!(projector_pixel(&y.view(), &y.view(), Point2::new(40.0, 30.0), f64::NAN, 0.6).is_none());
    }
}
