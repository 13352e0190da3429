//! `fringetool unwrap`: a wrapped phase becomes continuous by its neighbours, absolute where an anchor tells so.

mod input;
mod method;
mod output;

pub use method::Name;

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use fringe::unwrap::{Anchor, unwrap};
use input::Item;
use method::Choice;
use output::Line;
use std::path::{Path, PathBuf};

/// Arguments of `unwrap`.
#[derive(clap::Args)]
pub struct Args {
    /// Folder of a recording, or a wrapped phase in rad (`.npy`, NaN where there is none).
    input: PathBuf,
    #[command(flatten)]
    choice: Choice,
    /// What makes the phase absolute: `none`; `code`: what the recording's code tells; or a file (`.npy`) with the absolute
    /// phase in rad, NaN where it is not known.
    #[arg(long, default_value = "none", value_name = "none|code|FILE")]
    anchor: String,
    /// Only this camera.
    #[arg(long)]
    camera: Option<String>,
    /// Only this projector.
    #[arg(long)]
    projector: Option<String>,
    /// Folder for the wrapped and the unwrapped phase of each view (`….npy`) and its picture (`….png`).
    #[arg(long)]
    out: Option<PathBuf>,
    /// Machine-readable result.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<Outcome> {
    let from_file = args.input.is_file();
    let mut inputs: Vec<&Path> = Vec::new();
    let recording_file = args.input.join(files::recording::RECORDING_FILE);
    inputs.push(if from_file { &args.input } else { &recording_file });
    let anchor_file = (!["none", "code"].contains(&args.anchor.as_str())).then(|| Path::new(&args.anchor));
    inputs.extend(anchor_file);
    check_outputs(&[("--json", args.json.as_deref())], &inputs, args.out.as_deref())?;
    let settings = args.choice.settings()?;
    if from_file && args.anchor == "code" {
        bail!("--anchor code: {} has no code; name a recording, or a file as anchor", args.input.display());
    }
    let items = if from_file {
        vec![input::file(&args.input)?]
    } else {
        input::recording(
            &args.input,
            args.projector.as_deref(),
            args.camera.as_deref(),
            args.anchor == "code",
        )?
    };
    let anchor = anchor_file.map(input::anchor).transpose()?;
    let mut lines = Vec::new();
    for item in &items {
        let absolute_rad = match &anchor {
            Some(raster) => Some(input::fitting(raster, item, Path::new(&args.anchor))?),
            None => item.coded.as_ref().map(|map| map.phase_rad.as_slice()),
        };
        let anchor = absolute_rad.map(|absolute_rad| Anchor { absolute_rad });
        let done = unwrap(&item.wrapped(), anchor.as_ref(), &settings).with_context(|| item.place.clone())?;
        lines.push(Line::new(item, &done));
        if let Some(folder) = &args.out {
            output::write(folder, item, &done)?;
        }
    }
    for line in &lines {
        println!("{line}");
    }
    emit(args.json.as_deref(), &serde_json::json!({ "method": args.choice.name(), "views": lines }))?;
    Ok(Outcome::Done)
}

impl Item {
    fn wrapped(&self) -> fringe::unwrap::Wrapped<'_> {
        fringe::unwrap::Wrapped {
            width_px: self.map.info.width_px,
            height_px: self.map.info.height_px,
            phase_rad: &self.map.phase_rad,
            valid: &self.map.valid,
            modulation: self.measured.then_some(&self.map.modulation),
        }
    }
}
