//! `fringetool cmm-plan`: where a coordinate measuring machine probes, as CSV.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Result, bail};
use files::plan_file::read_plan;
use metrology::fit::tangents;
use metrology::inspection::{Element, Geometry};
use metrology::probing::{self, Probe, Rectangle};
use nalgebra::{Point3, Unit, Vector3};
use serde_json::json;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// All elements of an inspection plan, in the part frame, without what the plan excludes.
    Part {
        /// Inspection plan (TOML, docs/formats.md).
        plan: PathBuf,
        #[command(flatten)]
        common: Common,
    },
    /// A sphere or a cap of one: Hammersley points.
    Sphere {
        /// Diameter of the sphere, mm.
        #[arg(long, value_name = "MM")]
        diameter: f64,
        /// Largest angle from the axis that is probed, degrees (90: the upper half).
        #[arg(long, value_name = "DEG", default_value_t = 90.0)]
        polar_deg: f64,
        #[command(flatten)]
        place: Place,
        #[command(flatten)]
        common: Common,
    },
    /// A rectangle: a grid of cells, one random point in each.
    Plane {
        /// Edge lengths of the rectangle, mm, such as 50x30.
        #[arg(long, value_parser = size)]
        size: [f64; 2],
        #[command(flatten)]
        place: Place,
        #[command(flatten)]
        common: Common,
    },
    /// A cylinder: circles spaced like the points on them (thesis eq. 4.13, 4.14).
    Cylinder {
        /// Diameter of the cylinder, mm.
        #[arg(long, value_name = "MM")]
        diameter: f64,
        /// Height of the cylinder, mm.
        #[arg(long, value_name = "MM")]
        height: f64,
        #[command(flatten)]
        place: Place,
        #[command(flatten)]
        common: Common,
    },
}

#[derive(clap::Args)]
struct Place {
    /// Centre of the element, mm.
    #[arg(long, value_name = "x,y,z", value_parser = vector, allow_hyphen_values = true, default_value = "0,0,0")]
    center: [f64; 3],
    /// Axis of the element; for a plane its normal out of the material.
    #[arg(long, value_name = "x,y,z", value_parser = vector, allow_hyphen_values = true, default_value = "0,0,1")]
    axis: [f64; 3],
}

#[derive(clap::Args)]
struct Common {
    /// Number of points on each element; grids and circles round it up.
    #[arg(long, value_name = "N", default_value_t = 25)]
    points: usize,
    /// Seed of the random positions on planes.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Table to write (CSV): element, number, x, y, z and the normal out of the material.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// More points than anyone probes: a day at a second each.
const MOST_POINTS: usize = 100_000;

/// Longest length that is meant, mm.
const LONGEST_MM: f64 = 1e5;

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let (common, inputs): (&Common, Vec<&Path>) = match &args.what {
        What::Part { plan, common } => (common, vec![plan]),
        What::Sphere { common, .. } | What::Plane { common, .. } | What::Cylinder { common, .. } => {
            (common, vec![])
        }
    };
    check_outputs(&[("--out", Some(&common.out)), ("--json", common.json.as_deref())], &inputs, None)?;
    if !(1..=MOST_POINTS).contains(&common.points) {
        bail!("--points {}: must be 1 … {MOST_POINTS}", common.points);
    }
    let elements = elements(&args.what, common)?;
    let mut rows = Vec::new();
    for (name, probes) in &elements {
        for (number, probe) in probes.iter().enumerate() {
            let mut row = vec![name.clone(), (number + 1).to_string()];
            row.extend(probe.point_mm.iter().map(|v| format!("{v:.4}")));
            row.extend(probe.normal.iter().map(|v| format!("{v:.6}")));
            rows.push(row);
        }
    }
    let header = ["element", "number", "x_mm", "y_mm", "z_mm", "normal_x", "normal_y", "normal_z"];
    files::cmm::write_table(&common.out, &header, &rows)?;
    let counts: Vec<_> =
        elements.iter().map(|(name, p)| json!({ "name": name, "points": p.len() })).collect();
    emit(common.json.as_deref(), &json!({ "table": common.out, "points": rows.len(), "elements": counts }))?;
    for (name, probes) in &elements {
        println!("{name}: {} points", probes.len());
    }
    println!("{}: {} points", common.out.display(), rows.len());
    Ok(Outcome::Done)
}

