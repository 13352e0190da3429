//! Writes the files of a run: results, cloud, trace and report.

use crate::result_formats::{self, plan_of};
use crate::software::FRINGECELL;
use crate::supervisor::collect::Span;
use crate::supervisor::history::History;
use crate::supervisor::snapshot::CameraImage;
use anyhow::Result;
use cell::Cell;
use cell::cycle_number::wire;
use cell::executor::method_name;
use cell::schedule::label;
use devices::LoadedCell;
use files::atomic;
use files::cloud_pairs;
use files::footprints_off::{self, FootprintsOff};
use files::ply::write_cloud;
use files::result::{CycleResult, write_json};
use files::rims_left_out;
use files::trace::{TraceCycle, TraceSpan, write_trace};
use files::viewpoints;
use fringe::cloud::Point;
use fringe::phase::PhaseView;
use ipc::header::Phase;
use ipc::payload;
use ipc::port::Received;
use metrology::inspection::{self, FeatureResult, Plan};
use report::{Activity, FeatureRow, GreyPicture, Mark, PhasePicture, ReportInput};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use twin::Truth;

/// Writes the result of a cycle, during the run; returns the path of the file that no later cycle replaces.
pub fn cycle(folder: &Path, cell: &LoadedCell, result: &CycleResult) -> Result<PathBuf> {
    let results = folder.join("results");
    atomic::create_dir(&results)?;
    let path = results.join(format!("{:04}.json", result.number));
    write_json(&path, result)?;
    result_formats::write(&path, cell, result)?;
    write_json(&folder.join("result.json"), result)?;
    Ok(path)
}

/// Data for the files at the end of a run.
pub struct RunFiles<'a> {
    /// Configuration, graph and schedule of the cell.
    pub cell: &'a LoadedCell,
    /// Results of the last cycles.
    pub results: &'a [CycleResult],
    /// Times of the last cycles.
    pub history: &'a History,
    /// Images by indices of camera and projector.
    pub images: &'a BTreeMap<(u32, u32), CameraImage>,
    /// Phase maps by indices of camera and projector and by axis.
    pub maps: &'a BTreeMap<(u32, u32, u32), Received<Phase>>,
    /// Fused cloud of the last cycle that is ok.
    pub points: Option<&'a [Point]>,
    /// Truth of the simulation, in the demo.
    pub truth: Option<&'a Truth>,
}

/// Writes cloud, trace and report; returns why some of them are lost.
pub fn files(folder: &Path, run: &RunFiles) -> Vec<anyhow::Error> {
    let measured = run.results.iter().rev().find(|result| result.is_ok());
    let cloud = run.points.map(|points| cloud(&folder.join("cloud.ply"), run.cell, points, measured));
    let trace = trace(&folder.join("trace.json"), run.cell, run.history);
    [Some(trace), cloud, Some(report(folder, run))].into_iter().flatten().filter_map(Result::err).collect()
}

/// Writes the fused cloud, with what its cycle says of the footprints.
pub fn cloud(path: &Path, cell: &LoadedCell, points: &[Point], result: Option<&CycleResult>) -> Result<()> {
    let software = format!("fringecell {}", env!("CARGO_PKG_VERSION"));
    let cameras_off = result.map(cameras_off).and_then(|all| footprints_off::comment(&all));
    let assumed = result.map(cameras_assumed).and_then(|all| footprints_off::assumed_comment(&all));
    let mut comments = vec![
        ("rig_sha256", cell.file.rig_sha256.as_str()),
        ("config_sha256", &cell.file.sha256),
        ("cell", &cell.name),
        ("method", method_name(&cell.config.rig)),
        ("version", &software),
    ];
    let pairs = cloud_pairs::comment(&cell.config.rig.pairs);
    comments.push((cloud_pairs::COMMENT, &pairs));
    let edge_px = cell.config.settings.matching.surface.edge_px.to_string();
    comments.push((rims_left_out::COMMENT, &edge_px));
    let viewpoints = viewpoints::comment(&cell.config.rig, &cell.config.rig.pairs);
    comments.push((viewpoints::COMMENT, &viewpoints));
    comments.extend(cameras_off.as_ref().map(|text| (footprints_off::COMMENT, text.as_str())));
    comments.extend(assumed.as_ref().map(|text| (footprints_off::ASSUMED, text.as_str())));
    Ok(write_cloud(path, points, &comments)?)
}

/// The footprints that differ from what was taken off in a cycle.
fn cameras_off(result: &CycleResult) -> FootprintsOff {
    let mut all = FootprintsOff::new();
    for (output, report) in &result.reports {
        if let (Some(camera), Some(off_px2)) = (camera_of(output), report[footprints_off::COMMENT].as_f64()) {
            footprints_off::add(&mut all, camera, off_px2);
        }
    }
    all
}

