//! `fringetool decode`: phase, modulation and fringe order of a recording, as images and numbers.

use crate::Outcome;
use crate::filters::Filters;
use crate::phase_method::{PhaseArgs, PhaseName};
use crate::pipeline::{DecodedView, Decoding, decode_views_by};
use crate::report::{DecodeLine, check_folder, check_outputs, emit};
use anyhow::{Context, Result};
use cell::executor::Decoded;
use files::atomic;
use files::npy::Raster;
use files::recording::{RECORDING_FILE, RecordedProjector, Recording};
use fringe::decode::Diagnosis;
use fringe::pattern::Axis;
use fringe::phase::PhaseMap;
use report::picture;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Folder of the recording.
    recording: PathBuf,
    /// Folder for the images `<projector>-<camera>-<axis>-phase.png`, `…-modulation.png`, `…-order.png`, and for the rasters
    /// `…-phase.npy` (absolute, rad), `…-sigma.npy` (rad), `…-order.npy` (whole periods), NaN where masked; of one exposure
    /// `…-wrong-order.npy` (probability), `…-threshold.npy` and `…-threshold-u.npy` (DN).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Decode only this camera.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Decode only this projector.
    #[arg(long, value_name = "NAME")]
    projector: Option<String>,
    #[command(flatten)]
    filters: Filters,
    /// Method of the wrapped phase.
    #[arg(long = "phase-method", alias = "method", value_enum, default_value_t)]
    method: PhaseName,
    #[command(flatten)]
    phase: PhaseArgs,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let recording_file = args.recording.join(RECORDING_FILE);
    check_outputs(&[("--json", args.json.as_deref())], &[&recording_file], args.out.as_deref())?;
    if let Some(folder) = &args.out {
        check_folder("--out", folder, &[&recording_file])?;
    }
    let recording = Recording::open(&args.recording)?;
    check_names(args, &recording)?;
    check_json(args, &recording)?;
    let asked = |wanted: &Option<String>, name: &str| wanted.as_deref().is_none_or(|w| w == name);
    let (settings, method) = args.phase.choose(args.method);
    let how = Decoding {
        settings: &settings,
        sensors: &BTreeMap::new(),
        method,
        keep_diagnosis: args.out.is_some(),
    };
    let mut views = decode_views_by(&recording, &how, |projector, camera| {
        asked(&args.projector, projector) && asked(&args.camera, camera)
    })?;
    let filtered = args.filters.apply(&mut views)?;
    if let Some(folder) = &args.out {
        atomic::create_dir(folder)?;
        for view in &views {
            for decoded in &view.maps {
                write_pictures(folder, view, &decoded.map)?;
                write_rasters(folder, view, &decoded.map)?;
                write_diagnosis(folder, view, decoded)?;
            }
        }
    }
    let lines: Vec<DecodeLine> = lines(&views);
    for line in &lines {
        println!("{line}");
    }
    let missing = missing(&recording);
    for note in &missing {
        println!("{note}");
    }
    for line in &filtered {
        println!("{line}");
    }
    emit(
        args.json.as_deref(),
        &serde_json::json!({ "views": lines, "filters": filtered, "missing": missing }),
    )?;
    Ok(Outcome::Done)
}

/// What became of the sets that miss frames, by projector.
pub fn missing(recording: &Recording) -> Vec<String> {
    let of = |p: &RecordedProjector| -> Vec<String> {
        p.notes.iter().map(|note| format!("{}: {note}", p.name)).collect()
    };
    recording.projectors.iter().flat_map(of).collect()
}

/// One line per view and axis.
pub fn lines(views: &[DecodedView]) -> Vec<DecodeLine> {
    let line =
        |view: &DecodedView, decoded: &Decoded| DecodeLine::new(&view.projector, &view.camera, decoded);
    views.iter().flat_map(|view| view.maps.iter().map(move |decoded| line(view, decoded))).collect()
}

