//! Every phase method and every order on the same surfaces: error, wrong orders, time.

use super::recorded;
use super::shown::{Cell, Shown, counting};
use crate::Outcome;
use crate::bundled;
use crate::progress::Progress;
use crate::report::{check_outputs, emit, emit_bare};
use crate::simulate::load_scene;
use anyhow::{Context, Result, bail};
use cell::executor::PhaseMethod;
use fringe::decode::{DecodeSettings, OrderMethod};
use fringe::math::statistics::median;
use fringe::pattern::{Axis, Code, Direction, PatternSet};
use fringe::wrapped::Method;
use std::f64::consts::FRAC_PI_2;
use std::path::{Path, PathBuf};
use twin::{Scene, Twin, TwinSettings};

/// Camera of the tables: half the demo's, so that the whole table takes minutes.
const CAMERA_PX: (u32, u32) = (562, 375);

#[derive(clap::Args)]
pub struct Args {
    /// Recordings of real frames instead of the twin (docs/formats.md): each method gets some of the steps and is compared with all of them.
    #[arg(long = "recording", value_name = "DIR")]
    recordings: Vec<PathBuf>,
    /// Another recording of the same scene, by the same camera and projector, as reference: for instance one with a code.
    #[arg(long, value_name = "DIR", requires = "recordings")]
    reference: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A method with the sequence that it needs.
struct Row {
    name: &'static str,
    sequence: Vec<PatternSet>,
    settings: DecodeSettings,
    method: PhaseMethod,
}

/// A surface under a condition.
struct Column {
    name: &'static str,
    scene: Scene,
    settings: TwinSettings,
}

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    if !args.recordings.is_empty() {
        return on_recordings(args);
    }
    let (rows, columns) = (rows(), columns()?);
    let rig = twin::thesis::rig(CAMERA_PX.0, CAMERA_PX.1);
    let mut progress = Progress::new(rows.len() * columns.len(), "measuring");
    let mut cells = Vec::new();
    for row in &rows {
        for column in &columns {
            let twin = Twin::new(&column.scene, column.settings.clone(), &rig)?;
            let shown = Shown::new(&twin, &rig, "cam1", "proj1", &row.sequence)?;
            let evaluated = shown.evaluate(&row.settings, row.method);
            let refused = evaluated.as_ref().err().map(|error| format!("{error:#}"));
            cells.push(Cell {
                method: row.name,
                case: column.name.to_owned(),
                refused,
                evaluated: evaluated.ok(),
            });
            progress.step();
        }
    }
    drop(progress);
    print("phase error", &columns.iter().map(|column| column.name).collect::<Vec<_>>(), &cells);
    emit_bare(args.json.as_deref(), &cells)?;
    Ok(Outcome::Done)
}

fn on_recordings(args: &Args) -> Result<Outcome> {
    if let (Some(other), 2..) = (&args.reference, args.recordings.len()) {
        bail!(
            "--reference {}: is the reference of one recording, {} are given; give one --recording",
            other.display(),
            args.recordings.len()
        );
    }
    let mut views = Vec::new();
    for folder in &args.recordings {
        views.extend(recorded::views(folder, args.reference.as_deref())?);
    }
    let rows = recorded::rows();
    let mut progress = Progress::new(rows.len() * views.len(), "measuring");
    let mut cells = Vec::new();
    for row in &rows {
        for view in &views {
            cells.push(view.cell(row));
            progress.step();
        }
    }
    drop(progress);
    recorded::print(&views);
    let columns: Vec<&str> = views.iter().map(|view| view.reference.case.as_str()).collect();
    print("difference of the phase from the reference", &columns, &cells);
    let references: Vec<_> = views.iter().map(|view| &view.reference).collect();
    emit(args.json.as_deref(), &serde_json::json!({ "references": references, "cells": cells }))?;
    Ok(Outcome::Done)
}

fn columns() -> Result<Vec<Column>> {
    let config = bundled::load("configs/demo.toml")?;
    let twin_config = config.twin.as_ref().context("configs/demo.toml: has no [twin]")?;
    let scene = |path: &str| load_scene(Some(&bundled::find(Path::new(path))?.path), twin_config);
    let (plate, artefact) = (scene("configs/plane.scene.toml")?, load_scene(None, twin_config)?);
    let real = TwinSettings { position_scatter_mm: 0.0, angle_scatter_deg: 0.0, ..TwinSettings::default() };
    let column = |name, scene: &Scene, settings| Column { name, scene: scene.clone(), settings };
    Ok(vec![
        column("smooth", &plate, real.clone()),
        column("artefact", &artefact, real.clone()),
        column("low light", &artefact, TwinSettings { exposure: 0.12, ..real.clone() }),
        column("gamma 2.2", &artefact, TwinSettings { projector_gamma: 2.2, ..real.clone() }),
        column("moving", &artefact, TwinSettings { drift_um: 10.0, ..real }),
    ])
}

const X: Axis = Axis::X;

fn sine(period_px: f64, steps: u32, shifts_rad: Vec<f64>) -> PatternSet {
    PatternSet::Sine {
        axis: X,
        period_px,
        steps,
        first_step_rad: 0.0,
        direction: Direction::Forward,
        shifts_rad,
    }
}

fn even(period_px: f64, steps: u32) -> PatternSet {
    sine(period_px, steps, Vec::new())
}

