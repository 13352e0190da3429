//! All that is said about one series: charts, normality, capability, and the gauge's share.

use super::{Capability, Chart, Limits, Normality, capability, chart, normality};
use serde::Serialize;

/// What one characteristic measured, part after part.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Series {
    /// Name of the characteristic.
    pub name: String,
    /// Recipe that the parts were inspected with; absent where none is known.
    pub recipe: Option<String>,
    /// Unit of all values.
    pub unit: String,
    /// Measured values in the order of the parts.
    pub values: Vec<f64>,
    /// Identification of each part.
    pub parts: Vec<String>,
    /// Date of each value, as the source gives it; empty where it gives none.
    pub dates: Vec<String>,
    /// Standard uncertainty of each value; absent where none is stated.
    pub u: Vec<Option<f64>>,
    /// Nominal value of the plan; absent where none is known.
    pub nominal: Option<f64>,
    /// Limits of the last part.
    pub limits: Limits,
    /// Whether earlier parts had other limits.
    pub limits_changed: bool,
    /// Parts without a value of this characteristic.
    pub missing: usize,
}

/// How a series is evaluated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StudySettings {
    /// Values of a subgroup; 1: single values.
    pub subgroup: usize,
    /// Probability of the intervals, between 0 and 1.
    pub confidence: f64,
}

/// The evaluation of one series.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Study {
    /// The values and what is known of them.
    #[serde(flatten)]
    pub series: Series,
    /// Control charts; absent below two subgroups.
    pub chart: Option<Chart>,
    /// Test of the normal distribution; absent below eight values.
    pub normality: Option<Normality>,
    /// Indices against the limits; absent without limits or below two values.
    pub capability: Option<Capability>,
    /// Root mean square of the stated standard uncertainties; absent where one is missing.
    pub u_rms: Option<f64>,
    /// Share of the scatter's variance that the stated uncertainty explains at most, %; absent when nothing scatters.
    pub u_share_percent: Option<f64>,
}

/// Evaluates a series; values are finite.
pub fn study(series: Series, settings: StudySettings) -> Study {
    let values = &series.values;
    let chart = chart(values, settings.subgroup);
    let capability = capability(values, chart.as_ref(), series.limits, settings.confidence);
    let u: Option<Vec<f64>> = series.u.iter().copied().collect();
    let mean_square = |u: &Vec<f64>| u.iter().map(|u| u * u).sum::<f64>() / u.len() as f64;
    let variance_u = u.filter(|u| !u.is_empty()).as_ref().map(mean_square);
    let sd = super::sample_sd(values).filter(|sd| *sd > 0.0);
    Study {
        normality: normality(values),
        u_rms: variance_u.map(f64::sqrt),
        u_share_percent: variance_u.zip(sd).map(|(variance, sd)| 100.0 * variance / (sd * sd)),
        chart,
        capability,
        series,
    }
}
