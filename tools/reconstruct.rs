mod decoded;
mod pairs;
mod task;
mod why;

pub use decoded::{Clouds, DecodedRecording, fused_cloud};
pub use pairs::{projector_pairs, why_absent};
use task::{Task, task};

use crate::Outcome;
use crate::decode::{lines, missing};
use crate::filters::{FilterLine, Filters};
use crate::phase_method::{PhaseArgs, PhaseName};
use crate::pipeline::{DecodedView, Decoding, decode_views_by};
use crate::report::{check_outputs, emit_made_with};
use crate::software::FRINGETOOL;
use anyhow::{Context, Result, bail};
use cell::Settings;
use cell::executor::{Matched, PairMatcher, ProjectorCheck, Views};
use files::cloud_pairs;
use files::footprints_off::{self, FootprintsOff};
use files::provenance::Provenance;
use files::recording::{RECORDING_FILE, Recording};
use files::rig_file::RigFile;
use files::rims_left_out;
use files::viewpoints;
use fringe::cloud::Point;
use fringe::fusion::{Fuser, FusionReport, disagreement_warning};
use fringe::geometry::rig::{Pair, pictures};
use fringe::surface::{SurfaceReport, SurfaceSettings};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Folder of the recording (docs/formats.md).
    recording: PathBuf,
    /// Rig file (TOML, docs/formats.md).
    #[arg(long, value_name = "FILE", required_unless_present = "config")]
    rig: Option<PathBuf>,
    /// Configuration of a cell (TOML, docs/formats.md): its rig, its pairs and its settings give the cloud that the cell gives for these frames.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["rig", "method", "order", "fuse", "use_clipped"])]
    config: Option<PathBuf>,
    /// `phase`: match the phase of two cameras; `projector`: camera against calibrated projector.
    #[arg(long, value_enum, default_value_t = Method::Phase)]
    method: Method,
    /// Point cloud to write (PLY).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Picture of what became of each pixel of the left camera, with a legend (PNG); of several pairs one each, `why-PAIR.png`.
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Reconstruct only these pairs; by default all.
    #[arg(long, value_name = "NAME")]
    pair: Vec<String>,
    #[command(flatten)]
    filters: Filters,
    /// Side of the window over which points are smoothed by a quadratic, px: 1 (not at all), 3, 5 or 7.
    #[arg(long, value_name = "PX", value_parser = smoothing)]
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
    /// Two cameras see the same phase.
    Phase,
    /// One camera and the calibrated projector.
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

/// The cloud of one pair and what became of its pixels.
struct PairCloud {
    pair: Pair,
    points: Vec<Point>,
    report: Matched,
    /// How far the points lie beside what the left camera sees of the projector, where the rig file has it, px; and what a person should know of that.
    beside_projector_px: Option<f64>,
    warning: Option<String>,
    /// What became of each pixel of the left camera (see [`why`]).
    classes: Vec<u8>,
}

/// What became of the pixels of a pair, on one line; the causes add up to the valid pixels less the points.
fn line(report: &Matched) -> String {
    match report {
        Matched::Phase(r) => format!(
            "{} points of {} valid pixels; {} outside the other view, {} not seen by it, {} ambiguous, {} inconsistent, {} at steps \
             or edges, {} too uncertain, {}",
            r.points,
            r.valid + r.outside,
            r.outside,
            r.unmatched,
            r.ambiguous,
            r.inconsistent,
            r.discontinuous,
            r.uncertain + r.surface.uncertain,
            dropped(&r.surface)
        ),
        Matched::Projector(r) => {
            let both = r.epipolar_rms_px.map(|rms| {
                format!(", {} contradicting; both axes agree within {rms:.3} px rms", r.contradicting)
            });
            let both = both.unwrap_or_default();
            format!(
                "{} points of {} valid pixels; {} beside the projector, {}{both}",
                r.points,
                r.valid,
                r.missed,
                dropped(&r.surface)
            )
        }
    }
}

