//! `fringetool calibrate`: from pictures of a target to the rig file, all cameras and projectors in one adjustment.

mod draw;
mod images;
mod lengths;
pub mod model;
mod output;
mod report;
mod shots;
pub mod sights;
mod validation;

use crate::Outcome;
use crate::report::check_outputs;
use anyhow::{Context, Result, bail};
use characterise::calibration::{Calibration, Observations, SpacingSettings};
use characterise::target::TargetSpec;
use files::recording::Recording;
use lengths::Certified;
use report::Parts;
use sights::Gathered;
use std::path::PathBuf;
use validation::{Plan, Validation};

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
    /// Judge the rig by poses that it does not know: a number of groups held out in turn (0: none, default 5 where that is
    /// possible), or the name of a pose that the rig shall not know (may be repeated).
    #[arg(long, value_name = "GROUPS|POSE")]
    hold_out: Vec<String>,
    /// A certified length between two points of the target, with its standard uncertainty (k = 1): it is measured in each pose
    /// and compared; nothing is scaled.
    #[arg(long, value_name = "column,row:column,row=mm[,u_mm]")]
    check_length: Vec<String>,
    /// Folder for a picture of each image with what was found in it and its residuals.
    #[arg(long, value_name = "DIR")]
    draw: Option<PathBuf>,
    /// Report for people: one HTML file.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    model: model::Model,
    /// Machine-readable result.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [
        ("--out", Some(args.out.as_path())),
        ("--report", args.report.as_deref()),
        ("--json", args.json.as_deref()),
    ];
    check_outputs(&outputs, &[&args.target], None)?;
    if let Some(folder) = args.draw.as_ref().filter(|folder| folder.exists() && !folder.is_dir()) {
        bail!("--draw {}: is a file; name a folder for the pictures", folder.display());
    }
    let text = files::document::read_text(&args.target)?;
    let target = TargetSpec::parse(&text).with_context(|| args.target.display().to_string())?;
    let certified =
        args.check_length.iter().map(|c| Certified::parse(c, &target)).collect::<Result<Vec<_>>>()?;
    let gathered = gather(args, &target)?;
    let observations = gathered.observations(&target);
    let solved = solve(args, &gathered, &target, &observations);
    // A failed calibration needs the pictures most.
    if let Some(folder) = &args.draw {
        let calibration = solved.as_ref().ok().map(|(calibration, _)| calibration);
        draw::write(folder, &gathered, &observations, calibration, target.columns)?;
    }
    let (calibration, validation) = solved?;
    let of_model = model::note(&calibration).into_iter().chain(validation::notes(&validation));
    for note in gathered.notes.iter().cloned().chain(of_model) {
        eprintln!("{note}");
    }
    let pairs = output::pairs(&args.pair, &calibration, &gathered.lit)?;
    let lengths = certified
        .iter()
        .map(|c| c.check(&calibration, &validation, &observations, &pairs))
        .collect::<Result<Vec<_>>>()?;
    let indices: Vec<[usize; 2]> = pairs.iter().map(|(_, devices)| *devices).collect();
    let spacing = calibration
        .volume()
        .and_then(|volume| calibration.sphere_spacing_u_mm(&indices, &volume, &SpacingSettings::default()));
    output::write_rig(&args.out, &calibration, &pairs, &args.target)?;
    let parts = Parts {
        rig: &args.out,
        target_file: &args.target,
        target: &target,
        calibration: &calibration,
        observations: &observations,
        pairs: &pairs,
        spacing,
        validation: &validation,
        lengths: &lengths,
        notes: &gathered.notes,
    };
    if let Some(path) = &args.report {
        report::write(path, &parts)?;
    }
    output::print(&parts);
    crate::report::emit(args.json.as_deref(), &output::json(&parts))?;
    println!("{}", args.out.display());
    Ok(Outcome::Done)
}

/// Calibrates and judges the rig, once it is clear that the pictures show the target.
fn solve(
    args: &Args,
    gathered: &Gathered,
    target: &TargetSpec,
    observations: &Observations,
) -> Result<(Calibration, Validation)> {
    gathered.check(target).with_context(|| args.target.display().to_string())?;
    let plan = Plan::new(&args.hold_out, observations)?;
    plan.solve(observations, &args.model.settings()).with_context(|| gathered.summary())
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
