//! `fringetool plan-views`: what the pairs of a rig will see of a part, before anything is built.

mod features;
mod output;
mod proposals;
mod task;

use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit_made_with};
use crate::software::FRINGETOOL;
use crate::surface::{Chord, Direction};
use anyhow::{Context, Result};
use features::features;
use files::provenance::Provenance;
use metrology::view_planning::{Planner, Seeing, coverage, patches};
use output::{Planned, csv, machine_readable, picture, print};
use proposals::{proposals, write_rig};
use std::path::PathBuf;
use task::task;

/// Elements that are looked at between two steps of the progress bar.
const BLOCK: usize = 2048;

/// Command-line arguments of `fringetool plan-views`.
#[derive(clap::Args)]
pub struct Args {
    /// CAD of the part in the frame of its plan (STEP, STL, PLY with faces, OBJ), lengths of meshes in mm.
    part: PathBuf,
    #[command(flatten)]
    chord: Chord,
    /// Rig file (TOML, docs/formats.md): cameras, projectors and pairs.
    #[arg(long, value_name = "FILE", conflicts_with = "config", required_unless_present = "config")]
    rig: Option<PathBuf>,
    /// Cell configuration (TOML, docs/formats.md) instead of a rig file: with its rig, patterns, settings and first plan.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Inspection plan (TOML, docs/formats.md): the expected uncertainty of its features; its [placement] places the part.
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// Place of the part: a file with a 4 × 4 matrix, world from part; by default that of the plan.
    #[arg(long, value_name = "FILE")]
    world_from_part: Option<PathBuf>,
    /// Longest side of an element of the surface, mm.
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    element_mm: f64,
    /// With --rig: axis along which the fringes vary.
    #[arg(long, value_enum, default_value_t = AxisName::X, conflicts_with = "config")]
    axis: AxisName,
    /// With --rig: period of the finest fringes, projector pixels.
    #[arg(long, value_name = "PX", default_value_t = 16.0, conflicts_with = "config")]
    period_px: f64,
    /// With --rig: number of phase steps of the finest fringes.
    #[arg(long, value_name = "N", default_value_t = 10, conflicts_with = "config")]
    steps: u32,
    /// Grey value of the part under white light, on a face that looks at the projector, at the distance of the part's middle.
    #[arg(long, value_name = "DN", default_value_t = 157.0)]
    white_dn: f64,
    /// The same with the projector black.
    #[arg(long, value_name = "DN", default_value_t = 6.0)]
    black_dn: f64,
    /// Largest grey value of the cameras.
    #[arg(long, value_name = "DN", default_value_t = 255.0)]
    full_scale_dn: f64,
    /// Noise of cameras of which the rig file states none: read noise in grey values, and grey values per electron.
    #[arg(long, value_name = "DN,DN_PER_E", value_delimiter = ',', num_args = 1..=2, default_value = "0.4,0.024")]
    noise: Vec<f64>,
    /// Blur of the projectors on the part, standard deviation in their pixels (`focus` measures it).
    #[arg(long, value_name = "PX", default_value_t = 0.6)]
    blur_px: f64,
    /// Blur of the cameras, lens and area of the pixel together, standard deviation in their pixels.
    #[arg(long, value_name = "PX", default_value_t = 0.58)]
    camera_blur_px: f64,
    /// Share of the light that the part reflects, for the light that bounces.
    #[arg(long, value_name = "R", default_value_t = 0.7)]
    albedo: f64,
    /// Directions per element in which light that bounces is followed; 0: none.
    #[arg(long, value_name = "N", default_value_t = 32)]
    bounce_rays: u32,
    /// Side of the window over which points are smoothed, px; by default that of the configuration or of `reconstruct`.
    #[arg(long, value_name = "PX")]
    smoothing_px: Option<u32>,
    /// Draws of the noise over which the uncertainty of features is averaged.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    trials: u32,
    /// Propose up to so many further pairs, each the one that sees most of what no pair sees yet.
    #[arg(long, value_name = "N", default_value_t = 0)]
    propose: usize,
    /// Pairs that may be proposed: those of this rig file; by default those of the rig, turned about the part.
    #[arg(long, value_name = "RIG", requires = "propose")]
    candidates: Option<PathBuf>,
    /// Direction that is up, around which pairs are turned.
    #[arg(long, value_name = "x,y,z", default_value = "0,0,1", allow_hyphen_values = true)]
    up: Direction,
    /// Write the rig with the proposed pairs to this file (TOML, docs/formats.md).
    #[arg(long, value_name = "FILE", requires = "propose")]
    out: Option<PathBuf>,
    /// Write a picture of the part, coloured by number of pairs and by uncertainty, to this file (PNG).
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
    /// Write a table with one line for each element (CSV).
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// An axis on the command line.
#[derive(Clone, Copy, clap::ValueEnum)]
enum AxisName {
    X,
    Y,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let optional = [&args.rig, &args.config, &args.plan, &args.world_from_part, &args.candidates];
    let inputs: Vec<_> = std::iter::once(args.part.as_path())
        .chain(optional.into_iter().filter_map(|p| p.as_deref()))
        .collect();
    let outputs = [
        ("--out", args.out.as_deref()),
        ("--picture", args.picture.as_deref()),
        ("--csv", args.csv.as_deref()),
        ("--json", args.json.as_deref()),
    ];
    check_outputs(&outputs, &inputs, None)?;
    let task = task(args)?;
    let seeing = look(args, &task.planner)?;
    let (planner, pairs) = (&task.planner, task.planner.pairs().len());
    let planned = Planned {
        coverage: coverage(planner.elements(), &seeing, pairs),
        patches: patches(planner.elements(), &seeing, pairs, args.element_mm),
        features: features(&task, args.trials)?,
        proposals: proposals(args, &task, &seeing)?,
        seeing,
    };
    let mut provenance = Provenance::now(&FRINGETOOL).rig(&task.rig_file.sha256);
    if let Some((plan, sha256)) = &task.plan {
        provenance = provenance.plan(&plan.name, sha256);
    }
    if let Some(path) = &args.out {
        write_rig(path, &task, &planned.proposals)?;
    }
    if let Some(path) = &args.picture {
        files::atomic::write(path, &picture(&task, &planned)?)?;
    }
    if let Some(path) = &args.csv {
        files::atomic::write(path, csv(&task, &planned).as_bytes())?;
    }
    emit_made_with(args.json.as_deref(), &machine_readable(args, &task, &planned), provenance)?;
    print(args, &task, &planned);
    let all_measured = planned.features.iter().flatten().all(|feature| feature.u.is_some());
    Ok(if all_measured { Outcome::Done } else { Outcome::LimitFailed })
}

/// What each pair sees of each element.
fn look(args: &Args, planner: &Planner) -> Result<Vec<Seeing>> {
    let (count, pairs) = (planner.elements().len(), planner.pairs().len());
    let bytes = 2 * (count * pairs * size_of::<Seeing>()) as u64;
    files::memory::check(&args.part, &format!("{count} elements for {pairs} pairs"), bytes)
        .context("larger elements (--element-mm) need less")?;
    let mut progress = Progress::new(count.div_ceil(BLOCK), "following rays");
    let mut seeing = Vec::with_capacity(count * pairs);
    for first in (0..count).step_by(BLOCK) {
        seeing.extend(planner.seeing(first..(first + BLOCK).min(count)));
        progress.step();
    }
    Ok(seeing)
}
