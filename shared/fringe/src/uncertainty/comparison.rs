//! Agreement of two results (thesis eq. 4.12, ISO/IEC 17043).

use super::error::UncertaintyError;

/// Normalised error E_n = (x − X) / √(U_x² + U_X²) of two independent results with *expanded* uncertainties of the same
/// coverage; |E_n| ≤ 1 is agreement. E_n has no unit (the thesis prints degrees behind some).
///
/// # Errors
/// Numbers that are not finite, a negative uncertainty, or both uncertainties 0.
pub fn normalised_error(
    value: f64,
    expanded_uncertainty: f64,
    reference: f64,
    reference_expanded_uncertainty: f64,
) -> Result<f64, UncertaintyError> {
    let refuse = |key, value, limit| {
        Err(UncertaintyError::Value { place: "normalised error".into(), key, value, limit })
    };
    for (key, value) in [("value", value), ("reference value", reference)] {
        if !value.is_finite() {
            return refuse(key, value, "a finite number");
        }
    }
    let uncertainties = [
        ("expanded uncertainty", expanded_uncertainty),
        ("expanded uncertainty of the reference", reference_expanded_uncertainty),
    ];
    for (key, value) in uncertainties {
        if !(value.is_finite() && value >= 0.0) {
            return refuse(key, value, "zero or a positive number");
        }
    }
    let both = crate::math::hypot(expanded_uncertainty, reference_expanded_uncertainty);
    if both <= 0.0 {
        return refuse("expanded uncertainty", both, "above 0 for at least one of the two results");
    }
    Ok((value - reference) / both)
}
