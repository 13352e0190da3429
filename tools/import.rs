//! `fringetool import`: other people's image files and OpenCV calibration become a recording and a rig file.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::Result;
use std::path::PathBuf;

/// Arguments of `import`.
#[derive(clap::Args)]
pub struct Args {
    /// Layout (TOML) that says which file is which frame; tests/layouts/ has examples.
    layout: PathBuf,
    /// Folder of the foreign files.
    #[arg(long)]
    from: PathBuf,
    /// Folder for the recording; when the layout has a calibration, the rig file goes into it as `rig.toml`.
    #[arg(long)]
    out: PathBuf,
    /// Machine-readable result.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Runs the command.
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
