//! `fringetool plan-from-cad`: a first inspection plan from the faces of a STEP file.

mod chosen;
mod picture;
mod relations;

use crate::Outcome;
use crate::plan_text::keys;
use crate::report::{check_outputs, emit};
use crate::surface::length;
use anyhow::{Context, Result, bail};
use chosen::Chosen;
use files::document::Document;
use files::plan_file::parse_plan;
use files::step_file::{self, StepPart};
use metrology::general_tolerance::{FormClass, LengthClass};
use metrology::inspection::{Geometry, PLAN_FORMAT};
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// CAD of the part (STEP AP203, AP214 or AP242); lengths in its own unit.
    part: PathBuf,
    /// Inspection plan to write (TOML): elements with nominal geometry and names of the CAD, features with general tolerances.
    #[arg(long, value_name = "FILE.toml")]
    out: PathBuf,
    /// General tolerance of lengths and angles: class f, m, c or v of ISO 2768-1.
    #[arg(long, value_enum, value_name = "CLASS", default_value_t = Lengths::M)]
    tolerance: Lengths,
    /// General tolerance of flatness: class H, K or L of ISO 2768-2.
    #[arg(long, value_enum, value_name = "CLASS", default_value_t = Forms::K)]
    form: Forms,
    /// General surface profile of the whole part as in ISO 22081, mm, instead of flatness.
    #[arg(long, value_name = "MM", value_parser = length, conflicts_with = "form")]
    profile: Option<f64>,
    /// Largest distance of a point from its element, mm.
    #[arg(long, value_name = "MM", value_parser = length, default_value = "0.5")]
    margin: f64,
    /// What elements lose at their ends and round their holes, mm; at most a fifth of their width.
    #[arg(long, value_name = "MM", value_parser = length, default_value = "1")]
    inset: f64,
    /// Points that the cloud has on a square millimetre, about: an element needs a quarter of what it would have.
    #[arg(long, value_name = "N", default_value_t = 1.0)]
    density: f64,
    /// Elements of less area are left out, mm².
    #[arg(long, value_name = "MM2", default_value_t = 20.0)]
    least_area: f64,
    /// Elements that stay out, by their names in the table: what the cell cannot see.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    without: Vec<String>,
    /// Largest distance between triangles and surfaces, mm; default: 2e-5 of the part's size, within 0.0005 … 0.02.
    #[arg(long, value_name = "MM", value_parser = length)]
    chord_mm: Option<f64>,
    /// Write a picture of the elements, seen from two sides, to this file.
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Class of ISO 2768-1.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Lengths {
    /// Fine: class f of the table.
    F,
    /// Medium: class m of the table.
    M,
    /// Coarse: class c of the table.
    C,
    /// Very coarse: class v of the table.
    V,
}

/// Class of ISO 2768-2.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Forms {
    /// Finest: class H of the table.
    #[value(name = "H")]
    H,
    /// Usual: class K of the table.
    #[value(name = "K")]
    K,
    /// Widest: class L of the table.
    #[value(name = "L")]
    L,
}

impl Lengths {
    fn class(self) -> LengthClass {
        match self {
            Self::F => LengthClass::Fine,
            Self::M => LengthClass::Medium,
            Self::C => LengthClass::Coarse,
            Self::V => LengthClass::VeryCoarse,
        }
    }
}

impl Forms {
    fn class(self) -> FormClass {
        match self {
            Self::H => FormClass::H,
            Self::K => FormClass::K,
            Self::L => FormClass::L,
        }
    }
}

/// Normals of points may differ from those of their element by so much, degrees.
const NORMAL_TOLERANCE_DEG: f64 = 25.0;

/// Faces that are listed by their numbers.
const MOST_LISTED: usize = 8;

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [
        ("--out", Some(args.out.as_path())),
        ("--picture", args.picture.as_deref()),
        ("--json", args.json.as_deref()),
    ];
    check_outputs(&outputs, &[&args.part], None)?;
    if !(args.density > 0.0 && args.density <= 1e6) {
        bail!("--density {}: must be above 0 and at most 1e6 points per mm²", args.density);
    }
    if !(args.least_area >= 0.0 && args.least_area.is_finite()) {
        bail!("--least-area {}: must be 0 or more, mm²", args.least_area);
    }
    let part = step_file::read_part(&args.part, args.chord_mm)?;
    let mut all = chosen::elements(&part, args.least_area);
    chosen::leave_out(&mut all, &args.without)?;
    let kept: Vec<&Chosen> = all.iter().filter(|one| one.left_out.is_none()).collect();
    if kept.is_empty() && args.profile.is_none() {
        bail!(
            "{}: no plane, cylinder, cone, sphere or torus of {} mm² for a plan; a smaller --least-area, fewer names in --without, \
             or --profile for the whole surface, helps",
            args.part.display(),
            args.least_area
        );
    }
    let text = plan_text(args, &kept)?;
    let document = Document { path: args.out.clone(), text };
    let plan = parse_plan(&document).context("the draft")?;
    if let Some(path) = &args.picture {
        files::atomic::write(path, &picture::picture(&part, &all)?)?;
    }
    files::atomic::write(&args.out, document.text.as_bytes())?;
    emit(args.json.as_deref(), &result(args, &part, &all, plan.features.len()))?;
    print(args, &part, &all, plan.features.len());
    Ok(Outcome::Done)
}

/// The path of a file as a plan in a folder names it.
fn from_plan(part: &Path, plan: &Path) -> Result<String> {
    let absolute = std::path::absolute(part).with_context(|| part.display().to_string())?;
    let plan = std::path::absolute(plan).with_context(|| plan.display().to_string())?;
    let folder = plan.parent().unwrap_or(Path::new("/"));
    let path = absolute.strip_prefix(folder).unwrap_or(&absolute);
    path.to_str()
        .filter(|text| fringe::text::is_printable(text))
        .map(str::to_owned)
        .with_context(|| format!("{}: a plan cannot name this path; rename it", part.display()))
}