/// The cameras of which only what is known of any lens was taken off.
fn cameras_assumed(result: &CycleResult) -> BTreeSet<String> {
    let assumed = result.reports.iter().filter(|(_, report)| report[footprints_off::ASSUMED] == true);
    assumed.filter_map(|(output, _)| camera_of(output)).map(str::to_owned).collect()
}

/// The camera of a phase map, by the name of that output.
fn camera_of(output: &str) -> Option<&str> {
    output.strip_prefix("phase/").and_then(|rest| rest.split('/').next())
}

/// Writes the times of all stages.
pub fn trace(file: &Path, cell: &Cell, history: &History) -> Result<()> {
    let stages: Vec<&str> = cell.schedule.stages.iter().map(|s| s.name.as_str()).collect();
    let spans: Vec<TraceSpan> = history.spans.iter().filter_map(|span| trace_span(cell, span)).collect();
    let cycles: Vec<TraceCycle> = history.cycles.iter().cloned().collect();
    Ok(write_trace(file, &stages, &spans, &cycles)?)
}

fn trace_span(cell: &Cell, span: &Span) -> Option<TraceSpan> {
    let activation = cell.schedule.activations.get(span.activation)?;
    Some(TraceSpan {
        stage: activation.stage,
        name: label(&cell.graph, activation.work),
        cycle: span.cycle,
        wait_ns: span.wait_ns,
        start_ns: span.start_ns,
        end_ns: span.end_ns,
        send_ns: span.send_ns,
    })
}

/// Writes the report of the last cycle.
pub fn report(folder: &Path, run: &RunFiles) -> Result<()> {
    match report_text(run)? {
        Some(html) => Ok(atomic::write(&folder.join("report.html"), html.as_bytes())?),
        None => Ok(()),
    }
}

/// The report of the last cycle as HTML; `None` without a cycle.
pub fn report_text(run: &RunFiles) -> Result<Option<String>> {
    let Some(last) = run.results.last() else { return Ok(None) };
    let points = run.points.unwrap_or_default();
    let ok = last.is_ok();
    let cell = run.cell;
    let plan = plan_of(cell, last);
    let captions: Vec<(String, PhaseView)> = if ok { phase_maps(run, last.cycle)? } else { Vec::new() };
    let deviations = deviations(plan, last, points);
    let row = |feature: &FeatureResult| {
        let truth = run.truth.and_then(|t| t.get(&feature.name));
        let truth = truth.filter(|t| t.unit == feature.unit.to_string()).map(|t| t.value);
        FeatureRow { feature: feature.clone(), truth }
    };
    let input = ReportInput {
        cell: cell.name.clone(),
        part: part(last, plan),
        date: last.date.clone(),
        software_version: FRINGECELL.line(),
        rig_hash: cell.file.rig_sha256.clone(),
        plan_id: plan_line(last, plan),
        details: vec![
            ("Recipe".into(), last.recipe.clone().unwrap_or_default()),
            ("Cycle".into(), last.number.to_string()),
            ("Configuration".into(), cell.file.sha256.clone()),
        ],
        verdict: last.verdict,
        reason: if ok { String::new() } else { last.outcome.clone() },
        warnings: last.warnings.clone(),
        coverage_factor: Some(2.0),
        decision_rule: plan.map_or_else(String::new, |p| decision_rule(p.settings.guard_factor)),
        features: last.features.iter().map(row).collect(),
        camera_views: if ok { camera_views(run, last.cycle) } else { Vec::new() },
        phase_maps: captions.iter().map(|(caption, phase)| PhasePicture { caption, phase: *phase }).collect(),
        cloud: if ok { points } else { &[] },
        pair_names: cell.graph.pairs.iter().map(|p| p.name.clone()).collect(),
        deviations: &deviations,
        deviation_meaning:
            "Distance from the fitted element of the plan; positive is outside of the material.".into(),
        overlaps: last.overlaps.as_deref().unwrap_or_default(),
        timeline: timeline(cell, run.history, last.cycle),
        marks: marks(cell, run.history, last.cycle),
        cycles: run.results,
        notes: [Some(uncertainty_note(last)), run.truth.map(|_| TRUTH_NOTE)]
            .into_iter()
            .flatten()
            .map(str::to_owned)
            .collect(),
        ..ReportInput::default()
    };
    Ok(Some(report::html(&input)?))
}

