//! The axis from views of a sphere or of any object.

use super::input::{Axis, View, ViewArg, read};
use super::object::axis_of_object;
use crate::Outcome;
use crate::report::{check_outputs, emit};
use crate::surface::length;
use anyhow::{Context, Result, bail};
use characterise::rotation_stage::{StageCalibration, axis_from_places};
use files::stage_file::write_stage;
use metrology::fit::{self, FitSettings};
use nalgebra::Point3;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// A view (PLY or E57, docs/formats.md) and its angle in degrees, right-handed about the axis, such as `30=view.ply`; repeated for each view.
    #[arg(long = "view", value_name = "DEG=CLOUD", required = true, allow_hyphen_values = true)]
    views: Vec<ViewArg>,
    /// What was on the stage: a sphere beside the axis, or any object whose views overlap.
    #[arg(long, value_enum, default_value_t = Artefact::Sphere)]
    artefact: Artefact,
    /// Sphere: use only points within this distance of its surface, mm.
    #[arg(long, value_name = "MM", default_value = "0.2", value_parser = length)]
    within: f64,
    /// Sphere: fixed diameter, mm; by default it is fitted.
    #[arg(long, value_name = "MM", value_parser = length)]
    diameter: Option<f64>,
    /// Object: approximate axis, a point (mm) and a direction; by default each view is registered to the one before by search.
    #[arg(long, value_name = "x,y,z,dx,dy,dz", allow_hyphen_values = true)]
    rough: Option<Axis>,
    /// Axis file to write (TOML, docs/formats.md).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What was on the stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Artefact {
    /// Its centres determine the axis.
    Sphere,
    /// The alignment of its views does.
    Object,
}

/// An axis whose direction is less sure than this moves what lies 100 mm off by half a millimetre: nothing was measured.
const DIRECTION_LIMIT_RAD: f64 = 5e-3;

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let inputs: Vec<&Path> = args.views.iter().map(|view| view.path.as_path()).collect();
    let outputs = [("--out", Some(args.out.as_path())), ("--json", args.json.as_deref())];
    check_outputs(&outputs, &inputs, None)?;
    let views = read(&args.views)?;
    let found = match args.artefact {
        Artefact::Sphere => axis_from_places(&centres(args, &views)?)?,
        Artefact::Object => axis_of_object(&views, args.rough.map(|Axis(axis)| axis))?,
    };
    // An axis that the views do not determine is not written.
    if found.u_direction_rad.is_nan() || found.u_direction_rad > DIRECTION_LIMIT_RAD {
        bail!(
            "these views do not determine an axis: u of its direction {:.1} mrad, the limit is {} mrad, residual {:.4} mm; are the \
             angles right, is it one sphere in all views (--diameter), did it stay where it was on the stage?",
            found.u_direction_rad * 1e3,
            DIRECTION_LIMIT_RAD * 1e3,
            found.rms_mm
        );
    }
    let mut provenance = toml::Table::new();
    provenance.insert("software".into(), format!("fringetool {}", env!("CARGO_PKG_VERSION")).into());
    let names: Vec<toml::Value> = views.iter().map(|view| view.name.clone().into()).collect();
    provenance.insert("views".into(), names.into());
    write_stage(&args.out, &found, &provenance)?;
    print(&found, &args.out);
    emit(args.json.as_deref(), &found)?;
    Ok(Outcome::Done)
}

fn centres(args: &Args, views: &[View]) -> Result<Vec<(f64, Point3<f64>)>> {
    let centre = |view: &View| -> Result<(f64, Point3<f64>)> {
        let points: Vec<Point3<f64>> = view.points.iter().map(fringe::cloud::Point::position).collect();
        let held = fit::find_sphere(&points, args.diameter, args.within)?;
        let chosen: Vec<Point3<f64>> =
            points.iter().zip(held).filter(|(_, held)| *held).map(|(p, _)| *p).collect();
        let settings = FitSettings::default();
        let sphere = match args.diameter {
            Some(diameter_mm) => fit::sphere_of_diameter(&chosen, diameter_mm, &settings)?,
            None => fit::sphere(&chosen, &settings)?,
        };
        println!(
            "{}: sphere at ({:.4}, {:.4}, {:.4}) mm, diameter {:.4} mm, {} points",
            view.name,
            sphere.center_mm[0],
            sphere.center_mm[1],
            sphere.center_mm[2],
            sphere.diameter_mm,
            chosen.len()
        );
        Ok((view.angle_rad, sphere.center()))
    };
    views.iter().map(|view| centre(view).with_context(|| view.name.clone())).collect()
}

fn print(found: &StageCalibration, out: &Path) {
    let ([x, y, z], [a, b, c]) = (found.point_mm, found.direction);
    println!(
        "axis through ({x:.4}, {y:.4}, {z:.4}) mm along ({a:.6}, {b:.6}, {c:.6}); u across {:.4} mm, u of the direction \
         {:.1} µrad; residual {:.4} mm rms of {} views, arm {:.1} mm -> {}",
        found.u_point_mm,
        found.u_direction_rad * 1e6,
        found.rms_mm,
        found.views,
        found.arm_mm,
        out.display()
    );
}
