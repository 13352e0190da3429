//! `fringetool new-plan`: drafts an inspection plan from a cloud.

use crate::Outcome;
use crate::plan_text::{keys, legend};
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use files::document::Document;
use files::plan_file::parse_plan;
use fringe::cloud::Point;
use metrology::inspection::{DraftSettings, Found, Geometry, PLAN_FORMAT, draft};
use report::{ClassMap, class_map_png};
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// First cloud of the part, with normals (PLY or E57), lengths in mm.
    cloud: PathBuf,
    /// Inspection plan to write (TOML): elements with names and nominal values as found, features with a tolerance to correct.
    #[arg(long, value_name = "FILE.toml")]
    out: PathBuf,
    /// Largest distance of a point from its element, mm.
    #[arg(long, value_name = "MM", default_value_t = 0.1)]
    within: f64,
    /// Fewest points of an element; default: a hundredth of the cloud, at least 200.
    #[arg(long, value_name = "N")]
    min_points: Option<usize>,
    /// Most elements that are looked for.
    #[arg(long, value_name = "N", default_value_t = 12)]
    most: usize,
    /// Write a picture of the elements, seen along z, to this file.
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Angle between the normals of a point and its element, rad.
const NORMAL_RAD: f64 = 0.3;

/// Width of the picture, px.
const PICTURE_PX: f64 = 700.0;

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [
        ("--out", Some(args.out.as_path())),
        ("--picture", args.picture.as_deref()),
        ("--json", args.json.as_deref()),
    ];
    check_outputs(&outputs, &[&args.cloud], None)?;
    if !(args.within > 0.0 && args.within <= 100.0) {
        bail!("--within {}: must be above 0 and at most 100 mm", args.within);
    }
    if !(1..=200).contains(&args.most) {
        bail!("--most {}: must be 1 … 200", args.most);
    }
    let cloud = crate::surface::read_cloud_in_mm(&args.cloud)?;
    let min_points = args.min_points.unwrap_or((cloud.points.len() / 100).max(200)).max(40);
    let settings =
        DraftSettings { within_mm: args.within, normal_rad: NORMAL_RAD, min_points, most: args.most };
    let found = draft(&cloud.points, &settings);
    if found.is_empty() {
        bail!(
            "{}: no plane, sphere, cylinder or cone of {min_points} points within {} mm; a larger --within, a smaller \
             --min-points, or a cloud with normals helps",
            args.cloud.display(),
            args.within
        );
    }
    let named = named(&found);
    let text = plan_text(&args.cloud.display().to_string(), &named, args.within);
    let document = Document { path: args.out.clone(), text };
    parse_plan(&document).context("the draft")?;
    if let Some(path) = &args.picture {
        files::atomic::write(path, &picture(&cloud.points, &named)?)?;
    }
    files::atomic::write(&args.out, document.text.as_bytes())?;
    let elements: Vec<_> = named
        .iter()
        .map(|(name, f)| {
            json!({ "name": name, "kind": f.geometry.kind(), "points": f.form.points, "form_sigma_mm": f.form.form_sigma_mm })
        })
        .collect();
    let taken: usize = found.iter().map(|f| f.points.len()).sum();
    let result = json!({ "cloud": args.cloud, "plan": args.out, "points": cloud.points.len(),
        "points_left": cloud.points.len() - taken, "elements": elements });
    emit(args.json.as_deref(), &result)?;
    for (name, f) in &named {
        println!("{name}: {} points, sigma {:.4} mm", f.form.points, f.form.form_sigma_mm);
    }
    println!(
        "{}: {} element{}; {} of {} points left",
        args.out.display(),
        named.len(),
        if named.len() == 1 { "" } else { "s" },
        cloud.points.len() - taken,
        cloud.points.len()
    );
    Ok(Outcome::Done)
}

/// Elements with names: kind and number, counted from 1.
fn named(found: &[Found]) -> Vec<(String, &Found)> {
    let mut counts = std::collections::BTreeMap::new();
    found
        .iter()
        .map(|f| {
            let count: &mut usize = counts.entry(f.geometry.kind()).or_default();
            *count += 1;
            (format!("{}{count}", f.geometry.kind()), f)
        })
        .collect()
}

