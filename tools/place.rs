//! `fringetool place`: writes into an inspection plan where the part lies in a first cloud.

use crate::Outcome;
use crate::register::summary;
use crate::report::{check_outputs, emit};
use crate::surface::{Chord, check_units, read_cloud, read_reference, start};
use anyhow::{Context, Result, bail};
use files::document::Document;
use files::error::FileError;
use files::plan_file::{parse_plan, read_plan};
use metrology::inspection::{PlaceError, Placement, Plan, place};
use metrology::reference::Reference;
use metrology::register::Registration;
use nalgebra::{Isometry3, Vector3};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Command-line arguments of `fringetool place`.
#[derive(clap::Args)]
pub struct Args {
    /// Inspection plan of the part (TOML).
    plan: PathBuf,
    /// First cloud of the part as the cell sees it (PLY or E57), lengths in mm.
    cloud: PathBuf,
    /// The plan with the part's place as its `[placement]` (TOML).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The part's CAD in the plan's part frame (STEP in its own unit; STL, PLY with faces or OBJ in mm): the whole surface then
    /// fixes the pose, not only the plan's elements.
    #[arg(long, value_name = "MESH")]
    cad: Option<PathBuf>,
    #[command(flatten)]
    chord: Chord,
    /// Where the part lies about (world from part): `search` (any pose), `as-it-lies` (where part and world frame agree),
    /// or a file with a 4 × 4 matrix.
    #[arg(long, default_value = "search")]
    start: String,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The result for a program.
#[derive(Serialize)]
#[allow(clippy::struct_field_names, reason = "keys of the machine-readable result")]
struct Placed<'a> {
    plan: &'a Path,
    cloud: &'a Path,
    cad: Option<&'a Path>,
    placed: bool,
    /// Why the part could not be placed.
    reason: Option<String>,
    world_from_part: Option<WorldFromPart>,
    registration: Option<&'a Registration>,
    inspection: Option<&'a metrology::inspection::InspectionResult>,
}

/// A pose as the plan writes it.
#[derive(Serialize)]
struct WorldFromPart {
    rotation: [[f64; 3]; 3],
    translation_mm: [f64; 3],
}

/// Part of a cloud beside the CAD data that a person should know of: noise and edges leave some hundredths.
const MUCH_BESIDE: f64 = 0.1;

/// Runs the command `place`.
pub fn run(args: &Args) -> Result<Outcome> {
    let mut inputs: Vec<&Path> = vec![&args.plan, &args.cloud];
    inputs.extend(args.cad.as_deref());
    check_outputs(&[("--out", Some(&args.out)), ("--json", args.json.as_deref())], &inputs, None)?;
    let (plan, document) = read_plan(&args.plan)?;
    let cloud = read_cloud(&args.cloud)?;
    let mesh = match &args.cad {
        None => None,
        Some(path) => {
            let reference = read_reference(path, &args.chord, Vector3::z(), None)?;
            check_units((&args.cloud, &cloud.points), (path, &reference))?;
            match reference {
                Reference::Mesh(mesh) => Some(mesh),
                Reference::Cloud(_) => {
                    bail!(
                        "--cad {}: is a cloud; a mesh is needed (STEP, STL, PLY with faces)",
                        path.display()
                    )
                }
            }
        }
    };
    let result = place(&plan, &cloud.points, mesh, &start(&args.start)?);
    match result {
        Ok(placement) => {
            let pose = world_from_part(&placement.world_from_part);
            let text = with_placement(&document.text, &pose);
            check_text(&text, &plan, &pose).with_context(|| args.plan.display().to_string())?;
            files::atomic::write(&args.out, text.as_bytes())?;
            emit(args.json.as_deref(), &report(args, Ok((&placement, pose))))?;
            print(args, &placement);
            Ok(Outcome::Done)
        }
        Err(PlaceError::Cloud(error)) => Err(error).with_context(|| args.cloud.display().to_string()),
        Err(error) => {
            emit(args.json.as_deref(), &report(args, Err(&error)))?;
            println!("{}: not placed: {error}", args.plan.display());
            Ok(Outcome::LimitFailed)
        }
    }
}

