//! `fringetool unwrap`: a wrapped phase becomes continuous by its neighbours, and absolute by an anchor.

mod input;
mod method;
mod output;

pub use method::Name;

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use fringe::unwrap::{Anchor, unwrap};
use input::{Item, PhaseUnit};
use method::Choice;
use output::Line;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Folder of a recording, or a wrapped phase in rad (`.npy`, NaN where there is none).
    input: PathBuf,
    /// Unit of a phase from a file whose values are not within -π … π or 0 … 2π; a recording needs none.
    #[arg(long, value_enum)]
    phase_unit: Option<PhaseUnit>,
    #[command(flatten)]
    choice: Choice,
    /// What makes the phase absolute: `none`; `code`: the code of the recording; or a file (`.npy`) with the absolute
    /// phase in rad, NaN where it is unknown.
    #[arg(long, default_value = "none", value_name = "none|code|FILE")]
    anchor: String,
    /// Process only this camera.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Process only this projector.
    #[arg(long, value_name = "NAME")]
    projector: Option<String>,
    /// Folder to write the wrapped and the unwrapped phase of each view to (`….npy`), with images (`….png`).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
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
        bail!(
            "--anchor code: {} has no code; give a recording with one, or a file as anchor",
            args.input.display()
        );
    }
    if !from_file && args.phase_unit.is_some() {
        bail!("--phase-unit goes with a phase from a file; a recording knows its own");
    }
    let items = if from_file {
        vec![input::file(&args.input, args.phase_unit)?]
    } else {
        input::recording(
            &args.input,
            args.projector.as_deref(),
            args.camera.as_deref(),
            args.anchor == "code",
        )?
    };
    items.iter().try_for_each(input::has_phase)?;
    let anchor = anchor_file.map(input::anchor).transpose()?;
    let mut lines = Vec::new();
    for item in &items {
        let absolute_rad = match &anchor {
            Some(raster) => Some(input::fitting(raster, item, Path::new(&args.anchor))?),
            None => item.coded.as_ref().map(|map| map.phase_rad.as_slice()),
        };
        if let Some(absolute_rad) = absolute_rad {
            input::reaches(absolute_rad, item, &args.anchor)?;
            if let Some(off_rad) = input::beside(absolute_rad, item).filter(|off| off.abs() > MUCH_BESIDE_RAD)
            {
                println!(
                    "warning: --anchor {}: lies {off_rad:+.2} rad beside the phase of {} (mean less whole turns): is it of the same projector, period and phase unit? The whole \
                     turns that it gives may be wrong by one",
                    args.anchor, item.place
                );
            }
        }
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

/// Mean distance of an anchor from the phase, less whole turns, that a person should know of, rad: a sixth of a turn.
const MUCH_BESIDE_RAD: f64 = 1.0;

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
