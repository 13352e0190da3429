//! From the values of all positions to a characteristic, and to the verdict.

use std::collections::BTreeMap;

use super::plan::{Limit, TestPlan};
use super::result::{COVERAGE_FACTOR, Characteristic, PositionValue};
use super::rules::CharacteristicRule;

/// Scatter below this is rounding, mm: it means nothing and is left undetermined.
const RESOLUTION_MM: f64 = 1e-7;

/// A value with the standard uncertainty of its test value.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Value {
    /// As the report shows it.
    pub shown: PositionValue,
    /// Whether it was measured again after a broken limit.
    pub retest: bool,
    /// Standard uncertainty of the test value, mm.
    pub u_mm: f64,
}

/// The characteristic; `None` when nothing was measured for it.
pub(super) fn summarise(
    one: &CharacteristicRule,
    values: &[Value],
    plan: &TestPlan,
) -> Option<Characteristic> {
    let limit_of = |v: &Value| plan.limits.get(&one.symbol).and_then(|limit| limit.at(v.shown.length_mm));
    let mut values = values.to_vec();
    replace(&mut values, &|v| Some((limit_of(v)?, plan.decision.factor())));
    let values = &values[..];
    let taken = |v: &Value| v.shown.value.abs() / limit_of(v).unwrap_or(1.0);
    let counting = values.iter().filter(|v| !v.shown.replaced);
    let worst = counting.max_by(|a, b| taken(a).total_cmp(&taken(b)))?;
    let grows = matches!(plan.limits.get(&one.symbol), Some(Limit::Length(_)));
    let row = |v: &Value| PositionValue {
        limit: limit_of(v).filter(|_| grows),
        test_value_u: Some(COVERAGE_FACTOR * v.u_mm),
        ..v.shown.clone()
    };
    let CharacteristicRule { symbol, name, definition, decides, .. } = one;
    let mut result = Characteristic {
        symbol: symbol.clone(),
        name: name.clone(),
        definition: definition.clone(),
        unit: "mm".to_owned(),
        value: worst.shown.value,
        decides: *decides,
        limit: limit_of(worst),
        test_value_u: Some(COVERAGE_FACTOR * worst.u_mm),
        verdict: None,
        positions: values.iter().map(row).collect(),
        repeatability: repeatability(values),
        between_positions: between(values),
    };
    let guard_factor = plan.decision.factor();
    let verdicts: Vec<_> = result.positions.iter().map(|p| result.verdict_at(p, guard_factor)).collect();
    for (position, verdict) in result.positions.iter_mut().zip(verdicts) {
        position.verdict = verdict;
    }
    result.verdict = result.verdict_over_positions(guard_factor);
    Some(result)
}

/// Marks values that do not keep their limit and were measured again.
fn replace(values: &mut [Value], limit_and_guard: &dyn Fn(&Value) -> Option<(f64, f64)>) {
    let again: Vec<String> = values.iter().filter(|v| v.retest).map(|v| v.shown.position.clone()).collect();
    for value in values.iter_mut().filter(|v| !v.retest && again.contains(&v.shown.position)) {
        let Some((limit, guard)) = limit_and_guard(value) else { continue };
        value.shown.replaced = value.shown.value.abs() > limit - guard * value.u_mm;
    }
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
    (dof > 0).then(|| (sum / dof as f64).sqrt()).filter(|scatter| *scatter > RESOLUTION_MM)
}

/// Sample standard deviation of the means of positions.
fn between(values: &[Value]) -> Option<f64> {
    let means: Vec<f64> = repeats(values).values().map(|list| mean(list)).collect();
    let scatter = (means.len() > 1).then(|| (squares(&means) / (means.len() - 1) as f64).sqrt());
    scatter.filter(|scatter| *scatter > RESOLUTION_MM)
}
