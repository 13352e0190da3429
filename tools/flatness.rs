//! `fringetool flatness`: one surface measured several times: plane, deviations, maps and histograms.

use crate::Outcome;
use crate::fit::region::{Corners, Near, within};
use crate::report::{check_outputs, emit};
use crate::surface::{length, read_cloud_in_mm};
use anyhow::{Context, Result, bail};
use fringe::math::statistics::median;
use metrology::fit::{self, FitSettings, Form};
use metrology::inspection::{Across, FlatnessFilter, filtered_flatness};
use nalgebra::{Point3, Vector3};
use report::{FlatnessInput, FlatnessRepeat, write_flatness};
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Point clouds of the same surface (PLY or E57, docs/formats.md), one for each repeat, lengths in mm.
    #[arg(required = true)]
    clouds: Vec<PathBuf>,
    /// Use only points within r of (x, y, z), mm.
    #[arg(long, value_name = "x,y,z,r", allow_hyphen_values = true)]
    near: Option<Near>,
    /// Use only points between these two corners, mm.
    #[arg(long = "box", value_name = "x0,y0,z0,x1,y1,z1", allow_hyphen_values = true)]
    corners: Option<Corners>,
    /// Edge of the square cells whose means give the filtered flatness, mm.
    #[arg(long = "filter-mm", alias = "filter", value_name = "MM", default_value = "2.5", value_parser = length)]
    filter: f64,
    /// Upper limit of the colour scale, mm; by default from the data.
    #[arg(long, value_name = "MM", value_parser = length)]
    range: Option<f64>,
    /// Write a report with a map and a histogram of each repeat (HTML).
    #[arg(long, alias = "html", value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The numbers of one repeat.
#[derive(Serialize)]
struct Repeat {
    cloud: String,
    #[serde(flatten)]
    form: Form,
    /// Median of the uncertainties that the cloud states, mm; absent where it states none.
    sigma_stated_median_mm: Option<f64>,
    /// Range of the means over squares, mm.
    flatness_filtered_mm: f64,
    u_flatness_filtered_mm: f64,
    filter: FlatnessFilter,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let inputs: Vec<&Path> = args.clouds.iter().map(PathBuf::as_path).collect();
    check_outputs(&[("--report", args.report.as_deref()), ("--json", args.json.as_deref())], &inputs, None)?;
    let (mut repeats, mut shown) = (Vec::new(), Vec::new());
    let mut axes = None;
    for path in &args.clouds {
        let (repeat, picture, own_axes) = measure(args, path).with_context(|| path.display().to_string())?;
        if axes.is_some_and(|axes| axes != own_axes) {
            bail!(
                "{}: has another orientation than the first one; give repeats of one surface",
                path.display()
            );
        }
        axes = Some(own_axes);
        println!("{}", line(&repeat));
        repeats.push(repeat);
        shown.push(picture);
    }
    if let Some(path) = &args.report {
        write_flatness(path, &report(args, &repeats, shown, axes.unwrap_or(["x", "y"])))?;
        println!("{}", path.display());
    }
    let mean = |part: fn(&Repeat) -> f64| repeats.iter().map(part).sum::<f64>() / repeats.len() as f64;
    let means = serde_json::json!({
        "form_range_mm": mean(|r| r.form.form_range_mm),
        "form_sigma_mm": mean(|r| r.form.form_sigma_mm),
        "form_d95_mm": mean(|r| r.form.form_d95_mm),
        "flatness_filtered_mm": mean(|r| r.flatness_filtered_mm),
    });
    emit(args.json.as_deref(), &serde_json::json!({ "repeats": repeats, "mean": means }))?;
    Ok(Outcome::Done)
}

