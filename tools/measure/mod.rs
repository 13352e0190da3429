//! `fringetool measure`: an inspection plan on a cloud, as the cell does it, without the cell.

mod calibration_share;

use crate::Outcome;
use crate::report::{check_outputs, emit_made_with};
use crate::software::FRINGETOOL;
use anyhow::{Context, Result, anyhow};
pub use calibration_share::{OpenFootprints, feature_values, shares as calibration_shares};
use calibration_share::{REMEDY, with_calibration};
use files::cloud_pairs;
use files::footprints_off::{self, FootprintsOff};
use files::hash::{cloud_sha256_hex, sha256_hex};
use files::plan_file::read_plan;
use files::ply::Cloud;
use files::provenance::Provenance;
use files::rig_file::{RigFile, read_rig};
use files::rims_left_out;
use files::viewpoints;
use fringe::geometry::rig::Pair;
use metrology::inspection::{FeatureResult, InspectionResult, Plan, evaluate};
use metrology::verdict::Verdict;
use report::Formats;
use report::part::{PartInput, write_part};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Inspection plan (TOML, docs/formats.md).
    plan: PathBuf,
    /// Point cloud (PLY or E57), lengths in mm.
    cloud: PathBuf,
    /// Rig file that the cloud was made with: the covariance of its calibration and the uncertainty of its cameras' footprints join
    /// that of each feature. It fits every feature some ten times for each camera.
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Write the result as JSON to this file (`-`: standard output): features, elements and the pose of the part.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a report to this file.
    #[arg(long, value_name = "FILE.html")]
    html: Option<PathBuf>,
    /// Write the report as PDF, A4.
    #[arg(long, value_name = "FILE.pdf")]
    pdf: Option<PathBuf>,
    /// Write the features as a table (CSV), one line each.
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Write plan and results as QIF 3.0 (ISO 23952).
    #[arg(long, value_name = "FILE.qif")]
    qif: Option<PathBuf>,
    /// Write the features in the Q-DAS ASCII transfer format.
    #[arg(long, value_name = "FILE.dfq")]
    dfq: Option<PathBuf>,
    /// Who measured, for the reports.
    #[arg(long, value_name = "NAME")]
    operator: Option<String>,
}

impl Args {
    fn outputs(&self) -> Formats<'_> {
        Formats {
            html: self.html.as_deref(),
            pdf: self.pdf.as_deref(),
            csv: self.csv.as_deref(),
            qif: self.qif.as_deref(),
            dfq: self.dfq.as_deref(),
        }
    }
}

