//! Projectors: what is written, completed by what was recorded.

use super::devices::network_address;
use super::projector_output::{Light, check_board, light};
use super::raw::{RawConfig, RawProjector};
use super::trigger::trigger;
use super::values::{projector_driver, referenced};
use crate::correction::{PatternCorrection, read_correction};
use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::name::{check_name, duplicate};
use crate::recording::{RecordedProjector, Recording};
use crate::rig_file::unknown;
use crate::sequence::check_sequence;
use cell::configuration::{CameraConfig, Driver, ProjectorConfig};
use fringe::decode::{DecodeSettings, Decoder, prove_order};
use fringe::pattern::frame_count;
use std::collections::BTreeMap;

/// What lights, and how patterns are corrected.
pub(super) struct Lights {
    /// In the order of projection.
    pub(super) projectors: Vec<ProjectorConfig>,
    /// Pattern correction of each projector, by name.
    pub(super) corrections: BTreeMap<String, PatternCorrection>,
}

pub(super) fn projectors(
    document: &Document,
    raw: &RawConfig,
    cameras: &[CameraConfig],
    recording: Option<&Recording>,
    decode: &DecodeSettings,
) -> Result<Lights, FileError> {
    if raw.projector.is_empty() {
        let problem = Problem::Missing("[[projector]]".into());
        return Err(document.fault("projector", problem, "a cell has at least one projector"));
    }
    let names = cameras.iter().map(|camera| camera.name.as_str());
    let names = names.chain(raw.projector.iter().map(|projector| projector.name.as_str()));
    if let Some((index, name)) = duplicate(names) {
        let problem = Problem::Duplicate { kind: "view", name: name.to_owned() };
        let key = format!("projector[{}].name", index.saturating_sub(cameras.len()));
        return Err(document.fault(&key, problem, "cameras and projectors share one set of names"));
    }
    let mut lights = Lights { projectors: Vec::new(), corrections: BTreeMap::new() };
    for (index, raw) in raw.projector.iter().enumerate() {
        let key = format!("projector[{index}]");
        let mut projector = one_projector(document, &key, raw, recording)?;
        let size_px = [projector.width_px, projector.height_px];
        check_sequence(document, &key, size_px, &projector.sequence)?;
        check_decodable(document, &key, &projector, decode)?;
        check_lookers(document, &key, &projector, cameras)?;
        if let Some(correction) = correction(document, &key, raw, projector.driver)? {
            projector.level_table = Some(correction.table.clone());
            lights.corrections.insert(projector.name.clone(), correction);
        }
        check_board(document, &key, &projector)?;
        lights.projectors.push(projector);
    }
    Ok(lights)
}

/// The check of the decoder itself, on the smallest possible image, and whether a check in the sequence can prove the order of its frames.
fn check_decodable(
    document: &Document,
    key: &str,
    projector: &ProjectorConfig,
    settings: &DecodeSettings,
) -> Result<(), FileError> {
    let extent_px = [projector.width_px, projector.height_px];
    Decoder::new(&projector.sequence, 1, 1, 255, extent_px, settings)
        .and_then(|_| prove_order(&projector.sequence, extent_px))
        .map_err(|error| document.fault(&format!("{key}.sequence"), Problem::Decode(error), ""))
}

/// As written; what a projector of a recording leaves out is as recorded.
fn one_projector(
    document: &Document,
    key: &str,
    raw: &RawProjector,
    recording: Option<&Recording>,
) -> Result<ProjectorConfig, FileError> {
    check_name(&raw.name).map_err(|problem| document.fault(&format!("{key}.name"), problem, ""))?;
    let driver = projector_driver(document, &format!("{key}.driver"), &raw.driver)?;
    let recorded = match (driver, recording) {
        (Driver::Recording, Some(recording)) => Some(played(document, key, raw, recording)?),
        _ => None,
    };
    let needed = |part: &str| {
        let problem = Problem::Missing(format!("{part} of projector \"{}\"", raw.name));
        document.fault(key, problem, format!("add {part} = …"))
    };
    let recorded_cameras = || recorded.map(|r| r.cameras.iter().map(|camera| camera.name.clone()).collect());
    let Light { screen, lightcrafter, refresh_hz } = light(document, key, raw, driver)?;
    let size_px = [
        raw.width_px.or(recorded.map(|r| r.width_px)).ok_or_else(|| needed("width_px"))?,
        raw.height_px.or(recorded.map(|r| r.height_px)).ok_or_else(|| needed("height_px"))?,
    ];
    let cameras = raw.cameras.clone().or_else(recorded_cameras).ok_or_else(|| needed("cameras"))?;
    let sequence = raw
        .sequence
        .clone()
        .or_else(|| recorded.map(|r| r.sequence.clone()))
        .ok_or_else(|| needed("sequence"))?;
    Ok(ProjectorConfig {
        cameras,
        exposures_ms: recorded.map(|r| r.exposures_ms.clone()).unwrap_or_default(),
        address: network_address(document, key, raw, driver)?,
        refresh_hz,
        trigger: trigger(document, key, raw, driver)?,
        screen,
        lightcrafter,
        ..ProjectorConfig::new(&raw.name, driver, size_px, sequence)
    })
}