fn check_names(args: &Args, recording: &Recording) -> Result<()> {
    let path = recording.document.path.display();
    if let Some(name) = &args.projector
        && recording.projector(name).is_none()
    {
        let known: Vec<&str> = recording.projectors.iter().map(|p| p.name.as_str()).collect();
        anyhow::bail!("{path}: no projector \"{name}\"; known: {}", known.join(", "));
    }
    if let Some(name) = &args.camera
        && recording.projectors.iter().all(|p| p.camera(name).is_none())
    {
        anyhow::bail!("{path}: no camera \"{name}\"; see the key `cameras` of each [[projector]]");
    }
    Ok(())
}

/// Refuses a `--json` with the name of a file that the maps of a view get.
fn check_json(args: &Args, recording: &Recording) -> Result<()> {
    let (Some(json), Some(folder)) = (&args.json, &args.out) else { return Ok(()) };
    let beside = json
        .parent()
        .is_some_and(|parent| parent.canonicalize().ok() == folder.canonicalize().ok() || parent == folder);
    let name = json.file_name().unwrap_or_default().to_string_lossy();
    let of_view = |p: &RecordedProjector| {
        p.cameras.iter().any(|camera| name.starts_with(&format!("{}-{}-", p.name, camera.name)))
    };
    if beside && !name.ends_with(".json") && recording.projectors.iter().any(of_view) {
        anyhow::bail!("--json {}: is a name of the files of --out; name another file", json.display());
    }
    Ok(())
}

/// Beginning of the names of a map's files.
fn stem(view: &DecodedView, map: &PhaseMap) -> String {
    let axis = match map.info.axis {
        Axis::X => "x",
        Axis::Y => "y",
    };
    format!("{}-{}-{axis}", view.projector, view.camera)
}

/// What the order of each pixel rests on; NaN where it is masked.
fn write_diagnosis(folder: &Path, view: &DecodedView, decoded: &Decoded) -> Result<()> {
    type Part = fn(&Diagnosis) -> f32;
    let parts: [(&str, Part); 3] = [
        ("wrong-order", |d| d.wrong_order),
        ("threshold", |d| d.threshold_dn),
        ("threshold-u", |d| d.u_threshold_dn),
    ];
    let (width_px, height_px) = (decoded.map.info.width_px, decoded.map.info.height_px);
    for (what, part) in parts {
        let values: Vec<f32> = decoded.diagnosis.iter().map(part).collect();
        if values.iter().any(|value| !value.is_nan()) {
            let path = folder.join(format!("{}-{what}.npy", stem(view, &decoded.map)));
            files::npy::write(&path, &Raster { width_px, height_px, values })?;
        }
    }
    Ok(())
}

/// Phase, its standard uncertainty and the order as numbers.
fn write_rasters(folder: &Path, view: &DecodedView, map: &PhaseMap) -> Result<()> {
    let (width_px, height_px) = (map.info.width_px, map.info.height_px);
    let valid = |values: &[f32]| -> Vec<f32> {
        values.iter().zip(&map.valid).map(|(v, valid)| if *valid == 1 { *v } else { f32::NAN }).collect()
    };
    let phase = valid(&map.phase_rad);
    let order = phase.iter().map(|v| (v / std::f32::consts::TAU).floor()).collect();
    for (what, values) in [("sigma", valid(&map.sigma_rad)), ("order", order), ("phase", phase)] {
        let path = folder.join(format!("{}-{what}.npy", stem(view, map)));
        files::npy::write(&path, &Raster { width_px, height_px, values })?;
    }
    Ok(())
}

/// Pictures of phase, modulation and order of one map.
pub fn write_pictures(folder: &Path, view: &DecodedView, map: &PhaseMap) -> Result<()> {
    let phase = map.view();
    let pictures = [
        ("phase", picture::phase_png(&phase)),
        ("modulation", picture::modulation_png(&phase)),
        ("order", picture::order_png(&phase)),
    ];
    for (what, png) in pictures {
        let path = folder.join(format!("{}-{what}.png", stem(view, map)));
        let png = png.with_context(|| path.display().to_string())?;
        atomic::write(&path, &png)?;
    }
    Ok(())
}
