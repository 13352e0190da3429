//! `fringetool reconstruct`: a recording and a rig file become a point cloud.

mod pairs;

pub use pairs::projector_pairs;
use pairs::{camera_pairs, projector_pairs_or_fault};

use crate::Outcome;
use crate::decode::lines;
use crate::filters::{FilterLine, Filters};
use crate::phase_method::{PhaseArgs, PhaseMethod, PhaseName};
use crate::pipeline::{DecodedView, decode_views_by, match_maps};
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use files::recording::{RECORDING_FILE, Recording};
use files::rig_file::{RigFile, read_rig};
use fringe::cloud::Point;
use fringe::decode::DecodeSettings;
use fringe::fusion::{FusionReport, FusionSettings, fuse};
use fringe::geometry::rig::{Pair, Rig};
use fringe::matching::{MatchReport, MatchSettings, Matcher};
use fringe::pattern::Axis;
use fringe::phase::PhaseMap;
use fringe::projector::{ProjectorMatcher, ProjectorReport, ProjectorSettings};
use fringe::surface::SurfaceSettings;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Folder of the recording (docs/formats.md).
    recording: PathBuf,
    /// Rig file (TOML, docs/formats.md).
    #[arg(long)]
    rig: PathBuf,
    /// `phase`: match the phase of two cameras; `projector`: camera against calibrated projector.
    #[arg(long, value_enum, default_value_t = Method::Phase)]
    method: Method,
    /// Point cloud to write (PLY).
    #[arg(long)]
    out: PathBuf,
    /// Reconstruct only these pairs; by default all.
    #[arg(long)]
    pair: Vec<String>,
    #[command(flatten)]
    filters: Filters,
    /// Side of the window over which points are smoothed by a quadratic, px: 1 (not at all), 3, 5 or 7.
    #[arg(long, value_name = "PX")]
    smoothing_px: Option<u32>,
    /// Method of the wrapped phase.
    #[arg(long, value_enum, default_value_t)]
    phase_method: PhaseName,
    #[command(flatten)]
    phase: PhaseArgs,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// How points are found.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// Two cameras.
    Phase,
    /// Camera and projector.
    Projector,
}

impl Method {
    fn name(self) -> &'static str {
        match self {
            Self::Phase => "phase",
            Self::Projector => "projector",
        }
    }
}

/// The cloud of one pair and how it came about.
struct PairCloud {
    pair: Pair,
    points: Vec<Point>,
    report: PairReport,
}

/// What became of the pixels of a pair.
#[derive(serde::Serialize)]
#[serde(untagged)]
enum PairReport {
    Phase(MatchReport),
    Projector(ProjectorReport),
}

impl std::fmt::Display for PairReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Phase(r) => write!(
                f,
                "{} points of {} valid pixels; {} not seen by both, {} ambiguous, {} inconsistent, {} at steps or edges",
                r.points, r.valid, r.unmatched, r.ambiguous, r.inconsistent, r.discontinuous
            ),
            Self::Projector(r) => {
                write!(
                    f,
                    "{} points of {} valid pixels; {} beside the projector",
                    r.points, r.valid, r.missed
                )?;
                r.epipolar_rms_px.map_or(Ok(()), |rms| {
                    write!(f, ", {} contradicting; both axes agree within {rms:.3} px rms", r.contradicting)
                })
            }
        }
    }
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [("--out", Some(args.out.as_path())), ("--json", args.json.as_deref())];
    check_outputs(&outputs, &[&args.rig, &args.recording.join(RECORDING_FILE)], None)?;
    let recording = Recording::open(&args.recording)?;
    let rig_file = read_rig(&args.rig)?;
    if let Err(fault) = rig_file.read_covariance() {
        eprintln!("{fault} (points do not need it)");
    }
    let pairs = pairs::chosen(args, &recording, &rig_file)?;
    let surface = surface_settings(args.smoothing_px);
    let how = How { decode: args.phase.choose(args.phase_method), filters: &args.filters, surface: &surface };
    let Done { views, filtered, pairs: clouds } = clouds(&recording, &rig_file, args.method, &pairs, &how)?;
    let (fused, fusion) = join(&clouds);
    if fused.is_empty() {
        let seen: Vec<String> = lines(&views).iter().map(ToString::to_string).collect();
        bail!(
            "{}: no point at all; either the views share no valid phase, or rig and recording do not belong together; {}",
            args.recording.display(),
            seen.join("; ")
        );
    }
    write_cloud(args, &recording, &rig_file, &fused)?;
    for line in &filtered {
        println!("{line}");
    }
    print_report(&views, &clouds, &fusion, fused.len(), args);
    let mut result = json(args, &views, &clouds, &fusion, &fused);
    result["filters"] = serde_json::json!(filtered);
    emit(args.json.as_deref(), &result)?;
    Ok(Outcome::Done)
}