fn code(bits: u32, stripe_px: f64, shift_px: f64, code: Code) -> PatternSet {
    PatternSet::Gray { axis: X, bits, stripe_px, shift_px, invert: false, code, threshold: None }
}

/// The phase methods with one code, then the orders with one phase.
fn rows() -> Vec<Row> {
    let levels = [PatternSet::White {}, PatternSet::Black {}];
    let coded = |set: PatternSet| [vec![set, code(7, 8.0, 0.0, Code::Gray)], levels.to_vec()].concat();
    let row = |name, sequence, method| Row { name, sequence, settings: counting(), method };
    let own = PhaseMethod::default();
    let by = |method| PhaseMethod { method: Some(method), ..own };
    let quarter = |n: u32| (0..n).map(|i| FRAC_PI_2 * f64::from(i)).collect::<Vec<_>>();
    let mut rows = vec![
        row("three-step", coded(even(16.0, 3)), by(Method::ThreeStep)),
        row("3 steps", coded(even(16.0, 3)), own),
        row(
            "3 steps, harmonics removed",
            coded(even(16.0, 3)),
            PhaseMethod { remove_harmonics: true, ..own },
        ),
        row("3 steps, windowed filter", coded(even(16.0, 3)), PhaseMethod { window_px: Some(4.0), ..own }),
        row("4 steps", coded(even(16.0, 4)), own),
        row("5 uneven steps", coded(sine(16.0, 5, vec![0.1, 1.3, 2.2, 3.9, 4.4])), own),
        row("10 steps", coded(even(16.0, 10)), own),
        row("Carré", coded(sine(16.0, 4, quarter(4))), by(Method::Carre)),
        row("Hariharan", coded(sine(16.0, 5, quarter(5))), by(Method::Hariharan)),
        row("Fourier, rows", coded(even(16.0, 3)), by(Method::FourierRows)),
        row("Fourier, plane", coded(even(16.0, 3)), by(Method::Fourier)),
    ];
    let with = |sets: &[PatternSet]| [&[even(16.0, 6)], sets, &levels].concat();
    let sines = |periods: &[f64]| periods.iter().map(|p| even(*p, 6)).collect::<Vec<_>>();
    let order = |name, order, fuse, sequence| {
        let settings = DecodeSettings { order, fuse, ..counting() };
        Row { name, sequence, settings, method: PhaseMethod::default() }
    };
    // Grey levels must be separable: 13 of them number the periods of 96 px, which number those of 16 px.
    let stair = |stair_px, steps| PatternSet::Stair { axis: X, stair_px, steps };
    let whole = |shift_px| code(6, 16.0, shift_px, Code::Gray);
    rows.extend([
        order("Gray, half stripes", OrderMethod::Gray, false, with(&[code(7, 8.0, 0.0, Code::Gray)])),
        order("Gray, whole stripes", OrderMethod::Gray, false, with(&[whole(0.0)])),
        order("binary, half stripes", OrderMethod::Binary, false, with(&[code(7, 8.0, 0.0, Code::Binary)])),
        order("shifted Gray", OrderMethod::ShiftedGray, false, with(&[whole(0.0), whole(8.0)])),
        order("stairs of phase", OrderMethod::Stair, false, with(&[stair(8.0, 6)])),
        order("stairs of grey, 13 levels", OrderMethod::Stair, false, with(&[even(96.0, 6), stair(48.0, 1)])),
        order("hierarchical 16, 96, 608", OrderMethod::Hierarchical, false, sines(&[16.0, 96.0, 608.0])),
        order("heterodyne 16, 17.5, 19.5", OrderMethod::Heterodyne, false, sines(&[16.0, 17.5, 19.5])),
        order("coprime 16, 39", OrderMethod::NumberTheoretical, false, sines(&[16.0, 39.0])),
        order("coprime 16, 17, 19", OrderMethod::NumberTheoretical, false, sines(&[16.0, 17.0, 19.0])),
        order("coprime 16, 17, 19, fused", OrderMethod::NumberTheoretical, true, sines(&[16.0, 17.0, 19.0])),
    ]);
    rows
}

fn print(what: &str, columns: &[&str], cells: &[Cell]) {
    println!("{what} at valid pixels, mrad rms / wrong orders, ppm / valid share of lit pixels, %");
    print!("{:34}", "method");
    for column in columns {
        print!(" {column:>22}");
    }
    println!(" {:>11}", "CPU s/Mpx");
    for cells in cells.chunks(columns.len()) {
        print!("{:34}", cells[0].method);
        for cell in cells {
            let text = cell.evaluated.map_or("refused".to_owned(), |j| {
                let (wrong, valid) = (j.wrong_orders * 1e6, j.valid_share * 100.0);
                format!("{:.1} / {wrong:.0} / {valid:.1}", j.rms_rad * 1e3)
            });
            print!(" {text:>22}");
        }
        let mut times: Vec<f64> =
            cells.iter().filter_map(|c| c.evaluated.map(|j| j.seconds_per_mpx)).collect();
        println!(" {:>11.3}", median(&mut times).unwrap_or(f64::NAN));
    }
    for cell in cells {
        if let Some(reason) = &cell.refused {
            println!("{} on {}: {reason}", cell.method, cell.case);
        }
    }
}