/// The points that the surface stage left out, by cause.
fn dropped(surface: &SurfaceReport) -> String {
    let SurfaceReport { spikes, crumbs, steep, rims, .. } = surface;
    format!("{spikes} without neighbours, {crumbs} in small patches, {steep} too steep, {rims} at rims")
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [
        ("--out", Some(args.out.as_path())),
        ("--json", args.json.as_deref()),
        ("--map", args.map.as_deref()),
    ];
    let recording_file = args.recording.join(RECORDING_FILE);
    let inputs: Vec<_> =
        args.rig.iter().chain(&args.config).chain([&recording_file]).map(PathBuf::as_path).collect();
    check_outputs(&outputs, &inputs, None)?;
    let recording = Recording::open(&args.recording)?;
    let task = task(args, &recording)?;
    // The pictures have names of their own, none of which may be that of another output.
    let pictures = args.map.as_ref().map_or(Vec::new(), |path| why::paths(path, &task.pairs));
    let pictures = pictures.iter().map(|path| ("--map", Some(path.as_path())));
    check_outputs(&outputs[..2].iter().copied().chain(pictures).collect::<Vec<_>>(), &inputs, None)?;
    let done = clouds(&recording, &task, &args.filters)?;
    let (fused, fusion) = join(&done.pairs, &task.settings);
    if fused.is_empty() {
        let seen: Vec<String> = lines(&done.views).iter().map(ToString::to_string).collect();
        bail!(
            "{}: no point at all; either the views share no valid phase, or rig and recording do not belong together; {}{}",
            args.recording.display(),
            seen.join("; "),
            why::low_range(&recording).unwrap_or_default()
        );
    }
    write_cloud(args, &recording, (&task, &done.views), &fused)?;
    if let Some(path) = &args.map {
        for written in why::write(path, &done.views, &done.pairs)? {
            println!("what became of each pixel: {}", written.display());
        }
    }
    for line in &done.filtered {
        println!("{line}");
    }
    let missing = missing(&recording);
    print_report(&done, &fusion, fused.len(), (args, &missing));
    let mut result = json(args, &task, &done, &fusion, &fused);
    result["filters"] = serde_json::json!(done.filtered);
    result["missing"] = serde_json::json!(missing);
    let provenance = Provenance::now(&FRINGETOOL).rig(&task.rig.sha256);
    emit_made_with(args.json.as_deref(), &result, provenance)?;
    Ok(Outcome::Done)
}

/// The side of a window of smoothing.
fn smoothing(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|side| [1, 3, 5, 7].contains(side))
        .ok_or_else(|| "must be 1, 3, 5 or 7".to_owned())
}

/// What counts as a surface, with another window of smoothing if one is given.
pub fn surface_settings(smoothing_px: Option<u32>) -> SurfaceSettings {
    let usual = SurfaceSettings::default();
    SurfaceSettings { smoothing_px: smoothing_px.unwrap_or(usual.smoothing_px), ..usual }
}

/// What became of the frames.
struct Done {
    views: Vec<DecodedView>,
    filtered: Vec<FilterLine>,
    pairs: Vec<PairCloud>,
}

/// Decodes what the pairs need, filters, and gives the cloud of each.
fn clouds(recording: &Recording, task: &Task, filters: &Filters) -> Result<Done> {
    let mut views = decode(recording, task)?;
    let filtered = filters.apply(&mut views)?;
    let pairs = match_pairs(task, &task.rig, &views)?;
    Ok(Done { views, filtered, pairs })
}

/// Decodes what the pairs need.
fn decode(recording: &Recording, task: &Task) -> Result<Vec<DecodedView>> {
    let lit = |projector: &str, camera: &str| {
        task.pairs.iter().any(|p| p.projector == projector && (p.left == camera || p.right == camera))
    };
    let sensors = task.rig.sensors();
    let how = Decoding {
        settings: &task.settings.decode,
        sensors: &sensors,
        method: task.phase,
        keep_diagnosis: false,
    };
    decode_views_by(recording, &how, lit)
}

/// The cloud of each pair.
fn match_pairs(task: &Task, rig: &RigFile, views: &[DecodedView]) -> Result<Vec<PairCloud>> {
    let match_pair = |(index, pair): (usize, &Pair)| {
        let mut matcher = PairMatcher::new(&rig.rig, pair, index, &task.settings.matching)
            .with_context(|| rig.path.display().to_string())?;
        let view = |camera: &str| {
            let of = |view: &&DecodedView| view.projector == pair.projector && view.camera == camera;
            let maps = views.iter().find(of).into_iter().flat_map(|view| &view.maps);
            Views::of(maps.map(|decoded| decoded.map.view()))
        };
        let matched = matcher.cloud(&view(&pair.left), &view(&pair.right));
        let (points, report) =
            matched.with_context(|| format!("{}: pair \"{}\"", rig.path.display(), pair.name))?;
        let check = ProjectorCheck::new(&rig.rig, pair);
        let judged = check.map(|mut check| check.judge(&view(&pair.left), &points));
        let (beside_projector_px, warning) = judged.unwrap_or_default();
        let classes = Vec::new();
        let mut cloud =
            PairCloud { pair: pair.clone(), points, report, beside_projector_px, warning, classes };
        cloud.classes = why::classes(matcher.causes(), &why::left_maps(views, &cloud));
        Ok(cloud)
    };
    task.pairs.iter().enumerate().map(match_pair).collect()
}

fn join(clouds: &[PairCloud], settings: &Settings) -> (Vec<Point>, FusionReport) {
    let slices: Vec<&[Point]> = clouds.iter().map(|c| c.points.as_slice()).collect();
    let mut fused = Vec::new();
    let mut fuser = Fuser::of_pictures(pictures(clouds.iter().map(|cloud| &cloud.pair)));
    let fusion = fuser.fuse(&slices, &settings.fusion, &mut fused).clone();
    (fused, fusion)
}

