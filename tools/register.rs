//! `fringetool register`: brings clouds onto a reference: search over all poses, then point-to-plane ICP.

use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use crate::surface::{Chord, check_units, length, moved, read_cloud, read_reference, start};
use anyhow::{Context, Result, bail};
use files::rims_left_out;
use metrology::reference::Reference;
use metrology::register::{Outcome as Fit, RegisterSettings, Registration, register};
use nalgebra::Vector3;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Clouds to register, each on its own (PLY or E57, docs/formats.md), lengths in mm.
    #[arg(required = true)]
    clouds: Vec<PathBuf>,
    /// Reference: a cloud (PLY, E57), a mesh (STL, PLY with faces, OBJ; lengths in mm), or CAD (STEP, in its own unit).
    #[arg(long, value_name = "REFERENCE")]
    to: PathBuf,
    #[command(flatten)]
    chord: Chord,
    /// Registered cloud to write (PLY); for several clouds a folder, which gets a cloud and a transform for each.
    #[arg(long, value_name = "FILE|DIR")]
    out: PathBuf,
    /// Start of the registration: `search`, `as-it-lies` (identity), or a file with a 4 × 4 matrix (16 numbers, or JSON with `matrix`).
    #[arg(long, default_value = "search")]
    start: String,
    /// Largest distance of a match in the first round, mm; by default a tenth of the reference's diagonal.
    #[arg(long, value_name = "MM", value_parser = length)]
    reach: Option<f64>,
    /// Smallest share of a cloud's points that must match, 0 … 1.
    #[arg(long, value_name = "F", default_value_t = RegisterSettings::default().least_overlap)]
    overlap: f64,
    /// Write the transform and the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The registration of one cloud.
#[derive(Serialize)]
struct Aligned {
    cloud: String,
    reference: String,
    out: String,
    software: String,
    /// What the cloud says of the rims of faces, which is true in any place; what it says of cameras is not.
    #[serde(skip)]
    rims: Option<String>,
    #[serde(flatten)]
    registration: Registration,
}

/// The result for several clouds.
#[derive(Serialize)]
struct All<'a> {
    clouds: Vec<&'a Aligned>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let several = args.clouds.len() > 1;
    let mut inputs: Vec<&Path> = args.clouds.iter().map(PathBuf::as_path).collect();
    inputs.push(&args.to);
    let (out, made) =
        if several { (None, Some(args.out.as_path())) } else { (Some(args.out.as_path()), None) };
    check_outputs(&[("--out", out), ("--json", args.json.as_deref())], &inputs, made)?;
    if !(0.0..=1.0).contains(&args.overlap) {
        bail!("--overlap {}: must lie within 0 … 1", args.overlap);
    }
    let outs = places(args)?;
    let settings =
        RegisterSettings { reach_mm: args.reach, least_overlap: args.overlap, ..RegisterSettings::default() };
    let from = start(&args.start)?;
    let mut progress = Progress::new(args.clouds.len() + 1, "register");
    let reference = with_normals(read_reference(&args.to, &args.chord, Vector3::z(), None)?);
    progress.step();
    let mut done = Vec::new();
    for (cloud, out) in args.clouds.iter().zip(&outs) {
        let read = read_cloud(cloud)?;
        let (points, rims) = (&read.points, read.comment(rims_left_out::COMMENT).map(str::to_owned));
        check_units((cloud, points), (&args.to, &reference))?;
        let found =
            register(points, &reference, &from, &settings).with_context(|| cloud.display().to_string())?;
        done.push((moved(points, &found.pose()), aligned(args, (cloud, rims), out, found)));
        progress.step();
    }
    drop(progress);
    write(args, &outs, &done)?;
    let reliable = done.iter().all(|(_, aligned)| aligned.registration.is_reliable());
    Ok(if reliable { Outcome::Done } else { Outcome::LimitFailed })
}

/// Of a cloud: with the normals that the alignment needs.
pub fn with_normals(reference: Reference) -> Reference {
    match reference {
        Reference::Cloud(cloud) => Reference::Cloud(cloud.with_normals()),
        mesh @ Reference::Mesh(_) => mesh,
    }
}

fn aligned(
    args: &Args,
    (cloud, rims): (&Path, Option<String>),
    out: &Path,
    registration: Registration,
) -> Aligned {
    Aligned {
        cloud: cloud.display().to_string(),
        reference: args.to.display().to_string(),
        out: out.display().to_string(),
        software: concat!("fringetool ", env!("CARGO_PKG_VERSION")).to_owned(),
        rims,
        registration,
    }
}