/// The plan as text.
fn plan_text(cloud: &str, named: &[(String, &Found)], within_mm: f64) -> String {
    let mut text = format!(
        "# Draft from {}: nominal values are those of this cloud, tolerances are to be corrected.\n\
         format = \"{PLAN_FORMAT}\"\nname = \"draft\"\n",
        cloud.replace(|c: char| c.is_control(), " ")
    );
    for (name, f) in named {
        let _ = write!(
            text,
            "\n[[element]]\nkind = \"{}\"\nname = \"{name}\"\n{}",
            f.geometry.kind(),
            keys(&f.geometry, inset(&f.geometry))
        );
        let _ = write!(
            text,
            "margin_mm = {:.3}\nnormal_tolerance_deg = 25.0\nmin_points = {}\n",
            4.0 * within_mm,
            (f.form.points / 4).max(10)
        );
    }
    for (name, f) in named {
        let _ = write!(text, "{}", feature(name, f, within_mm));
    }
    let planes: Vec<&String> = of_kind(named, "plane");
    for other in planes.iter().skip(1) {
        let _ = write!(
            text,
            "\n[[feature]]\nkind = \"angle\"\nname = \"{}_{other}_angle\"\nelements = [\"{}\", \"{other}\"]\ntolerance_deg = [-0.2, 0.2]\n",
            planes[0], planes[0]
        );
    }
    let spheres = of_kind(named, "sphere");
    for other in spheres.iter().skip(1) {
        let _ = write!(
            text,
            "\n[[feature]]\nkind = \"distance\"\nname = \"{}_{other}_distance\"\nelements = [\"{}\", \"{other}\"]\ntolerance_mm = [-0.1, 0.1]\n",
            spheres[0], spheres[0]
        );
    }
    text
}

fn of_kind<'a>(named: &'a [(String, &Found)], kind: &str) -> Vec<&'a String> {
    named.iter().filter(|(_, f)| f.geometry.kind() == kind).map(|(name, _)| name).collect()
}

/// What the ends of an element lose, mm: a twentieth, at most 1 mm.
fn inset(geometry: &Geometry) -> f64 {
    let half = match geometry {
        Geometry::Plane { half_size_mm, .. } => half_size_mm[0].min(half_size_mm[1]),
        Geometry::Cylinder { half_length_mm, .. } => *half_length_mm,
        _ => 0.0,
    };
    (0.05 * half).min(1.0)
}

/// The feature that an element has by itself.
fn feature(name: &str, f: &Found, within_mm: f64) -> String {
    let head = |kind: &str, what: &str| {
        format!("\n[[feature]]\nkind = \"{kind}\"\nname = \"{name}_{what}\"\nelement = \"{name}\"\n")
    };
    match &f.geometry {
        Geometry::Plane { half_size_mm, .. } => {
            let edge = (half_size_mm[0].min(half_size_mm[1]) / 8.0).max(0.5);
            format!("{}filter_mm = {edge:.2}\nlimit_mm = {within_mm:.3}\n", head("flatness", "flatness"))
        }
        Geometry::Cone { .. } => format!("{}tolerance_deg = [-0.2, 0.2]\n", head("half-angle", "half_angle")),
        _ => format!("{}tolerance_mm = [-0.1, 0.1]\n", head("size", "diameter")),
    }
}

/// The elements in colours, seen along z.
fn picture(points: &[Point], named: &[(String, &Found)]) -> Result<Vec<u8>> {
    let flat = || {
        points
            .iter()
            .map(|p| [p.position_mm[0], p.position_mm[1]])
            .filter(|p| p.iter().all(|v| v.is_finite()))
    };
    let low = flat().fold([f64::INFINITY; 2], |l, p| [l[0].min(p[0]), l[1].min(p[1])]);
    let high = flat().fold([f64::NEG_INFINITY; 2], |h, p| [h[0].max(p[0]), h[1].max(p[1])]);
    let size = [0, 1].map(|i| (high[i] - low[i]).max(1e-6));
    let mut scale = PICTURE_PX / size[0].max(size[1]);
    // No finer than the points lie.
    scale = scale.min((points.len() as f64 / (size[0] * size[1])).sqrt() * 0.8);
    let [width, height] = size.map(|s| (s * scale) as usize + 1);
    let mut classes = vec![u8::MAX; width * height];
    let mut paint = |index: usize, class: u8| {
        let [x, y, _] = points[index].position_mm;
        if x.is_finite() && y.is_finite() {
            let (column, row) = (((x - low[0]) * scale) as usize, ((high[1] - y) * scale) as usize);
            classes[row.min(height - 1) * width + column.min(width - 1)] = class;
        }
    };
    (0..points.len()).for_each(|index| paint(index, 0));
    for (number, (_, f)) in named.iter().enumerate() {
        f.points.iter().for_each(|index| paint(*index as usize, (number + 1).min(250) as u8));
    }
    let legend = legend("left", named.iter().map(|(name, _)| name.clone()));
    let (width_px, height_px) = (width as u32, height as u32);
    Ok(class_map_png(&ClassMap { width_px, height_px, classes: &classes, legend: &legend })?)
}
