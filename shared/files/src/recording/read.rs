//! Opening a recording: every frame is found and measured before the first one is decoded.

use super::frames::{equal_headers, list_frames};
use super::{FRAMES_FOLDER, RECORDING_FILE, RECORDING_FORMAT, RecordedCamera, RecordedProjector, Recording};
use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::hash::sha256_hex;
use crate::name::{check_name, duplicate};
use crate::sequence::check_sequence;
use fringe::pattern::{PatternSet, frame_count, without};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawRecording {
    #[serde(rename = "format")]
    _format: String,
    #[serde(default)]
    projector: Vec<RawProjector>,
    #[serde(default)]
    provenance: toml::Table,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawProjector {
    name: String,
    width_px: u32,
    height_px: u32,
    cameras: Vec<String>,
    sequence: Vec<PatternSet>,
    full_scale_dn: Option<FullScale>,
    #[serde(default)]
    exposures_ms: Vec<f64>,
    #[serde(default)]
    missing: BTreeSet<usize>,
}

/// One number for all cameras, or one for each that differs.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum FullScale {
    All(u16),
    ByCamera(BTreeMap<String, u16>),
}

impl FullScale {
    fn of(&self, camera: &str) -> Option<u16> {
        match self {
            Self::All(value) => Some(*value),
            Self::ByCamera(values) => values.get(camera).copied(),
        }
    }

    fn values(&self) -> Vec<u16> {
        match self {
            Self::All(value) => vec![*value],
            Self::ByCamera(values) => values.values().copied().collect(),
        }
    }
}

pub(super) fn open(folder: &Path) -> Result<Recording, FileError> {
    let folder = match folder.file_name() {
        Some(name) if name == RECORDING_FILE => folder.parent().unwrap_or(Path::new("")),
        _ => folder,
    };
    let folder =
        std::path::absolute(folder).map_err(|source| FileError::io(folder, "resolve the path", source))?;
    let file = folder.join(RECORDING_FILE);
    if folder.is_dir() && !file.exists() {
        let problem = Problem::Missing(RECORDING_FILE.into());
        let remedy = "not a recording, or one that was broken off before its end (the file is written last)";
        return Err(FileError::new(&folder, problem, remedy));
    }
    let document = Document::read(&file)?;
    let raw: RawRecording = document.parse(RECORDING_FORMAT)?;
    if raw.projector.is_empty() {
        let problem = Problem::Missing("[[projector]]".into());
        return Err(document.fault("projector", problem, "describe each projector and its sequence"));
    }
    if let Some((index, name)) = duplicate(raw.projector.iter().map(|p| p.name.as_str())) {
        let problem = Problem::Duplicate { kind: "projector", name: name.to_owned() };
        return Err(document.fault(&format!("projector[{index}].name"), problem, "rename one of them"));
    }
    let projectors = raw
        .projector
        .iter()
        .enumerate()
        .map(|(index, projector)| self::projector(&document, &folder, index, projector))
        .collect::<Result<Vec<_>, _>>()?;
    one_size_per_camera(&document, &projectors)?;
    let sha256 = sha256_hex(document.text.as_bytes());
    Ok(Recording { folder, document, sha256, projectors, provenance: raw.provenance })
}

fn projector(
    document: &Document,
    folder: &Path,
    index: usize,
    raw: &RawProjector,
) -> Result<RecordedProjector, FileError> {
    let key = format!("projector[{index}]");
    check_name(&raw.name).map_err(|problem| document.fault(&format!("{key}.name"), problem, ""))?;
    check_sequence(document, &key, [raw.width_px, raw.height_px], &raw.sequence)?;
    check_full_scale(document, &key, raw)?;
    check_exposures(document, &key, &raw.exposures_ms)?;
    let cameras_key = format!("{key}.cameras");
    if raw.cameras.is_empty() {
        let problem = Problem::Missing("a camera".into());
        return Err(document.fault(&cameras_key, problem, "name the cameras that took frames"));
    }
    if let Some((_, name)) = duplicate(raw.cameras.iter().map(String::as_str)) {
        let problem = Problem::Duplicate { kind: "camera", name: name.to_owned() };
        return Err(document.fault(&cameras_key, problem, "name it once"));
    }
    for (number, name) in raw.cameras.iter().enumerate() {
        let key = format!("{cameras_key}[{number}]");
        check_name(name).map_err(|problem| document.fault(&key, problem, ""))?;
    }
    let count = frame_count(&raw.sequence);
    let left = without(&raw.sequence, &raw.missing)
        .map_err(|error| document.fault(&format!("{key}.missing"), Problem::Pattern(error), ""))?;
    if left.frames.is_empty() {
        let problem = Problem::Missing("a frame that is left".into());
        return Err(document.fault(&format!("{key}.missing"), problem, "record again"));
    }
    let camera = |name: &String| {
        let folder = folder.join(FRAMES_FOLDER).join(&raw.name).join(name);
        camera(
            document,
            &cameras_key,
            name,
            &folder,
            ([count, raw.exposures_ms.len()], &left.frames),
            raw.full_scale_dn.as_ref(),
        )
    };
    Ok(RecordedProjector {
        name: raw.name.clone(),
        width_px: raw.width_px,
        height_px: raw.height_px,
        cameras: raw.cameras.iter().map(camera).collect::<Result<_, _>>()?,
        sequence: left.sequence,
        notes: left.notes,
        exposures_ms: raw.exposures_ms.clone(),
    })
}

