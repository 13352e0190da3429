//! `fringetool import-rig`: a calibration of OpenCV, ROS, Kalibr, mrcal or MATLAB becomes a rig file.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use files::foreign_rig::{self, Program};
use files::hash::sha256_hex;
use files::opencv::{CalibrationNames, Storage, rig_of_calibration};
use files::rig_file::{parse_rig, rig_text, write_rig};
use fringe::geometry::rig::Rig;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// OpenCV YAML or XML with `M1 D1 M2 D2 R T` (also `K1`, `cameraMatrix1`, …), or `K D` for a single camera; `camera_info` of ROS,
    /// `camchain.yaml` of Kalibr, `.cameramodel` of mrcal, or MATLAB's `jsonencode(toStruct(parameters))`.
    calibration: PathBuf,
    /// A second file with what the first lacks, such as `extrinsics.yml` beside `intrinsics.yml`, or another camera of ROS or
    /// mrcal; repeated for more cameras.
    #[arg(long, value_name = "FILE")]
    and: Vec<PathBuf>,
    /// Rig file to write (TOML, docs/formats.md).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Names of the views in the rig; one name for a single camera. By default `left,right` of OpenCV, of other programs those in
    /// the files, or `cam1,cam2,…`.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    views: Vec<String>,
    /// Image size such as `1280x1024`, where the file has no image_width and image_height.
    #[arg(long)]
    size: Option<String>,
    /// The second view is a projector.
    #[arg(long = "second-is-projector", alias = "projector")]
    projector: bool,
    /// The distortion coefficients of OpenCV's file are k1, k2, k3, k4 of its module `fisheye`.
    #[arg(long)]
    fisheye: bool,
    /// Millimetres per unit of length: 1000 for a calibration in metres. By default 1 of OpenCV and MATLAB, 1000 of ROS, Kalibr
    /// and mrcal.
    #[arg(long, value_name = "MM")]
    unit_mm: Option<f64>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [("--out", Some(args.out.as_path())), ("--json", args.json.as_deref())];
    let inputs: Vec<&Path> =
        std::iter::once(&args.calibration).chain(&args.and).map(PathBuf::as_path).collect();
    check_outputs(&outputs, &inputs, None)?;
    if let Some(unit_mm) = args.unit_mm.filter(|unit_mm| !(unit_mm.is_finite() && *unit_mm > 0.0)) {
        bail!("--unit-mm {unit_mm}: must be a positive number");
    }
    let rig = match Program::of_file(&args.calibration)? {
        Some(program) => of_program(args, program, &inputs)?,
        None => of_opencv(args)?,
    };
    let mut provenance = toml::Table::new();
    provenance.insert("software".into(), format!("fringetool {}", env!("CARGO_PKG_VERSION")).into());
    provenance.insert("calibration".into(), args.calibration.display().to_string().into());
    let bytes = files::document::read_text(&args.calibration)?;
    provenance.insert("calibration_sha256".into(), sha256_hex(bytes.as_bytes()).into());
    for (number, path) in args.and.iter().enumerate() {
        let bytes = files::document::read_text(path)?;
        let key =
            if number == 0 { "calibration_and".to_owned() } else { format!("calibration_and{}", number + 1) };
        provenance.insert(format!("{key}_sha256"), sha256_hex(bytes.as_bytes()).into());
        provenance.insert(key, path.display().to_string().into());
    }
    // Names are checked before anything is written: what is written can be read.
    let text = rig_text(&rig, &provenance, None);
    parse_rig(&args.out, text)?;
    write_rig(&args.out, &rig, &provenance, None)?;
    if let Some(hint) = rig.unit_hint() {
        eprintln!("warning: {}: {hint}; --unit-mm 1000 converts them", args.calibration.display());
    }
    let (cameras, projectors) = (rig.cameras.len(), rig.projectors.len());
    println!("{}: {cameras} cameras, {projectors} projectors", args.out.display());
    let result = serde_json::json!({ "rig": args.out, "cameras": cameras, "projectors": projectors });
    emit(args.json.as_deref(), &result)?;
    Ok(Outcome::Done)
}

/// A calibration of OpenCV, of one camera or two views.
fn of_opencv(args: &Args) -> Result<Rig> {
    let default = || ["left", "right"].map(str::to_owned).to_vec();
    let views = if args.views.is_empty() { default() } else { args.views.clone() };
    if views.len() > 2 {
        bail!("--views {}: name one view or two", views.join(","));
    }
    let mut storage = Storage::read(&args.calibration)?;
    for path in &args.and {
        storage.add(Storage::read(path)?)?;
    }
    let names = CalibrationNames {
        views,
        size_px: args.size.as_deref().map(size).transpose()?,
        projector: args.projector,
        fisheye: args.fisheye,
        unit_mm: args.unit_mm.unwrap_or(1.0),
    };
    Ok(rig_of_calibration(&storage, &names)?)
}

/// A calibration of another program.
fn of_program(args: &Args, program: Program, files: &[&Path]) -> Result<Rig> {
    if args.size.is_some() || args.projector || args.fisheye {
        bail!(
            "--size, --second-is-projector and --fisheye are for OpenCV's files; this one is of {program:?}, and states them"
        );
    }
    Ok(foreign_rig::read(program, files, &args.views, args.unit_mm.unwrap_or_else(|| program.unit_mm()))?)
}

fn size(text: &str) -> Result<(u32, u32)> {
    let form = || format!("--size {text}: write columns x rows, such as 1280x1024");
    let (width, height) = text.split_once('x').with_context(form)?;
    Ok((width.trim().parse().with_context(form)?, height.trim().parse().with_context(form)?))
}
