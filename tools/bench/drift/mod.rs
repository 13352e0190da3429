//! What correcting a drifted camera gives on the twin: drifts of a calibrated rig singly and together, with and without a length standard.

use super::accuracy::Bench;
use super::calibrated::Calibrated;
use super::calibration::bars::{SPACING_MM, worst_spacing};
use super::calibration::board::{Cell, Plan};
use super::scan::{decode, views};
use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit_bare};
use anyhow::{Context, Result};
use cell::executor::PairMatcher;
use characterise::health::{
    Choice, HealthSettings, Match, Partner, check_pair, estimate_view, match_projector, match_views, stepped,
};
use fringe::geometry::camera::Camera;
use fringe::matching::MatchSettings;
use fringe::pattern::{Axis, PatternSet};
use fringe::phase::{PhaseMap, PhaseView};
use metrology::inspection::evaluate;
use serde::Serialize;
use std::path::PathBuf;
use twin::{Twin, TwinSettings};

/// The camera that drifts, and what sees the same places: the other camera of its pair, and both projectors.
const VIEW: &str = "cam2";
const PARTNERS: [&str; 3] = ["cam1", "proj1", "proj2"];
/// The length standard: spheres of the part, certified to this, mm.
const LENGTH: &str = "sphere_spacing";
const U_LENGTH_MM: f64 = 0.0005;

#[derive(clap::Args)]
pub struct Args {
    /// Calibrations for each drift, each with poses and corner errors of its own.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=1000))]
    trials: u64,
    /// Calibrations without any drift, of which none may be corrected.
    #[arg(long, value_name = "N", default_value_t = 36, value_parser = clap::value_parser!(u64).range(0..=10_000))]
    undrifted: u64,
    /// Placements of the part, each with its own noise.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=100))]
    placements: u64,
    /// Smooth systematic errors of the phase, rms in px.
    #[arg(long, value_name = "PX", default_value_t = HealthSettings::default().phase_error_px)]
    phase_error_px: f64,
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
    let work = args.placements + args.undrifted + args.trials * drifts.len() as u64;
    let mut progress = Progress::new(work as usize, "drifting");
    let seen: Vec<Seen> = (0..args.placements)
        .map(|cycle| {
            let seen = Seen::new(&bench, &cell, cycle);
            progress.step();
            seen
        })
        .collect::<Result<_>>()?;
    let trial = |seed: u64| {
        Ok::<_, anyhow::Error>((Calibrated::new(&cell, seed)?, &seen[(seed % args.placements) as usize]))
    };
    let mut report = Report { undrifted: args.undrifted, corrected: 0, rows: Vec::new() };
    for seed in 0..args.undrifted {
        let (calibrated, seen) = trial(seed)?;
        report.corrected += u64::from(!seen.healthy(&calibrated, view(&calibrated), &settings)?);
        progress.step();
    }
    for seed in 0..args.trials {
        let (calibrated, seen) = trial(seed)?;
        for (name, drift) in &drifts {
            report.rows.push(row((name, drift), seed, &calibrated, seen, &bench, &settings)?);
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

/// What the cameras see of one placement of the part, along both axes.
struct Seen {
    maps: [Vec<PhaseMap>; 2],
    /// Matches with each partner, the view on the right.
    matches: [Vec<Match>; PARTNERS.len()],
}

impl Seen {
    fn new(bench: &Bench, cell: &Cell, cycle: u64) -> Result<Self> {
        let twin = Twin::new(&bench.scene, TwinSettings::default(), &cell.rig)?;
        let maps =
            |camera: &str, projector: &str| decode(&twin, camera, projector, &cell.rig, &sequence(), cycle);
        let [one, two, other] = [maps("cam1", "proj1")?, maps(VIEW, "proj1")?, maps(VIEW, "proj2")?];
        let ([lx, ly], [rx, ry]) = (both(&one)?, both(&two)?);
        let projected = |maps: &[PhaseMap]| {
            let [x, y] = both(maps)?;
            let turned = |m: &Match| Match { left: m.right, right: m.left, ..*m };
            Ok::<_, anyhow::Error>(match_projector([&x, &y])?.matches.iter().map(turned).collect())
        };
        let matches = [match_views([&lx, &ly], [&rx, &ry])?.matches, projected(&two)?, projected(&other)?];
        Ok(Self { maps: [one, two], matches })
    }

    /// Whether all pairs of the view are healthy with it in a state.
    fn healthy(&self, calibrated: &Calibrated, view: &Camera, settings: &HealthSettings) -> Result<bool> {
        for (name, matches) in PARTNERS.iter().zip(&self.matches) {
            let covariance = calibrated.covariance(name, VIEW)?;
            if !check_pair(calibrated.device(name)?, view, matches, Some(&covariance), settings)?.healthy {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The length standard as the pair measures it with the view in a state, with its uncertainty, mm.
    fn length(&self, calibrated: &Calibrated, bench: &Bench, view: &Camera) -> Result<Option<(f64, f64)>> {
        let mut rig = calibrated.rig.clone();
        rig.cameras[1].camera = view.clone();
        let mut matcher = PairMatcher::new(&rig, &rig.pairs[0], 0, &MatchSettings::default())?;
        let cloud = matcher.cloud(&views(&self.maps[0]), &views(&self.maps[1]))?.0;
        let result = evaluate(&bench.plan, &cloud);
        let feature = result.features.iter().find(|feature| feature.name == LENGTH);
        Ok(feature.and_then(|feature| Some((feature.value?, feature.u?.hypot(U_LENGTH_MM)))))
    }
}

/// The maps of columns and rows.
fn both(maps: &[PhaseMap]) -> Result<[PhaseView<'_>; 2]> {
    let along = |axis| maps.iter().find(|map| map.info.axis == axis).map(PhaseMap::view);
    Ok([along(Axis::X).context("columns were decoded")?, along(Axis::Y).context("rows were decoded")?])
}

/// Fringes along both axes, as `configs/calibration.toml` has them.
fn sequence() -> Vec<PatternSet> {
    vec![
        PatternSet::sine(Axis::X, 16.0, 10),
        PatternSet::gray(Axis::X, 7, 8.0),
        PatternSet::sine(Axis::Y, 18.0, 10),
        PatternSet::gray(Axis::Y, 7, 9.0),
        PatternSet::White {},
        PatternSet::Black {},
    ]
}

fn row(
    (name, drift): (&'static str, &[f64; 7]),
    seed: u64,
    calibrated: &Calibrated,
    seen: &Seen,
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
    if seen.healthy(calibrated, &file, settings)? {
        return Ok(row);
    }
    let partners: Vec<Partner> = (0..PARTNERS.len())
        .map(|i| {
            Ok(Partner {
                fixed: calibrated.device(PARTNERS[i])?,
                matches: &seen.matches[i],
                measures: i == 0,
            })
        })
        .collect::<Result<_>>()?;
    let estimate = estimate_view(
        &file,
        &partners,
        Some(&calibrated.joint(&[PARTNERS.as_slice(), &[VIEW]].concat())?),
        settings,
    )?;
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
    let readings = estimate
        .readings(&[nominal], |view| Ok::<_, anyhow::Error>(vec![seen.length(calibrated, bench, view)?]))?;
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
