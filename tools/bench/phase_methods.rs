//! Every phase method and every order on the same surfaces: error, wrong orders, time.

use super::shown::{Judged, Shown};
use crate::Outcome;
use crate::phase_method::PhaseMethod;
use crate::pipeline::decode_views_by;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use crate::simulate::load_scene;
use anyhow::{Context, Result};
use fringe::decode::{DecodeSettings, OrderMethod};
use fringe::math::wrap_rad;
use fringe::pattern::{Axis, Code, Direction, PatternSet};
use fringe::phase::PhaseMap;
use fringe::wrapped::Method;
use rig::config::Config;
use rig::recording::Recording;
use serde::Serialize;
use std::f64::consts::FRAC_PI_2;
use std::path::{Path, PathBuf};
use std::time::Instant;
use twin::{Scene, Twin, TwinSettings};

/// Camera of the tables: half the demo's, so that the whole table takes minutes.
const CAMERA_PX: (u32, u32) = (562, 375);

/// Arguments of `bench phase-methods`.
#[derive(clap::Args)]
pub struct Args {
    /// A recording of real frames instead of the twin: the methods that its sets allow, judged by their smoothness.
    #[arg(long)]
    recording: Option<PathBuf>,
    /// Machine-readable result.
    #[arg(long)]
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

#[derive(Serialize)]
struct Cell {
    method: &'static str,
    case: &'static str,
    /// Why there is no result.
    refused: Option<String>,
    #[serde(flatten)]
    judged: Option<Judged>,
}

/// Runs the benchmark.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    if let Some(folder) = &args.recording {
        return on_recording(folder, args.json.as_deref());
    }
    let (rows, columns) = (rows(), columns()?);
    let rig = twin::thesis::rig(CAMERA_PX.0, CAMERA_PX.1);
    let mut progress = Progress::new(rows.len() * columns.len(), "measuring");
    let mut cells = Vec::new();
    for row in &rows {
        for column in &columns {
            let twin = Twin::new(&column.scene, column.settings.clone(), &rig)?;
            let shown = Shown::new(&twin, &rig, "cam1", "proj1", &row.sequence)?;
            let judged = shown.judge(&row.settings, &row.method);
            let refused = judged.as_ref().err().map(|error| format!("{error:#}"));
            cells.push(Cell { method: row.name, case: column.name, refused, judged: judged.ok() });
            progress.step();
        }
    }
    drop(progress);
    print(&rows, &columns, &cells);
    emit(args.json.as_deref(), &cells)?;
    Ok(Outcome::Done)
}

