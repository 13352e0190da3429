//! The reference-plane method: height from the phase difference to a plane (thesis section 2.1.4, eq. 2.17–2.19).
//!
//! Δφ = φ_object − φ_reference in each pixel (eq. 2.17), and Z ≈ K₀ Δφ (eq. 2.19), where K₀ = L / (2π f d) differs from
//! pixel to pixel, and Z is not quite proportional (eq. 2.18). Both are measured rather than derived: planes at known
//! heights give each pixel its own polynomial Z = k₀ + k₁ Δφ + k₂ Δφ² + …, by least squares. k₁ is the K₀ of eq. 2.19. Neither camera
//! nor projector needs to be characterised; lateral coordinates, tilt and the height of the planes are taken from
//! elsewhere. A plane that a pixel saw wrongly is left out of that pixel's polynomial where enough others are left. A pixel that fewer planes show than there are coefficients has no height, and heights are given within the
//! calibrated range and a margin only: a polynomial is not valid beyond its planes.

mod error;
mod polynomial;
mod reject;
#[cfg(test)]
mod tests;

pub use error::PlaneError;

use fringe::phase::{PhaseInfo, PhaseView};
use polynomial::{Fit, height, slope};
use rayon::prelude::*;
use reject::{Outcome, PlaneSample, reject_outliers, scales};
use serde::Serialize;

/// Highest degree: beyond a cubic there is nothing left to fit but noise.
pub const MOST_DEGREE: usize = 3;

/// Largest number of planes.
pub const MOST_PLANES: usize = 64;

/// Heights beyond the calibrated planes are given within this share of the range between them.
const MARGIN: f64 = 0.1;

/// A calibration for one camera and projector that do not move.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneCalibration {
    /// Size, axis and period of the phase.
    pub info: PhaseInfo,
    /// Lowest and highest plane, mm.
    pub range_mm: [f64; 2],
    /// Phase of the reference plane, rad; NaN where there is no calibration.
    pub reference_rad: Vec<f32>,
    /// k₀, k₁, … each as a raster, mm per rad to the power of its number; NaN where there is no calibration.
    pub coefficients: Vec<Vec<f32>>,
}

/// How well the planes fit.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct PlaneReport {
    /// Number of planes used.
    pub planes: usize,
    /// Degree of the polynomials.
    pub degree: usize,
    /// Pixels with a calibration.
    pub calibrated: usize,
    /// Of each plane, in the order given: pixels whose polynomial was fitted without it.
    pub rejected: Vec<usize>,
    /// Pixels without a calibration because their planes contradict each other and none could be spared.
    pub inconsistent: usize,
    /// Root mean square residual of the heights over all pixels and planes, mm, for the degrees of freedom of the fits; absent
    /// with as many coefficients as planes.
    pub rms_mm: Option<f64>,
    /// Median, lowest and highest tenth of K₀ = dZ/dφ at the reference plane, mm per rad.
    pub k0_mm_per_rad: Option<[f64; 3]>,
}

/// Heights over the reference plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Heights {
    /// Columns of the camera, px.
    pub width_px: u32,
    /// Rows of the camera, px.
    pub height_px: u32,
    /// Height, mm; NaN where not known.
    pub height_mm: Vec<f32>,
    /// Standard uncertainty from the phase noise alone, mm.
    pub sigma_mm: Vec<f32>,
    /// Pixels with phase and calibration, but a height beyond the calibrated range.
    pub beyond: usize,
}

