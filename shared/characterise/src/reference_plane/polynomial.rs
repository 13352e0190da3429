//! Polynomials of one pixel.

use super::MOST_DEGREE;
use nalgebra::{Matrix4, Vector4};

/// Phase differences of all planes within this of each other, rad, determine no slope.
const LEAST_SPREAD_RAD: f64 = 1e-4;

/// A polynomial through the planes of one pixel.
#[derive(Debug, Clone, Copy)]
pub struct Fit {
    /// k₀, k₁, …; zero beyond the degree.
    pub coefficients: [f64; MOST_DEGREE + 1],
    /// Sum of squared residuals, mm².
    pub squares: f64,
    /// Degrees of freedom: planes less coefficients.
    pub freedom: usize,
}

/// Z of a phase difference.
pub fn height(k: &[f64; MOST_DEGREE + 1], difference_rad: f64) -> f64 {
    k.iter().rev().fold(0.0, |sum, k| sum * difference_rad + k)
}

/// dZ/dφ at a phase difference.
pub fn slope(k: &[f64; MOST_DEGREE + 1], difference_rad: f64) -> f64 {
    (1..k.len()).rev().fold(0.0, |sum, i| sum * difference_rad + i as f64 * k[i])
}

/// Least squares of Z over (Δφ, Z); `None` with fewer points than coefficients, or phases that determine no slope.
pub fn fit(points: &[(f64, f64)], degree: usize) -> Option<Fit> {
    let scale = points.iter().map(|(x, _)| x.abs()).fold(0.0, f64::max);
    if points.len() < degree + 1 || scale < LEAST_SPREAD_RAD {
        return None;
    }
    let powers = |x: f64| {
        let u = x / scale;
        let mut row = Vector4::new(1.0, u, u * u, u * u * u);
        row.iter_mut().skip(degree + 1).for_each(|value| *value = 0.0);
        row
    };
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for (x, z) in points {
        let row = powers(*x);
        normal += row * row.transpose();
        right += row * *z;
    }
    for unused in degree + 1..=MOST_DEGREE {
        normal[(unused, unused)] = 1.0;
    }
    let decomposed = normal.cholesky()?;
    let pivots = decomposed.l_dirty().diagonal();
    if pivots.min() < 1e-6 * pivots.max() {
        return None;
    }
    let scaled = decomposed.solve(&right);
    let squares = points.iter().map(|(x, z)| (powers(*x).dot(&scaled) - z).powi(2)).sum();
    let mut coefficients = [0.0; MOST_DEGREE + 1];
    let mut power = 1.0;
    for (k, scaled) in coefficients.iter_mut().zip(scaled.iter()) {
        *k = scaled / power;
        power *= scale;
    }
    Some(Fit { coefficients, squares, freedom: points.len() - degree - 1 })
}
