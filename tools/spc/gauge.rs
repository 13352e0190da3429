//! Studies of the gauge over the series of the command.

use super::Args;
use super::input::Parts;
use anyhow::{Context, Result, ensure};
use metrology::spc::{Series, TypeOne, TypeTwo, type_one, type_two};
use serde::Serialize;

/// Smallest Cg and Cgk of a gauge that is good enough.
const LEAST_CGK: f64 = 1.33;

/// Largest shares of the gauge: below the first it is good, above the second it is refused, %.
const SHARES_PERCENT: [f64; 2] = [10.0, 30.0];

/// The study of one feature.
#[derive(Serialize)]
pub struct GaugeStudy {
    /// Name of the feature.
    pub feature: String,
    /// Unit of the values.
    pub unit: String,
    /// Width of the tolerance; absent where none is known.
    pub tolerance: Option<f64>,
    /// Bias and repeatability on one reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub type_one: Option<TypeOne>,
    /// Analysis of variance of parts, operators and trials.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub type_two: Option<TypeTwo>,
    /// `capable`, `conditional`, `not-capable` or `undetermined`.
    pub rating: &'static str,
}

impl GaugeStudy {
    /// Whether the gauge is not good enough, or is not proven to be.
    pub fn is_refused(&self) -> bool {
        matches!(self.rating, "not-capable" | "undetermined")
    }
}

/// The studies that the options ask for; none without `--reference` and `--gauge`.
pub fn studies(args: &Args, parts: &Parts) -> Result<Vec<GaugeStudy>> {
    if args.reference.is_none() && !args.gauge {
        ensure!(args.tolerance.is_none(), "--tolerance belongs to --reference or --gauge; leave it out");
        return Ok(Vec::new());
    }
    ensure!(
        args.reference.is_none() || parts.series.len() == 1,
        "--reference: {} features have values, and a reference has one; choose it with --feature",
        parts.series.len()
    );
    let each = parts.series.iter().zip(&parts.readings);
    each.map(|(series, readings)| {
        let tolerance = args.tolerance.or(series
            .limits
            .upper
            .zip(series.limits.lower)
            .map(|(upper, lower)| upper - lower));
        let what = || format!("feature \"{}\"", series.name);
        match args.reference {
            Some(reference) => first(series, reference, tolerance).with_context(what),
            None => second(series, readings, tolerance).with_context(what),
        }
    })
    .collect()
}

fn first(series: &Series, reference: f64, tolerance: Option<f64>) -> Result<GaugeStudy> {
    let width = tolerance.filter(|width| *width > 0.0);
    let width = width.context("a study of type 1 needs the width of the tolerance: add --tolerance")?;
    let study = type_one(&series.values, reference, width)?;
    let rating = match (study.cg, study.cgk) {
        (Some(cg), Some(cgk)) if cg >= LEAST_CGK && cgk >= LEAST_CGK => "capable",
        (Some(_), Some(_)) => "not-capable",
        _ => "undetermined",
    };
    Ok(GaugeStudy { type_one: Some(study), rating, ..empty(series, tolerance) })
}

fn second(
    series: &Series,
    readings: &[metrology::spc::Reading],
    tolerance: Option<f64>,
) -> Result<GaugeStudy> {
    ensure!(
        readings.len() == series.values.len(),
        "a study of type 2 needs an operator for each value: give a table with the column \"operator\" (docs/formats.md)"
    );
    let study = type_two(readings, tolerance)?;
    // Against the tolerance where there is one: parts of a study need not vary as those of the process do.
    let share = study.grr_of_tolerance_percent.or(study.grr_of_variation_percent);
    // Readings that are all alike say nothing of the gauge: it is frozen, or its steps are too coarse for these parts.
    let rating = match share.filter(|_| study.grr_of_variation_percent.is_some()) {
        None => "undetermined",
        Some(share) if share <= SHARES_PERCENT[0] => "capable",
        Some(share) if share <= SHARES_PERCENT[1] => "conditional",
        Some(_) => "not-capable",
    };
    Ok(GaugeStudy { type_two: Some(study), rating, ..empty(series, tolerance) })
}

fn empty(series: &Series, tolerance: Option<f64>) -> GaugeStudy {
    let (feature, unit) = (series.name.clone(), series.unit.clone());
    GaugeStudy { feature, unit, tolerance, type_one: None, type_two: None, rating: "undetermined" }
}