/// Calibrates with planes at known heights (mm, phase); the first one is the reference. In each pixel planes beyond `reject_sigmas`
/// robust standard deviations are left out (infinite: none).
///
/// # Errors
/// Too few or too many planes for the degree, heights that repeat or are not finite, maps of unequal size, axis or period, a limit
/// that is not above 0.
pub fn calibrate(
    planes: &[(f64, PhaseView<'_>)],
    degree: usize,
    reject_sigmas: f64,
) -> Result<(PlaneCalibration, PlaneReport), PlaneError> {
    check(planes, degree, reject_sigmas)?;
    let info = planes[0].1.info;
    let [low, high] = range(planes);
    let seen = |pixel| of_pixel(planes, pixel);
    let spare = planes.len() > degree + 1 && reject_sigmas.is_finite();
    let scales = if spare { scales(planes.len(), info.len(), degree, high - low, seen) } else { Vec::new() };
    let limit = if spare { reject_sigmas } else { f64::INFINITY };
    let outcomes: Vec<Outcome> =
        (0..info.len()).into_par_iter().map(|i| reject_outliers(seen(i), degree, limit, &scales)).collect();
    let inconsistent = outcomes.iter().filter(|j| matches!(j, Outcome::Inconsistent)).count();
    let mut rejected = vec![0; planes.len()];
    let fits: Vec<Option<Fit>> = outcomes
        .into_iter()
        .map(|outcome| match outcome {
            Outcome::Fitted(fit, without) => {
                rejected.iter_mut().enumerate().for_each(|(i, n)| *n += ((without >> i) & 1) as usize);
                Some(fit)
            }
            Outcome::Unknown | Outcome::Inconsistent => None,
        })
        .collect();
    let plane = |value: &dyn Fn(&Fit) -> f64| -> Vec<f32> {
        fits.iter().map(|fit| fit.as_ref().map_or(f32::NAN, |fit| value(fit) as f32)).collect()
    };
    let calibration = PlaneCalibration {
        info,
        range_mm: range(planes),
        reference_rad: fits
            .iter()
            .enumerate()
            .map(|(i, fit)| if fit.is_some() { planes[0].1.phase_rad[i] } else { f32::NAN })
            .collect(),
        coefficients: (0..=degree).map(|k| plane(&|fit| fit.coefficients[k])).collect(),
    };
    let known = || fits.iter().flatten();
    let freedom: usize = known().map(|fit| fit.freedom).sum();
    let squares: f64 = known().map(|fit| fit.squares).sum();
    let report = PlaneReport {
        planes: planes.len(),
        degree,
        calibrated: known().count(),
        rejected,
        inconsistent,
        rms_mm: (freedom > 0).then(|| (squares / freedom as f64).sqrt()),
        k0_mm_per_rad: tenths(known().map(|fit| fit.coefficients[1]).collect()),
    };
    Ok((calibration, report))
}

impl PlaneCalibration {
    /// Heights of an object.
    ///
    /// # Errors
    /// A phase of another size, axis or period.
    pub fn measure(&self, object: &PhaseView<'_>) -> Result<Heights, PlaneError> {
        same(&self.info, &object.info, 0)?;
        let n = self.info.len();
        let margin_mm = MARGIN * (self.range_mm[1] - self.range_mm[0]);
        let (low, high) = (self.range_mm[0] - margin_mm, self.range_mm[1] + margin_mm);
        let of_pixel = |i: usize| -> (f32, f32, bool) {
            let difference_rad = f64::from(object.phase_rad[i]) - f64::from(self.reference_rad[i]);
            if object.valid[i] != 1 || !difference_rad.is_finite() {
                return (f32::NAN, f32::NAN, false);
            }
            let mut coefficients = [0.0; MOST_DEGREE + 1];
            for (value, raster) in coefficients.iter_mut().zip(&self.coefficients) {
                *value = f64::from(raster[i]);
            }
            let z_mm = height(&coefficients, difference_rad);
            if !(low..=high).contains(&z_mm) {
                return (f32::NAN, f32::NAN, true);
            }
            let sigma_mm = slope(&coefficients, difference_rad).abs() * f64::from(object.sigma_rad[i]);
            (z_mm as f32, sigma_mm as f32, false)
        };
        let pixels: Vec<(f32, f32, bool)> = (0..n).into_par_iter().map(of_pixel).collect();
        Ok(Heights {
            width_px: self.info.width_px,
            height_px: self.info.height_px,
            height_mm: pixels.iter().map(|p| p.0).collect(),
            sigma_mm: pixels.iter().map(|p| p.1).collect(),
            beyond: pixels.iter().filter(|p| p.2).count(),
        })
    }
}

/// What a pixel saw of the planes; nothing without the reference.
fn of_pixel(planes: &[(f64, PhaseView<'_>)], pixel: usize) -> Vec<PlaneSample> {
    let phase = |map: &PhaseView<'_>| {
        (map.valid[pixel] == 1 && map.phase_rad[pixel].is_finite()).then(|| f64::from(map.phase_rad[pixel]))
    };
    let Some(reference_rad) = phase(&planes[0].1) else { return Vec::new() };
    let of_plane = |(plane, (z_mm, map)): (usize, &(f64, PhaseView<'_>))| {
        let difference_rad = phase(map)? - reference_rad;
        Some(PlaneSample { plane, difference_rad, z_mm: *z_mm, sigma_rad: f64::from(map.sigma_rad[pixel]) })
    };
    planes.iter().enumerate().filter_map(of_plane).collect()
}

fn range(planes: &[(f64, PhaseView<'_>)]) -> [f64; 2] {
    let heights = || planes.iter().map(|(z_mm, _)| *z_mm);
    [heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max)]
}

fn tenths(mut values: Vec<f64>) -> Option<[f64; 3]> {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get((share * (values.len().max(1) - 1) as f64) as usize).copied();
    Some([at(0.5)?, at(0.1)?, at(0.9)?])
}

fn check(planes: &[(f64, PhaseView<'_>)], degree: usize, reject_sigmas: f64) -> Result<(), PlaneError> {
    if reject_sigmas.is_nan() || reject_sigmas <= 0.0 {
        return Err(PlaneError::Reject { sigmas: reject_sigmas });
    }
    if planes.len() > MOST_PLANES {
        return Err(PlaneError::Many { planes: planes.len() });
    }
    if !(1..=MOST_DEGREE).contains(&degree) {
        return Err(PlaneError::Degree { degree });
    }
    if planes.len() < degree + 1 {
        return Err(PlaneError::Few { planes: planes.len(), needed: degree + 1 });
    }
    for (i, (z_mm, map)) in planes.iter().enumerate() {
        if !z_mm.is_finite() || planes[..i].iter().any(|(other, _)| other == z_mm) {
            return Err(PlaneError::Height { number: i + 1, z_mm: *z_mm });
        }
        same(&planes[0].1.info, &map.info, i)?;
        let planes_of = [map.phase_rad.len(), map.sigma_rad.len(), map.valid.len()];
        if planes_of.iter().any(|n| *n != map.info.len()) {
            return Err(PlaneError::Size { number: i + 1 });
        }
    }
    Ok(())
}

fn same(a: &PhaseInfo, b: &PhaseInfo, number: usize) -> Result<(), PlaneError> {
    if (a.width_px, a.height_px) != (b.width_px, b.height_px) {
        return Err(PlaneError::Size { number: number + 1 });
    }
    if a.axis != b.axis || a.period_px != b.period_px {
        return Err(PlaneError::Pattern {
            number: number + 1,
            period_px: b.period_px,
            expected_px: a.period_px,
        });
    }
    Ok(())
}
