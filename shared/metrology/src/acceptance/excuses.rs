//! Certificates that could take an error of the instrument upon themselves: read at another temperature, or shared out among
//! several artefacts of nearly one length.

use super::certificate::{diameter, spacing};
use super::plan::{Artefact, TestPlan};
use super::result::Violation;
use super::rules::{RuleSet, Statistic};

/// Calibrated lengths that differ by less than this part of themselves are one length.
const ONE_LENGTH: f64 = 0.01;

/// What of these a plan does; no standard that was at hand states it.
pub(super) fn violations(plan: &TestPlan, rules: &RuleSet) -> Vec<Violation> {
    let used = |a: &&Artefact| plan.positions.iter().any(|p| p.artefact == a.id);
    let artefacts: Vec<&Artefact> = plan.artefacts.iter().filter(used).collect();
    let mut list: Vec<Violation> = artefacts.iter().filter_map(|a| warmth(plan, rules, a)).collect();
    list.extend(artefacts.iter().enumerate().filter_map(|(i, a)| alike(&artefacts[..i], a)));
    list
}

/// A correction for temperature that is larger than the limit decides more than the instrument does.
fn warmth(plan: &TestPlan, rules: &RuleSet, artefact: &Artefact) -> Option<Violation> {
    let conditions = &plan.conditions;
    let deciding = rules.characteristics.iter().filter(|c| c.decides && c.artefact == artefact.kind);
    let corrections = deciding.flat_map(|one| {
        let limit = plan.limits.get(&one.symbol);
        let calibrated = match one.statistic {
            Statistic::Size | Statistic::Size25 => &artefact.diameters_mm,
            _ if one.statistic.of_length() => &artefact.spacings_mm,
            _ => return Vec::new(),
        };
        let of = |(index, length): (usize, &f64)| {
            let limit_mm = limit?.at(Some(*length))?;
            let at_test =
                if one.statistic.of_length() { spacing } else { diameter }(index, artefact, conditions);
            Some(((at_test.value_mm - length).abs(), limit_mm, one.symbol.clone()))
        };
        calibrated.iter().enumerate().filter_map(of).collect()
    });
    let (actual, required, symbol) = corrections.max_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1)))?;
    let rule = "correction for temperature within the limit".to_owned();
    let text = format!(
        "{rule}: the lengths of {} are corrected by up to {actual:.4} mm from {} °C to {} °C, at most {required:.4} mm, the limit \
         of {symbol}: measure nearer to the temperature of the certificate",
        artefact.id, artefact.calibrated_at_c, conditions.temperature_c
    );
    (actual > required).then_some(Violation { rule, required, actual, unit: "mm".into(), text })
}

/// Two bars of nearly one length: the error of each position could go to the certificate that hides it.
fn alike(before: &[&Artefact], artefact: &Artefact) -> Option<Violation> {
    let longest = |a: &Artefact| a.spacings_mm.iter().copied().fold(0.0, f64::max);
    let mine = longest(artefact);
    let near = |other: &&&Artefact| {
        other.kind == artefact.kind && mine > 0.0 && (longest(other) - mine).abs() < ONE_LENGTH * mine
    };
    let other = before.iter().find(near)?;
    let rule = "one bar for one length".to_owned();
    let text = format!(
        "{rule}: {} and {} have nearly one length, {} mm and {mine} mm, so that an error of the instrument could be shared out \
         among their certificates: measure all positions with one of them",
        other.id,
        artefact.id,
        longest(other)
    );
    Some(Violation { rule, required: 1.0, actual: 2.0, unit: "bars".into(), text })
}
