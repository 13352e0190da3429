//! Views brought together by the axis, refined by ICP, fused.

use super::input::{View, ViewArg, check_near, middle, onto, read, trusted};
use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use crate::surface::{length, moved};
use anyhow::Result;
use characterise::rotation_stage::StageAxis;
use files::stage_file::read_stage;
use fringe::cloud::Point;
use fringe::fusion::{Fuser, FusionReport, FusionSettings};
use fringe::geometry::pose::Pose;
use metrology::register::InitialPose;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Axis file (from `rotation-stage calibrate`; docs/formats.md).
    #[arg(long, value_name = "FILE")]
    stage: PathBuf,
    /// A view (PLY or E57, docs/formats.md) and its angle in degrees, such as `30=view.ply`; repeated for each view. All are moved to angle 0.
    #[arg(long = "view", value_name = "DEG=CLOUD", required = true, allow_hyphen_values = true)]
    views: Vec<ViewArg>,
    /// Use the axis alone, without ICP.
    #[arg(long)]
    no_refine: bool,
    /// Largest distance of a match in ICP, and largest motion of a view by it, mm.
    #[arg(long, value_name = "MM", default_value = "1", value_parser = length)]
    reach: f64,
    /// Merged cloud to write (PLY).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What became of a view.
#[derive(Debug, Serialize)]
struct Placed {
    cloud: String,
    angle_deg: f64,
    points: usize,
    /// Whether the pose comes from ICP or from the axis.
    refined: bool,
    /// How far ICP moved the middle of the view, mm.
    moved_mm: f64,
    /// Distance of the matches, mm; absent for the first view and without ICP.
    rms_mm: Option<f64>,
    /// Why the result of ICP was not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let mut inputs: Vec<&Path> = args.views.iter().map(|view| view.path.as_path()).collect();
    inputs.push(&args.stage);
    let outputs = [("--out", Some(args.out.as_path())), ("--json", args.json.as_deref())];
    check_outputs(&outputs, &inputs, None)?;
    let axis = read_stage(&args.stage)?;
    let views = read(&args.views)?;
    let (clouds, placed) = place(args, &axis, &views)?;
    let slices: Vec<&[Point]> = clouds.iter().map(Vec::as_slice).collect();
    let mut merged = Vec::new();
    // Each view has pictures of its own.
    let mut fuser = Fuser::of_pictures((0..slices.len()).map(|view| vec![view]).collect());
    let fusion = fuser.fuse(&slices, &FusionSettings::default(), &mut merged).clone();
    let stage = args.stage.display().to_string();
    let software = concat!("fringetool ", env!("CARGO_PKG_VERSION"));
    files::ply::write_cloud(&args.out, &merged, &[("stage", &stage), ("software", software)])?;
    print(&placed, &fusion, merged.len(), &args.out);
    let json = serde_json::json!({ "points": merged.len(), "views": placed, "fusion": fusion });
    emit(args.json.as_deref(), &json)?;
    Ok(Outcome::Done)
}

/// Each view by the axis, then onto all views before it.
fn place(args: &Args, axis: &StageAxis, views: &[View]) -> Result<(Vec<Vec<Point>>, Vec<Placed>)> {
    let mut progress = Progress::new(views.len(), "aligning");
    let (mut clouds, mut placed): (Vec<Vec<Point>>, Vec<Placed>) = (Vec::new(), Vec::new());
    let mut there: Vec<Point> = Vec::new();
    for (number, view) in views.iter().enumerate() {
        let by_axis = axis.back(view.angle_rad);
        let (pose, report) = if number == 0 || args.no_refine {
            (by_axis, Placed::by_axis(view, None))
        } else {
            refine(args, view, &there, &by_axis)?
        };
        let mut points = moved(&view.points, &pose);
        for point in &mut points {
            point.pair = number as u32;
        }
        there.extend_from_slice(&points);
        clouds.push(points);
        placed.push(report);
        progress.step();
    }
    Ok((clouds, placed))
}

fn refine(args: &Args, view: &View, there: &[Point], by_axis: &Pose) -> Result<(Pose, Placed)> {
    let found = match onto(view, there, InitialPose::Given(*by_axis), Some(args.reach)) {
        Ok(found) if trusted(&found) => found,
        Ok(found) => {
            let free = found.undetermined.first().map(metrology::register::Freedom::describe);
            let reason = free.map_or("did not converge".to_owned(), |free| format!("undetermined: {free}"));
            return Ok((*by_axis, Placed::by_axis(view, Some(reason))));
        }
        // Views that do not overlap are as good as the axis.
        Err(error) => return Ok((*by_axis, Placed::by_axis(view, Some(format!("{error:#}"))))),
    };
    let at = middle(&view.points);
    let moved_mm = check_near(&found.pose(), by_axis, &at, args.reach, &view.name)?;
    let placed =
        Placed { refined: true, moved_mm, rms_mm: Some(found.rms_mm), ..Placed::by_axis(view, None) };
    Ok((found.pose(), placed))
}

impl Placed {
    fn by_axis(view: &View, reason: Option<String>) -> Self {
        Self {
            cloud: view.name.clone(),
            angle_deg: view.angle_deg,
            points: view.points.len(),
            refined: false,
            moved_mm: 0.0,
            rms_mm: None,
            reason,
        }
    }
}

fn print(placed: &[Placed], fusion: &FusionReport, points: usize, out: &Path) {
    for view in placed {
        let how = match (&view.reason, view.rms_mm) {
            (Some(reason), _) => format!("by the axis alone ({reason})"),
            (None, Some(rms_mm)) => format!("refined by {:.4} mm, {rms_mm:.4} mm rms", view.moved_mm),
            (None, None) => "by the axis".to_owned(),
        };
        println!("{} at {}°: {} points, {how}", view.cloud, view.angle_deg, view.points);
    }
    for o in &fusion.overlaps {
        println!("overlap {} – {}: {o}", placed[o.a].cloud, placed[o.b].cloud);
    }
    println!("{}: {points} points", out.display());
}
