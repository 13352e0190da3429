//! `fringetool convert`: clouds as other programs want them: E57, thinned, or as a mesh.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use crate::surface::{length, read_cloud_in_mm};
use anyhow::{Context, Result, bail, ensure};
use files::ply::Cloud;
use files::rims_left_out;
use fringe::cloud::Point;
use metrology::spatial::{extent_and_least_edge_mm, thinned_cloud};
use metrology::surface_net::{NetCheck, Opening, SurfaceNet};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Openings that are listed.
const MOST_OPENINGS: usize = 20;

#[derive(clap::Args)]
pub struct Args {
    /// Cloud to convert (PLY or E57, docs/formats.md), lengths in mm.
    cloud: PathBuf,
    /// File to write: a cloud (`.ply`, or `.e57` with a scan for each pair), with `--mesh` a mesh (`.ply` or `.stl`).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Keep one point in each cube of this edge, mm: the one with the smallest uncertainty.
    #[arg(long, value_name = "MM", value_parser = length)]
    decimate: Option<f64>,
    /// Keep the points of this pair only, counted from 1 in the order of the rig file.
    #[arg(long, value_name = "N")]
    pair: Option<u32>,
    /// Connect the points by triangles: closed where the surface was seen, with the deviation of the points from the mesh.
    #[arg(long)]
    mesh: bool,
    /// Size of the triangles, mm; by default twice the distance of neighbouring points.
    #[arg(long, value_name = "MM", value_parser = length, requires = "mesh")]
    cell: Option<f64>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What was read and written.
#[derive(Serialize)]
struct Converted {
    cloud: String,
    out: String,
    points_read: usize,
    points: usize,
    mesh: Option<Mesh>,
}

/// The mesh, and how far its points lie from it.
#[derive(Serialize)]
struct Mesh {
    corners: usize,
    triangles: usize,
    cell_mm: f64,
    area_mm2: f64,
    deviation_rms_mm: f64,
    deviation_mean_mm: f64,
    deviation_95_mm: f64,
    deviation_largest_mm: f64,
    points_without: usize,
    openings: usize,
    largest_openings: Vec<Hole>,
}

/// A line at which the mesh ends.
#[derive(Serialize)]
struct Hole {
    area_mm2: f64,
    perimeter_mm: f64,
    middle_mm: [f64; 3],
}

impl From<&Opening> for Hole {
    fn from(opening: &Opening) -> Self {
        let Opening { perimeter_mm, area_mm2, middle_mm } = *opening;
        Self { area_mm2, perimeter_mm, middle_mm }
    }
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let format = Format::of(&args.out, args.mesh)?;
    check_outputs(&[("--out", Some(&args.out)), ("--json", args.json.as_deref())], &[&args.cloud], None)?;
    let Cloud { points: read, comments, .. } = read_cloud_in_mm(&args.cloud)?;
    let points_read = read.len();
    let points = kept(args, read)?;
    let mesh = match format {
        Format::PlyCloud => {
            let source = args.cloud.display().to_string();
            let mut said = said(&comments, &source);
            let before = said.len();
            said.retain(|(key, _)| args.decimate.is_none() || *key != rims_left_out::COMMENT);
            if said.len() < before {
                eprintln!(
                    "{}: measure outlines (circle, slot, rectangle, edge) before you thin a cloud: what it leaves out at rims is known in pixels",
                    args.out.display()
                );
            }
            files::ply::write_cloud(&args.out, &points, &said)?;
            None
        }
        Format::E57 => {
            files::e57_file::write_cloud(&args.out, &points)?;
            eprintln!("{}: places and modulation; E57 has no normals and uncertainties", args.out.display());
            None
        }
        Format::PlyMesh | Format::Stl => Some(write_mesh(args, format, &points)?),
    };
    let result = Converted {
        cloud: args.cloud.display().to_string(),
        out: args.out.display().to_string(),
        points_read,
        points: points.len(),
        mesh,
    };
    emit(args.json.as_deref(), &result)?;
    print(&result);
    Ok(Outcome::Done)
}

/// What is written, by the name of the file.
#[derive(Clone, Copy, PartialEq)]
enum Format {
    PlyCloud,
    E57,
    PlyMesh,
    Stl,
}

impl Format {
    fn of(out: &Path, mesh: bool) -> Result<Self> {
        let extension = out.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        match (extension.as_str(), mesh) {
            ("ply", false) => Ok(Self::PlyCloud),
            ("e57", false) => Ok(Self::E57),
            ("ply", true) => Ok(Self::PlyMesh),
            ("stl", true) => Ok(Self::Stl),
            ("stl", false) => bail!("--out {}: an STL file holds triangles; add --mesh", out.display()),
            ("e57", true) => bail!(
                "--out {}: an E57 file holds points; name a .ply or .stl file for a mesh",
                out.display()
            ),
            _ => bail!("--out {}: name a .ply, .e57 or .stl file", out.display()),
        }
    }
}

/// What the cloud says of how it was measured, which the points that are left share, and where they come from.
fn said<'a>(comments: &'a [String], source: &'a str) -> Vec<(&'a str, &'a str)> {
    let kept = comments.iter().filter_map(|line| line.split_once(": "));
    kept.filter(|(key, _)| !["unit", "source"].contains(key)).chain([("source", source)]).collect()
}

