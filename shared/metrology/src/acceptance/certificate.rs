//! What a certificate states at the temperature of the test, and how uncertain the test value is by it.

use super::plan::{Artefact, Conditions};
use super::result::ArtefactRecord;
use super::rules::{Kind, Statistic};

/// A calibrated length at the temperature of the test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Length {
    /// Length at the temperature of the test, mm.
    pub value_mm: f64,
    /// Standard uncertainty of the length, mm.
    pub u_mm: f64,
}

/// L (1 + α ΔT) with u² = u²(cal) + (L ΔT u(α))² + (L α u(T))², the terms of ISO/TS 23165 that do not depend on fixing.
pub(super) fn at_test(length_mm: f64, u_mm: f64, artefact: &Artefact, conditions: &Conditions) -> Length {
    let warmer = conditions.temperature_c - artefact.calibrated_at_c;
    let (alpha, u_alpha) = (artefact.expansion_per_k, artefact.u_expansion_per_k);
    let by_alpha = length_mm * warmer * u_alpha;
    let by_temperature = length_mm * alpha * conditions.u_temperature_k;
    let u_mm = (u_mm * u_mm + by_alpha * by_alpha + by_temperature * by_temperature).sqrt();
    Length { value_mm: length_mm * (1.0 + alpha * warmer), u_mm }
}

/// Calibrated diameter of a sphere.
pub(super) fn diameter(index: usize, artefact: &Artefact, conditions: &Conditions) -> Length {
    let nominal = artefact.diameters_mm.get(index).copied().unwrap_or(f64::NAN);
    at_test(nominal, artefact.u_diameter_mm.unwrap_or(f64::NAN), artefact, conditions)
}

/// Calibrated distance of a ball bar's first sphere from another.
pub(super) fn spacing(index: usize, artefact: &Artefact, conditions: &Conditions) -> Length {
    let nominal = artefact.spacings_mm.get(index).copied().unwrap_or(f64::NAN);
    at_test(nominal, artefact.u_spacing_mm.unwrap_or(f64::NAN), artefact, conditions)
}

/// Standard uncertainty of a test value, mm: artefact, temperature and form, never the instrument.
///
/// Form: √((F/2)² + u²(F)) with the certified form deviation F (ISO/TS 23165). Sizes and spacings: the calibrated length
/// at the temperature of the test; the form deviation displaces a partly seen sphere by at most F/2, a rectangular
/// distribution, once for a size and for each of the two centres of a spacing.
pub(super) fn u_test_value_mm(
    statistic: Statistic,
    length: usize,
    artefact: &Artefact,
    conditions: &Conditions,
) -> f64 {
    let half = 0.5 * artefact.form_mm;
    let seen_partly = half * half / 3.0;
    let u_length = |length: Length, times: f64| (length.u_mm * length.u_mm + times * seen_partly).sqrt();
    match statistic {
        Statistic::FormRange | Statistic::FormSigma | Statistic::FormD95 | Statistic::Form25 => {
            (half * half + artefact.u_form_mm * artefact.u_form_mm).sqrt()
        }
        Statistic::Size | Statistic::Size25 => u_length(diameter(length, artefact, conditions), 1.0),
        Statistic::Spacing | Statistic::SpacingAndSize => {
            u_length(spacing(length, artefact, conditions), 2.0)
        }
        // Both diameters come from one laboratory: their mean is as uncertain as each.
        Statistic::LengthBidirectional => {
            let between = u_length(spacing(length, artefact, conditions), 2.0);
            let of_size = u_length(diameter(length + 1, artefact, conditions), 1.0);
            (between * between + of_size * of_size).sqrt()
        }
    }
}

/// The artefact as a report shows it.
pub(super) fn record(artefact: &Artefact) -> ArtefactRecord {
    let mut values: Vec<(String, f64, Option<f64>)> = Vec::new();
    for (index, diameter) in artefact.diameters_mm.iter().enumerate() {
        values.push((format!("diameter {}", index + 1), *diameter, artefact.u_diameter_mm));
    }
    for (index, spacing) in artefact.spacings_mm.iter().enumerate() {
        values.push((format!("spacing 1–{}", index + 2), *spacing, artefact.u_spacing_mm));
    }
    if artefact.kind == Kind::Plane {
        let sides = artefact.size_mm.iter().flatten();
        values.extend(sides.zip(["length", "width"]).map(|(side, name)| (name.to_owned(), *side, None)));
    }
    values.push(("form deviation".to_owned(), artefact.form_mm, Some(artefact.u_form_mm)));
    let Artefact { id, kind, certificate, .. } = artefact;
    let mut validity = Vec::new();
    validity.extend(artefact.certificate_date.as_ref().map(|day| format!("from {day}")));
    validity.extend(artefact.certificate_valid_until.as_ref().map(|day| format!("until {day}")));
    validity.extend(artefact.zero_reason.as_ref().map(|why| format!("uncertainty 0: {why}")));
    let validity = validity.join(", ");
    ArtefactRecord {
        id: id.clone(),
        kind: kind.name().to_owned(),
        certificate: certificate.clone(),
        validity,
        values,
    }
}
