//! From the values of all positions to a characteristic, and to the verdict.

use std::collections::BTreeMap;

use super::plan::{DecisionRule, Limit, TestPlan};
use super::result::{Characteristic, PositionValue, TestVerdict};
use super::rules::CharacteristicRule;
use crate::inspection::{Verdict, decide};

/// Coverage factor of the stated test-value uncertainty.
const COVERAGE_FACTOR: f64 = 2.0;

/// A value with the standard uncertainty of its test value.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Value {
    /// As the report shows it.
    pub shown: PositionValue,
    /// mm.
    pub u_mm: f64,
}

/// The characteristic; `None` when nothing was measured for it.
pub(super) fn summarise(
    one: &CharacteristicRule,
    values: &[Value],
    plan: &TestPlan,
) -> Option<Characteristic> {
    let limit_of = |v: &Value| plan.limits.get(&one.symbol).and_then(|limit| limit.at(v.shown.length_mm));
    let taken = |v: &Value| v.shown.value.abs() / limit_of(v).unwrap_or(1.0);
    let worst = values.iter().max_by(|a, b| taken(a).total_cmp(&taken(b)))?;
    let limit = limit_of(worst);
    let grows = matches!(plan.limits.get(&one.symbol), Some(Limit::Length(_)));
    let guard = match plan.decision.rule {
        DecisionRule::Simple => 0.0,
        DecisionRule::Iso14253 => plan.decision.guard_factor,
    };
    // Every value must pass, and a negative error counts as a positive one.
    let verdict = values
        .iter()
        .filter_map(|v| {
            let limit = limit_of(v)?;
            Some(verdict_of(decide(v.shown.value, v.u_mm, guard, Some(-limit), limit)))
        })
        .max_by_key(|verdict| rank(*verdict));
    let CharacteristicRule { symbol, name, definition, decides, .. } = one;
    Some(Characteristic {
        symbol: symbol.clone(),
        name: name.clone(),
        definition: definition.clone(),
        unit: "mm".to_owned(),
        value: worst.shown.value,
        decides: *decides,
        limit,
        test_value_u: Some(COVERAGE_FACTOR * worst.u_mm),
        verdict,
        positions: values
            .iter()
            .map(|v| PositionValue { limit: limit_of(v).filter(|_| grows), ..v.shown.clone() })
            .collect(),
        repeatability: repeatability(values),
        between_positions: between(values),
    })
}

fn verdict_of(verdict: Verdict) -> TestVerdict {
    match verdict {
        Verdict::Pass => TestVerdict::Pass,
        Verdict::Fail => TestVerdict::Fail,
        Verdict::Indeterminate | Verdict::NotMeasured => TestVerdict::Indeterminate,
    }
}

fn rank(verdict: TestVerdict) -> u8 {
    match verdict {
        TestVerdict::Pass => 0,
        TestVerdict::Indeterminate => 1,
        TestVerdict::Fail => 2,
    }
}

/// Verdict of the test: one limit that is broken fails it. A deciding characteristic without a limit proves nothing.
pub(super) fn test_verdict(characteristics: &[Characteristic]) -> TestVerdict {
    let verdicts = characteristics.iter().filter(|c| c.decides || c.limit.is_some());
    verdicts
        .map(|c| c.verdict.unwrap_or(TestVerdict::Indeterminate))
        .max_by_key(|verdict| rank(*verdict))
        .unwrap_or(TestVerdict::Indeterminate)
}

/// Values of the same position and views, one a repeat.
fn repeats(values: &[Value]) -> BTreeMap<(&str, &[String]), Vec<f64>> {
    let mut map: BTreeMap<(&str, &[String]), Vec<f64>> = BTreeMap::new();
    for value in values {
        map.entry((&value.shown.position, &value.shown.views)).or_default().push(value.shown.value);
    }
    map
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn squares(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|v| (v - mean) * (v - mean)).sum()
}

/// Pooled sample standard deviation within positions.
fn repeatability(values: &[Value]) -> Option<f64> {
    let groups = repeats(values);
    let dof: usize = groups.values().map(|list| list.len() - 1).sum();
    let sum: f64 = groups.values().map(|list| squares(list)).sum();
    (dof > 0).then(|| (sum / dof as f64).sqrt())
}

/// Sample standard deviation of the means of positions.
fn between(values: &[Value]) -> Option<f64> {
    let means: Vec<f64> = repeats(values).values().map(|list| mean(list)).collect();
    (means.len() > 1).then(|| (squares(&means) / (means.len() - 1) as f64).sqrt())
}
