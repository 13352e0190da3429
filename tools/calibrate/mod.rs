//! `fringetool calibrate`: from images of a target to the rig file, all cameras and projectors in one adjustment.

pub mod detections;
mod draw;
mod images;
mod lengths;
pub mod model;
mod output;
pub mod projector_reading;
mod report;
mod sensors;
mod shown;
mod target_images;
mod validation;

use crate::Outcome;
use crate::report::check_outputs;
use anyhow::{Context, Result, bail};
use characterise::calibration::{Calibration, LensChoice, Observations, SpacingSettings};
use detections::Gathered;
use lengths::Certified;
use report::Parts;
use sensors::Characterised;
use shown::Shown;
use std::collections::BTreeMap;
use std::path::PathBuf;
use validation::{Plan, Validation};

#[derive(clap::Args)]
pub struct Args {
    /// Target file (TOML: kind, columns, rows, pitch_mm, or several faces; docs/formats.md).
    #[arg(long, value_name = "FILE", required_unless_present = "points")]
    target: Option<PathBuf>,
    /// Rig file to write (TOML, docs/formats.md).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Recordings of the target (docs/formats.md), one for each pose. Projectors are characterised where sine or Gray sets along both axes were recorded.
    recordings: Vec<PathBuf>,
    /// Images instead of recordings, `camera=pattern` with `*`; the n-th image of each camera shows the same pose.
    #[arg(long, value_name = "camera=pattern")]
    images: Vec<String>,
    /// Points that another program found, instead of a target and its images: a file of point lists (TOML, docs/formats.md).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["target", "draw"])]
    points: Option<PathBuf>,
    /// A pair: `name=left,right` or `name=left,right,projector`. By default each projector seen by exactly two cameras makes
    /// one pair.
    #[arg(long, value_name = "name=left,right[,projector]")]
    pair: Vec<String>,
    /// Validate the rig with poses that were not used: a number of groups held out in turn (0: none, default 5 where that is
    /// possible), or the name of a pose to leave out (may be repeated).
    #[arg(long, value_name = "GROUPS|POSE")]
    hold_out: Vec<String>,
    /// A certified length between two points of the target, with its standard uncertainty (k = 1). It is measured in each pose
    /// and compared; the rig is not scaled.
    #[arg(long, value_name = "column,row:column,row=mm[,u_mm]")]
    check_length: Vec<String>,
    /// Folder to write an annotated copy of each image to: detected points and residuals.
    #[arg(long = "pictures", alias = "draw", value_name = "DIR")]
    draw: Option<PathBuf>,
    /// Write a report as one HTML file.
    #[arg(long, alias = "html", value_name = "FILE.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    model: model::Model,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let covariance = files::rig_file::covariance_beside(&args.out);
    let outputs = [
        ("--out", Some(args.out.as_path())),
        ("the covariance of --out", Some(covariance.as_path())),
        ("--report", args.report.as_deref()),
        ("--json", args.json.as_deref()),
    ];
    let (shown, lists) = Shown::read(args)?;
    check_outputs(&outputs, &[shown.file], None)?;
    if let Some(folder) = args.draw.as_ref().filter(|folder| folder.exists() && !folder.is_dir()) {
        bail!("--pictures {}: is a file; name a folder for the images", folder.display());
    }
    let certified = args
        .check_length
        .iter()
        .map(|c| Certified::parse(c, (shown.columns, shown.rows)))
        .collect::<Result<Vec<_>>>()?;
    let gathered = shown.gather(args)?;
    let observations = shown.observations(&gathered, lists)?;
    let solved = solve(args, &gathered, &shown, &observations);
    // A failed calibration needs the images most.
    if let Some(folder) = &args.draw {
        let calibration = solved.as_ref().ok().map(|(calibration, _, _)| calibration);
        draw::write(folder, &gathered, &observations, calibration, shown.columns)?;
    }
    let (calibration, validation, lenses) = solved?;
    let sensors = sensors::characterise(&gathered, &calibration);
    let absent = noted(&gathered, &calibration, &validation, &sensors);
    let pairs = output::pairs(&args.pair, &calibration, &gathered.lit)?;
    let lengths = certified
        .iter()
        .map(|c| c.check(&calibration, &validation, &observations, &pairs))
        .collect::<Result<Vec<_>>>()?;
    let indices: Vec<[usize; 2]> = pairs.iter().map(|(_, devices)| *devices).collect();
    let spacing = calibration
        .volume()
        .and_then(|volume| calibration.sphere_spacing_u_mm(&indices, &volume, &SpacingSettings::default()));
    output::write_rig(&args.out, &calibration, &pairs, &sensors, shown.file)?;
    let parts = Parts {
        rig: &args.out,
        shown: &shown,
        lenses: lenses.as_ref(),
        calibration: &calibration,
        observations: &observations,
        pairs: &pairs,
        spacing,
        validation: &validation,
        lengths: &lengths,
        sensors: &sensors,
        notes: &gathered.notes,
        not_characterised: &absent,
    };
    if let Some(path) = &args.report {
        report::write(path, &parts)?;
    }
    output::print(&parts);
    crate::report::emit(args.json.as_deref(), &output::json(&parts))?;
    println!("{}", args.out.display());
    Ok(Outcome::Done)
}

/// Prints what was left out; the devices that are not characterised, each with the reasons.
fn noted(
    gathered: &Gathered,
    calibration: &Calibration,
    validation: &Validation,
    sensors: &BTreeMap<String, Characterised>,
) -> Vec<(String, String)> {
    let of_model = model::note(calibration).into_iter().chain(validation::notes(validation));
    let of_model = of_model.chain(sensors::notes(sensors));
    for note in gathered.notes.iter().cloned().chain(of_model) {
        eprintln!("{note}");
    }
    for view in &calibration.views {
        let rejected = view.residuals.iter().filter(|residual| !residual.used).count();
        let (all, place) = (view.residuals.len(), gathered.place(view.device, view.pose));
        if rejected == all {
            eprintln!(
                "{place}: none of {all} points fits the others; did the target move between the cameras, or was it seen from behind or in a \
                 mirror?"
            );
        } else if 2 * rejected > all {
            eprintln!(
                "{place}: {rejected} of {all} points do not fit the others and are left out; is it a picture of another camera, or was the \
                 focus or zoom another?"
            );
        }
    }
    let absent = gathered.not_characterised();
    for (device, why) in &absent {
        eprintln!("\"{device}\" is not characterised and not in the rig file: {why}");
    }
    absent
}

/// Calibrates and validates the rig, after checking that the images show the target.
fn solve(
    args: &Args,
    gathered: &Gathered,
    shown: &Shown,
    observations: &Observations,
) -> Result<(Calibration, Validation, Option<LensChoice>)> {
    shown.check(gathered)?;
    let plan = Plan::new(&args.hold_out, observations)?;
    let summary = || match &args.points {
        Some(file) => file.display().to_string(),
        None => gathered.summary(),
    };
    let (settings, lenses) = args.model.chosen(observations).with_context(summary)?;
    let (calibration, validation) = plan.solve(observations, &settings).with_context(summary)?;
    Ok((calibration, validation, lenses))
}