fn columns() -> Result<Vec<Column>> {
    let config = Config::load(Path::new("configs/demo.toml"))?;
    let twin_config = config.twin.as_ref().context("configs/demo.toml: has no [twin]")?;
    let scene = |path: &str| load_scene(Some(Path::new(path)), twin_config);
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
    let plain = DecodeSettings::default();
    let row = |name, sequence, method| Row { name, sequence, settings: plain.clone(), method };
    let own = PhaseMethod::default();
    let by = |method| PhaseMethod::new(Some(method), false, None);
    let quarter = |n: u32| (0..n).map(|i| FRAC_PI_2 * f64::from(i)).collect::<Vec<_>>();
    let mut rows = vec![
        row("three-step", coded(even(16.0, 3)), by(Method::ThreeStep)),
        row("3 steps", coded(even(16.0, 3)), own),
        row("3 steps, harmonics removed", coded(even(16.0, 3)), PhaseMethod::new(None, true, None)),
        row("3 steps, windowed filter", coded(even(16.0, 3)), PhaseMethod::new(None, false, Some(4.0))),
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
        let settings = DecodeSettings { order, fuse, ..DecodeSettings::default() };
        Row { name, sequence, settings, method: PhaseMethod::default() }
    };
    let stair = |steps| PatternSet::Stair { axis: X, stair_px: 8.0, steps };
    let whole = |shift_px| code(6, 16.0, shift_px, Code::Gray);
    rows.extend([
        order("Gray, half stripes", OrderMethod::Gray, false, with(&[code(7, 8.0, 0.0, Code::Gray)])),
        order("Gray, whole stripes", OrderMethod::Gray, false, with(&[whole(0.0)])),
        order("binary, half stripes", OrderMethod::Binary, false, with(&[code(7, 8.0, 0.0, Code::Binary)])),
        order("shifted Gray", OrderMethod::ShiftedGray, false, with(&[whole(0.0), whole(8.0)])),
        order("stairs of phase", OrderMethod::Stair, false, with(&[stair(6)])),
        order("stairs of grey", OrderMethod::Stair, false, with(&[stair(1)])),
        order("hierarchical 16, 96, 608", OrderMethod::Hierarchical, false, sines(&[16.0, 96.0, 608.0])),
        order("heterodyne 16, 17.5, 19.5", OrderMethod::Heterodyne, false, sines(&[16.0, 17.5, 19.5])),
        order("coprime 16, 39", OrderMethod::NumberTheoretical, false, sines(&[16.0, 39.0])),
        order("coprime 16, 17, 19", OrderMethod::NumberTheoretical, false, sines(&[16.0, 17.0, 19.0])),
        order("coprime 16, 17, 19, fused", OrderMethod::NumberTheoretical, true, sines(&[16.0, 17.0, 19.0])),
    ]);
    rows
}

fn print(rows: &[Row], columns: &[Column], cells: &[Cell]) {
    println!("phase error of valid pixels, mrad rms / wrong orders, ppm / valid share of lit pixels, %");
    print!("{:28}", "method");
    for column in columns {
        print!(" {:>22}", column.name);
    }
    println!(" {:>8}", "s/Mpx");
    for (row, cells) in rows.iter().zip(cells.chunks(columns.len())) {
        print!("{:28}", row.name);
        for cell in cells {
            match &cell.judged {
                Some(j) => print!(
                    " {:>22}",
                    format!(
                        "{:.1} / {:.0} / {:.1}",
                        j.rms_rad * 1e3,
                        j.wrong_orders * 1e6,
                        j.valid_share * 100.0
                    )
                ),
                None => print!(" {:>22}", "refused"),
            }
        }
        let mut times: Vec<f64> = cells.iter().filter_map(|c| c.judged.map(|j| j.seconds_per_mpx)).collect();
        times.sort_by(f64::total_cmp);
        println!(" {:>8.3}", times.get(times.len() / 2).copied().unwrap_or(f64::NAN));
    }
    for cell in cells {
        if let Some(reason) = &cell.refused {
            println!("{} on {}: {reason}", cell.method, cell.case);
        }
    }
}

/// What a real recording can tell without a truth.
#[derive(Serialize)]
struct Smoothness {
    method: &'static str,
    view: String,
    refused: Option<String>,
    valid: usize,
    /// Robust standard deviation of the second difference along rows over √6: the noise, where the surface is smooth.
    observed_rad: f64,
    /// Median of the predicted uncertainty.
    predicted_rad: f64,
    /// Places where the absolute phase jumps by whole periods, of all places where it could.
    jumps: f64,
    seconds_per_mpx: f64,
}

/// Methods that a recording's sets may allow, with and without filters.
fn candidates() -> Vec<(&'static str, DecodeSettings, PhaseMethod)> {
    let order = |order, fuse| DecodeSettings { order, fuse, ..DecodeSettings::default() };
    let auto = || DecodeSettings::default();
    let by = |method| PhaseMethod::new(Some(method), false, None);
    vec![
        ("least squares", auto(), PhaseMethod::default()),
        ("least squares, fused", order(OrderMethod::Auto, true), PhaseMethod::default()),
        ("coprime table", order(OrderMethod::NumberTheoretical, false), PhaseMethod::default()),
        ("coprime table, fused", order(OrderMethod::NumberTheoretical, true), PhaseMethod::default()),
        ("harmonics removed", auto(), PhaseMethod::new(None, true, None)),
        ("windowed filter", auto(), PhaseMethod::new(None, false, Some(4.0))),
        ("three-step", auto(), by(Method::ThreeStep)),
        ("Carré", auto(), by(Method::Carre)),
        ("Fourier, rows", auto(), by(Method::FourierRows)),
        ("Fourier, plane", auto(), by(Method::Fourier)),
    ]
}

