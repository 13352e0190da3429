//! `fringetool fit`: an element through the points of a cloud, by least squares of the orthogonal distance.

mod print;
pub mod region;

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use metrology::fit::{
    self, CircleZone, Correlation, CylinderZone, FitError, FitSettings, PlaneZone, Residuals, SphereZone,
};
use nalgebra::Point3;
use print::Describe;
use region::{Chosen, Corners, Left, Near};
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Element that is fitted to the cloud.
    #[arg(value_enum)]
    element: Element,
    /// Point cloud (PLY or E57), lengths in mm.
    cloud: PathBuf,
    /// Use only points within r of (x, y, z), mm.
    #[arg(long, value_name = "x,y,z,r", allow_hyphen_values = true)]
    near: Option<Near>,
    /// Use only points between these two corners, mm.
    #[arg(long = "box", value_name = "x0,y0,z0,x1,y1,z1", allow_hyphen_values = true)]
    corners: Option<Corners>,
    /// Sphere and plane: use only points within this distance of the element that most points of the region agree on, mm.
    /// The search draws its samples with a fixed seed; the number of points left out is reported.
    #[arg(long, value_name = "MM")]
    within: Option<f64>,
    /// Fraction of the points to reject, largest residuals first, 0 … 0.5 (VDI/VDE 2634 part 3 allows 0.03).
    #[arg(long = "reject-fraction", alias = "reject", value_name = "F", default_value_t = 0.0)]
    reject: f64,
    /// Sphere only: fixed diameter, mm.
    #[arg(long, value_name = "MM")]
    diameter: Option<f64>,
    /// Sphere only: fixed radius, mm.
    #[arg(long, value_name = "MM", conflicts_with = "diameter")]
    radius: Option<f64>,
    /// Also compute the minimum zone (Chebyshev) of the points used: sphere, plane, cylinder, circle.
    #[arg(long)]
    minimum_zone: bool,
    /// Edge of the cells within which noise is correlated, mm; by default the correlation is estimated from the
    /// residuals.
    #[arg(long, value_name = "MM")]
    cluster: Option<f64>,
    /// Treat points as independent: uncertainties are too small wherever neighbours share noise.
    #[arg(long, conflicts_with = "cluster")]
    independent: bool,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Element {
    Sphere,
    Plane,
    Cylinder,
    Cone,
    Circle,
    Line,
    Torus,
}

/// The fit with its minimum zone.
#[derive(Serialize)]
struct Report<'a, F: Serialize, Z: Serialize> {
    #[serde(flatten)]
    fit: &'a F,
    #[serde(flatten)]
    left: Left,
    #[serde(skip_serializing_if = "Option::is_none")]
    minimum_zone_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    minimum_zone: Option<Z>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[&args.cloud], None)?;
    refuse_strays(args)?;
    let cloud = crate::surface::read_cloud_in_mm(&args.cloud)?;
    let chosen = region::choose(args, &cloud)?;
    fit(args, &chosen).with_context(|| args.cloud.display().to_string())?;
    Ok(Outcome::Done)
}

/// Options that mean nothing for the element.
fn refuse_strays(args: &Args) -> Result<()> {
    let Args { element, .. } = args;
    if *element != Element::Sphere && (args.diameter.is_some() || args.radius.is_some()) {
        bail!("--diameter and --radius are for spheres only; leave them out");
    }
    if args.within.is_some() && !matches!(element, Element::Sphere | Element::Plane) {
        bail!("--within is for sphere and plane only; limit the region with --near");
    }
    if args.minimum_zone && matches!(element, Element::Cone | Element::Line | Element::Torus) {
        bail!("--minimum-zone is for sphere, plane, cylinder and circle only; leave it out");
    }
    Ok(())
}

impl Args {
    /// The diameter that is given, mm.
    fn given_diameter_mm(&self) -> Option<f64> {
        self.diameter.or(self.radius.map(|radius| 2.0 * radius))
    }

    fn settings(&self) -> FitSettings<'static> {
        let correlation = match self.cluster {
            Some(edge) => Correlation::Cells(edge),
            None if self.independent => Correlation::Independent,
            None => Correlation::Estimated,
        };
        FitSettings {
            max_reject_fraction: self.reject,
            within_mm: self.within,
            correlation,
            ..FitSettings::default()
        }
    }
}

fn fit(args: &Args, chosen: &Chosen) -> Result<()> {
    let points = &chosen.points[..];
    let settings = FitSettings { shared_mm: &chosen.shared_mm, ..args.settings() };
    let job = Job { args, points, left: chosen.left };
    match args.element {
        Element::Sphere => {
            let sphere = match args.given_diameter_mm() {
                Some(diameter) => fit::sphere_of_diameter(points, diameter, &settings)?,
                None => fit::sphere(points, &settings)?,
            };
            job.finish(&sphere, &sphere.residuals, Some(fit::sphere_minimum_zone))
        }
        Element::Plane => {
            let plane = fit::plane(points, &settings)?;
            job.finish(&plane, &plane.residuals, Some(fit::plane_minimum_zone))
        }
        Element::Cylinder => {
            let cylinder = fit::cylinder(points, &settings)?;
            job.finish(&cylinder, &cylinder.residuals, Some(fit::cylinder_minimum_zone))
        }
        Element::Circle => {
            let circle = fit::circle(points, &settings)?;
            job.finish(&circle, &circle.residuals, Some(fit::circle_minimum_zone))
        }
        Element::Cone => {
            let cone = fit::cone(points, &settings)?;
            job.finish(&cone, &cone.residuals, NO_ZONE)
        }
        Element::Torus => {
            let torus = fit::torus(points, &settings)?;
            job.finish(&torus, &torus.residuals, NO_ZONE)
        }
        Element::Line => {
            let line = fit::line(points, &settings)?;
            job.finish(&line, &line.residuals, NO_ZONE)
        }
    }
}

/// A minimum zone of any element.
trait Zone: Serialize {
    fn width_mm(&self) -> f64;
}

macro_rules! zones {
    ($($zone:ty),*) => { $(impl Zone for $zone {
        fn width_mm(&self) -> f64 {
            self.minimum_zone_mm
        }
    })* };
}
zones!(SphereZone, PlaneZone, CylinderZone, CircleZone);

/// How a zone is found.
type Finder<Z> = fn(&[Point3<f64>]) -> Result<Z, FitError>;

/// For elements whose minimum zone is not computed; `refuse_strays` refuses these.
const NO_ZONE: Option<Finder<PlaneZone>> = None;

/// What is printed and written about.
struct Job<'a> {
    args: &'a Args,
    points: &'a [Point3<f64>],
    left: Left,
}

impl Job<'_> {
    /// Prints and writes a fit, with its minimum zone where requested.
    fn finish<F: Serialize + Describe, Z: Zone>(
        self,
        fit: &F,
        residuals: &Residuals,
        find: Option<impl Fn(&[Point3<f64>]) -> Result<Z, FitError>>,
    ) -> Result<()> {
        let used = self.points.iter().zip(&residuals.used).filter(|(_, used)| **used);
        let used = || used.map(|(point, _)| *point).collect::<Vec<_>>();
        let minimum_zone = find.filter(|_| self.args.minimum_zone).map(|find| find(&used())).transpose()?;
        let minimum_zone_mm = minimum_zone.as_ref().map(Zone::width_mm);
        let report = Report { fit, left: self.left, minimum_zone_mm, minimum_zone };
        emit(self.args.json.as_deref(), &report)?;
        print::print(fit, &self.left, minimum_zone_mm);
        Ok(())
    }
}
