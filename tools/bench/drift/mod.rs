//! What correcting a drifted camera gives on the twin: drifts of a calibrated rig singly and together, with and without a length standard.

mod recorded;

use super::accuracy::Bench;
use super::calibrated::Calibrated;
use super::calibration::bars::{SPACING_MM, worst_spacing};
use super::calibration::board::{Cell, Plan};
use crate::Outcome;
use crate::numbers::within;
use crate::progress::Progress;
use crate::report::{check_outputs, emit_bare};
use anyhow::{Context, Result};
use characterise::health::{Choice, HealthSettings, Partner, estimate_view, stepped};
use fringe::geometry::camera::Camera;
use recorded::{Fringes, LENGTH, PLACES, Recorded, U_LENGTH_MM};
use serde::Serialize;
use std::path::PathBuf;

/// The camera that drifts, and what sees the same places: the other camera of its pair, both projectors, and the other cameras.
const VIEW: &str = "cam2";
const PARTNERS: [&str; 5] = ["cam1", "proj1", "proj2", "cam3", "cam4"];

#[derive(clap::Args)]
pub struct Args {
    /// Calibrations for each drift, each with poses and corner errors of its own.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=1000))]
    trials: u64,
    /// Calibrations without any drift, of which none may be corrected.
    #[arg(long, value_name = "N", default_value_t = 36, value_parser = clap::value_parser!(u64).range(0..=10_000))]
    undrifted: u64,
    /// Recordings that a correction rests on: the part as it lies, then tilted and shifted.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=PLACES.len() as u64))]
    recordings: u64,
    /// Sets of recordings, each with its own noise.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=100))]
    sets: u64,
    /// Smooth systematic errors of the phase, rms in px.
    #[arg(long, value_name = "PX", default_value_t = HealthSettings::default().phase_error_px, value_parser = |text: &str| within(text, 0.0..=1.0))]
    phase_error_px: f64,
    #[command(flatten)]
    fringes: Fringes,
    #[command(flatten)]
    board: Plan,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// One drift of one calibration.
#[derive(Debug, Serialize)]
struct Row {
    drift: &'static str,
    seed: u64,
    /// Largest error of a sphere spacing of 120 mm over the volume: undrifted, drifted, mm.
    undrifted_mm: f64,
    drifted_mm: f64,
    without: Ending,
    with: Ending,
}

/// How a correction ended.
#[derive(Debug, Serialize)]
struct Ending {
    /// What changed, as chosen; the reason where nothing was.
    model: String,
    /// Largest error of a sphere spacing after it, mm.
    worst_mm: Option<f64>,
    /// Stated standard uncertainty of a length of 120 mm anywhere in the volume, by the correction, mm.
    u_mm: Option<f64>,
}

/// Everything that was found.
#[derive(Debug, Serialize)]
struct Report {
    undrifted: u64,
    /// Of the undrifted rigs, how many a correction would have changed.
    corrected: u64,
    rows: Vec<Row>,
}

/// Drifts: rotations (rad), shifts (mm), relative focal length.
fn drifts() -> Vec<(&'static str, [f64; 7])> {
    let turn = 0.01_f64.to_radians();
    let one = |i: usize, by: f64| std::array::from_fn(|k| if k == i { by } else { 0.0 });
    vec![
        ("0.01° about x", one(0, turn)),
        ("0.01° about y", one(1, turn)),
        ("0.01° about z", one(2, turn)),
        ("0.05 mm along x", one(3, 0.05)),
        ("0.05 mm along y", one(4, 0.05)),
        ("0.05 mm along z", one(5, 0.05)),
        ("focal length 0.02 %", one(6, 2e-4)),
        ("0.01° about y, 0.05 mm along y", [0.0, turn, 0.0, 0.0, 0.05, 0.0, 0.0]),
        ("0.01° about x, focal length 0.02 %", [turn, 0.0, 0.0, 0.0, 0.0, 0.0, 2e-4]),
        ("0.05 mm along x, focal length 0.02 %", [0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 2e-4]),
        ("0.01° about y, 0.05 mm along x, focal length 0.02 %", [0.0, turn, 0.0, 0.05, 0.0, 0.0, 2e-4]),
    ]
}

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    let settings = HealthSettings { phase_error_px: args.phase_error_px, ..HealthSettings::default() };
    settings.check()?;
    let (bench, cell) = (Bench::demo()?, Cell::new(args.board.clone(), 1)?);
    let drifts = drifts();
    let work = args.sets * args.recordings + args.undrifted + args.trials * drifts.len() as u64;
    let mut progress = Progress::new(work as usize, "drifting");
    let mut record = |set: u64, place: u64| {
        progress.step();
        Recorded::part(&bench, &cell, &args.fringes, place as usize, set * args.recordings + place)
    };
    let sets: Vec<Vec<Recorded>> = (0..args.sets)
        .map(|set| (0..args.recordings).map(|place| record(set, place)).collect())
        .collect::<Result<_>>()?;
    let trial = |seed: u64| {
        Ok::<_, anyhow::Error>((Calibrated::new(&cell, seed)?, sets[(seed % args.sets) as usize].as_slice()))
    };
    let mut report = Report { undrifted: args.undrifted, corrected: 0, rows: Vec::new() };
    for seed in 0..args.undrifted {
        let (calibrated, recorded) = trial(seed)?;
        report.corrected += u64::from(!healthy(recorded, &calibrated, view(&calibrated), &settings)?);
        progress.step();
    }
    for seed in 0..args.trials {
        let (calibrated, recorded) = trial(seed)?;
        for (name, drift) in &drifts {
            report.rows.push(row((name, drift), seed, &calibrated, recorded, &bench, &settings)?);
            progress.step();
        }
    }
    drop(progress);
    print(&report, &drifts);
    emit_bare(args.json.as_deref(), &report)?;
    Ok(Outcome::Done)
}