/// Note on the uncertainties in the report.
fn uncertainty_note(result: &CycleResult) -> &'static str {
    if result.calibration_shares_sha256.is_some() {
        "Uncertainties contain the scatter of the points, the calibration of the rig, as it was found on one part (calibration_shares), and the \
         contributions u_system_mm and u_system_deg of the inspection plan for everything besides."
    } else {
        "Uncertainties contain the scatter of the points and the contributions u_system_mm and u_system_deg of the inspection plan. What the \
         calibration of the rig adds is not part of them, unless the plan states it. If it states nothing, they describe repeatability only."
    }
}

/// Note on the truth in the report of the demo.
const TRUTH_NOTE: &str = "The part is simulated. The column truth comes from the simulator; the measurement does \
    not use it.";

/// The part as the job named it, else as the plan does.
fn part(result: &CycleResult, plan: Option<&Plan>) -> String {
    let named = result.part.as_ref().or(plan.map(|plan| &plan.name));
    named.cloned().unwrap_or_else(|| "no inspection plan".to_owned())
}

/// Name and hash of the plan.
fn plan_line(result: &CycleResult, plan: Option<&Plan>) -> String {
    let Some(plan) = plan else { return String::new() };
    format!("{}, SHA-256 {}", plan.name, result.plan_sha256.as_deref().unwrap_or("unknown"))
}

fn decision_rule(guard_factor: f64) -> String {
    format!("ISO 14253-1 with a guard band of {guard_factor} standard uncertainties.")
}

/// Distances of the points from the elements that the inspection fitted.
fn deviations(plan: Option<&Plan>, result: &CycleResult, points: &[Point]) -> Vec<(u32, f32)> {
    match (plan, &result.alignment) {
        (Some(plan), Some(alignment)) => inspection::deviations(plan, alignment, &result.elements, points),
        _ => Vec::new(),
    }
}

fn camera_views(run: &RunFiles, cycle: u64) -> Vec<GreyPicture> {
    let graph = &run.cell.graph;
    let fresh = run.images.iter().filter(|(_, p)| p.cycle == wire(cycle));
    let views = fresh.filter_map(|((camera, projector), picture)| {
        let (camera, projector) =
            (graph.cameras.get(*camera as usize)?, graph.projectors.get(*projector as usize)?);
        Some(GreyPicture {
            caption: format!("{} under {}", camera.name, projector.name),
            width_px: picture.width_px,
            height_px: picture.height_px,
            values: picture.values.clone(),
        })
    });
    views.collect()
}

fn phase_maps<'a>(run: &'a RunFiles, cycle: u64) -> Result<Vec<(String, PhaseView<'a>)>> {
    let graph = &run.cell.graph;
    let fresh = run.maps.values().filter(|m| m.header().cycle == wire(cycle));
    fresh
        .map(|map| {
            let header = map.header();
            let name = |camera: u32| graph.cameras.get(camera as usize).map_or("?", |c| c.name.as_str());
            let axis = if header.axis == 0 { "x" } else { "y" };
            Ok((format!("{}, axis {axis}", name(header.camera)), payload::phase(header, map.payload())?))
        })
        .collect()
}

fn timeline(cell: &Cell, history: &History, cycle: u64) -> Vec<report::Span> {
    let mut rows = Vec::new();
    for span in history.spans.iter().filter(|s| s.cycle == cycle) {
        let Some(activation) = cell.schedule.activations.get(span.activation) else { continue };
        let stage = &cell.schedule.stages[activation.stage].name;
        let mut row = |activity, start_ns, end_ns| {
            rows.push(report::Span { stage: stage.clone(), activity, start_ns, end_ns });
        };
        if span.wait_ns > 0 {
            row(Activity::Wait, span.start_ns.saturating_sub(span.wait_ns), span.start_ns);
        }
        row(Activity::Compute, span.start_ns, span.end_ns);
    }
    rows
}

fn marks(cell: &Cell, history: &History, cycle: u64) -> Vec<Mark> {
    use cell::schedule::Work;
    let ends = |test: fn(&Work) -> bool| {
        let of_cycle = history.spans.iter().filter(|s| s.cycle == cycle);
        let matching =
            of_cycle.filter(|s| cell.schedule.activations.get(s.activation).is_some_and(|a| test(&a.work)));
        matching.map(|s| s.end_ns).max()
    };
    let mark = |name: &str, at: Option<u64>| at.map(|at_ns| Mark { name: name.to_owned(), at_ns });
    [
        mark("last frame", ends(|w| matches!(w, Work::Expose { .. }))),
        mark("verdict", ends(|w| matches!(w, Work::Inspect))),
    ]
    .into_iter()
    .flatten()
    .collect()
}