fn write_cloud(
    args: &Args,
    recording: &Recording,
    (task, views): (&Task, &[DecodedView]),
    points: &[Point],
) -> Result<()> {
    let software = format!("fringetool {}", env!("CARGO_PKG_VERSION"));
    let folder = recording.folder.display().to_string();
    let mut comments = vec![("rig_sha256", task.rig.sha256.as_str())];
    comments.extend(task.config_sha256.as_ref().map(|sha256| ("config_sha256", sha256.as_str())));
    comments.extend([
        ("recording", folder.as_str()),
        ("recording_sha256", recording.sha256.as_str()),
        ("method", task.method),
        ("software", software.as_str()),
    ]);
    let mut cameras_off = FootprintsOff::new();
    for view in views {
        let off = view.maps.iter().filter_map(|decoded| decoded.report.footprint_off_px2());
        off.for_each(|off_px2| footprints_off::add(&mut cameras_off, &view.camera, off_px2));
    }
    let cameras_off = footprints_off::comment(&cameras_off);
    let assumed = |view: &&DecodedView| view.maps.iter().any(|decoded| decoded.report.footprint_assumed);
    let assumed = views.iter().filter(assumed).map(|view| view.camera.clone()).collect();
    let assumed = footprints_off::assumed_comment(&assumed);
    let pairs = cloud_pairs::comment(&task.pairs);
    comments.push((cloud_pairs::COMMENT, pairs.as_str()));
    let edge_px = task.settings.matching.surface.edge_px.to_string();
    comments.push((rims_left_out::COMMENT, edge_px.as_str()));
    let viewpoints = viewpoints::comment(&task.rig.rig, &task.pairs);
    comments.push((viewpoints::COMMENT, viewpoints.as_str()));
    comments.extend(cameras_off.as_ref().map(|text| (footprints_off::COMMENT, text.as_str())));
    comments.extend(assumed.as_ref().map(|text| (footprints_off::ASSUMED, text.as_str())));
    Ok(files::ply::write_cloud(&args.out, points, &comments)?)
}

fn print_report(done: &Done, fusion: &FusionReport, points: usize, (args, missing): (&Args, &[String])) {
    for line in lines(&done.views) {
        println!("{line}");
    }
    for note in missing {
        println!("{note}");
    }
    for cloud in &done.pairs {
        println!("{}: {}", cloud.pair.name, line(&cloud.report));
        let left_out: Vec<String> = why::left_out(&cloud.classes)
            .into_iter()
            .map(|(cause, count)| format!("{count} {cause}"))
            .collect();
        if !left_out.is_empty() {
            println!("{}: lit pixels without a point: {}", cloud.pair.name, left_out.join(", "));
        }
    }
    for warning in done.pairs.iter().filter_map(|cloud| cloud.warning.as_ref()) {
        println!("warning: {warning}");
    }
    for cloud in &done.pairs {
        let (points, valid) = match &cloud.report {
            Matched::Phase(r) => (r.points, r.valid),
            Matched::Projector(r) => (r.points, r.valid),
        };
        if u64::from(points) * 2 < u64::from(valid) {
            println!(
                "warning: pair \"{}\": {points} of {valid} valid pixels became points, fewer than half; where the part does not hide so much of itself, recording \
                 and rig do not belong together: does each folder hold the frames of the camera that the rig file means?",
                cloud.pair.name
            );
        }
    }
    for o in &fusion.overlaps {
        println!("overlap {} – {}: {o}", done.pairs[o.a].pair.name, done.pairs[o.b].pair.name);
    }
    if let Some(warning) = disagreement_warning(fusion.disagreeing, fusion.points) {
        println!("warning: {warning}");
    } else if fusion.disagreeing > 0 {
        println!(
            "pairs disagree beyond what they state at {} points: their uncertainty is raised",
            fusion.disagreeing
        );
    }
    println!("{}: {points} points", args.out.display());
}

fn json(args: &Args, task: &Task, done: &Done, fusion: &FusionReport, fused: &[Point]) -> serde_json::Value {
    let pairs: Vec<_> = done
        .pairs
        .iter()
        .map(|c| {
            let left_out: serde_json::Map<String, serde_json::Value> =
                why::left_out(&c.classes).into_iter().map(|(cause, count)| (cause, count.into())).collect();
            serde_json::json!({
                "name": c.pair.name, "points": c.points.len(), "matching": c.report, "left_out": left_out,
                "beside_projector_px": c.beside_projector_px,
            })
        })
        .collect();
    serde_json::json!({
        "method": task.method,
        "points": fused.len(),
        "cloud": args.out,
        "views": lines(&done.views),
        "pairs": pairs,
        "fusion": fusion,
    })
}