fn check_full_scale(document: &Document, key: &str, raw: &RawProjector) -> Result<(), FileError> {
    let Some(full_scale) = &raw.full_scale_dn else { return Ok(()) };
    let key = format!("{key}.full_scale_dn");
    if let FullScale::ByCamera(values) = full_scale
        && let Some(name) = values.keys().find(|name| !raw.cameras.contains(name))
    {
        let known = raw.cameras.iter().map(String::as_str);
        return Err(crate::rig_file::unknown(document, &key, "camera", name, known));
    }
    match full_scale.values().into_iter().find(|value| *value < 255) {
        Some(value) => {
            let problem = Problem::Value { value: value.to_string(), limit: "255 … 65535".into() };
            Err(document.fault(
                &key,
                problem,
                "the grey value at which the sensor is full: 1023, 4095, 65535",
            ))
        }
        None => Ok(()),
    }
}

fn camera(
    document: &Document,
    key: &str,
    name: &str,
    folder: &Path,
    ([count, exposures], used): ([usize; 2], &[usize]),
    full_scale: Option<&FullScale>,
) -> Result<RecordedCamera, FileError> {
    if !folder.is_dir() {
        let problem = Problem::Missing(format!("the folder {} of camera \"{name}\"", folder.display()));
        return Err(document.fault(key, problem, "frames lie in frames/<projector>/<camera>/000.png"));
    }
    let mut all = list_frames(folder, (count, used), exposures.max(1))?;
    let head = equal_headers(&all.concat())?;
    let longer = all.split_off(1);
    let frames = all.concat();
    let full_scale_dn = match head.bits {
        8 => 255,
        _ => full_scale.and_then(|scale| scale.of(name)).unwrap_or(u16::MAX),
    };
    Ok(RecordedCamera {
        name: name.to_owned(),
        width_px: head.width_px,
        height_px: head.height_px,
        bits: head.bits,
        full_scale_dn,
        frames,
        longer,
    })
}

/// Most exposures of a recording.
const MOST_EXPOSURES: usize = 16;

fn check_exposures(document: &Document, key: &str, exposures_ms: &[f64]) -> Result<(), FileError> {
    let key = format!("{key}.exposures_ms");
    let fault = |value: String, limit: &str| {
        document.fault(
            &key,
            Problem::Value { value, limit: limit.into() },
            "one time per exposure, each once",
        )
    };
    if exposures_ms.len() > MOST_EXPOSURES {
        return Err(fault(format!("{} exposures", exposures_ms.len()), "at most 16"));
    }
    let bad = |(i, ms): &(usize, &f64)| !(ms.is_finite() && **ms > 0.0) || exposures_ms[..*i].contains(ms);
    match exposures_ms.iter().enumerate().find(bad) {
        Some((_, ms)) => Err(fault(ms.to_string(), "times above 0 ms, each once")),
        None => Ok(()),
    }
}

/// A camera that looks at several projectors is one camera.
fn one_size_per_camera(document: &Document, projectors: &[RecordedProjector]) -> Result<(), FileError> {
    let mut sizes: BTreeMap<&str, (&str, &RecordedCamera)> = BTreeMap::new();
    for projector in projectors {
        for camera in &projector.cameras {
            let (first, known) = *sizes.entry(&camera.name).or_insert((&projector.name, camera));
            let what = |c: &RecordedCamera| (c.width_px, c.height_px, c.full_scale_dn);
            if what(known) != what(camera) {
                let text = |c: &RecordedCamera, of: &str| {
                    let (width, height, full) = what(c);
                    format!("{width} × {height} px, full at {full} DN under \"{of}\"")
                };
                let problem = Problem::Disagreement {
                    what: "frames",
                    here: format!("camera \"{}\" has {}", camera.name, text(camera, &projector.name)),
                    there: text(known, first),
                };
                return Err(document.fault("projector", problem, "a camera has one size and depth"));
            }
        }
    }
    Ok(())
}
