//! `fringetool check-rig`: detects from fringes on any object whether a rig has changed since its calibration.

mod print;
mod trend;

pub use print::{moved_alike, suspects};

use crate::Outcome;
use crate::calibrate::projector_reading::axis_without_coordinates;
use crate::numbers::within;
use crate::pipeline::{DecodedView, decode_views};
use crate::reconstruct::{projector_pairs, why_absent};
use crate::report::{check_outputs, emit_made_with};
use crate::software::FRINGETOOL;
use anyhow::{Context, Result, bail};
use characterise::health::{
    HealthSettings, Match, MatchCounts, PairCovariance, PairHealth, check_pair, match_projector, match_views,
};
use files::provenance::Provenance;
use files::recording::{RECORDING_FILE, RecordedRig, Recording};
use files::rig_file::{Covariance, RigFile, read_rig};
use fringe::decode::DecodeSettings;
use fringe::geometry::rig::Pair;
use fringe::pattern::Axis;
use fringe::phase::PhaseView;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Folder of the recording (docs/formats.md): any object with smooth faces, lit with fringes along both axes.
    recording: PathBuf,
    /// Rig file to check (TOML, docs/formats.md).
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Probability that a healthy pair is reported as unhealthy.
    #[arg(long, value_name = "P", default_value_t = HealthSettings::default().false_alarm, value_parser = |text: &str| within(text, 1e-9..=0.1))]
    false_alarm: f64,
    /// Smooth systematic errors of the phase (footprint, blur, stray light), rms in px.
    #[arg(long, value_name = "PX", default_value_t = HealthSettings::default().phase_error_px, value_parser = |text: &str| within(text, 0.0..=1.0))]
    phase_error_px: f64,
    /// Append the result to this trend file, one sealed line for each check, and print its history. The file is created when absent.
    #[arg(long, value_name = "FILE")]
    trend: Option<PathBuf>,
    /// Key file (16 bytes or more) that seals the lines of the trend file; without it they are only chained by SHA-256.
    #[arg(long, value_name = "FILE", requires = "trend")]
    key: Option<PathBuf>,
    /// Date of the recording (RFC 3339); default: `date` in the recording's provenance, else now.
    #[arg(long)]
    date: Option<String>,
    /// Draw the trend as an SVG image.
    #[arg(long, alias = "chart", value_name = "FILE", requires = "trend")]
    picture: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Names of pairs and devices, each with the reason.
pub type Unchecked = Vec<(String, String)>;

/// A checked pair with its matches.
pub type Examined = (PairCheck, Vec<Match>);

/// Result of the check of one pair.
#[derive(serde::Serialize)]
pub struct PairCheck {
    /// Name in the rig file.
    pub name: String,
    /// Name of its left view.
    pub left: String,
    /// Name of its right view.
    pub right: String,
    /// Name of the projector that lit both.
    pub projector: String,
    #[serde(flatten)]
    counts: MatchCounts,
    /// What the residuals say.
    #[serde(flatten)]
    pub health: PairHealth,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    check_files(args)?;
    let settings = HealthSettings {
        false_alarm: args.false_alarm,
        phase_error_px: args.phase_error_px,
        ..HealthSettings::default()
    };
    settings.check()?;
    let recording = Recording::open(&args.recording)?;
    let date = trend::date(args, &recording)?;
    // A broken trend file is reported before the work, not after.
    trend::verify(args)?;
    let rig_file = read_rig(&args.rig)?;
    let covariance = rig_file.read_covariance()?;
    let (checks, unchecked) = examine(&recording, &rig_file, covariance.as_ref(), &settings)?;
    let checks: Vec<PairCheck> = checks.into_iter().map(|(check, _)| check).collect();
    print::print(&checks, &rig_file.rig, covariance.is_some());
    for (name, why) in &unchecked {
        println!("\"{name}\" is not checked: {why}");
    }
    let healthy = checks.iter().all(|check| check.health.healthy);
    trend::append(args, date.clone(), &recording, &rig_file, &checks)?;
    let result = serde_json::json!({
        "recording": args.recording,
        "date": date,
        "rig": args.rig,
        "rig_sha256": rig_file.sha256,
        "settings": settings,
        "pairs": checks,
        "suspects": suspects(checks.iter()),
        "healthy": healthy,
        "not_checked": unchecked.iter().map(|(name, why)| serde_json::json!({ "name": name, "why": why })).collect::<Vec<_>>(),
    });
    let provenance = Provenance::now(&FRINGETOOL).rig(&rig_file.sha256);
    emit_made_with(args.json.as_deref(), &result, provenance)?;
    Ok(if healthy { Outcome::Done } else { Outcome::LimitFailed })
}

/// Every pair that a recording checks, with its matches; and what it does not check, with the reason.
pub fn examine(
    recording: &Recording,
    rig_file: &RigFile,
    covariance: Option<&Covariance>,
    settings: &HealthSettings,
) -> Result<(Vec<Examined>, Unchecked)> {
    let (pairs, unchecked) = pairs(recording, rig_file)?;
    let checks = check_pairs(recording, rig_file, &pairs, covariance, settings)?;
    Ok((checks.into_iter().collect::<Result<_>>()?, unchecked))
}