/// What counts as a surface, with another window of smoothing if one is given.
pub fn surface_settings(smoothing_px: Option<u32>) -> SurfaceSettings {
    let usual = SurfaceSettings::default();
    SurfaceSettings { smoothing_px: smoothing_px.unwrap_or(usual.smoothing_px), ..usual }
}

/// The fused cloud of a recording from all its pairs, for commands that measure on it.
pub fn fused_cloud(
    recording: &Recording,
    rig_file: &RigFile,
    method: Method,
    surface: &SurfaceSettings,
) -> Result<Vec<Point>> {
    let pairs = match method {
        Method::Phase => camera_pairs(recording, rig_file)?,
        Method::Projector => projector_pairs_or_fault(recording, rig_file)?,
    };
    let decode = (DecodeSettings::default(), PhaseMethod::default());
    let how = How { decode, filters: &Filters::default(), surface };
    let done = clouds(recording, rig_file, method, &pairs, &how)?;
    Ok(join(&done.pairs).0)
}

/// What is done between frames and points.
struct How<'a> {
    decode: (DecodeSettings, PhaseMethod),
    filters: &'a Filters,
    surface: &'a SurfaceSettings,
}

/// What became of the frames.
struct Done {
    views: Vec<DecodedView>,
    filtered: Vec<FilterLine>,
    pairs: Vec<PairCloud>,
}

/// Decodes what the pairs need, filters, and gives the cloud of each.
fn clouds(
    recording: &Recording,
    rig_file: &RigFile,
    method: Method,
    pairs: &[Pair],
    how: &How,
) -> Result<Done> {
    let lit = |projector: &str, camera: &str| {
        pairs.iter().any(|p| p.projector == projector && (p.left == camera || p.right == camera))
    };
    let mut views = decode_views_by(recording, &how.decode.0, &how.decode.1, lit)?;
    let filtered = how.filters.apply(&mut views)?;
    let mut clouds = Vec::new();
    for (index, pair) in pairs.iter().enumerate() {
        let cloud = match method {
            Method::Phase => match_pair(&rig_file.rig, pair, index, &views, how.surface),
            Method::Projector => intersect_pair(&rig_file.rig, pair, index, &views, how.surface),
        };
        clouds.push(cloud.with_context(|| format!("{}: pair \"{}\"", rig_file.path.display(), pair.name))?);
    }
    Ok(Done { views, filtered, pairs: clouds })
}

fn join(clouds: &[PairCloud]) -> (Vec<Point>, FusionReport) {
    let slices: Vec<&[Point]> = clouds.iter().map(|c| c.points.as_slice()).collect();
    let mut fused = Vec::new();
    let fusion = fuse(&slices, &FusionSettings::default(), &mut fused);
    (fused, fusion)
}

fn view<'a>(views: &'a [DecodedView], projector: &str, camera: &str) -> Result<&'a DecodedView> {
    views
        .iter()
        .find(|v| v.projector == projector && v.camera == camera)
        .with_context(|| format!("camera \"{camera}\" was not recorded under projector \"{projector}\""))
}

