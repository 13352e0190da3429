//! Performance of the last parts against their limits, from the values of all of them together.

use crate::feed::Ended;
use metrology::inspection::FeatureResult;
use metrology::spc::{Limits, capability};
use serde_json::{Value, json};
use std::sync::Arc;

/// Fewest parts that an index is told of.
const MIN_PARTS: usize = 10;

/// Probability that an interval holds the true index.
const CONFIDENCE: f64 = 0.95;

/// Of each feature of the last cycle: name, number of values, mean and sample standard deviation in its unit, and Ppk with its interval, over
/// the last `count` cycles of the same recipe that measured it.
pub fn performance<'a>(
    ended: impl DoubleEndedIterator<Item = &'a Arc<Ended>> + Clone,
    count: usize,
) -> Value {
    let Some(last) = ended.clone().next_back() else { return json!([]) };
    let same = ended.rev().filter(|one| one.result.recipe == last.result.recipe);
    let same: Vec<&Arc<Ended>> = same.take(count).collect();
    let of = |feature: &FeatureResult| {
        let found = same
            .iter()
            .rev()
            .filter_map(|one| one.result.features.iter().find(|other| other.name == feature.name)?.value);
        let values: Vec<f64> = found.collect();
        // A deviation of form cannot be below zero: that is no limit of the process.
        let lower = feature.lower.filter(|lower| *lower != 0.0 || feature.nominal != 0.0);
        let limits = Limits { lower, upper: feature.upper };
        let all = capability(&values, None, limits, CONFIDENCE);
        let ppk = all.as_ref().and_then(|all| all.ppk).filter(|_| values.len() >= MIN_PARTS);
        json!({
            "name": feature.name,
            "count": values.len(),
            "mean": all.as_ref().map(|all| all.mean),
            "sd": all.as_ref().map(|all| all.sd),
            "ppk": ppk,
        })
    };
    last.result.features.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use files::result::CycleResult;

    fn ended(recipe: &str, value: f64) -> Arc<Ended> {
        let feature = |name: &str, lower, nominal| FeatureResult {
            name: name.into(),
            value: Some(value),
            lower: Some(lower),
            upper: Some(10.0),
            nominal,
            ..FeatureResult::default()
        };
        let features = vec![feature("both", 2.0, 6.0), feature("flat", 0.0, 0.0)];
        let result = CycleResult { recipe: Some(recipe.into()), features, ..CycleResult::default() };
        Arc::new(Ended { result, spans: Vec::new() })
    }

    #[test]
    fn the_index_is_that_of_the_parts_of_the_recipe_and_one_sided_for_a_flatness() {
        // Mean 5, sample standard deviation 1 but for n − 1: 12 values 4 and 6 by turns.
        let mut all: Vec<Arc<Ended>> =
            (0..12).map(|n| ended("a", if n % 2 == 0 { 4.0 } else { 6.0 })).collect();
        all.insert(3, ended("b", 100.0));
        let told = performance(all.iter(), 200);
        let sd = (12.0_f64 / 11.0).sqrt();
        assert_eq!((&told[0]["count"], &told[0]["mean"]), (&json!(12), &json!(5.0)));
        let near = |value: &Value, expected: f64| {
            assert!((value.as_f64().unwrap() - expected).abs() < 1e-12, "{value} is not {expected}");
        };
        near(&told[0]["sd"], sd);
        near(&told[0]["ppk"]["value"], 1.0 / sd);
        near(&told[1]["ppk"]["value"], 5.0 / (3.0 * sd));
        assert!(told[0]["ppk"]["low"].as_f64() < told[0]["ppk"]["value"].as_f64());
        assert_eq!(performance(all.iter(), 9)[0]["ppk"], Value::Null);
        assert_eq!(performance([].iter(), 9), json!([]));
    }
}
