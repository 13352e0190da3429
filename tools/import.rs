//! `fringetool import`: image files of another system and an OpenCV calibration become a recording and a rig file.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::Result;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Layout (TOML, docs/formats.md) that maps files to frames; tests/layouts/ has examples.
    layout: PathBuf,
    /// Folder of the files to import.
    #[arg(long, value_name = "DIR")]
    from: PathBuf,
    /// Folder to write the recording to (docs/formats.md); with a calibration in the layout also the rig file `rig.toml`.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[&args.layout], Some(&args.out))?;
    let report = files::import::import(&args.layout, &args.from, &args.out)?;
    let rig = report.rig.as_ref().map_or_else(|| "no rig file".to_owned(), |path| path.display().to_string());
    println!("{}: {} frames; {rig}", report.recording.display(), report.frames);
    let result =
        serde_json::json!({ "recording": report.recording, "rig": report.rig, "frames": report.frames });
    emit(args.json.as_deref(), &result)?;
    Ok(Outcome::Done)
}
