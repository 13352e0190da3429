//! `fringetool calibrate`: from pictures of a target to the rig file, all cameras and projectors in one adjustment.

mod images;
mod output;
mod sights;

use crate::Outcome;
use anyhow::{Context, Result, bail};
use fringe::calibration::{CalibrationSettings, SpacingSettings, calibrate};
use fringe::target::TargetSpec;
use rig::recording::Recording;
use sights::Gathered;
use std::path::PathBuf;

/// Arguments of `calibrate`.
#[derive(clap::Args)]
pub struct Args {
    /// What the target is (TOML: kind, columns, rows, pitch_mm).
    #[arg(long)]
    target: PathBuf,
    /// Rig file to write.
    #[arg(long)]
    out: PathBuf,
    /// Recordings of the target, one a pose. Projectors are characterised where both fringe directions were recorded.
    recordings: Vec<PathBuf>,
    /// Pictures instead of recordings, `camera=pattern` with `*`; the n-th picture of each camera shows the same pose.
    #[arg(long, value_name = "camera=pattern")]
    images: Vec<String>,
    /// A pair: `name=left,right` or `name=left,right,projector`. Without it each projector that lit exactly two cameras
    /// makes one.
    #[arg(long, value_name = "name=left,right[,projector]")]
    pair: Vec<String>,
    /// Machine-readable result.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<Outcome> {
    let text = rig::document::read_text(&args.target)?;
    let target = TargetSpec::parse(&text).with_context(|| args.target.display().to_string())?;
    let gathered = gather(args, &target)?;
    gathered.check(&target).with_context(|| args.target.display().to_string())?;
    let observations = gathered.observations(&target);
    let calibration =
        calibrate(&observations, &CalibrationSettings::default()).with_context(|| gathered.summary())?;
    for note in &gathered.notes {
        eprintln!("{note}");
    }
    let pairs = output::pairs(&args.pair, &calibration, &gathered.lit)?;
    let indices = output::pair_indices(&pairs, &calibration);
    let spacing = calibration
        .volume()
        .and_then(|volume| calibration.sphere_spacing_u_mm(&indices, &volume, &SpacingSettings::default()));
    output::write_rig(&args.out, &calibration, pairs, &args.target)?;
    output::print(&calibration, &observations, spacing.as_ref());
    crate::report::emit(args.json.as_deref(), &output::json(&calibration, &observations, spacing.as_ref()))?;
    println!("{}", args.out.display());
    Ok(Outcome::Done)
}

fn gather(args: &Args, target: &TargetSpec) -> Result<Gathered> {
    match (args.recordings.is_empty(), args.images.is_empty()) {
        (true, true) => {
            bail!("neither recordings nor --images: name the recordings of the target, one a pose")
        }
        (false, false) => bail!("recordings and --images together: give one of them"),
        (true, false) => images::gather(&args.images, target),
        (false, true) => {
            let opened =
                args.recordings.iter().map(|path| Ok(Recording::open(path)?)).collect::<Result<Vec<_>>>()?;
            sights::gather(&opened, target)
        }
    }
}
