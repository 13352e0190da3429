//! Agreement of two results (thesis eq. 4.12, ISO/IEC 17043).

use serde::Serialize;

use super::budget::Uncertain;
use super::error::UncertaintyError;

/// A result beside another one of the same measurand (thesis tables 4.5, 4.6, 5.2).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Comparison {
    /// Deviation from the reference value, x − X.
    pub deviation: f64,
    /// Expanded uncertainty of the deviation, √(U_x² + U_X²).
    pub deviation_expanded_uncertainty: f64,
    /// Normalised error E_n = deviation / its expanded uncertainty.
    pub normalised_error: f64,
    /// Whether both results agree, |E_n| ≤ 1.
    pub agrees: bool,
}

/// Compares a result with a reference by [`normalised_error`].
///
/// # Errors
/// As there.
pub fn compare(result: Uncertain, reference: Uncertain) -> Result<Comparison, UncertaintyError> {
    let normalised_error = normalised_error(result, reference)?;
    Ok(Comparison {
        deviation: result.value - reference.value,
        deviation_expanded_uncertainty: both(result, reference),
        normalised_error,
        agrees: normalised_error.abs() <= 1.0,
    })
}

fn both(result: Uncertain, reference: Uncertain) -> f64 {
    fringe::math::hypot(result.expanded_uncertainty, reference.expanded_uncertainty)
}

/// Normalised error E_n = (x − X) / √(U_x² + U_X²) of two independent results with *expanded* uncertainties of the same
/// coverage; |E_n| ≤ 1 is agreement. E_n has no unit (the thesis prints degrees behind some).
///
/// # Errors
/// Numbers that are not finite, a negative uncertainty, or both uncertainties 0.
pub fn normalised_error(result: Uncertain, reference: Uncertain) -> Result<f64, UncertaintyError> {
    let refuse = |key, value, limit| {
        Err(UncertaintyError::Value { place: "normalised error".into(), key, value, limit })
    };
    for (key, value) in [("value", result.value), ("reference value", reference.value)] {
        if !value.is_finite() {
            return refuse(key, value, "a finite number");
        }
    }
    let uncertainties = [
        ("expanded uncertainty", result.expanded_uncertainty),
        ("expanded uncertainty of the reference", reference.expanded_uncertainty),
    ];
    for (key, value) in uncertainties {
        if !(value.is_finite() && value >= 0.0) {
            return refuse(key, value, "zero or a positive number");
        }
    }
    let both = both(result, reference);
    if both <= 0.0 {
        return refuse("expanded uncertainty", both, "above 0 for at least one of the two results");
    }
    Ok((result.value - reference.value) / both)
}
