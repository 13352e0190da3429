//! `fringetool compare`: compares a cloud with a cloud or a CAD mesh.

mod m3c2;
mod output;

use crate::Outcome;
use crate::register::{summary, with_normals};
use crate::report::check_outputs;
use crate::surface::{Chord, Direction, check_units, length, moved, read_cloud, read_reference, start};
use anyhow::{Context, Result, anyhow, bail};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;
use metrology::compare::{Comparison, Tolerance, compare, compare_with_nearest};
use metrology::reference::Reference;
use metrology::register::{RegisterSettings, Registration, register};
use metrology::verdict::Verdict;
use nalgebra::Vector3;
use output::{Compared, write};
use std::path::{Path, PathBuf};

/// Fewest points of a cloud: a standard deviation takes two.
const LEAST_POINTS: usize = 2;

#[derive(clap::Args)]
pub struct Args {
    /// Cloud to compare (PLY or E57, docs/formats.md), lengths in mm.
    cloud: PathBuf,
    /// Reference: a cloud (PLY, E57), a mesh (STL, PLY with faces, OBJ; lengths in mm), or CAD (STEP, in its own unit).
    reference: PathBuf,
    #[command(flatten)]
    chord: Chord,
    /// Definition of the distances: to the surface of the reference, to its nearest point, or means in cylinders with a level of detection.
    #[arg(long, value_enum, default_value_t = Method::Surface)]
    method: Method,
    /// Register the cloud to the reference first.
    #[arg(long, value_enum, default_value_t = Align::None)]
    align: Align,
    /// Inspection plan (TOML, docs/formats.md) with the datums of `--align rps`; the reference is in its part frame.
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// Start of `--align best-fit`: `search`, `as-it-lies` (identity), or a file with a 4 × 4 matrix.
    #[arg(long, default_value = "search")]
    start: String,
    /// Points farther from the reference than this are counted and left out, mm.
    #[arg(long, value_name = "MM", value_parser = length)]
    max_distance: Option<f64>,
    /// Radius of the neighbourhood that defines the surface of a reference cloud, mm; by default three spacings of its points.
    #[arg(long, value_name = "MM", value_parser = length)]
    radius: Option<f64>,
    /// Direction to the outside of a reference cloud without normals, where it is open; a closed one has its own outside.
    #[arg(long, value_name = "x,y,z", default_value = "0,0,1", allow_hyphen_values = true)]
    towards: Direction,
    /// M3C2: diameters on which normals are tried, mm.
    #[arg(long, value_name = "D,D,…", value_delimiter = ',', value_parser = length)]
    normal_scales: Option<Vec<f64>>,
    /// M3C2: diameter of the cylinder, mm.
    #[arg(long, value_name = "MM", value_parser = length)]
    projection_scale: Option<f64>,
    /// M3C2: edge of the cells that contain one core point each, mm.
    #[arg(long, value_name = "MM", value_parser = length)]
    core: Option<f64>,
    /// M3C2: uncertainty of the alignment, mm.
    #[arg(long = "registration-error", alias = "registration", value_name = "MM", default_value_t = 0.0)]
    registration: f64,
    /// Tolerance band of the deviations, mm: `LOWER,UPPER`, or one number for ± it. The verdict becomes the exit code.
    #[arg(long, value_name = "MM", value_parser = band, allow_hyphen_values = true)]
    tolerance: Option<[f64; 2]>,
    /// Share of the points that may lie outside of the tolerance, %.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, requires = "tolerance")]
    allow_outside: f64,
    /// Upper limit of the colour scale, mm; by default from the data.
    #[arg(long, value_name = "MM", value_parser = length)]
    range: Option<f64>,
    /// Write the cloud with its deviations as `deviation` (mm) and colours (PLY).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write a report with the map of deviations and the histogram (HTML).
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Who measured, for the report.
    #[arg(long, value_name = "NAME")]
    operator: Option<String>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl Args {
    /// Largest distance that is compared, mm.
    fn limit_mm(&self) -> f64 {
        self.max_distance.unwrap_or(f64::INFINITY)
    }
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Method {
    /// Signed along the reference's normal, point by point.
    Surface,
    /// Without a sign, to the nearest point of a cloud or place of a mesh; that to a cloud grows with the spacing of its points.
    Nearest,
    /// Lague, Brodu & Leroux 2013.
    M3c2,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Align {
    /// No registration: as measured.
    None,
    /// Point-to-plane ICP over all points.
    BestFit,
    /// 3-2-1 on the datums of a plan.
    Rps,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [
        ("--out", args.out.as_deref()),
        ("--report", args.report.as_deref()),
        ("--json", args.json.as_deref()),
    ];
    let mut inputs: Vec<&Path> = vec![&args.cloud, &args.reference];
    inputs.extend(args.plan.as_deref());
    check_outputs(&outputs, &inputs, None)?;
    check_flags(args)?;
    let points = read_cloud(&args.cloud)?.points;
    metrology::reference::check(&points, LEAST_POINTS).with_context(|| args.cloud.display().to_string())?;
    let reference = read_reference(&args.reference, &args.chord, args.towards.0, args.radius)?;
    check_units((&args.cloud, &points), (&args.reference, &reference))?;
    let (points, reference, alignment) = align(args, points, reference)?;
    // Without a sign no side is outside.
    let reference = if args.method == Method::Nearest { reference } else { faced(args, reference)? };
    let limit_mm = args.limit_mm();
    let compared = match (args.method, &reference) {
        (Method::Surface, _) => {
            point_by_point(args, (&points, &reference), compare(&points, &reference, limit_mm))?
        }
        (Method::Nearest, _) => {
            let compared = compare_with_nearest(&points, &reference, limit_mm);
            point_by_point(args, (&points, &reference), compared)?
        }
        (Method::M3c2, Reference::Cloud(cloud)) => m3c2::compare(args, &points, cloud)?,
        (Method::M3c2, Reference::Mesh(_)) => {
            bail!("{}: is a mesh; --method m3c2 compares two clouds", args.reference.display())
        }
    };
    write(args, &compared, &reference, &alignment)?;
    if compared.conformity.is_some_and(|conformity| conformity.verdict != Verdict::Pass) {
        return Ok(Outcome::LimitFailed);
    }
    let reliable = match &alignment {
        Alignment::BestFit(found) => found.is_reliable(),
        Alignment::None | Alignment::Rps(_) => true,
    };
    Ok(if reliable { Outcome::Done } else { Outcome::LimitFailed })
}

fn check_flags(args: &Args) -> Result<()> {
    if (args.align == Align::Rps) != args.plan.is_some() {
        bail!("--align rps and --plan go together: the plan names the datums");
    }
    if !(0.0..100.0).contains(&args.allow_outside) {
        bail!("--allow-outside {}: 0 % to less than 100 %", args.allow_outside);
    }
    if args.tolerance.is_some() && args.method != Method::Surface {
        bail!(
            "--tolerance judges signed distances of points: it goes with --method surface; M3C2 has a level of detection instead"
        );
    }
    if args.registration < 0.0 || !args.registration.is_finite() {
        bail!("--registration-error {}: an uncertainty is not negative", args.registration);
    }
    Ok(())
}

/// What was done to bring the cloud onto the reference.
enum Alignment {
    None,
    BestFit(Box<Registration>),
    Rps(Box<metrology::inspection::AlignmentResult>),
}

fn align(
    args: &Args,
    points: Vec<Point>,
    reference: Reference,
) -> Result<(Vec<Point>, Reference, Alignment)> {
    let named = || args.cloud.display().to_string();
    match args.align {
        Align::None => Ok((points, reference, Alignment::None)),
        Align::BestFit => {
            let reference = with_normals(reference);
            let from = start(&args.start)?;
            let found =
                register(&points, &reference, &from, &RegisterSettings::default()).with_context(named)?;
            summary(&found);
            Ok((moved(&points, &found.pose()), reference, Alignment::BestFit(Box::new(found))))
        }
        Align::Rps => {
            let path = args.plan.as_deref().ok_or_else(|| anyhow!("--align rps needs --plan"))?;
            let (plan, _) = files::plan_file::read_plan(path)?;
            let found = metrology::inspection::locate(&plan, &points).with_context(named)?;
            let world_from_part = Pose {
                rotation: nalgebra::Matrix3::from_fn(|r, c| found.rotation[r][c]),
                translation: Vector3::from(found.translation_mm),
            };
            Ok((moved(&points, &world_from_part.inverse()), reference, Alignment::Rps(Box::new(found))))
        }
    }
}

/// Gives a reference cloud without normals an outside, and says which.
fn faced(args: &Args, reference: Reference) -> Result<Reference> {
    let cloud = match reference {
        Reference::Cloud(cloud) if !cloud.has_normals() => cloud,
        other => return Ok(other),
    };
    let named = || args.reference.display().to_string();
    let (cloud, facing) = cloud.faced().with_context(named)?;
    let [x, y, z]: [f64; 3] = args.towards.0.into();
    let outside = match (facing.closed, facing.open) {
        (closed, 0) => format!("{closed} closed surface(s): positive is outside"),
        (0, _) => format!("positive is towards ({x}, {y}, {z}), --towards changes that"),
        (closed, open) => format!(
            "{closed} closed surface(s): positive is outside; {open} open one(s): positive is towards ({x}, {y}, {z}), \
             --towards changes that"
        ),
    };
    eprintln!("{}: has no normals; {outside}", named());
    Ok(Reference::Cloud(cloud))
}

/// Distances of single points.
fn point_by_point(
    args: &Args,
    (points, reference): (&[Point], &Reference),
    compared: Comparison,
) -> Result<Compared> {
    let Some(statistics) = compared.statistics else {
        let c = compared.counts;
        bail!(
            "{}: no point can be compared with {}: {} too far, {} beside it, {} where it has no surface; the clouds do not \
             overlap, or --max-distance is too small: align them first (--align best-fit)",
            args.cloud.display(),
            args.reference.display(),
            c.cut_too_far,
            c.cut_beyond_edge,
            c.cut_no_surface
        );
    };
    let conformity = args.tolerance.and_then(|[lower_mm, upper_mm]| {
        let tolerance = Tolerance { lower_mm, upper_mm, allowed_share: args.allow_outside / 100.0 };
        let of_reference = reference.sigmas_mm(points, args.limit_mm());
        tolerance.judge(points, &of_reference, &compared.deviations)
    });
    let deviations_mm = compared.deviations.iter().map(|d| d.mm()).collect();
    Ok(Compared {
        points: points.to_vec(),
        deviations_mm,
        statistics,
        counts: Some(compared.counts),
        m3c2: None,
        conformity,
    })
}

/// A tolerance band: two limits, or one for both sides.
fn band(text: &str) -> Result<[f64; 2], String> {
    let parts =
        text.split(',').map(|part| part.trim().parse::<f64>().map_err(|error| format!("{part:?}: {error}")));
    match parts.collect::<Result<Vec<f64>, String>>()?[..] {
        [half] if half.is_finite() && half > 0.0 => Ok([-half, half]),
        [lower, upper] if lower.is_finite() && upper.is_finite() && lower < upper => Ok([lower, upper]),
        _ => Err("LOWER,UPPER with LOWER below UPPER, or one number above 0".into()),
    }
}