/// The plan as text.
fn plan_text(args: &Args, kept: &[&Chosen]) -> Result<String> {
    let name = args.part.file_stem().and_then(|s| s.to_str()).unwrap_or("part");
    let printable: String = name.chars().filter(|c| !c.is_control()).collect();
    let mut text = format!(
        "# From {}: nominal geometry of the CAD, general tolerances: correct them by the drawing.\n\
         # The part frame is that of the CAD: `fringetool place` finds the part in a cloud.\n\
         format = \"{PLAN_FORMAT}\"\nname = {}\n",
        args.part.display().to_string().replace(|c: char| c.is_control(), " "),
        toml::Value::String(printable)
    );
    for one in kept {
        let _ = write!(text, "{}", element(args, one));
    }
    for feature in relations::features(kept, args.tolerance.class(), &relations::Form::of(args)) {
        let _ = write!(text, "\n[[feature]]\n{feature}");
    }
    if let Some(limit) = args.profile {
        let _ = write!(
            text,
            "\n[[element]]\nkind = \"surface\"\nname = \"whole_surface\"\nfile = {}\nmargin_mm = {:.3}\n\
             normal_tolerance_deg = {NORMAL_TOLERANCE_DEG:.1}\nmin_points = 1000\n\
             \n[[feature]]\nkind = \"surface-profile\"\nname = \"whole_surface_profile\"\nelement = \"whole_surface\"\n\
             limit_mm = {limit}\n",
            toml::Value::String(from_plan(&args.part, &args.out)?),
            args.margin.max(limit)
        );
    }
    Ok(text)
}

/// One element, with the faces that it comes from.
fn element(args: &Args, one: &Chosen) -> String {
    let geometry = &one.feature.geometry;
    let inset = match geometry {
        Geometry::Plane { half_size_mm, .. } => {
            args.inset.min(0.4 * half_size_mm[0]).min(0.4 * half_size_mm[1])
        }
        Geometry::Cylinder { half_length_mm, .. } | Geometry::Cone { half_length_mm, .. } => {
            args.inset.min(0.4 * half_length_mm)
        }
        _ => 0.0,
    };
    let mut text = format!(
        "\n# {}\n[[element]]\nkind = \"{}\"\nname = \"{}\"\n{}margin_mm = {:.3}\n",
        one.origin(),
        geometry.kind(),
        one.name,
        keys(geometry, inset),
        args.margin
    );
    // Normals of spheres and tori point outwards in a plan; those of a socket or a hollow do not.
    let hollow = one.feature.internal && matches!(geometry, Geometry::Sphere { .. } | Geometry::Torus { .. });
    if !hollow {
        let _ = writeln!(text, "normal_tolerance_deg = {NORMAL_TOLERANCE_DEG:.1}");
    }
    let points = (0.25 * args.density * one.feature.area_mm2).clamp(20.0, 1e8) as usize;
    let _ = writeln!(text, "min_points = {points}");
    text
}

fn result(args: &Args, part: &StepPart, all: &[Chosen], features: usize) -> serde_json::Value {
    let elements: Vec<_> = all
        .iter()
        .map(|one| {
            json!({
                "name": one.name, "kind": one.feature.geometry.kind(), "faces": one.feature.faces,
                "cad_names": one.feature.names, "area_mm2": one.feature.area_mm2, "left_out": one.left_out,
                "instance": one.feature.instance,
            })
        })
        .collect();
    let free = part.solids.iter().flat_map(|solid| &solid.free_faces);
    let free_faces: Vec<_> = free
        .map(|face| json!({"face": face.id, "cad_name": face.name, "kind": face.kind, "area_mm2": face.area_mm2}))
        .collect();
    json!({
        "part": args.part, "plan": args.out, "solids": part.solids.len(), "triangles": part.triangle_count(),
        "chord_mm": part.chord_mm, "volume_mm3": part.volume_mm3(),
        "elements": elements, "free_faces": free_faces, "features": features,
    })
}

fn print(args: &Args, part: &StepPart, all: &[Chosen], features: usize) {
    println!("{}: {}", args.part.display(), part.words());
    println!("{:<16} {:<9} {:>12} {:>12}  face", "element", "kind", "size", "area mm²");
    for one in all {
        let why = one.left_out.as_ref().map(|why| format!("; left out: {why}")).unwrap_or_default();
        println!(
            "{:<16} {:<9} {:>12} {:>12.1}  {}{why}",
            one.name,
            one.feature.geometry.kind(),
            one.size(),
            one.feature.area_mm2,
            one.origin()
        );
    }
    print_free_faces(part);
    let kept = all.iter().filter(|one| one.left_out.is_none()).count();
    println!("{}: {kept} elements, {features} features", args.out.display());
}

/// Faces that are no elements, by the kind of their surface.
fn print_free_faces(part: &StepPart) {
    let mut kinds: BTreeMap<&str, (Vec<String>, f64)> = BTreeMap::new();
    for face in part.solids.iter().flat_map(|solid| &solid.free_faces) {
        let (faces, area_mm2) = kinds.entry(face.kind).or_default();
        faces.push(format!("#{}", face.id));
        *area_mm2 += face.area_mm2;
    }
    for (kind, (faces, area_mm2)) in kinds {
        let more = match faces.len().saturating_sub(MOST_LISTED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let listed = faces.iter().take(MOST_LISTED).map(String::as_str).collect::<Vec<_>>().join(" ");
        println!("no element, but compared ({kind}): {area_mm2:.1} mm², {listed}{more}");
    }
}
