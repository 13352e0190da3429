//! `fringetool spc`: statistics over the parts of a cell, and studies of the gauge.

mod gauge;
mod input;
mod print;

use crate::Outcome;
use crate::report::{check_outputs, emit};
use crate::software::FRINGETOOL;
use anyhow::{Result, bail, ensure};
use files::clock::rfc3339_now;
use metrology::spc::{Study, StudySettings, study};
use report::spc::{DfqInput, SpcInput, write_dfq, write_spc};
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Folder of a cell's results (`run --out`), files of its store of parts, or tables (CSV, docs/formats.md).
    #[arg(required = true)]
    results: Vec<PathBuf>,
    /// Use only this feature; may be repeated.
    #[arg(long = "feature", value_name = "NAME")]
    features: Vec<String>,
    /// Use only parts of this recipe.
    #[arg(long, value_name = "NAME")]
    recipe: Option<String>,
    /// Use only the last N parts of each feature.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
    last: Option<u64>,
    /// Values of a subgroup; 1: charts of single values and moving ranges.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100))]
    subgroup: u64,
    /// Probability of the confidence intervals.
    #[arg(long, value_name = "P", default_value_t = 0.95)]
    confidence: f64,
    /// Ppk that each feature must reach with the lower limit of its confidence interval; exit code 1 otherwise.
    #[arg(long, value_name = "INDEX")]
    least_ppk: Option<f64>,
    /// Study of the gauge, type 1: all parts are measurements of one reference with this value.
    #[arg(long, value_name = "VALUE", conflicts_with = "gauge")]
    reference: Option<f64>,
    /// Study of the gauge, type 2: each operator measures each part equally often (analysis of variance, AIAG MSA).
    #[arg(long)]
    gauge: bool,
    /// Width of the tolerance for a study of the gauge; default: from the limits of the feature.
    #[arg(long, value_name = "WIDTH")]
    tolerance: Option<f64>,
    /// Write the statistics as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a report with charts to this file.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Write all values in the Q-DAS transfer format to this file.
    #[arg(long, value_name = "FILE.dfq")]
    dfq: Option<PathBuf>,
}

/// The result that `--json` writes.
#[derive(Serialize)]
struct Statistics<'a> {
    results: &'a [PathBuf],
    parts: usize,
    parts_not_ok: usize,
    confidence: f64,
    features: &'a [Study],
    gauge: &'a [gauge::GaugeStudy],
    capable: Option<bool>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [
        ("--json", args.json.as_deref()),
        ("--report", args.report.as_deref()),
        ("--dfq", args.dfq.as_deref()),
    ];
    check(args)?;
    let inputs = input::files(&args.results)?;
    let paths: Vec<&std::path::Path> = inputs.iter().map(PathBuf::as_path).collect();
    check_outputs(&outputs, &paths, None)?;
    let parts = input::read(args, &inputs)?;
    let settings = StudySettings { subgroup: args.subgroup as usize, confidence: args.confidence };
    let studies: Vec<Study> = parts.series.iter().map(|series| study(series.clone(), settings)).collect();
    let gauges = gauge::studies(args, &parts)?;
    let capable = capable(args, &studies)?;
    let statistics = Statistics {
        results: &args.results,
        parts: parts.count,
        parts_not_ok: parts.not_ok,
        confidence: args.confidence,
        features: &studies,
        gauge: &gauges,
        capable,
    };
    emit(args.json.as_deref(), &statistics)?;
    write_reports(args, &studies, &parts)?;
    print::print(&parts, &studies, &gauges, args);
    let refused = capable == Some(false) || gauges.iter().any(gauge::GaugeStudy::is_refused);
    Ok(if refused { Outcome::LimitFailed } else { Outcome::Done })
}

/// Values of options that no range holds.
fn check(args: &Args) -> Result<()> {
    ensure!(
        (0.5..=0.999_999).contains(&args.confidence),
        "--confidence {}: must lie within 0.5 … 0.999999, such as 0.95",
        args.confidence
    );
    for (name, value) in [("--least-ppk", args.least_ppk), ("--tolerance", args.tolerance)] {
        if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
            bail!("{name} {value}: give a number greater than 0");
        }
    }
    if let Some(value) = args.reference.filter(|value| !value.is_finite()) {
        bail!("--reference {value}: give a finite number");
    }
    Ok(())
}

/// Whether each feature is proven to reach the index that is asked for; `None` when none is.
///
/// # Errors
/// An index is asked for where no feature has limits.
fn capable(args: &Args, studies: &[Study]) -> Result<Option<bool>> {
    let Some(least) = args.least_ppk else { return Ok(None) };
    let limited: Vec<&Study> =
        studies.iter().filter(|s| s.series.limits != metrology::spc::Limits::default()).collect();
    ensure!(!limited.is_empty(), "--least-ppk {least}: no feature has limits");
    // No index is no proof.
    let reaches = |study: &&Study| {
        let ppk = study.capability.as_ref().and_then(|capability| capability.ppk);
        ppk.is_some_and(|ppk| ppk.low >= least)
    };
    Ok(Some(limited.iter().all(reaches)))
}

fn write_reports(args: &Args, studies: &[Study], parts: &input::Parts) -> Result<()> {
    let sources: Vec<String> = args.results.iter().map(|path| path.display().to_string()).collect();
    if let Some(file) = &args.report {
        let input = SpcInput {
            studies,
            sources: &sources.join(", "),
            parts: parts.count,
            parts_not_ok: parts.not_ok,
            confidence: args.confidence,
            least_ppk: args.least_ppk,
            date: &rfc3339_now(),
            software: &FRINGETOOL.line(),
        };
        write_spc(file, &input)?;
    }
    if let Some(file) = &args.dfq {
        write_dfq(file, &DfqInput { studies, remark: &sources.join(", ") })?;
    }
    Ok(())
}
