//! The law of propagation of uncertainty (GUM 5.1, 5.2; thesis eq. 4.9–4.11).

use super::budget::{Budget, Evaluation, Quantity, Row};
use super::correlation::{Group, groups, variance};
use super::distribution::Distribution;
use super::dof::effective_dof;
use super::error::UncertaintyError;
use super::student::{coverage_factor, coverage_probability};

/// Fewest degrees of freedom: below, t has no use and its quantiles leave the range of numbers.
const LEAST_DOF: f64 = 0.1;

impl Budget {
    /// Combines and expands.
    ///
    /// Correlated quantities enter ν_eff as one contribution with the ν that they share: exact for quantities read at the
    /// same time (R. Willink, Metrologia 44, 340, 2007), and with the smallest of different ν, which a note reports.
    ///
    /// # Errors
    /// See [`UncertaintyError`].
    pub fn evaluate(&self) -> Result<Evaluation, UncertaintyError> {
        let groups = self.check()?;
        let estimates: Vec<f64> = self.quantities.iter().map(|q| q.estimate).collect();
        let estimate = self.model.value(&estimates, &mut Vec::new());
        if !estimate.is_finite() {
            return Err(UncertaintyError::ModelValue { value: estimate });
        }
        let sensitivities = self.sensitivities(&estimates)?;
        let signed: Vec<f64> =
            self.quantities.iter().zip(&sensitivities).map(|(q, c)| c * q.standard_uncertainty()).collect();
        let scale = signed.iter().fold(0.0_f64, |largest, c| largest.max(c.abs()));
        let mut notes = self.blind(&sensitivities);
        let (combined, dof) = self.combine(&signed, scale, &groups, &mut notes);
        if !combined.is_finite() {
            return Err(UncertaintyError::ModelValue { value: combined });
        }
        let k = self.factor(dof, &mut notes);
        let squares: f64 = signed.iter().map(|c| share(*c, combined)).sum();
        let covered = if combined > 0.0 { coverage_probability(k, dof) } else { 1.0 };
        let rows = self.quantities.iter().zip(&sensitivities);
        Ok(Evaluation {
            estimate,
            rows: rows.map(|(q, c)| row(q, *c, combined)).collect(),
            correlation_share: if groups.is_empty() || combined <= 0.0 { 0.0 } else { 1.0 - squares },
            combined_standard_uncertainty: combined,
            effective_dof: dof,
            coverage_factor: k,
            coverage_probability: self.coverage_probability,
            covered_probability: covered,
            expanded_uncertainty: k * combined,
            notes,
        })
    }

    /// Everything but the model's value; the groups of correlated quantities come with it.
    pub(super) fn check(&self) -> Result<Vec<Group>, UncertaintyError> {
        if self.quantities.is_empty() {
            return Err(UncertaintyError::Empty);
        }
        if self.model.arity() != self.quantities.len() {
            let (expected, found) = (self.model.arity(), self.quantities.len());
            return Err(UncertaintyError::Arity { expected, found });
        }
        self.quantities.iter().try_for_each(check_quantity)?;
        let p = self.coverage_probability;
        within("coverage", "probability", p, (0.5..=0.9999).contains(&p), "0.5 … 0.9999")?;
        if let Some(k) = self.coverage_factor {
            within("coverage", "factor", k, k > 0.0 && k <= 100.0, "above 0, up to 100")?;
        }
        groups(self)
    }

    fn sensitivities(&self, estimates: &[f64]) -> Result<Vec<f64>, UncertaintyError> {
        let sensitivities = self.model.sensitivities(estimates);
        let bad = sensitivities.iter().zip(&self.quantities).find(|(c, _)| !c.is_finite());
        match bad {
            Some((c, q)) => Err(UncertaintyError::Derivative { quantity: q.name.clone(), value: *c }),
            None => Ok(sensitivities),
        }
    }

    /// Where the law of propagation sees nothing: a sensitivity of 0 beside an uncertainty that is not.
    fn blind(&self, sensitivities: &[f64]) -> Vec<String> {
        let unseen = |(q, c): &(&Quantity, &f64)| **c == 0.0 && q.value > 0.0;
        let rows = self.quantities.iter().zip(sensitivities).filter(unseen);
        rows.map(|(q, _)| {
            format!(
                "the sensitivity of {} is 0 at the estimates: its uncertainty does not enter the budget; the Monte Carlo \
                 method shows whether it matters",
                q.name
            )
        })
        .collect()
    }