/// The plan with the places whence the cloud was seen, by the numbers of the pairs in the rig file or in the cloud.
fn seen_from(plan: Plan, args: &Args, cloud: &Cloud, pairs: Option<&[Pair]>) -> Result<Plan> {
    let places = viewpoints::of_cloud(cloud, pairs).with_context(|| {
        let (path, name) = (args.cloud.display(), viewpoints::COMMENT);
        format!("{path}: comment {name} gives no places of cameras: reconstruct the cloud again")
    })?;
    Ok(plan.with_viewpoints(places))
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let inputs: Vec<_> =
        [&args.plan, &args.cloud].into_iter().chain(&args.rig).map(PathBuf::as_path).collect();
    let outputs = args.outputs();
    let flags: Vec<_> = [("--json", args.json.as_deref())].into_iter().chain(outputs.flags()).collect();
    check_outputs(&flags, &inputs, None)?;
    let (mut plan, document) = read_plan(&args.plan)?;
    let mut cloud = crate::surface::read_cloud_in_mm(&args.cloud)?;
    let edge_px = rims_left_out::of_cloud(&cloud).with_context(|| {
        let (path, name) = (args.cloud.display(), rims_left_out::COMMENT);
        format!("{path}: comment {name} is no number of pixels: reconstruct the cloud again")
    })?;
    if let Some(edge_px) = edge_px {
        plan = plan.with_rims_left_out(edge_px);
    }
    let cameras_off = footprints_off::of_cloud(&cloud).with_context(|| {
        format!(
            "{}: comment {} names no cameras with px²: reconstruct the cloud again",
            args.cloud.display(),
            footprints_off::COMMENT
        )
    })?;
    let mut provenance = Provenance::now(&FRINGETOOL).plan(&plan.name, &sha256_hex(document.text.as_bytes()));
    let mut pairs = None;
    let result = if let Some(rig) = &args.rig {
        let file = read_rig(rig)?;
        let named = cloud_pairs::number_by_rig(&mut cloud, &file.rig.pairs);
        pairs = Some(named.map_err(|fault| anyhow!("{}: {fault}", args.cloud.display()))?);
        plan = seen_from(plan, args, &cloud, Some(&file.rig.pairs))?;
        let result = with_calibration(&plan, &cloud.points, &file, &cameras_off)?;
        warn_of_other_rig(&args.cloud, cloud.comment("rig_sha256"), &file);
        provenance = provenance.rig(&file.sha256);
        result
    } else {
        warn(&cameras_off, &args.cloud);
        warn_of_assumed(&cloud, &args.cloud)?;
        plan = seen_from(plan, args, &cloud, None)?;
        evaluate(&plan, &cloud.points)
    };
    let mut all = machine_readable(args, cloud.points.len(), &result)?;
    if let Some(pairs) = pairs {
        all["pairs"] = json!(pairs);
        all["cloud_rig_sha256"] = json!(cloud.comment("rig_sha256"));
        for feature in all["features"].as_array_mut().into_iter().flatten() {
            feature.as_object_mut().map(|feature| feature.entry("u_calibration").or_insert(Value::Null));
        }
    }
    write_report(
        args,
        &result,
        (plan.settings.guard_factor, &document.text),
        &provenance,
        cloud.points.len(),
    )?;
    emit_made_with(args.json.as_deref(), &all, provenance)?;
    print(&result);
    if args.rig.is_some() {
        print_shares(&result);
    }
    // What is not proven is not accepted; a part that was not found is nothing measured.
    Ok(if result.verdict == Verdict::Pass { Outcome::Done } else { Outcome::LimitFailed })
}

/// Says where the rig file may not be that of the cloud.
fn warn_of_other_rig(cloud: &Path, made_with: Option<&str>, rig: &RigFile) {
    match made_with {
        Some(made_with) if made_with == rig.sha256 => {}
        Some(made_with) => eprintln!(
            "warning: {}: was made with a rig file of SHA-256 {made_with}, --rig {} has {}: the uncertainties hold only if both \
             are of the same calibration",
            cloud.display(),
            rig.path.display(),
            rig.sha256
        ),
        None => eprintln!(
            "warning: {}: does not say which rig file it was made with: the uncertainties hold only if it was --rig {}, and only where the points \
             were measured, not moved by a registration",
            cloud.display(),
            rig.path.display()
        ),
    }
}

/// Says what a result without `--rig` does not hold.
fn warn(cameras_off: &FootprintsOff, path: &Path) {
    if !cameras_off.is_empty() {
        eprintln!(
            "warning: {}: {}, which the uncertainties do not hold: {REMEDY}, or take it in with --rig",
            path.display(),
            calibration_share::other_footprint(cameras_off)
        );
    }
}

/// Says so where only what is known of any lens was taken off the frames.
fn warn_of_assumed(cloud: &Cloud, path: &Path) -> Result<()> {
    let cameras = footprints_off::assumed_of_cloud(cloud).with_context(|| {
        format!(
            "{}: comment {} names no cameras: reconstruct the cloud again",
            path.display(),
            footprints_off::ASSUMED
        )
    })?;
    if !cameras.is_empty() {
        let names: Vec<&str> = cameras.iter().map(String::as_str).collect();
        eprintln!(
            "warning: {}: the footprint of {} is not known, and that of any lens in focus was taken off; the uncertainties do not hold what it differs by: \
             calibrate the cameras and take it in with --rig, or record white and black",
            path.display(),
            names.join(", ")
        );
    }
    Ok(())
}

