//! `fringetool measure`: an inspection plan on a cloud, as the cell does it, without the cell.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result};
use files::document::Document;
use metrology::inspection::{FeatureResult, InspectionResult, Plan, Verdict, evaluate};
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Inspection plan (TOML, docs/formats.md).
    plan: PathBuf,
    /// Point cloud (PLY or E57), lengths in mm.
    cloud: PathBuf,
    /// Write the result as JSON to this file (`-`: standard output): features, elements and the pose of the part.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The result with what it was made from.
#[derive(Serialize)]
struct Measurement<'a> {
    cloud: &'a PathBuf,
    points: usize,
    #[serde(flatten)]
    result: &'a InspectionResult,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[&args.plan, &args.cloud], None)?;
    let document = Document::read(&args.plan)?;
    let plan = Plan::from_toml(&document.text).with_context(|| args.plan.display().to_string())?;
    let cloud = crate::surface::read_cloud_in_mm(&args.cloud)?;
    let result = evaluate(&plan, &cloud.points);
    emit(
        args.json.as_deref(),
        &Measurement { cloud: &args.cloud, points: cloud.points.len(), result: &result },
    )?;
    print(&result);
    // What is not proven is not accepted; a part that was not found is nothing measured.
    Ok(if result.verdict == Verdict::Pass { Outcome::Done } else { Outcome::LimitFailed })
}

fn print(result: &InspectionResult) {
    match (&result.alignment, &result.alignment_failure) {
        (Some(found), _) if found.rounds > 0 => println!(
            "{}: found {:.3} mm and {:.3}° from its nominal place; the datum spheres are {:+.4} mm off their nominal distance",
            result.plan, found.offset_mm, found.angle_deg, found.line_residual_mm
        ),
        (_, Some(reason)) => println!("{}: not found: {reason}", result.plan),
        _ => println!("{}: evaluated at its nominal pose", result.plan),
    }
    let wide = result.features.iter().map(|f| f.name.chars().count()).max().unwrap_or(0).max(7);
    println!(
        "{:wide$}  {:>11}  {:>9}  {:>9}  {:>11} … {:<11} verdict",
        "feature", "value", "u", "deviation", "lower", "upper"
    );
    for feature in &result.features {
        println!("{}", line(feature, wide));
    }
    println!("verdict: {}", conclusion(result));
}

/// The verdict, and what stands in its way.
fn conclusion(result: &InspectionResult) -> String {
    if result.alignment_failure.is_some() {
        return "none, because the part was not found".to_owned();
    }
    let missing = result.features.iter().filter(|f| f.verdict == Verdict::NotMeasured).count();
    match missing {
        0 => word(result.verdict).to_owned(),
        _ => {
            format!("{}; {missing} of {} features not measured", word(result.verdict), result.features.len())
        }
    }
}

/// A feature's line of the table.
fn line(feature: &FeatureResult, wide: usize) -> String {
    let (Some(value), Some(u), Some(deviation)) = (feature.value, feature.u, feature.deviation) else {
        let reason = feature.reason.as_deref().unwrap_or("no reason given");
        return format!("{:wide$}  not measured: {reason}", feature.name);
    };
    let FeatureResult { name, unit, lower, upper, .. } = feature;
    format!(
        "{name:wide$}  {value:>8.4} {unit:<3} {u:>9.5}  {deviation:>+9.4}  {lower:>11.4} … {upper:<11.4} {}",
        word(feature.verdict)
    )
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "pass",
        Verdict::Indeterminate => "indeterminate",
        Verdict::Fail => "fail",
        Verdict::NotMeasured => "not measured",
    }
}