    /// u_c and ν_eff; contributions are divided by `scale`, so that squares neither vanish nor overflow.
    fn combine(&self, signed: &[f64], scale: f64, groups: &[Group], notes: &mut Vec<String>) -> (f64, f64) {
        if scale <= 0.0 || !scale.is_finite() {
            return (scale, f64::INFINITY);
        }
        let scaled: Vec<f64> = signed.iter().map(|c| c / scale).collect();
        let grouped = |i: &usize| groups.iter().any(|g| g.members.contains(i));
        let mut parts: Vec<(f64, f64)> = (0..scaled.len())
            .filter(|i| !grouped(i))
            .map(|i| (scaled[i].abs(), self.quantities[i].dof))
            .collect();
        for group in groups {
            let dofs = || group.members.iter().map(|i| self.quantities[*i].dof);
            let least = dofs().fold(f64::INFINITY, f64::min);
            if dofs().any(|dof| dof != least) {
                let names: Vec<&str> =
                    group.members.iter().map(|i| self.quantities[*i].name.as_str()).collect();
                notes.push(format!(
                    "{} are correlated and have different degrees of freedom: the smallest, {least}, is used for all",
                    names.join(", ")
                ));
            }
            parts.push((variance(group, &scaled).sqrt(), least));
        }
        let combined = parts.iter().map(|(u, _)| u * u).sum::<f64>().sqrt();
        (combined * scale, effective_dof(combined, &parts))
    }

    /// k for ν_eff, or the fixed one with a note where it covers less than requested.
    fn factor(&self, dof: f64, notes: &mut Vec<String>) -> f64 {
        let used = if self.truncate_dof && dof.is_finite() { dof.floor().max(1.0) } else { dof };
        let needed = coverage_factor(self.coverage_probability, used);
        let Some(k) = self.coverage_factor else { return needed };
        // Half a percent is within the rounding of "k = 2 for 95 %".
        if needed > k * 1.005 {
            notes.push(format!(
                "k = {k} is fixed by the budget; at ν_eff = {dof:.1} it covers {:.1} %, {:.2} % need k = {needed:.2}",
                100.0 * coverage_probability(k, dof),
                100.0 * self.coverage_probability
            ));
        }
        k
    }
}

fn check_quantity(quantity: &Quantity) -> Result<(), UncertaintyError> {
    let place = quantity.name.as_str();
    let (x, value, dof) = (quantity.estimate, quantity.value, quantity.dof);
    within(place, "estimate", x, x.is_finite(), "a finite number")?;
    within(
        place,
        "uncertainty or half-width",
        value,
        value.is_finite() && value >= 0.0,
        "zero or a positive number",
    )?;
    within(place, "degrees of freedom", dof, dof >= LEAST_DOF, "at least 0.1, or infinite")?;
    match quantity.distribution {
        Distribution::Normal { coverage_factor: k } => {
            within(place, "coverage factor", k, k.is_finite() && k > 0.0, "above 0")
        }
        Distribution::Trapezoidal { top_ratio: r } => {
            within(place, "top over base", r, (0.0..=1.0).contains(&r), "0 … 1")
        }
        Distribution::CurvilinearTrapezoidal { limit_ratio: r } => {
            within(place, "uncertainty of the limits over half-width", r, (0.0..=1.0).contains(&r), "0 … 1")
        }
        Distribution::Rectangular | Distribution::Triangular | Distribution::UShaped => Ok(()),
    }
}

fn within(
    place: &str,
    key: &'static str,
    value: f64,
    allowed: bool,
    limit: &'static str,
) -> Result<(), UncertaintyError> {
    if allowed {
        return Ok(());
    }
    Err(UncertaintyError::Value { place: place.to_owned(), key, value, limit })
}

/// Share of a contribution in the variance.
fn share(contribution: f64, combined: f64) -> f64 {
    if combined <= 0.0 {
        return 0.0;
    }
    (contribution / combined) * (contribution / combined)
}

fn row(quantity: &Quantity, sensitivity: f64, combined: f64) -> Row {
    let standard_uncertainty = quantity.standard_uncertainty();
    let contribution = (sensitivity * standard_uncertainty).abs();
    Row {
        name: quantity.name.clone(),
        source: quantity.source.clone(),
        unit: quantity.unit.clone(),
        estimate: quantity.estimate,
        method: quantity.method,
        distribution: quantity.distribution,
        value: quantity.value,
        divisor: quantity.distribution.divisor(),
        standard_uncertainty,
        sensitivity,
        contribution,
        share: share(contribution, combined),
        dof: quantity.dof,
    }
}