/// Writes the reports that are wanted.
fn write_report(
    args: &Args,
    result: &InspectionResult,
    (guard_factor, plan_text): (f64, &str),
    provenance: &Provenance,
    points: usize,
) -> Result<()> {
    let outputs = args.outputs();
    if outputs.flags().iter().all(|(_, path)| path.is_none()) {
        return Ok(());
    }
    let cloud_sha256 = cloud_sha256_hex(&args.cloud)?;
    let plan_sha256 = sha256_hex(plan_text.as_bytes());
    let pair = |label: &str, text: String| (label.to_owned(), text);
    let mut made_with = vec![
        pair("Plan", format!("{} (SHA-256 {plan_sha256})", args.plan.display())),
        pair("Cloud", format!("{}, {points} points (SHA-256 {cloud_sha256})", args.cloud.display())),
        pair("Software", FRINGETOOL.line()),
        pair("Date", provenance.date.clone()),
        pair("Operator", args.operator.clone().unwrap_or_else(|| "not stated".to_owned())),
    ];
    let rig_sha256 = provenance.rig_sha256.as_deref().unwrap_or("unknown");
    made_with
        .extend(args.rig.iter().map(|rig| pair("Rig", format!("{} (SHA-256 {rig_sha256})", rig.display()))));
    let sha256 = sha256_hex(format!("{plan_sha256}{cloud_sha256}").as_bytes());
    let input = PartInput {
        result,
        part: None,
        guard_factor,
        date: &provenance.date,
        made_with: &made_with,
        sha256: &sha256,
    };
    Ok(write_part(&input, &outputs)?)
}

/// The result with what it was made from. A feature without a verdict states it by a word, and has its `reason` even when it is
/// `null`.
fn machine_readable(args: &Args, points: usize, result: &InspectionResult) -> Result<Value> {
    let mut all = serde_json::to_value(result)?;
    all["cloud"] = json!(args.cloud);
    all["points"] = json!(points);
    for feature in all["features"].as_array_mut().into_iter().flatten() {
        if feature["verdict"].is_null() {
            feature["verdict"] = json!("not-measured");
        }
        feature.as_object_mut().map(|feature| feature.entry("reason").or_insert(Value::Null));
    }
    Ok(all)
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
    for beyond in result.elements.iter().filter_map(|element| element.beyond.as_ref()) {
        println!("warning: {beyond}");
    }
    println!("verdict: {}", conclusion(result));
}

/// What each uncertainty is made of.
fn print_shares(result: &InspectionResult) {
    println!("standard uncertainty by points, calibration and plan (u_system):");
    for feature in &result.features {
        if let (Some(noise), Some(share)) = (feature.u_noise, feature.u_calibration) {
            let FeatureResult { name, unit, u_system, .. } = feature;
            println!("  {name}: {noise:.5}, {share:.5}, {u_system:.5} {unit}");
        }
    }
}

/// The verdict, and what stands in its way.
fn conclusion(result: &InspectionResult) -> String {
    if result.alignment_failure.is_some() {
        return "none, because the part was not found".to_owned();
    }
    let missing = result.features.iter().filter(|f| f.verdict.is_none()).count();
    match missing {
        0 => result.verdict.to_string(),
        _ => {
            format!("{}; {missing} of {} features not measured", result.verdict, result.features.len())
        }
    }
}

/// A feature's line of the table.
fn line(feature: &FeatureResult, wide: usize) -> String {
    let (Some(value), Some(u), Some(deviation)) = (feature.value, feature.u, feature.deviation) else {
        let reason = feature.reason.as_deref().unwrap_or("no reason given");
        return format!("{:wide$}  not measured: {reason}", feature.name);
    };
    let FeatureResult { name, unit, .. } = feature;
    let lower = feature.lower.unwrap_or(f64::NEG_INFINITY);
    let upper = feature.upper.unwrap_or(f64::INFINITY);
    let verdict = feature.verdict.map_or_else(|| "not measured".to_owned(), |v| v.to_string());
    format!(
        "{name:wide$}  {value:>8.4} {unit:<3} {u:>9.5}  {deviation:>+9.4}  {lower:>11.4} … {upper:<11.4} {verdict}"
    )
}