/// A repeat, its map, and the names of the map's axes.
fn measure(args: &Args, path: &Path) -> Result<(Repeat, FlatnessRepeat, [&'static str; 2])> {
    let cloud = read_cloud_in_mm(path)?;
    let held: Vec<_> =
        cloud.points.iter().filter(|p| within(args.near, args.corners, &p.position())).collect();
    if held.is_empty() {
        bail!("no point within --near and --box (the cloud has {})", cloud.points.len());
    }
    let points: Vec<Point3<f64>> = held.iter().map(|p| p.position()).collect();
    let plane = fit::plane(&points, &FitSettings::default())?;
    // Seen along the world axis that the surface faces most.
    let (first, second, axes) = match plane.normal_vector().iamax() {
        0 => (1, 2, ["y", "z"]),
        1 => (0, 2, ["x", "z"]),
        _ => (0, 1, ["x", "y"]),
    };
    // The squares of the filter lie in the plane, along the axis that the map shows first: a surface keeps its flatness when it is tilted.
    let normal = plane.normal_vector();
    let mut along = Vector3::zeros();
    along[first] = 1.0;
    let along = (along - normal * normal[first]).normalize();
    let in_plane = |p: &Point3<f64>| [p.coords.dot(&along), p.coords.dot(&normal.cross(&along))];
    let places = held.iter().zip(&points);
    let across: Vec<Across> =
        places.map(|(held, p)| Across { place_mm: in_plane(p), sigma_mm: held.sigma_mm }).collect();
    let deviations_mm = plane.residuals.deviation_mm;
    let filtered = filtered_flatness(&across, &deviations_mm, args.filter).context("--filter-mm")?;
    let mut stated: Vec<f32> = held.iter().map(|p| p.sigma_mm).filter(|s| *s > 0.0).collect();
    let repeat = Repeat {
        cloud: path.display().to_string(),
        form: plane.form,
        sigma_stated_median_mm: median(&mut stated).map(f64::from),
        flatness_filtered_mm: filtered.range_mm,
        u_flatness_filtered_mm: filtered.u_mm,
        filter: filtered.report,
    };
    let name = path.file_stem().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let caption = format!(
        "{} points, range {:.1} µm, sigma {:.1} µm",
        repeat.form.points,
        repeat.form.form_range_mm * 1e3,
        repeat.form.form_sigma_mm * 1e3
    );
    let across_mm = points.iter().map(|p| [p[first], p[second]]).collect();
    Ok((repeat, FlatnessRepeat { name, across_mm, deviations_mm, caption }, axes))
}

fn um(mm: f64) -> String {
    format!("{:.1}", mm * 1e3)
}

fn stated(repeat: &Repeat) -> String {
    repeat.sigma_stated_median_mm.map_or_else(|| "–".into(), um)
}

fn line(repeat: &Repeat) -> String {
    format!(
        "{}: {} points; sigma {} µm (stated {}), 95 % within {} µm, range {} µm; means over {} mm: range {} µm, u {} µm, of \
         which noise makes {} µm",
        repeat.cloud,
        repeat.form.points,
        um(repeat.form.form_sigma_mm),
        stated(repeat),
        um(repeat.form.form_d95_mm),
        um(repeat.form.form_range_mm),
        repeat.filter.filter_mm,
        um(repeat.flatness_filtered_mm),
        um(repeat.u_flatness_filtered_mm),
        um(repeat.filter.noise_range_mm),
    )
}

fn report(
    args: &Args,
    repeats: &[Repeat],
    shown: Vec<FlatnessRepeat>,
    axes: [&'static str; 2],
) -> FlatnessInput {
    let filtered = format!("means over {} mm, µm", args.filter);
    let head = [
        "repeat",
        "points",
        "sigma, µm",
        "stated, µm",
        "95 % within, µm",
        "range, µm",
        &filtered,
        "of it noise, µm",
    ];
    let row = |(repeat, shown): (&Repeat, &FlatnessRepeat)| {
        vec![
            shown.name.clone(),
            repeat.form.points.to_string(),
            um(repeat.form.form_sigma_mm),
            stated(repeat),
            um(repeat.form.form_d95_mm),
            um(repeat.form.form_range_mm),
            um(repeat.flatness_filtered_mm),
            um(repeat.filter.noise_range_mm),
        ]
    };
    let rows = repeats.iter().zip(&shown).map(row);
    let table = std::iter::once(head.map(str::to_owned).to_vec()).chain(rows).collect();
    let definition = repeats.first().map_or("", |repeat| &repeat.filter.definition);
    FlatnessInput {
        title: format!("{} repeats", repeats.len()),
        details: vec![
            ("Region".into(), region(args)),
            ("Date".into(), files::clock::rfc3339_now()),
            ("Software".into(), crate::software::FRINGETOOL.line()),
        ],
        table,
        repeats: shown,
        axes,
        half_range_mm: args.range,
        notes: vec![
            "Plane: least squares of the orthogonal distances of all points of the region; none is rejected.".into(),
            "Sigma: sample standard deviation (n − 1) of the distances. 95 % within: width of the narrowest interval that holds \
             95 % of them. Range: largest less smallest distance; of noise alone it grows with the number of points."
                .into(),
            format!("Means: {definition}."),
            "Stated: median standard uncertainty that the cloud gives its points.".into(),
        ],
    }
}

fn region(args: &Args) -> String {
    let parts = [args.corners.map(|c| c.to_string()), args.near.map(|n| n.to_string())];
    let text: Vec<String> = parts.into_iter().flatten().collect();
    if text.is_empty() { "the whole cloud".into() } else { text.join(", ") }
}