fn on_recording(folder: &Path, json: Option<&Path>) -> Result<Outcome> {
    let recording = Recording::open(folder)?;
    let mut all = Vec::new();
    println!(
        "{:24} {:>10} {:>10} {:>10} {:>9} {:>8}",
        "method", "valid", "mrad seen", "predicted", "jumps", "s/Mpx"
    );
    for (name, settings, method) in candidates() {
        let start = Instant::now();
        let views = match decode_views_by(&recording, &settings, &method, |_, _| true) {
            Ok(views) => views,
            Err(error) => {
                println!("{name:24} refused: {error:#}");
                let (view, refused) = (String::new(), Some(format!("{error:#}")));
                let none = (f64::NAN, f64::NAN, f64::NAN);
                all.push(Smoothness {
                    method: name,
                    view,
                    refused,
                    valid: 0,
                    observed_rad: none.0,
                    predicted_rad: none.1,
                    jumps: none.2,
                    seconds_per_mpx: none.0,
                });
                continue;
            }
        };
        let pixels: usize = views.iter().flat_map(|v| &v.maps).map(|m| m.map.info.len()).sum();
        let seconds_per_mpx = start.elapsed().as_secs_f64() / (pixels as f64 * 1e-6);
        for (view, decoded) in views.iter().flat_map(|v| v.maps.iter().map(move |m| (v, m))) {
            let (observed_rad, predicted_rad) = smoothness(&decoded.map);
            let row = Smoothness {
                method: name,
                view: format!("{}/{} {:?}", view.projector, view.camera, decoded.map.info.axis),
                refused: None,
                valid: decoded.report.valid,
                observed_rad,
                predicted_rad,
                jumps: decoded.report.continuity.jump_fraction(),
                seconds_per_mpx,
            };
            println!(
                "{name:24} {:>10} {:>10.2} {:>10.2} {:>9.5} {:>8.2}  {}",
                row.valid,
                row.observed_rad * 1e3,
                row.predicted_rad * 1e3,
                row.jumps,
                row.seconds_per_mpx,
                row.view
            );
            all.push(row);
        }
    }
    emit(json, &all)?;
    Ok(Outcome::Done)
}

/// Robust noise along rows (1.4826 · median of the second difference over √6) and the median prediction.
fn smoothness(map: &PhaseMap) -> (f64, f64) {
    let width = map.info.width_px as usize;
    let mut bends = Vec::new();
    for row in 0..map.info.height_px as usize {
        let (phase, valid) =
            (&map.phase_rad[row * width..(row + 1) * width], &map.valid[row * width..(row + 1) * width]);
        let triples = phase.windows(3).zip(valid.windows(3)).filter(|(_, v)| v.iter().all(|v| *v == 1));
        bends.extend(
            triples.map(|(p, _)| wrap_rad(f64::from(p[0]) - 2.0 * f64::from(p[1]) + f64::from(p[2])).abs()),
        );
    }
    let median = |values: &mut Vec<f64>| {
        let middle = values.len() / 2;
        if values.is_empty() { f64::NAN } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    let mut sigma: Vec<f64> = map.sigma_rad.iter().filter(|s| s.is_finite()).map(|s| f64::from(*s)).collect();
    (1.4826 * median(&mut bends) / 6.0_f64.sqrt(), median(&mut sigma))
}
