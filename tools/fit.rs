//! `fringetool fit`: an element through the points of a cloud, by least squares of the orthogonal distance.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use fringe::fit::{self, FitSettings, Form};
use nalgebra::Point3;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Arguments of `fit`.
#[derive(clap::Args)]
pub struct Args {
    /// Which element.
    #[arg(value_enum)]
    element: Element,
    /// Point cloud (PLY), lengths in mm.
    cloud: PathBuf,
    /// Only points within r of (x, y, z), mm.
    #[arg(long, value_name = "x,y,z,r", allow_hyphen_values = true)]
    near: Option<Near>,
    /// Fraction of the points that is rejected, largest residuals first, 0 … 0.5 (VDI/VDE 2634 part 3 allows 0.03).
    #[arg(long, default_value_t = 0.0)]
    reject: f64,
    /// Sphere only: a given diameter, mm.
    #[arg(long)]
    diameter: Option<f64>,
    /// Edge of the cells within which noise may be correlated, mm; without it points count as independent.
    #[arg(long)]
    cluster: Option<f64>,
    /// Machine-readable result.
    #[arg(long)]
    json: Option<PathBuf>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Element {
    Sphere,
    Plane,
    Cylinder,
    Cone,
}

/// A ball that limits the region.
#[derive(Clone, Copy, Debug)]
struct Near {
    center_mm: Point3<f64>,
    radius_mm: f64,
}

impl FromStr for Near {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text
            .split(',')
            .map(|part| part.trim().parse::<f64>().map_err(|_| format!("\"{part}\" is no number")))
            .collect::<Result<_, _>>()?;
        match numbers.as_slice() {
            [x, y, z, r] if numbers.iter().all(|v| v.is_finite()) && *r > 0.0 => {
                Ok(Self { center_mm: Point3::new(*x, *y, *z), radius_mm: *r })
            }
            _ => Err("four finite numbers x,y,z,r in mm, r above 0".into()),
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[&args.cloud], None)?;
    let cloud = rig::ply::read_cloud(&args.cloud)?;
    if let Some(hint) = cloud.unit_hint() {
        eprintln!("{}: {hint}", args.cloud.display());
    }
    if cloud.dropped > 0 {
        eprintln!("{}: {} points without finite coordinates left out", args.cloud.display(), cloud.dropped);
    }
    let points: Vec<Point3<f64>> = cloud
        .points
        .iter()
        .map(fringe::cloud::Point::position)
        .filter(|p| args.near.is_none_or(|near| (p - near.center_mm).norm() <= near.radius_mm))
        .collect();
    if points.is_empty() {
        bail!(
            "{}: no point {} (the cloud has {})",
            args.cloud.display(),
            if args.near.is_some() { "within --near" } else { "at all" },
            cloud.points.len()
        );
    }
    let settings = FitSettings { max_reject_fraction: args.reject, cluster_mm: args.cluster };
    fit(args, &points, &settings).with_context(|| args.cloud.display().to_string())?;
    Ok(Outcome::Done)
}

fn fit(args: &Args, points: &[Point3<f64>], settings: &FitSettings) -> Result<()> {
    if args.diameter.is_some() && !matches!(args.element, Element::Sphere) {
        bail!("--diameter goes with sphere only");
    }
    let json = args.json.as_deref();
    match args.element {
        Element::Sphere => {
            let sphere = match args.diameter {
                Some(diameter) => fit::sphere_of_diameter(points, diameter, settings)?,
                None => fit::sphere(points, settings)?,
            };
            let [x, y, z] = sphere.center_mm;
            println!(
                "sphere: centre ({x:.5}, {y:.5}, {z:.5}) mm, diameter {:.5} mm, u {:.5} mm",
                sphere.diameter_mm, sphere.u_diameter_mm
            );
            finish(&sphere, &sphere.form, json)
        }
        Element::Plane => {
            let plane = fit::plane(points, settings)?;
            let [x, y, z] = plane.normal;
            println!(
                "plane: normal ({x:.7}, {y:.7}, {z:.7}), offset {:.5} mm, u {:.5} mm",
                plane.offset_mm, plane.u_offset_mm
            );
            finish(&plane, &plane.form, json)
        }
        Element::Cylinder => {
            let cylinder = fit::cylinder(points, settings)?;
            println!("cylinder: diameter {:.5} mm, u {:.5} mm", cylinder.diameter_mm, cylinder.u_diameter_mm);
            print_axis(cylinder.axis_point_mm, cylinder.axis_direction);
            finish(&cylinder, &cylinder.form, json)
        }
        Element::Cone => {
            let cone = fit::cone(points, settings)?;
            println!("cone:");
            print_axis(cone.axis_point_mm, cone.axis_direction);
            finish(&cone, &cone.form, json)
        }
    }
}

fn print_axis([x, y, z]: [f64; 3], [u, v, w]: [f64; 3]) {
    println!("  axis through ({x:.5}, {y:.5}, {z:.5}) mm along ({u:.7}, {v:.7}, {w:.7})");
}

fn finish<T: Serialize>(element: &T, form: &Form, json: Option<&Path>) -> Result<()> {
    println!(
        "  {} points, {} rejected; form: range {:.5} mm, sigma {:.5} mm, 95 % within {:.5} mm",
        form.points, form.rejected, form.form_range_mm, form.form_sigma_mm, form.form_d95_mm
    );
    emit(json, element)
}
