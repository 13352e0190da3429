//! Rejection of planes that one pixel measured wrongly: wrong fringe order, glint, dust.
//!
//! With n planes and m coefficients the residuals of a least-squares fit share out an outlier, so each plane is compared with the
//! polynomial through the others (deleted residual). Even without outliers these are not zero: noise, and what the polynomial does not
//! follow, which is alike all over the field. So each plane's deleted residuals are measured against their own median and scatter
//! (by the median magnitude about it) over the field, the scatter raised where a pixel's phase is noisier than most. Where one is beyond
//! the limit, the plane without which the others fit best is left out (an outlier bends the polynomial past its neighbours, whose
//! residuals may be larger than its own), and the rest tested again, while at least m + 1 planes would be left: with m + 1 given, their residuals show that one is wrong
//! but not which, and the pixel is left out as a whole.

use super::MOST_DEGREE;
use super::polynomial::{Fit, fit, height};
use fringe::math::statistics::{median, sigma_by_median};

/// Pixels that make the scales of the planes.
const SAMPLES: usize = 32_768;
/// Scatter below this share of the calibrated range is rounding.
const LEAST_SCATTER: f64 = 1e-6;

/// What one pixel saw of one plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaneSample {
    /// Number of the plane.
    pub plane: usize,
    /// Phase less that of the reference, rad.
    pub difference_rad: f64,
    /// Height of the plane, mm.
    pub z_mm: f64,
    /// Noise of the phase, rad.
    pub sigma_rad: f64,
}

/// Deleted residuals of a plane over the field.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    median_mm: f64,
    sigma_mm: f64,
    sigma_rad: f64,
}

/// What became of a pixel.
pub(super) enum Outcome {
    /// Without the planes whose numbers are set in the mask.
    Fitted(Fit, u64),
    /// Fewer planes than coefficients, or no slope.
    Unknown,
    /// One of its planes is wrong, and it is undetermined which.
    Inconsistent,
}

fn points(seen: &[PlaneSample]) -> Vec<(f64, f64)> {
    seen.iter().map(|s| (s.difference_rad, s.z_mm)).collect()
}

/// Height of a plane by the polynomial through the others, less its own, mm.
fn deleted_mm(seen: &[PlaneSample], index: usize, degree: usize) -> Option<f64> {
    let mut others = points(seen);
    let (x, z_mm) = others.remove(index);
    let others: [f64; MOST_DEGREE + 1] = fit(&others, degree)?.coefficients;
    Some(height(&others, x) - z_mm)
}

/// The scale of each plane, from pixels that saw all of them.
pub(super) fn scales(
    planes: usize,
    pixels: usize,
    degree: usize,
    range_mm: f64,
    of_pixel: impl Fn(usize) -> Vec<PlaneSample>,
) -> Vec<Scale> {
    let mut residuals: Vec<Vec<f64>> = vec![Vec::new(); planes];
    let mut noise: Vec<Vec<f64>> = vec![Vec::new(); planes];
    for pixel in (0..pixels).step_by((pixels / SAMPLES).max(1)) {
        let seen = of_pixel(pixel);
        if seen.len() < planes {
            continue;
        }
        for (index, one) in seen.iter().enumerate() {
            residuals[index].extend(deleted_mm(&seen, index, degree));
            noise[index].push(one.sigma_rad);
        }
    }
    let scale = |(residuals, noise): (&mut Vec<f64>, &mut Vec<f64>)| {
        let median_mm = median(residuals).unwrap_or(f64::NAN);
        for residual in residuals.iter_mut() {
            *residual -= median_mm;
        }
        let sigma_mm =
            sigma_by_median(residuals).map_or(f64::NAN, |sigma| sigma.max(LEAST_SCATTER * range_mm));
        Scale { median_mm, sigma_mm, sigma_rad: median(noise).unwrap_or(f64::NAN) }
    };
    residuals.iter_mut().zip(&mut noise).map(scale).collect()
}

/// Fits a pixel without its outlier planes, beyond `limit` standard deviations.
pub(super) fn reject_outliers(
    mut seen: Vec<PlaneSample>,
    degree: usize,
    limit: f64,
    scales: &[Scale],
) -> Outcome {
    let mut rejected = 0_u64;
    loop {
        let Some(whole) = fit(&points(&seen), degree) else { return Outcome::Unknown };
        // Without redundancy or without scales no plane can be tested.
        if seen.len() < degree + 2 || scales.iter().any(|scale| scale.sigma_mm.is_nan()) {
            return Outcome::Fitted(whole, rejected);
        }
        let size = |(index, one): (usize, &PlaneSample)| -> Option<f64> {
            let scale = scales.get(one.plane)?;
            let noisier = (one.sigma_rad / scale.sigma_rad).max(1.0);
            let noisier = if noisier.is_finite() { noisier } else { 1.0 };
            Some((deleted_mm(&seen, index, degree)? - scale.median_mm).abs() / (scale.sigma_mm * noisier))
        };
        let sizes: Vec<f64> = seen.iter().enumerate().map(|part| size(part).unwrap_or(0.0)).collect();
        if sizes.iter().all(|size| *size <= limit) {
            return Outcome::Fitted(whole, rejected);
        }
        if seen.len() == degree + 2 {
            return Outcome::Inconsistent;
        }
        // The scales stay those of all planes: fewer scatter a little more, which the limit allows for.
        let left = |index: usize| {
            let mut rest = points(&seen);
            rest.remove(index);
            fit(&rest, degree).map_or(f64::INFINITY, |fit| fit.squares)
        };
        let squares: Vec<f64> = (0..seen.len()).map(left).collect();
        let out = (0..squares.len()).fold(0, |out, i| if squares[i] < squares[out] { i } else { out });
        rejected |= 1 << seen[out].plane.min(63);
        seen.remove(out);
    }
}
