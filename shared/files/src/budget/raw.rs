//! The budget as it is written: unknown keys are refused, nothing is meant yet.

use metrology::uncertainty::IntervalKind;
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawBudget {
    #[expect(dead_code, reason = "Document::parse has compared it")]
    format: String,
    pub name: String,
    #[serde(default)]
    pub remark: String,
    #[serde(default = "two_sigma")]
    pub coverage_probability: f64,
    pub coverage_factor: Option<f64>,
    #[serde(default)]
    pub truncate_dof: bool,
    pub measurand: RawMeasurand,
    #[serde(default)]
    pub quantity: Vec<RawQuantity>,
    #[serde(default)]
    pub correlation: Vec<RawCorrelation>,
    #[serde(default)]
    pub monte_carlo: RawMonteCarlo,
    pub reference: Option<RawReference>,
}

/// What k = 2 of a normal distribution holds.
fn two_sigma() -> f64 {
    0.9545
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawMeasurand {
    pub symbol: String,
    pub unit: String,
    pub model: Option<String>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub struct RawQuantity {
    pub name: String,
    #[serde(default)]
    pub source: String,
    pub unit: Option<String>,
    pub estimate: Option<f64>,
    #[serde(rename = "type")]
    pub method: Option<String>,
    pub readings: Option<Vec<f64>>,
    pub standard_deviation: Option<f64>,
    pub observations: Option<u32>,
    pub standard_uncertainty: Option<f64>,
    pub expanded_uncertainty: Option<f64>,
    pub coverage_factor: Option<f64>,
    pub half_width: Option<f64>,
    pub distribution: Option<String>,
    pub top_ratio: Option<f64>,
    pub limit_uncertainty: Option<f64>,
    pub dof: Option<f64>,
    pub relative_uncertainty_of_u: Option<f64>,
    pub sensitivity: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawCorrelation {
    pub between: [String; 2],
    pub coefficient: Option<f64>,
    #[serde(default)]
    pub from_readings: bool,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub struct RawMonteCarlo {
    pub seed: Option<u64>,
    pub digits: Option<u8>,
    pub trials: Option<u64>,
    pub max_trials: Option<u64>,
    pub interval: Option<IntervalKind>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawReference {
    pub name: String,
    pub value: f64,
    pub expanded_uncertainty: f64,
}
