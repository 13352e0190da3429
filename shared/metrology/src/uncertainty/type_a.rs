//! Type A evaluation: statistics of repeated readings (GUM 4.2, thesis eq. 4.1).

use super::error::UncertaintyError;

/// Statistics of n readings of one quantity (Type A evaluation).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TypeA {
    /// Arithmetic mean of the observations.
    pub mean: f64,
    /// Sample standard deviation s, divisor n − 1.
    pub standard_deviation: f64,
    /// Standard uncertainty of the mean, s/√n (eq. 4.1).
    pub standard_uncertainty: f64,
    /// ν = n − 1.
    pub dof: f64,
}

impl TypeA {
    /// Evaluates readings in any unit. Two passes, so that a large mean costs no digits of the deviations.
    ///
    /// # Errors
    /// Fewer than two readings, or one that is not finite.
    pub fn of(readings: &[f64]) -> Result<Self, UncertaintyError> {
        let n = readings.len();
        if n < 2 {
            return Err(UncertaintyError::Readings { place: "readings".into(), found: n, least: 2 });
        }
        if let Some(bad) = readings.iter().find(|r| !r.is_finite()) {
            return Err(not_finite(*bad));
        }
        let mean = mean(readings);
        let squares: f64 = readings.iter().map(|r| (r - mean) * (r - mean)).sum();
        let dof = (n - 1) as f64;
        let standard_deviation = (squares / dof).sqrt();
        // Readings near the largest number overflow in a sum or a square.
        if !standard_deviation.is_finite() {
            return Err(not_finite(standard_deviation));
        }
        let standard_uncertainty = standard_deviation / (n as f64).sqrt();
        Ok(Self { mean, standard_deviation, standard_uncertainty, dof })
    }
}

fn mean(readings: &[f64]) -> f64 {
    readings.iter().sum::<f64>() / readings.len() as f64
}

fn not_finite(value: f64) -> UncertaintyError {
    UncertaintyError::Value {
        place: "readings".into(),
        key: "reading",
        value,
        limit: "finite numbers, also their squares",
    }
}

/// Correlation coefficient of the means of two quantities read at the same time (GUM 5.2.3, eq. 17 and H.9).
///
/// # Errors
/// Series of different length, fewer than two pairs, no scatter in one of them, numbers that are not finite.
pub fn observed_correlation(first: &[f64], second: &[f64]) -> Result<f64, UncertaintyError> {
    let (a, b) = (TypeA::of(first)?, TypeA::of(second)?);
    if first.len() != second.len() {
        let found = first.len().min(second.len());
        let least = first.len().max(second.len());
        return Err(UncertaintyError::Readings { place: "simultaneous readings".into(), found, least });
    }
    let scale = a.standard_deviation * b.standard_deviation;
    if scale <= 0.0 {
        let limit = "above 0: readings that do not scatter have no correlation";
        return Err(UncertaintyError::Value {
            place: "readings".into(),
            key: "scatter",
            value: scale,
            limit,
        });
    }
    let products: f64 = first.iter().zip(second).map(|(x, y)| (x - a.mean) * (y - b.mean)).sum();
    // Rounding may lead past 1 where one series is a multiple of the other.
    Ok((products / (a.dof * scale)).clamp(-1.0, 1.0))
}
