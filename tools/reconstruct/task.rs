//! What is to be reconstructed, with which settings: from a rig file and options, or from the configuration of a cell.

use super::pairs::{camera_pairs, chosen, projector_pairs_or_fault};
use super::{Args, Method, surface_settings};
use anyhow::{Result, bail};
use cell::Settings;
use cell::executor::{PhaseMethod, method_name};
use files::config::Config;
use files::recording::Recording;
use files::rig_file::{RigFile, read_rig};
use fringe::geometry::rig::Pair;
use fringe::matching::MatchSettings;
use std::path::Path;

/// What is to be reconstructed.
pub(super) struct Task {
    /// Geometry of all views.
    pub(super) rig: RigFile,
    /// The pairs; the points carry their numbers in this order.
    pub(super) pairs: Vec<Pair>,
    /// Of decoder, matcher and fusion.
    pub(super) settings: Settings,
    /// How the wrapped phase is found.
    pub(super) phase: PhaseMethod,
    /// As the cloud names it.
    pub(super) method: &'static str,
    /// SHA-256 of the configuration, if there is one.
    pub(super) config_sha256: Option<String>,
}

/// The task that the command line describes.
pub(super) fn task(args: &Args, recording: &Recording) -> Result<Task> {
    match (&args.config, &args.rig) {
        (Some(config), _) => of_cell(args, recording, config),
        (None, Some(rig)) => of_rig(args, recording, rig),
        (None, None) => bail!("--rig or --config is missing"),
    }
}

fn of_rig(args: &Args, recording: &Recording, path: &Path) -> Result<Task> {
    let rig = read_rig(path)?;
    if let Err(fault) = rig.read_covariance() {
        eprintln!("{fault} (points do not need it)");
    }
    if let Some(hint) = rig.rig.unit_hint() {
        eprintln!(
            "warning: {}: {hint}; `fringetool import-rig --unit-mm 1000` converts a calibration",
            path.display()
        );
    }
    let pairs = match args.method {
        Method::Phase => camera_pairs(recording, &rig)?,
        Method::Projector => projector_pairs_or_fault(recording, &rig)?,
    };
    let pairs = chosen(pairs, &args.pair)?;
    let (decode, phase) = args.phase.choose(args.phase_method);
    let matching = MatchSettings { surface: surface_settings(args.smoothing_px), ..MatchSettings::default() };
    let settings = Settings { decode, matching, ..Settings::default() };
    Ok(Task { rig, pairs, settings, phase, method: args.method.name(), config_sha256: None })
}

/// As the cell would do it: the same pairs in the same order with the same settings.
fn of_cell(args: &Args, recording: &Recording, path: &Path) -> Result<Task> {
    let Config { cell, rig_path, rig_sha256, sha256, .. } = Config::load(path)?;
    for projector in &cell.projectors {
        let Some(recorded) = recording.projector(&projector.name) else { continue };
        let same = projector.sequence == recorded.sequence
            && (projector.width_px, projector.height_px) == (recorded.width_px, recorded.height_px);
        if !same {
            bail!(
                "{}: projector \"{}\" showed another sequence or had another size than in {}; name the configuration that \
                 recorded, or --rig",
                recording.document.path.display(),
                projector.name,
                path.display()
            );
        }
    }
    let rig = RigFile {
        path: rig_path,
        sha256: rig_sha256,
        rig: cell.rig,
        provenance: toml::Table::new(),
        covariance: None,
    };
    let recorded = recording.rig(&rig)?;
    if let Some(absent) = recorded.absent_pairs.first() {
        bail!(
            "{}: pair \"{}\" of {} was not recorded; list pairs = […] without it in a copy of the configuration",
            recording.document.path.display(),
            absent.name,
            path.display()
        );
    }
    let mut settings = cell.settings;
    if let Some(smoothing_px) = args.smoothing_px {
        settings.matching.surface.smoothing_px = smoothing_px;
    }
    let pairs = chosen(rig.rig.pairs.clone(), &args.pair)?;
    let (_, phase) = args.phase.choose(args.phase_method);
    Ok(Task { method: method_name(&rig.rig), rig, pairs, settings, phase, config_sha256: Some(sha256) })
}
