//! What a feature reads: a value with what the scatter of its points says of it, before anything is decided.

use super::filter::Filtered;
use super::flatness::{OfUsed, effect_of};
use super::result::FlatnessFilter;
use crate::fit::{Derived, Form, PlaneFit};

/// A measured value with the uncertainty that the scatter of its points shows.
pub(super) struct Reading {
    pub value: f64,
    pub u_noise: f64,
    pub form_sigma_mm: Option<f64>,
    pub form_range_mm: Option<f64>,
    pub filter: Option<FlatnessFilter>,
    pub points: usize,
    pub rejected: usize,
    /// What widens the upper limit.
    pub bonus_mm: Option<f64>,
    /// Definition of the value, where the name does not say it.
    pub detail: Option<String>,
}

impl Reading {
    /// Of what was computed from elements.
    pub fn derived(derived: Derived, forms: &[&Form]) -> Self {
        Self::new(derived.value, derived.u, forms)
    }

    /// Whether every number that is reported is one.
    pub fn is_finite(&self) -> bool {
        let filter = self.filter.as_ref().map_or([0.0; 2], |f| [f.u_cell_mm, f.noise_range_mm]);
        let form = [self.form_sigma_mm, self.form_range_mm].map(Option::unwrap_or_default);
        [self.value, self.u_noise].iter().chain(&filter).chain(&form).all(|v| v.is_finite())
    }

    /// A range with what errors in common do to it, mm.
    pub fn with_shared(self, u_shared_mm: f64) -> Self {
        let u_noise = (self.u_noise * self.u_noise + u_shared_mm * u_shared_mm).sqrt();
        Self { u_noise, ..self }
    }

    /// A value with its uncertainty, of elements with these forms.
    pub fn new(value: f64, u_noise: f64, forms: &[&Form]) -> Self {
        Self {
            value,
            u_noise,
            form_sigma_mm: None,
            form_range_mm: None,
            filter: None,
            points: forms.iter().map(|f| f.points).sum(),
            rejected: forms.iter().map(|f| f.rejected).sum(),
            bonus_mm: None,
            detail: None,
        }
    }
}

/// Range of the residuals kept, with its sigma beside it under its own name.
pub(super) fn flatness(fit: &PlaneFit) -> Reading {
    let form = &fit.form;
    let u = OfUsed::new(&fit.residuals, effect_of(fit)).range_mm;
    unfiltered(form, Reading::new(form.form_range_mm, u, &[form]))
}

/// Range of the cell means; see [`super::filter::filtered`].
pub(super) fn filtered_flatness(fit: &PlaneFit, found: &Filtered) -> Reading {
    let reading = Reading::new(found.range_mm, found.u_mm, &[&fit.form]);
    unfiltered(&fit.form, Reading { filter: Some(found.report.clone()), ..reading })
}

/// A flatness with what its single points show beside it.
fn unfiltered(form: &Form, reading: Reading) -> Reading {
    Reading { form_sigma_mm: Some(form.form_sigma_mm), form_range_mm: Some(form.form_range_mm), ..reading }
}