/// What the residuals of each pair of cameras, or of a camera and its projector, say; with its matches. Decodes what these pairs need.
pub fn check_pairs(
    recording: &Recording,
    rig_file: &RigFile,
    pairs: &[Pair],
    covariance: Option<&Covariance>,
    settings: &HealthSettings,
) -> Result<Vec<Result<Examined>>> {
    let lit = |projector: &str, camera: &str| {
        pairs.iter().any(|p| p.projector == projector && (p.left == camera || p.right == camera))
    };
    let views = decode_views(recording, &DecodeSettings::default(), &rig_file.sensors(), lit)?;
    let checks = pairs.iter().map(|pair| {
        check(pair, rig_file, covariance, &views, settings)
            .with_context(|| format!("{}: pair \"{}\"", recording.folder.display(), pair.name))
    });
    Ok(checks.collect())
}

fn check_files(args: &Args) -> Result<()> {
    let recording_file = args.recording.join(RECORDING_FILE);
    let mut inputs = vec![args.rig.as_path(), &recording_file];
    inputs.extend(args.key.as_deref());
    let outputs = [
        ("--trend", args.trend.as_deref()),
        ("--picture", args.picture.as_deref()),
        ("--json", args.json.as_deref()),
    ];
    Ok(check_outputs(&outputs, &inputs, None)?)
}

/// Pairs of cameras, then cameras with the projector, of all projectors that showed coordinates along both axes; and what is not
/// checked, with the reason.
fn pairs(recording: &Recording, rig_file: &RigFile) -> Result<(Vec<Pair>, Unchecked)> {
    let both = |name: &str| {
        let recorded = recording.projector(name);
        recorded.is_some_and(|projector| axis_without_coordinates(&projector.sequence).is_none())
    };
    let RecordedRig { rig, absent_pairs } = recording.rig(rig_file)?;
    let by_camera = rig.pairs.into_iter().filter(|pair| rig_file.rig.camera(&pair.right).is_some());
    let mut pairs: Vec<Pair> = by_camera.chain(projector_pairs(recording, rig_file)?).collect();
    let mut unchecked = unchecked(recording, rig_file, &pairs, both);
    unchecked.extend(absent_pairs.iter().map(|pair| (pair.name.clone(), why_absent(pair, recording))));
    pairs.retain(|pair| both(&pair.projector));
    if pairs.is_empty() {
        bail!(
            "{}: no projector shows fringes along both axes to two cameras of a [[pair]], or to one camera while it is \
             in {} itself; record `sine` and `gray` sets with axis = \"x\" and axis = \"y\"",
            recording.document.path.display(),
            rig_file.path.display()
        );
    }
    Ok((pairs, unchecked))
}

/// What the recording does not check, and why.
fn unchecked(
    recording: &Recording,
    rig_file: &RigFile,
    pairs: &[Pair],
    both: impl Fn(&str) -> bool,
) -> Unchecked {
    let mut all = Unchecked::new();
    let mut add = |name: &str, why: String| {
        if all.iter().all(|(known, _)| known != name) {
            all.push((name.to_owned(), why));
        }
    };
    for projector in &recording.projectors {
        if rig_file.rig.projector(&projector.name).is_none() {
            add(&projector.name, "it is not in the rig file".to_owned());
        }
    }
    for pair in pairs.iter().filter(|pair| !both(&pair.projector)) {
        let sequence = recording.projector(&pair.projector).map_or(&[][..], |p| &p.sequence);
        let axis = axis_without_coordinates(sequence).unwrap_or("x");
        add(&pair.name, format!("projector \"{}\" shows no sine or gray sets along {axis}", pair.projector));
    }
    for camera in &rig_file.rig.cameras {
        let seen = |p: &Pair| both(&p.projector) && (p.left == camera.name || p.right == camera.name);
        if !pairs.iter().any(seen) {
            add(&camera.name, "no pair of it was recorded along both axes".to_owned());
        }
    }
    all
}

fn check(
    pair: &Pair,
    rig_file: &RigFile,
    covariance: Option<&Covariance>,
    views: &[DecodedView],
    settings: &HealthSettings,
) -> Result<Examined> {
    let rig = &rig_file.rig;
    let both = |camera: &str| -> Result<[PhaseView<'_>; 2]> {
        let view = views.iter().find(|v| v.projector == pair.projector && v.camera == camera);
        let maps = view.and_then(|view| Some([view.map(Axis::X)?.view(), view.map(Axis::Y)?.view()]));
        maps.with_context(|| {
            format!("projector \"{}\" is not seen by camera \"{camera}\" along both axes", pair.projector)
        })
    };
    let [lx, ly] = both(&pair.left)?;
    let left = rig.camera(&pair.left).context("its left camera is not in the rig file")?;
    let (right, found) = if let Some(right) = rig.camera(&pair.right) {
        let [rx, ry] = both(&pair.right)?;
        (right, match_views([&lx, &ly], [&rx, &ry])?)
    } else {
        let right = rig.projector(&pair.right).context("its right view is not in the rig file")?;
        (right, match_projector([&lx, &ly])?)
    };
    let covariance = covariance.and_then(|c| pair_covariance(c, pair));
    let health = check_pair(left, right, &found.matches, covariance.as_ref(), settings)?;
    let Pair { name, left, right, projector } = pair.clone();
    Ok((PairCheck { name, left, right, projector, counts: found.counts, health }, found.matches))
}

/// The part of the covariance that a pair needs; `None` where the calibration did not include one of its views.
pub fn pair_covariance(covariance: &Covariance, pair: &Pair) -> Option<PairCovariance> {
    let matrix = covariance.part(&[&pair.left, &pair.right])?;
    let names = [covariance.parameters.clone(), covariance.parameters.clone()];
    Some(PairCovariance { names, matrix })
}