fn report<'a>(args: &'a Args, result: Result<(&'a Placement, WorldFromPart), &PlaceError>) -> Placed<'a> {
    let (placement, pose, reason) = match result {
        Ok((placement, pose)) => (Some(placement), Some(pose), None),
        Err(error) => (None, None, Some(error.to_string())),
    };
    Placed {
        plan: &args.plan,
        cloud: &args.cloud,
        cad: args.cad.as_deref(),
        placed: placement.is_some(),
        reason,
        world_from_part: pose,
        registration: placement.map(|p| &p.registration),
        inspection: placement.map(|p| &p.inspection),
    }
}

fn print(args: &Args, placement: &Placement) {
    let [x, y, z]: [f64; 3] = placement.world_from_part.translation.vector.into();
    let angle_deg = placement.world_from_part.rotation.angle().to_degrees();
    println!("{} -> {}", args.plan.display(), args.out.display());
    println!("  the part's origin lies at ({x:.3}, {y:.3}, {z:.3}) mm, turned by {angle_deg:.3}°");
    summary(&placement.registration);
    let beside = 1.0 - placement.registration.overlap;
    if args.cad.is_some() && beside > MUCH_BESIDE {
        println!(
            "warning: {:.0} % of the cloud does not lie on the CAD data: where these are no fixtures, it is another part, or its mirror image (left hand for \
             right hand); compare with `fringetool compare`",
            100.0 * beside
        );
    }
    for element in &placement.inspection.elements {
        println!("  element {}: {} points", element.name, element.points.len());
    }
}

fn world_from_part(pose: &Isometry3<f64>) -> WorldFromPart {
    let r = pose.rotation.to_rotation_matrix().into_inner();
    let row = |i: usize| [r[(i, 0)], r[(i, 1)], r[(i, 2)]];
    WorldFromPart { rotation: [row(0), row(1), row(2)], translation_mm: pose.translation.vector.into() }
}

/// The plan's text with its `[placement]` replaced, or put before the first table. Everything else stays as written.
fn with_placement(text: &str, pose: &WorldFromPart) -> String {
    let [a, b, c] = pose.rotation.map(|row| format!("{row:?}"));
    let table = format!(
        "[placement]\nrotation = [\n  {a},\n  {b},\n  {c},\n]\ntranslation_mm = {:?}\n\n",
        pose.translation_mm
    );
    let mut out = String::with_capacity(text.len() + table.len());
    let (mut written, mut within) = (false, false);
    for line in text.split_inclusive('\n') {
        if let Some(name) = header(line) {
            within = name == "placement";
            if !written {
                out.push_str(&table);
                written = true;
            }
        }
        if !within {
            out.push_str(line);
        }
    }
    if !written {
        out.push_str(&table);
    }
    out
}

/// The name of the table that a line opens; rows of numbers open none.
fn header(line: &str) -> Option<&str> {
    let inner = line.trim_start().strip_prefix('[')?;
    let name = inner.strip_prefix('[').unwrap_or(inner).trim_start();
    let opens = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '"');
    opens.then(|| name.split(']').next().unwrap_or(name).trim())
}

fn parse(text: &str) -> Result<Plan, FileError> {
    parse_plan(&Document { path: "plan".into(), text: text.to_owned() })
}

/// Refuses to write a plan that is not the one read with another place.
fn check_text(text: &str, plan: &Plan, pose: &WorldFromPart) -> Result<()> {
    let again = parse(text).context("with the place written into it")?;
    let near = (again.world_from_part.translation.vector - Vector3::from(pose.translation_mm)).norm() < 1e-9;
    let same = Plan { world_from_part: plan.world_from_part, ..again };
    if !near || same != *plan {
        bail!(
            "placement: cannot be replaced in its present form; write it as a table of its own, [placement]"
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: &str = "# A plan.\nformat = \"fringecell-plan/1\"\nname = \"part\"\n\n# Its elements.\n[[element]]\nkind = \
        \"plane\"\nname = \"top\"\npoint_mm = [0.0, 0.0, 0.0]\nnormal = [0.0, 0.0, 1.0]\nsize_mm = [9.0, 9.0]\nmargin_mm = \
        0.5\nmin_points = 10\n\n[[feature]]\nkind = \"plane-flatness\"\nname = \"f\"\nelement = \"top\"\nlimit_mm = 0.1\n";

    #[test]
    fn the_place_is_written_and_replaced_and_nothing_else_changes() {
        let pose = |z: f64| WorldFromPart {
            rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            translation_mm: [1.5, -2.0, z],
        };
        let plan = parse(PLAN).unwrap();
        let once = with_placement(PLAN, &pose(600.25));
        check_text(&once, &plan, &pose(600.25)).unwrap();
        assert!(once.contains("# A plan.") && once.contains("# Its elements."));
        let twice = with_placement(&once, &pose(7.0));
        check_text(&twice, &plan, &pose(7.0)).unwrap();
        assert_eq!((twice.matches("[placement]").count(), twice.contains("600.25")), (1, false));
        // A place that is written as a value of its own cannot be replaced: that is reported, and nothing is written.
        let inline = PLAN.replacen(
            "\n\n",
            "\nplacement = { rotation = [[1,0,0],[0,1,0],[0,0,1]], translation_mm = [0,0,0] }\n\n",
            1,
        );
        assert!(check_text(&with_placement(&inline, &pose(7.0)), &plan, &pose(7.0)).is_err());
    }
}
