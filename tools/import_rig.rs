//! `fringetool import-rig`: a calibration in OpenCV's YAML or XML becomes a rig file.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use files::hash::sha256_hex;
use files::opencv::{CalibrationNames, Storage, rig_of_calibration};
use files::rig_file::{parse_rig, rig_text, write_rig};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// OpenCV YAML or XML with `M1 D1 M2 D2 R T` (also `K1`, `cameraMatrix1`, …), or `K D` for a single camera.
    calibration: PathBuf,
    /// A second file with what the first lacks, such as `extrinsics.yml` beside `intrinsics.yml`.
    #[arg(long, value_name = "FILE")]
    and: Option<PathBuf>,
    /// Rig file to write (TOML, docs/formats.md).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Names of the views in the rig, `left,right`; one name for a single camera.
    #[arg(long, value_name = "NAMES", default_value = "left,right", value_delimiter = ',')]
    views: Vec<String>,
    /// Image size such as `1280x1024`, where the file has no image_width and image_height.
    #[arg(long)]
    size: Option<String>,
    /// The second view is a projector.
    #[arg(long = "second-is-projector", alias = "projector")]
    projector: bool,
    /// Millimetres per unit of T: 1000 for a calibration in metres.
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    unit_mm: f64,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [("--out", Some(args.out.as_path())), ("--json", args.json.as_deref())];
    let inputs: Vec<&std::path::Path> =
        std::iter::once(&args.calibration).chain(&args.and).map(PathBuf::as_path).collect();
    check_outputs(&outputs, &inputs, None)?;
    if !(1..=2).contains(&args.views.len()) {
        bail!("--views {}: name one view or two", args.views.join(","));
    }
    if !(args.unit_mm.is_finite() && args.unit_mm > 0.0) {
        bail!("--unit-mm {}: must be a positive number", args.unit_mm);
    }
    let mut storage = Storage::read(&args.calibration)?;
    if let Some(path) = &args.and {
        storage.add(Storage::read(path)?)?;
    }
    let names = CalibrationNames {
        views: args.views.clone(),
        size_px: args.size.as_deref().map(size).transpose()?,
        projector: args.projector,
        unit_mm: args.unit_mm,
    };
    let rig = rig_of_calibration(&storage, &names)?;
    let mut provenance = toml::Table::new();
    provenance.insert("software".into(), format!("fringetool {}", env!("CARGO_PKG_VERSION")).into());
    provenance.insert("calibration".into(), args.calibration.display().to_string().into());
    let bytes = files::document::read_text(&args.calibration)?;
    provenance.insert("calibration_sha256".into(), sha256_hex(bytes.as_bytes()).into());
    if let Some(path) = &args.and {
        let bytes = files::document::read_text(path)?;
        provenance.insert("calibration_and".into(), path.display().to_string().into());
        provenance.insert("calibration_and_sha256".into(), sha256_hex(bytes.as_bytes()).into());
    }
    // Names are checked before anything is written: what is written can be read.
    let text = rig_text(&rig, &provenance, None);
    parse_rig(&args.out, text)?;
    write_rig(&args.out, &rig, &provenance, None)?;
    let (cameras, projectors) = (rig.cameras.len(), rig.projectors.len());
    println!("{}: {cameras} cameras, {projectors} projectors", args.out.display());
    let result = serde_json::json!({ "rig": args.out, "cameras": cameras, "projectors": projectors });
    emit(args.json.as_deref(), &result)?;
    Ok(Outcome::Done)
}

fn size(text: &str) -> Result<(u32, u32)> {
    let form = || format!("--size {text}: write columns x rows, such as 1280x1024");
    let (width, height) = text.split_once('x').with_context(form)?;
    Ok((width.trim().parse().with_context(form)?, height.trim().parse().with_context(form)?))
}
