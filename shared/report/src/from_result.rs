//! Rows of the report from the machine-readable results, so that `result.json` and the report cannot differ.

use super::{CycleRow, FeatureRow, StageTimes, Verdict};
use files::result::{CycleResult, FeatureResult, ResultVerdict};

impl From<ResultVerdict> for Verdict {
    fn from(verdict: ResultVerdict) -> Self {
        match verdict {
            ResultVerdict::Pass => Self::Pass,
            ResultVerdict::Indeterminate => Self::Indeterminate,
            ResultVerdict::Fail => Self::Fail,
        }
    }
}

impl From<&FeatureResult> for FeatureRow {
    /// The reason of an absent value becomes the small print; a feature with limits but no verdict has no result.
    fn from(feature: &FeatureResult) -> Self {
        let has_limits = feature.lower.is_some() || feature.upper.is_some();
        Self {
            name: feature.name.clone(),
            detail: feature.reason.as_ref().or(feature.detail.as_ref()).cloned().unwrap_or_default(),
            unit: feature.unit.clone(),
            value: feature.value.unwrap_or(f64::NAN),
            standard_uncertainty: feature.u,
            lower: feature.lower,
            upper: feature.upper,
            verdict: feature.verdict.map(Verdict::from).or(has_limits.then_some(Verdict::NoResult)),
            truth: None,
        }
    }
}

impl From<&CycleResult> for CycleRow {
    /// The number of points is taken from the further key `points`, if that is there.
    fn from(cycle: &CycleResult) -> Self {
        Self {
            cycle: cycle.cycle,
            outcome: cycle.outcome.clone(),
            verdict: cycle.verdict.map(Verdict::from),
            latency_ns: cycle.latency_ns,
            points: cycle.more.get("points").and_then(serde_json::Value::as_u64),
        }
    }
}

/// The times of each stage over all cycles, stages in order of their first appearance.
pub fn stage_times(cycles: &[CycleResult]) -> Vec<StageTimes> {
    let mut all: Vec<StageTimes> = Vec::new();
    for stage in cycles.iter().flat_map(|c| &c.stages) {
        let place = all.iter().position(|s| s.name == stage.name).unwrap_or_else(|| {
            all.push(StageTimes { name: stage.name.clone(), ..StageTimes::default() });
            all.len() - 1
        });
        all[place].wait_ns.push(stage.wait_ns);
        all[place].compute_ns.push(stage.compute_ns);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use files::result::StageResult;
    use std::collections::BTreeMap;

    fn cycle(number: u64, stages: &[(&str, u64)]) -> CycleResult {
        let stage = |(name, compute_ns): &(&str, u64)| StageResult {
            name: (*name).to_owned(),
            wait_ns: 1,
            compute_ns: *compute_ns,
            ..StageResult::default()
        };
        CycleResult {
            cycle: number,
            outcome: "ok".to_owned(),
            verdict: Some(ResultVerdict::Indeterminate),
            features: vec![],
            stages: stages.iter().map(stage).collect(),
            latency_ns: Some(5),
            hashes: BTreeMap::new(),
            more: BTreeMap::from([("points".to_owned(), serde_json::json!(812))]),
        }
    }

    #[test]
    fn a_cycle_that_lost_a_stage_does_not_shift_the_others() {
        let cycles = [cycle(0, &[("decode", 10), ("fusion", 20)]), cycle(1, &[("fusion", 21)])];
        let times = stage_times(&cycles);
        assert_eq!(times[0].compute_ns, [10]);
        assert_eq!((times[1].name.as_str(), &times[1].compute_ns[..]), ("fusion", &[20, 21][..]));
        let row = CycleRow::from(&cycles[1]);
        assert_eq!((row.cycle, row.points, row.verdict), (1, Some(812), Some(Verdict::Indeterminate)));
    }

    #[test]
    fn a_feature_without_a_value_says_why() {
        let mut feature = FeatureResult {
            name: "sphere".to_owned(),
            value: None,
            unit: "mm".to_owned(),
            u: None,
            lower: None,
            upper: Some(1.0),
            verdict: None,
            reason: Some("12 points, at least 100 needed".to_owned()),
            detail: Some("of all points".to_owned()),
        };
        let row = FeatureRow::from(&feature);
        assert!(row.value.is_nan());
        assert_eq!(
            (row.verdict, row.detail.as_str()),
            (Some(Verdict::NoResult), "12 points, at least 100 needed")
        );
        feature.reason = None;
        assert_eq!(FeatureRow::from(&feature).detail, "of all points");
        feature.upper = None;
        assert_eq!(FeatureRow::from(&feature).verdict, None);
    }
}