/// Where each cloud goes.
fn places(args: &Args) -> Result<Vec<PathBuf>> {
    if args.clouds.len() == 1 {
        return Ok(vec![args.out.clone()]);
    }
    if args.out.is_file() {
        bail!("--out {}: is a file; several clouds need a folder", args.out.display());
    }
    let mut places: Vec<PathBuf> = Vec::new();
    for cloud in &args.clouds {
        let stem = cloud.file_stem().unwrap_or_default();
        let place = args.out.join(stem).with_extension("ply");
        if places.contains(&place) {
            bail!(
                "{}: another cloud of this name goes to {} too; rename one",
                cloud.display(),
                place.display()
            );
        }
        if args.clouds.iter().chain([&args.to]).any(|input| place.exists() && same(input, &place)) {
            bail!(
                "--out {}: would overwrite the input {}; name another folder",
                args.out.display(),
                place.display()
            );
        }
        places.push(place);
    }
    Ok(places)
}

fn same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Writes what was found, once all of it is.
fn write(args: &Args, outs: &[PathBuf], done: &[(Vec<fringe::cloud::Point>, Aligned)]) -> Result<()> {
    let several = args.clouds.len() > 1;
    if several {
        files::atomic::create_dir(&args.out)?;
    }
    for (out, (points, aligned)) in outs.iter().zip(done) {
        let mut comments = vec![
            ("source", aligned.cloud.as_str()),
            ("aligned_with", aligned.reference.as_str()),
            ("alignment", word(&aligned.registration)),
            ("software", aligned.software.as_str()),
        ];
        comments.extend(aligned.rims.as_ref().map(|pixels| (rims_left_out::COMMENT, pixels.as_str())));
        files::ply::write_cloud(out, points, &comments)?;
        if several {
            files::result::write_json(&out.with_extension("json"), aligned)?;
        }
        print(aligned);
    }
    if let [(_, only)] = done {
        return emit(args.json.as_deref(), only);
    }
    emit(args.json.as_deref(), &All { clouds: done.iter().map(|(_, aligned)| aligned).collect() })
}

fn print(aligned: &Aligned) {
    let r = &aligned.registration;
    println!("{} -> {}", aligned.cloud, aligned.out);
    summary(r);
}

/// What an alignment is worth, in a few lines.
pub fn summary(r: &Registration) {
    let [x, y, z] = r.translation_mm;
    println!("  translation ({x:.5}, {y:.5}, {z:.5}) mm, rotation {:.5}°", r.angle_deg());
    println!(
        "  rms {:.5} mm of {} matches, overlap {:.1} %, {} after {:?} iterations (last motion {:.1e} mm)",
        r.rms_mm,
        r.inliers,
        100.0 * r.overlap,
        if r.converged { "converged" } else { "not converged" },
        r.iterations,
        r.last_motion_mm
    );
    if r.at_edges > 0 {
        println!("  {} points near edges of the mesh stayed out: they see both faces", r.at_edges);
    }
    let centre = r.u_translation_mm.map(|u| determined(u, format!("{u:.1e}"))).join(", ");
    let rotation = r.u_rotation_rad.map(|u| determined(u, format!("{:.1}", u * 1e6))).join(", ");
    println!(
        "  u of the centre ({centre}) mm, of the rotation ({rotation}) µrad, condition {:.1}",
        r.condition
    );
    for line in doubts(r) {
        println!("  {line}");
    }
}

/// An uncertainty as text; a word where the surfaces do not determine the coordinate.
pub fn determined(u: f64, text: String) -> String {
    if u.is_finite() { text } else { "undetermined".to_owned() }
}

/// The outcome in one word.
pub fn word(r: &Registration) -> &'static str {
    match r.outcome {
        Fit::Aligned => "aligned",
        Fit::Undetermined => "undetermined",
        Fit::Ambiguous => "ambiguous",
        Fit::NotConverged => "not converged",
    }
}

/// Why the pose may not be used, or not all of it.
pub fn doubts(r: &Registration) -> Vec<String> {
    let mut lines: Vec<String> = r
        .undetermined
        .iter()
        .map(|free| format!("UNDETERMINED, left as it was: {}", free.describe()))
        .collect();
    if let Some(share) = r.rival {
        let why = if r.rival_is_symmetry == Some(true) {
            "it differs by a symmetry of the reference"
        } else {
            "the points do not distinguish the two"
        };
        lines.push(format!(
            "{}: another pose matches {:.1} % as many points: {why}; to choose one, give --start (as-it-lies, or a file \
             with the pose near which to begin)",
            if r.outcome == Fit::Undetermined { "SYMMETRIC" } else { "AMBIGUOUS" },
            100.0 * share
        ));
    }
    if r.outcome == Fit::NotConverged {
        lines.push(format!(
            "NOT CONVERGED: the points still move by {:.1e} mm a round; give a start nearer to the pose (--start)",
            r.last_motion_mm
        ));
    }
    lines
}