fn match_pair(
    rig: &Rig,
    pair: &Pair,
    index: usize,
    views: &[DecodedView],
    surface: &SurfaceSettings,
) -> Result<PairCloud> {
    let settings = MatchSettings { surface: *surface, ..MatchSettings::default() };
    let camera = |name: &str| rig.camera(name).with_context(|| format!("no camera \"{name}\" in the rig"));
    let mut matcher = Matcher::new(camera(&pair.left)?, camera(&pair.right)?, &settings)?;
    let (left, right) =
        (view(views, &pair.projector, &pair.left)?, view(views, &pair.projector, &pair.right)?);
    let maps: Vec<_> = left.maps.iter().map(|decoded| decoded.map.view()).collect();
    // Without a valid pixel any axis will do: there is nothing to match.
    let axis = matcher.best_axis(&maps).or(maps.first().map(|map| map.info.axis)).unwrap_or(Axis::X);
    let (points, report) = match_maps(&mut matcher, along(left, axis)?, along(right, axis)?, index)?;
    Ok(PairCloud { pair: pair.clone(), points, report: PairReport::Phase(report) })
}

fn along(view: &DecodedView, axis: Axis) -> Result<&PhaseMap> {
    view.map(axis).with_context(|| format!("camera \"{}\" has no phase along {axis:?}", view.camera))
}

fn intersect_pair(
    rig: &Rig,
    pair: &Pair,
    index: usize,
    views: &[DecodedView],
    surface: &SurfaceSettings,
) -> Result<PairCloud> {
    let settings = ProjectorSettings { surface: *surface, ..ProjectorSettings::default() };
    let camera = rig.camera(&pair.left).with_context(|| format!("no camera \"{}\" in the rig", pair.left))?;
    let projector =
        rig.projector(&pair.right).with_context(|| format!("no projector \"{}\" in the rig", pair.right))?;
    let mut matcher = ProjectorMatcher::new(camera, projector, &settings)?;
    let view = view(views, &pair.projector, &pair.left)?;
    let (x, y) = (view.map(Axis::X).map(PhaseMap::view), view.map(Axis::Y).map(PhaseMap::view));
    let mut points = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
    let report = matcher.run(x.as_ref(), y.as_ref(), index as u32, &mut points)?;
    points.truncate(report.points as usize);
    Ok(PairCloud { pair: pair.clone(), points, report: PairReport::Projector(report) })
}

fn write_cloud(args: &Args, recording: &Recording, rig_file: &RigFile, points: &[Point]) -> Result<()> {
    let software = format!("fringetool {}", env!("CARGO_PKG_VERSION"));
    let folder = recording.folder.display().to_string();
    let comments = [
        ("rig_sha256", rig_file.sha256.as_str()),
        ("recording", folder.as_str()),
        ("recording_sha256", recording.sha256.as_str()),
        ("method", args.method.name()),
        ("software", software.as_str()),
        ("unit", "mm"),
    ];
    Ok(files::ply::write_cloud(&args.out, points, &comments)?)
}

fn print_report(
    views: &[DecodedView],
    clouds: &[PairCloud],
    fusion: &FusionReport,
    points: usize,
    args: &Args,
) {
    for line in lines(views) {
        println!("{line}");
    }
    for cloud in clouds {
        println!("{}: {}", cloud.pair.name, cloud.report);
    }
    for o in &fusion.overlaps {
        println!(
            "overlap {} – {}: {} points, mean {:+.1} µm, standard deviation {:.1} µm",
            clouds[o.a].pair.name,
            clouds[o.b].pair.name,
            o.count,
            o.mean_mm * 1e3,
            o.sd_mm * 1e3
        );
    }
    println!("{}: {points} points", args.out.display());
}

fn json(
    args: &Args,
    views: &[DecodedView],
    clouds: &[PairCloud],
    fusion: &FusionReport,
    fused: &[Point],
) -> serde_json::Value {
    let pairs: Vec<_> = clouds
        .iter()
        .map(|c| serde_json::json!({ "name": c.pair.name, "points": c.points.len(), "matching": c.report }))
        .collect();
    serde_json::json!({
        "method": args.method.name(),
        "points": fused.len(),
        "cloud": args.out,
        "views": lines(views),
        "pairs": pairs,
        "fusion": fusion,
    })
}
