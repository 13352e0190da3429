//! What the inspection tells the supervisor, and how it comes to it.

use fringe::cloud::Point;
use metrology::inspection::{self, Plan, Verdict, evaluate};
use serde::{Deserialize, Serialize};

/// A judgement against a tolerance, with the measurement's uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ResultVerdict {
    /// Surely within.
    Pass,
    /// The uncertainty reaches over a limit.
    Indeterminate,
    /// Surely outside.
    Fail,
}

/// One feature of a cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FeatureResult {
    /// As in the plan.
    pub name: String,
    /// In `unit`; absent when it could not be measured.
    pub value: Option<f64>,
    /// `mm`, `deg`.
    pub unit: String,
    /// Standard uncertainty, in `unit`.
    pub u: Option<f64>,
    /// Lower limit, in `unit`.
    pub lower: Option<f64>,
    /// Upper limit, in `unit`.
    pub upper: Option<f64>,
    /// Absent when the plan sets no limit or there is no value.
    pub verdict: Option<ResultVerdict>,
    /// Why there is no value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// How the value is defined and what else was seen, where the name does not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
}

/// What the inspection tells the supervisor about a cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// Absent without plan.
    pub verdict: Option<ResultVerdict>,
    /// In the order of the plan.
    pub features: Vec<FeatureResult>,
    /// Why the part was not found.
    pub alignment_failure: Option<String>,
}

/// Measures and judges; without a plan there is nothing to judge.
pub fn judge(plan: Option<&Plan>, points: &[Point]) -> Judgement {
    let Some(plan) = plan else {
        return Judgement { verdict: None, features: Vec::new(), alignment_failure: None };
    };
    let result = evaluate(plan, points);
    Judgement {
        verdict: verdict(result.verdict),
        features: result.features.iter().map(feature).collect(),
        alignment_failure: result.alignment_failure,
    }
}

fn feature(feature: &inspection::FeatureResult) -> FeatureResult {
    FeatureResult {
        name: feature.name.clone(),
        value: feature.value,
        unit: feature.unit.to_owned(),
        u: feature.u,
        lower: Some(feature.lower).filter(|l| l.is_finite()),
        upper: Some(feature.upper).filter(|u| u.is_finite()),
        verdict: verdict(feature.verdict),
        reason: feature.reason.clone(),
        detail: feature.detail(),
    }
}

fn verdict(verdict: Verdict) -> Option<ResultVerdict> {
    match verdict {
        Verdict::Pass => Some(ResultVerdict::Pass),
        Verdict::Indeterminate => Some(ResultVerdict::Indeterminate),
        Verdict::Fail => Some(ResultVerdict::Fail),
        Verdict::NotMeasured => None,
    }
}