/// The pattern correction that a projector names.
fn correction(
    document: &Document,
    key: &str,
    raw: &RawProjector,
    driver: Driver,
) -> Result<Option<PatternCorrection>, FileError> {
    let Some(target) = &raw.pattern_correction else { return Ok(None) };
    let key = format!("{key}.pattern_correction");
    if driver == Driver::Recording {
        let problem = Problem::Unsupported("the frames of a recording cannot be corrected".into());
        return Err(document.fault(&key, problem, "remove the key"));
    }
    let correction = referenced(document, &key, target, read_correction)?;
    match &correction.projector {
        Some(name) if *name != raw.name => {
            let problem = Problem::Disagreement {
                what: "projectors",
                here: format!("this is \"{}\"", raw.name),
                there: format!("{target} was measured for \"{name}\""),
            };
            Err(document.fault(&key, problem, "measure this projector with `fringetool gamma`"))
        }
        _ => Ok(Some(correction)),
    }
}

/// The projector of the recording that a projector of the cell plays; what is written must be what was recorded.
fn played<'a>(
    document: &Document,
    key: &str,
    raw: &RawProjector,
    recording: &'a Recording,
) -> Result<&'a RecordedProjector, FileError> {
    let at = recording.document.path.display();
    let Some(recorded) = recording.projector(&raw.name) else {
        let known = recording.projectors.iter().map(|projector| projector.name.as_str());
        return Err(unknown(document, &format!("{key}.name"), "recorded projector", &raw.name, known));
    };
    let differs = |part: &str, here: String, there: String| {
        let problem = Problem::Disagreement {
            what: "configuration and recording",
            here: format!("{part} = {here}"),
            there: format!("{there} in {at}"),
        };
        document.fault(&format!("{key}.{part}"), problem, "leave the key out to take it from the recording")
    };
    for (part, here, there) in
        [("width_px", raw.width_px, recorded.width_px), ("height_px", raw.height_px, recorded.height_px)]
    {
        if let Some(here) = here.filter(|here| *here != there) {
            return Err(differs(part, here.to_string(), there.to_string()));
        }
    }
    if let Some(here) = raw.sequence.as_ref().filter(|here| **here != recorded.sequence) {
        let (here, there) = (frame_count(here), frame_count(&recorded.sequence));
        return Err(differs("sequence", format!("{here} frames"), format!("another one of {there} frames")));
    }
    let absent = raw.cameras.iter().flatten().find(|name| recorded.camera(name).is_none());
    match absent {
        Some(name) => {
            let known = recorded.cameras.iter().map(|camera| camera.name.as_str());
            Err(unknown(document, &format!("{key}.cameras"), "recorded camera", name, known))
        }
        None => Ok(recorded),
    }
}

fn check_lookers(
    document: &Document,
    key: &str,
    projector: &ProjectorConfig,
    cameras: &[CameraConfig],
) -> Result<(), FileError> {
    let key = format!("{key}.cameras");
    if projector.cameras.is_empty() {
        let problem =
            Problem::Missing(format!("a camera that takes frames of projector \"{}\"", projector.name));
        return Err(document.fault(&key, problem, "name at least one camera"));
    }
    if let Some((_, name)) = duplicate(projector.cameras.iter().map(String::as_str)) {
        let problem = Problem::Duplicate { kind: "camera", name: name.to_owned() };
        return Err(document.fault(&key, problem, "name it once"));
    }
    let known = cameras.iter().map(|camera| camera.name.as_str());
    for (index, name) in projector.cameras.iter().enumerate() {
        if !cameras.iter().any(|camera| camera.name == *name) {
            return Err(unknown(document, &format!("{key}[{index}]"), "[[camera]]", name, known));
        }
    }
    Ok(())
}

/// The frames of a recording fit the cameras of the rig.
pub(super) fn check_recorded_sizes(
    document: &Document,
    recording: &Recording,
    cameras: &[CameraConfig],
) -> Result<(), FileError> {
    for (index, camera) in cameras.iter().enumerate().filter(|(_, c)| c.driver == Driver::Recording) {
        let mut seen = recording.projectors.iter().filter_map(|projector| projector.camera(&camera.name));
        let here = (camera.width_px, camera.height_px);
        if let Some(other) = seen.find(|seen| (seen.width_px, seen.height_px) != here) {
            let problem = Problem::Disagreement {
                what: "sizes",
                here: format!("camera \"{}\" has {} × {} px in the rig", camera.name, here.0, here.1),
                there: format!(
                    "{} × {} px in {}",
                    other.width_px,
                    other.height_px,
                    recording.folder.display()
                ),
            };
            let remedy = "use the rig file of this camera and this image size";
            return Err(document.fault(&format!("camera[{index}].name"), problem, remedy));
        }
    }
    Ok(())
}
