//! What each source of error of section 2.4 does to the phase and to the point, on the twin.

use super::accuracy::{Bench, Case};
use super::shown::{Evaluated, Shown};
use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit_bare};
use anyhow::Result;
use cell::executor::PhaseMethod;
use fringe::decode::DecodeSettings;
use fringe::frame::{FrameView, Pixels};
use serde::Serialize;
use std::path::{Path, PathBuf};
use twin::{Twin, TwinSettings};

#[derive(clap::Args)]
pub struct Args {
    /// Columns of the camera, px; the rows keep the aspect ratio. The demo has 1124.
    #[arg(long, value_name = "PX", default_value_t = 562)]
    width_px: u32,
    /// Image of the phase errors (PNG), one tile for each source in the order of the table: grey is zero, black and white are ∓ 0.1 rad.
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Serialize)]
struct Row {
    source: &'static str,
    phase: Evaluated,
    point_rms_um: f64,
    point_mean_um: f64,
    outliers: usize,
    points: usize,
}

/// Error in the image that is black or white, rad.
const PICTURE_RAD: f32 = 0.1;
/// Tiles of a row of the image.
const TILES: usize = 4;

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [("--picture", args.picture.as_deref()), ("--json", args.json.as_deref())];
    check_outputs(&outputs, &[], None)?;
    if !(64..=4496).contains(&args.width_px) {
        return super::out_of_range("--width-px", args.width_px.into(), "64 to 4496");
    }
    let rig = twin::thesis::rig(args.width_px, args.width_px * 750 / 1124);
    let bench = Bench { rig, ..Bench::demo()? };
    let cases = cases();
    let mut progress = Progress::new(cases.len(), "measuring");
    let (mut rows, mut tiles) = (Vec::new(), Vec::new());
    for (source, settings) in cases {
        let twin = Twin::new(&bench.scene, settings.clone(), &bench.rig)?;
        let shown = Shown::new(&twin, &bench.rig, "cam1", "proj1", &bench.sequence)?;
        // Every pixel counts, whatever light it gets.
        let decode = DecodeSettings { max_bounce_rad: 0.0, ..DecodeSettings::default() };
        let method = PhaseMethod::default();
        let phase = shown.evaluate(&decode, method)?;
        tiles.push(shown.errors_rad(&shown.decode(&decode, method)?.0)?.0);
        let point = bench.measure(Case { name: source, settings, quiet: None, lens: true })?;
        rows.push(Row {
            source,
            phase,
            point_rms_um: point.rms_um,
            point_mean_um: point.mean_um,
            outliers: point.outliers,
            points: point.points,
        });
        progress.step();
    }
    drop(progress);
    print(&rows);
    if let Some(path) = &args.picture {
        write_picture(path, &tiles, args.width_px as usize)?;
        println!("{}", path.display());
    }
    emit_bare(args.json.as_deref(), &rows)?;
    Ok(Outcome::Done)
}

/// Each source alone, on top of a twin without imperfections but with a footprint, and all together.
fn cases() -> Vec<(&'static str, TwinSettings)> {
    let real = TwinSettings { position_scatter_mm: 0.0, angle_scatter_deg: 0.0, ..TwinSettings::default() };
    let ideal = TwinSettings::ideal();
    let with = |change: &dyn Fn(&mut TwinSettings)| {
        let mut settings = ideal.clone();
        change(&mut settings);
        settings
    };
    vec![
        ("none", ideal.clone()),
        ("gamma 1.2", with(&|s| s.projector_gamma = 1.2)),
        ("gamma 2.2", with(&|s| s.projector_gamma = 2.2)),
        ("noise, full well 10 500 e", with(&|s| (s.shot_noise, s.read_noise_e) = (true, 7.0))),
        (
            "noise, a quarter of the light",
            with(&|s| (s.shot_noise, s.read_noise_e, s.exposure) = (true, 7.0, 0.25)),
        ),
        ("defocus 0.05 px/mm", with(&|s| s.defocus_px_per_mm = 0.05)),
        ("defocus 0.2 px/mm", with(&|s| s.defocus_px_per_mm = 0.2)),
        ("camera blur 1 px", with(&|s| s.camera_blur_px = 1.0)),
        ("vibration 1 µm", with(&|s| s.vibration_um = 1.0)),
        ("vibration 10 µm", with(&|s| s.vibration_um = 10.0)),
        ("drift 5 µm a frame", with(&|s| s.drift_um = 5.0)),
        ("ambient 20 %, shot noise", with(&|s| (s.ambient, s.shot_noise) = (0.2, true))),
        ("saturation, exposure 1.6", with(&|s| s.exposure = 1.6)),
        ("first bounce, 32 rays", with(&|s| s.bounce_rays = 32)),
        ("quantisation 8 bits", with(&|s| s.bits = 8)),
        ("all, as in the demo", real),
    ]
}

fn print(rows: &[Row]) {
    println!(
        "{:32} {:>10} {:>10} {:>10} {:>9} {:>9} {:>10} {:>10} {:>8} {:>8}",
        "source",
        "phase mrad",
        "mean mrad",
        "predicted",
        "wrong ppm",
        "valid %",
        "point µm",
        "mean µm",
        "outliers",
        "points"
    );
    for row in rows {
        let p = &row.phase;
        println!(
            "{:32} {:>10.2} {:>+10.2} {:>10.2} {:>9.0} {:>9.2} {:>10.2} {:>+10.2} {:>8} {:>8}",
            row.source,
            p.rms_rad * 1e3,
            p.mean_rad * 1e3,
            p.sigma_rad * 1e3,
            p.wrong_orders * 1e6,
            p.valid_share * 100.0,
            row.point_rms_um,
            row.point_mean_um,
            row.outliers,
            row.points
        );
    }
}

fn write_picture(path: &Path, tiles: &[Vec<f32>], width: usize) -> Result<()> {
    let height = tiles.first().map_or(0, |tile| tile.len() / width);
    let (columns, rows) = (TILES * width, tiles.len().div_ceil(TILES) * height);
    let mut picture = vec![40_u8; columns * rows];
    for (number, tile) in tiles.iter().enumerate() {
        let (left, top) = (number % TILES * width, number / TILES * height);
        for (i, error) in tile.iter().enumerate().filter(|(_, error)| !error.is_nan()) {
            let at = (top + i / width) * columns + left + i % width;
            picture[at] = (128.0 + 127.0 * (error / PICTURE_RAD).clamp(-1.0, 1.0)) as u8;
        }
    }
    let frame = FrameView {
        width_px: columns as u32,
        height_px: rows as u32,
        full_scale_dn: 255,
        pixels: Pixels::Mono8(&picture),
    };
    Ok(files::image_file::write_png(path, &frame)?)
}
