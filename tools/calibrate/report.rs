//! `--report`: what the report of the calibration is given.

use super::sensors::Characterised;
use super::shown::Shown;
use super::validation::Validation;
use anyhow::Result;
use characterise::calibration::LensChoice;
use characterise::calibration::{Calibration, Observations, SpacingSettings, SphereSpacing};
use fringe::geometry::rig::Pair;
use report::calibration::{CalibrationReport, LengthCheck, write_html};
use std::collections::BTreeMap;
use std::path::Path;

/// Everything that was computed.
pub struct Parts<'a> {
    /// The rig file as written.
    pub rig: &'a Path,
    /// The target, or the lists of its points.
    pub shown: &'a Shown<'a>,
    /// The lens models that were compared, if they were.
    pub lenses: Option<&'a LensChoice>,
    /// Result of the adjustment.
    pub calibration: &'a Calibration,
    /// What it was given.
    pub observations: &'a Observations,
    /// Pairs and their devices.
    pub pairs: &'a [(Pair, [usize; 2])],
    /// Predicted uncertainty of a sphere spacing.
    pub spacing: Option<SphereSpacing>,
    /// Held-out poses and halves.
    pub validation: &'a Validation,
    /// Certified lengths compared with measured ones.
    pub lengths: &'a [LengthCheck],
    /// Footprint and noise of the cameras.
    pub sensors: &'a BTreeMap<String, Characterised>,
    /// What was left out.
    pub notes: &'a [String],
    /// Devices that are not in the rig, and why.
    pub not_characterised: &'a [(String, String)],
}

/// Writes the report as HTML.
pub fn write(path: &Path, parts: &Parts) -> Result<()> {
    let pairs: Vec<(String, [usize; 2])> = parts.pairs.iter().map(|(p, d)| (p.name.clone(), *d)).collect();
    let report = CalibrationReport {
        rig: parts.rig.display().to_string(),
        details: details(parts)?,
        calibration: parts.calibration,
        observations: parts.observations,
        columns: parts.shown.columns,
        pairs: &pairs,
        spacing_mm: SpacingSettings::default().spacing_mm,
        spacing: parts.spacing,
        held_out: parts.validation.held.as_ref().map_err(String::as_str),
        held_out_how: &parts.validation.how,
        cross: parts.validation.cross.as_ref().map_err(String::as_str),
        lengths: parts.lengths,
        notes: parts.notes,
    };
    Ok(write_html(path, &report)?)
}

fn details(parts: &Parts) -> Result<Vec<(String, String)>> {
    let hash = files::hash::sha256_hex(&files::document::read_bytes(parts.rig, 1 << 24)?);
    let seen = parts.calibration.boards.iter().flatten().count();
    let mut details: Vec<(String, String)> = [
        ("Rig file", parts.rig.display().to_string()),
        ("SHA-256 of the rig file", hash),
        ("Target", parts.shown.text.clone()),
        ("Target file", parts.shown.file.display().to_string()),
        ("Lens model of the cameras", super::model::lenses_line(parts.calibration, parts.lenses)),
        ("Poses", format!("{seen} used of {}", parts.observations.poses.len())),
        (
            "Observations",
            format!(
                "{} views; {} degrees of freedom",
                parts.calibration.views.len(),
                parts.calibration.degrees_of_freedom
            ),
        ),
        ("Held-out poses", parts.validation.how.clone()),
        ("Date", files::clock::rfc3339_now()),
        ("Software", crate::software::FRINGETOOL.line()),
    ]
    .map(|(label, text)| (label.to_owned(), text))
    .into();
    let known = super::sensors::lines(parts.sensors).into_iter();
    details.extend(known.map(|(camera, text)| (format!("Blur and noise of {camera}"), text)));
    Ok(details)
}