/// The camera that drifts, as calibrated.
fn view(calibrated: &Calibrated) -> &Camera {
    &calibrated.rig.cameras[1].camera
}

/// Largest error of a sphere spacing over the volume with the camera in a state, mm.
fn worst_mm(calibrated: &Calibrated, view: &Camera) -> f64 {
    let [left, right] = [0, 1].map(|i| &calibrated.truth.cameras[i].camera);
    worst_spacing([&calibrated.rig.cameras[0].camera, view], [left, right])
}

/// Whether all pairs of the view are healthy with it in a state, in every recording.
fn healthy(
    recorded: &[Recorded],
    calibrated: &Calibrated,
    view: &Camera,
    settings: &HealthSettings,
) -> Result<bool> {
    for recorded in recorded {
        if !recorded.healthy(calibrated, view, settings)? {
            return Ok(false);
        }
    }
    Ok(true)
}

fn row(
    (name, drift): (&'static str, &[f64; 7]),
    seed: u64,
    calibrated: &Calibrated,
    recorded: &[Recorded],
    bench: &Bench,
    settings: &HealthSettings,
) -> Result<Row> {
    // The camera drifted by this after its calibration, so that the file lacks it.
    let file = stepped(view(calibrated), &drift.map(|d| -d));
    let ending = |model: &str, view: Option<&Camera>| Ending {
        model: model.to_owned(),
        worst_mm: view.map(|view| worst_mm(calibrated, view)),
        u_mm: None,
    };
    let mut row = Row {
        drift: name,
        seed,
        undrifted_mm: worst_mm(calibrated, view(calibrated)),
        drifted_mm: worst_mm(calibrated, &file),
        without: ending("not seen", Some(&file)),
        with: ending("not seen", Some(&file)),
    };
    if healthy(recorded, calibrated, &file, settings)? {
        return Ok(row);
    }
    let partners: Vec<Partner> = recorded
        .iter()
        .map(|recorded| recorded.partners(calibrated))
        .collect::<Result<Vec<_>>>()?
        .into_iter()
        .flatten()
        .collect();
    let calibration = calibrated.joint(&[PARTNERS.as_slice(), &[VIEW]].concat())?;
    let estimate = estimate_view(&file, &partners, Some(&calibration), settings)?;
    let ended = |choice: Option<Choice>| match choice {
        Some(Choice::Clear(view)) => {
            let u_mm = Some(view.u_volume * SPACING_MM);
            Ending { u_mm, ..ending(&view.name(), Some(&view.camera)) }
        }
        Some(Choice::LengthsOpen { models, apart }) => {
            let names: Vec<String> = models.iter().map(characterise::health::ViewCorrection::name).collect();
            ending(&format!("lengths open by {:.1} µm in 100 mm ({})", apart * 1e5, names.join(" or ")), None)
        }
        None => ending("contradicted", None),
    };
    row.without = ended(estimate.choose());
    let nominal =
        bench.scene.truth().get(LENGTH).map(|truth| truth.value).context("the part has a spacing")?;
    let certified = vec![(nominal, U_LENGTH_MM); recorded.len()];
    let readings = estimate.readings(&certified, |view| {
        recorded.iter().map(|recorded| recorded.length(bench, calibrated, view)).collect::<Result<Vec<_>>>()
    })?;
    row.with = ended(estimate.with_lengths(&readings).choose());
    Ok(row)
}

fn print(report: &Report, drifts: &[(&'static str, [f64; 7])]) {
    println!("{} undrifted rigs, {} corrected", report.undrifted, report.corrected);
    println!(
        "{:52} {:>20} {:>20}  worst sphere spacing over the volume, µm: undrifted, drifted; corrected without and with a length; u of the latter by the correction",
        "drift of one camera", "without a length", "with a length"
    );
    for (name, _) in drifts {
        for row in report.rows.iter().filter(|row| row.drift == *name) {
            let um = |mm: Option<f64>| mm.map_or_else(|| "–".to_owned(), |mm| format!("{:.2}", mm * 1e3));
            println!(
                "{:52} {:>20} {:>20}  {:6} {:6} {:6} {:6} {:6}",
                name,
                row.without.model,
                row.with.model,
                um(Some(row.undrifted_mm)),
                um(Some(row.drifted_mm)),
                um(row.without.worst_mm),
                um(row.with.worst_mm),
                um(row.with.u_mm)
            );
        }
    }
}
