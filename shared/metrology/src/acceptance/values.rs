//! The values that one group of elements gives for a characteristic.

use super::certificate::{diameter, spacing, u_test_value_mm};
use super::elements::Group;
use super::fitted::Fitted;
use super::patches::{middle_direction, representative};
use super::plan::{Artefact, PositionPlan, TestPlan};
use super::result::PositionValue;
use super::rules::{CharacteristicRule, Statistic};
use super::summary::Value;
use super::{AcceptanceError, at};
use crate::fit::{FitSettings, SphereFit, centre_distance_mm, sphere};
use nalgebra::Point3;

/// Values of one group.
pub(super) struct Job<'a> {
    pub(super) plan: &'a TestPlan,
    pub(super) position: &'a PositionPlan,
    pub(super) artefact: &'a Artefact,
    pub(super) group: &'a Group,
    pub(super) place: &'a str,
}

impl Job<'_> {
    pub(super) fn values(
        &self,
        one: &CharacteristicRule,
        fitted: &Fitted,
    ) -> Result<Vec<Value>, AcceptanceError> {
        let form = |pick: &dyn Fn(&crate::fit::Form) -> f64| {
            fitted.form(0).map(|form| self.value(one.statistic, 0, pick(form), &[form])).into_iter().collect()
        };
        Ok(match (one.statistic, fitted) {
            (Statistic::FormRange, _) => form(&|f| f.form_range_mm),
            (Statistic::FormSigma, _) => form(&|f| f.form_sigma_mm),
            (Statistic::FormD95, _) => form(&|f| f.form_d95_mm),
            (Statistic::Size, Fitted::Spheres(fits)) => fits
                .iter()
                .take(1)
                .map(|fit| self.value(one.statistic, 0, self.size(fit), &[&fit.form]))
                .collect(),
            (Statistic::Form25 | Statistic::Size25, Fitted::Spheres(fits)) => {
                self.of_25(one.statistic, fits)?.into_iter().collect()
            }
            (
                Statistic::Spacing | Statistic::SpacingAndSize | Statistic::LengthBidirectional,
                Fitted::Spheres(fits),
            ) => self.spacings(one.statistic, fits),
            (_, Fitted::Plane(_)) => Vec::new(),
        })
    }

    fn size(&self, fit: &SphereFit) -> f64 {
        fit.diameter_mm - diameter(0, self.artefact, &self.plan.conditions).value_mm
    }

    fn spacings(&self, statistic: Statistic, fits: &[SphereFit]) -> Vec<Value> {
        let Some((first, others)) = fits.split_first() else { return Vec::new() };
        let size = |index: usize| diameter(index, self.artefact, &self.plan.conditions).value_mm;
        others
            .iter()
            .enumerate()
            .map(|(index, other)| {
                let mut calibrated = spacing(index, self.artefact, &self.plan.conditions).value_mm;
                let mut found = centre_distance_mm(first, other).value;
                if statistic == Statistic::LengthBidirectional {
                    calibrated += 0.5 * (size(0) + size(index + 1));
                    found += 0.5 * (first.diameter_mm + other.diameter_mm);
                }
                let error = found - calibrated;
                let mut value = self.value(statistic, index, error, &[&first.form, &other.form]);
                value.shown.length_mm = Some(calibrated);
                if others.len() > 1 {
                    value.shown.position = format!("{} 1–{}", value.shown.position, index + 2);
                }
                value
            })
            .collect()
    }

    fn of_25(&self, statistic: Statistic, fits: &[SphereFit]) -> Result<Option<Value>, AcceptanceError> {
        let (Some(fit), Some(points)) = (fits.first(), self.group.elements.first()) else { return Ok(None) };
        let used: Vec<Point3<f64>> =
            points.iter().zip(&fit.residuals.used).filter(|(_, used)| **used).map(|(p, _)| *p).collect();
        let first: Vec<Point3<f64>> = points
            .iter()
            .zip(&fit.residuals.used)
            .take(self.group.first_view)
            .filter(|(_, used)| **used)
            .map(|(p, _)| *p)
            .collect();
        let pole = middle_direction(fit, &first);
        let chosen = representative(fit, &used, &pole).map_err(|missing| AcceptanceError::NotFound {
            place: self.place.to_owned(),
            message: format!(
                "{missing} of the 25 directions of the sphere show no points: measure it from more sides"
            ),
        })?;
        let small = sphere(&chosen, &FitSettings::default()).map_err(|source| at(self.place, source))?;
        let value = if statistic == Statistic::Form25 { small.form.form_range_mm } else { self.size(&small) };
        Ok(Some(self.value(statistic, 0, value, &[&fit.form])))
    }

    fn value(&self, statistic: Statistic, length: usize, value: f64, forms: &[&crate::fit::Form]) -> Value {
        Value {
            shown: PositionValue {
                position: self.position.name.clone(),
                repeat: self.position.repeat,
                value,
                length_mm: None,
                limit: None,
                test_value_u: None,
                verdict: None,
                replaced: false,
                points: forms.iter().map(|form| form.points).sum(),
                rejected: forms.iter().map(|form| form.rejected).sum(),
                excluded: self.group.excluded,
                views: self.group.views.clone(),
            },
            retest: self.position.retest,
            u_mm: u_test_value_mm(statistic, length, self.artefact, &self.plan.conditions),
        }
    }
}