/// The points that are asked for.
fn kept(args: &Args, mut points: Vec<Point>) -> Result<Vec<Point>> {
    if let Some(pair) = args.pair {
        let most = points.iter().map(|point| u64::from(point.pair) + 1).max().unwrap_or(0);
        points.retain(|point| u64::from(point.pair) + 1 == u64::from(pair));
        if points.is_empty() {
            bail!("--pair {pair}: {} has no such points; pairs are 1 … {most}", args.cloud.display());
        }
    }
    match args.decimate {
        Some(edge_mm) => decimated(args, &points, edge_mm),
        None => Ok(points),
    }
}

/// One point in each cube; refuses an edge too small for the grid, which would coarsen it without a word.
fn decimated(args: &Args, points: &[Point], edge_mm: f64) -> Result<Vec<Point>> {
    metrology::reference::check(points, 1).with_context(|| args.cloud.display().to_string())?;
    let (extent_mm, least_mm) = extent_and_least_edge_mm(points);
    ensure!(
        edge_mm >= least_mm,
        "--decimate {edge_mm}: {} extends over {extent_mm:.3} mm, the smallest edge for it is {:.2e} mm; give a larger edge, or \
         remove a point that lies far outside",
        args.cloud.display(),
        1.01 * least_mm
    );
    Ok(thinned_cloud(points, edge_mm))
}

fn write_mesh(args: &Args, format: Format, points: &[Point]) -> Result<Mesh> {
    let named = || args.cloud.display().to_string();
    let net = SurfaceNet::new(points, args.cell).with_context(named)?;
    let check = NetCheck::of(&net, points).with_context(named)?;
    let openings = net.openings();
    let deviation = format!("{:.4} mm rms, {:.4} mm largest", check.rms_mm, check.largest_mm);
    let comments = [("source", named()), ("deviation of the points", deviation)];
    if format == Format::Stl {
        files::mesh_file::write_stl(&args.out, &net.corners, &net.triangles)?;
    } else {
        let comments: Vec<(&str, &str)> =
            comments.iter().map(|(key, value)| (*key, value.as_str())).collect();
        files::mesh_file::write_ply(&args.out, &net.corners, &net.triangles, &comments)?;
    }
    Ok(Mesh {
        corners: net.corners.len(),
        triangles: net.triangles.len(),
        cell_mm: net.cell_mm,
        area_mm2: net.area_mm2(),
        deviation_rms_mm: check.rms_mm,
        deviation_mean_mm: check.mean_mm,
        deviation_95_mm: check.within_95_mm,
        deviation_largest_mm: check.largest_mm,
        points_without: check.without,
        openings: openings.len(),
        largest_openings: openings.iter().take(MOST_OPENINGS).map(Hole::from).collect(),
    })
}

fn print(result: &Converted) {
    println!("{}: {} of {} points", result.out, result.points, result.points_read);
    let Some(mesh) = &result.mesh else { return };
    println!(
        "{} triangles of {:.3} mm, {:.1} mm²; 95 % of the points lie within {:.4} mm of it (rms {:.4}, largest {:.4}); {} have no part of it",
        mesh.triangles,
        mesh.cell_mm,
        mesh.area_mm2,
        mesh.deviation_95_mm,
        mesh.deviation_rms_mm,
        mesh.deviation_largest_mm,
        mesh.points_without
    );
    for hole in mesh.largest_openings.iter().take(5) {
        let [x, y, z] = hole.middle_mm;
        println!(
            "open: {:.2} mm², {:.2} mm around, about ({x:.2}, {y:.2}, {z:.2}) mm",
            hole.area_mm2, hole.perimeter_mm
        );
    }
    if mesh.openings > 5 {
        println!("{} more openings: --json lists the largest", mesh.openings - 5);
    }
}