/// Elements with their points.
fn elements(what: &What, common: &Common) -> Result<Vec<(String, Vec<Probe>)>> {
    let one = |name: &str, probes: Vec<Probe>| Ok(vec![(name.to_owned(), probes)]);
    match what {
        What::Part { plan: path, .. } => {
            let (plan, _) = read_plan(path)?;
            plan.elements.iter().map(|e| Ok((e.name.clone(), of_element(e, common, path)?))).collect()
        }
        What::Sphere { diameter, polar_deg, place, .. } => {
            let radius_mm = 0.5 * length("--diameter", *diameter)?;
            if !(*polar_deg > 0.0 && *polar_deg <= 180.0) {
                bail!("--polar-deg {polar_deg}: must be above 0 and at most 180");
            }
            let cos_polar = [fringe::math::cos(polar_deg.to_radians()), 1.0];
            one(
                "sphere",
                probing::sphere(&place.center(), radius_mm, &place.axis()?, cos_polar, common.points),
            )
        }
        What::Plane { size, place, .. } => {
            let normal = place.axis()?.into_inner();
            let half_size_mm = [0.5 * length("--size", size[0])?, 0.5 * length("--size", size[1])?];
            let rectangle =
                Rectangle { center_mm: place.center(), normal, edges: tangents(&normal), half_size_mm };
            one("plane", probing::plane(&rectangle, common.points, common.seed, &|_| true))
        }
        What::Cylinder { diameter, height, place, .. } => {
            let (radius_mm, height_mm) =
                (0.5 * length("--diameter", *diameter)?, length("--height", *height)?);
            one(
                "cylinder",
                probing::cylinder(&place.center(), &place.axis()?, radius_mm, height_mm, common.points),
            )
        }
    }
}

/// Points on an element of a plan.
fn of_element(element: &Element, common: &Common, plan: &Path) -> Result<Vec<Probe>> {
    match &element.geometry {
        Geometry::Sphere { center_mm, radius_mm, axis, cos_polar } => {
            let axis = Unit::new_normalize(*axis);
            Ok(probing::sphere(center_mm, *radius_mm, &axis, *cos_polar, common.points))
        }
        Geometry::Plane { point_mm, normal, edges, half_size_mm, exclusions } => {
            let rectangle = Rectangle {
                center_mm: *point_mm,
                normal: *normal,
                edges: *edges,
                half_size_mm: *half_size_mm,
            };
            let taken = |across: [f64; 2]| !exclusions.iter().any(|e| e.covers(across));
            let probes = probing::plane(&rectangle, common.points, common.seed, &taken);
            if probes.len() < common.points {
                bail!(
                    "{}: element {}: its exclusions leave no area for {} points",
                    plan.display(),
                    element.name,
                    common.points
                );
            }
            Ok(probes)
        }
        Geometry::Cylinder { point_mm, axis, radius_mm, half_length_mm, internal, .. } => {
            let axis = Unit::new_normalize(*axis);
            let mut probes =
                probing::cylinder(point_mm, &axis, *radius_mm, 2.0 * half_length_mm, common.points);
            if *internal {
                for probe in &mut probes {
                    probe.normal = -probe.normal;
                }
            }
            Ok(probes)
        }
        other => {
            eprintln!(
                "{}: element {}: no points are planned on a {}",
                plan.display(),
                element.name,
                other.kind()
            );
            Ok(Vec::new())
        }
    }
}

impl Place {
    fn center(&self) -> Point3<f64> {
        Point3::from(self.center)
    }

    fn axis(&self) -> Result<Unit<Vector3<f64>>> {
        match Unit::try_new(Vector3::from(self.axis), 1e-9) {
            Some(axis) => Ok(axis),
            None => bail!("--axis: has no length; give a direction such as 0,0,1"),
        }
    }
}

/// Checks that a length is positive.
fn length(flag: &str, value_mm: f64) -> Result<f64> {
    if value_mm > 0.0 && value_mm <= LONGEST_MM {
        return Ok(value_mm);
    }
    bail!("{flag} {value_mm}: must be above 0 and at most {LONGEST_MM} mm")
}

/// Parses three numbers `x,y,z`.
fn vector(text: &str) -> Result<[f64; 3], String> {
    numbers(text, ',')?.try_into().map_err(|_| "three numbers x,y,z".into())
}

/// Parses two edges `AxB`.
fn size(text: &str) -> Result<[f64; 2], String> {
    numbers(text, 'x')?.try_into().map_err(|_| "two edges in mm, such as 50x30".into())
}

fn numbers(text: &str, between: char) -> Result<Vec<f64>, String> {
    let parse = |part: &str| part.trim().parse::<f64>().ok().filter(|v| v.abs() <= LONGEST_MM);
    text.split(between)
        .map(|p| parse(p).ok_or_else(|| format!("\"{p}\" is not a number up to {LONGEST_MM}")))
        .collect()
}
