//! The reference-plane method: height from the phase difference to a plane (thesis section 2.1.4, eq. 2.17–2.19).
//!
//! Δφ = φ_object − φ_reference in each pixel (eq. 2.17), and Z ≈ K₀ Δφ (eq. 2.19), where K₀ = L / (2π f d) differs from
//! pixel to pixel, and Z is not quite proportional (eq. 2.18). Both are measured rather than derived: planes at known
//! heights give each pixel its own polynomial Z = k₀ + k₁ Δφ + k₂ Δφ² + …, by least squares. k₁ is the K₀ of eq. 2.19. Neither camera
//! nor projector needs to be characterised; lateral coordinates, tilt and the height of the planes are taken from
//! elsewhere. A pixel that fewer planes show than there are coefficients has no height, and heights are given within the
//! calibrated range and a margin only: a polynomial tells nothing beyond its planes.

mod error;
mod polynomial;
#[cfg(test)]
mod tests;

pub use error::PlaneError;

use crate::phase::{PhaseInfo, PhaseView};
use polynomial::{Fit, fit, height, slope};
use rayon::prelude::*;
use serde::Serialize;

/// Highest degree: beyond a cubic there is nothing left to fit but noise.
pub const MOST_DEGREE: usize = 3;

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
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct PlaneReport {
    /// Planes.
    pub planes: usize,
    /// Degree of the polynomials.
    pub degree: usize,
    /// Pixels with a calibration.
    pub calibrated: usize,
    /// Root mean square residual of the heights over all pixels and planes, mm, for the degrees of freedom of the fits; absent
    /// with as many coefficients as planes.
    pub rms_mm: Option<f64>,
    /// Median, lowest and highest tenth of K₀ = dZ/dφ at the reference plane, mm per rad.
    pub k0_mm_per_rad: Option<[f64; 3]>,
}

/// Heights over the reference plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Heights {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Height, mm; NaN where not known.
    pub height_mm: Vec<f32>,
    /// Standard uncertainty from the phase noise alone, mm.
    pub sigma_mm: Vec<f32>,
    /// Pixels with phase and calibration, but a height beyond the calibrated range.
    pub beyond: usize,
}

/// Calibrates with planes at known heights (mm, phase); the first one is the reference.
///
/// # Errors
/// Too few planes for the degree, heights that repeat or are not finite, maps of unequal size, axis or period.
pub fn calibrate(
    planes: &[(f64, PhaseView<'_>)],
    degree: usize,
) -> Result<(PlaneCalibration, PlaneReport), PlaneError> {
    check(planes, degree)?;
    let info = planes[0].1.info;
    let fits: Vec<Option<Fit>> =
        (0..info.len()).into_par_iter().map(|i| of_pixel(planes, i, degree)).collect();
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

fn of_pixel(planes: &[(f64, PhaseView<'_>)], pixel: usize, degree: usize) -> Option<Fit> {
    let phase = |map: &PhaseView<'_>| {
        (map.valid[pixel] == 1 && map.phase_rad[pixel].is_finite()).then(|| f64::from(map.phase_rad[pixel]))
    };
    let reference_rad = phase(&planes[0].1)?;
    let points: Vec<(f64, f64)> =
        planes.iter().filter_map(|(z_mm, map)| Some((phase(map)? - reference_rad, *z_mm))).collect();
    fit(&points, degree)
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

fn check(planes: &[(f64, PhaseView<'_>)], degree: usize) -> Result<(), PlaneError> {
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
