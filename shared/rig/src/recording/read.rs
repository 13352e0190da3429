//! Opening a recording: every frame is found and measured before the first one is decoded.

use super::{RECORDING_FILE, RECORDING_FORMAT, RecordedCamera, RecordedProjector, RecordedRig, Recording};
use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean, list};
use crate::hash::sha256_hex;
use crate::image_file::{ImageHeader, read_header};
use crate::name::{check_name, duplicate};
use crate::rig_file::RigFile;
use crate::sequence::check_sequence;
use fringe::pattern::{PatternSet, frame_count};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

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
        return Err(document.fault("projector", problem, "say what was projected"));
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
        return Err(document.fault(&cameras_key, problem, "say who looked"));
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
    let camera = |name: &String| {
        let folder = folder.join("frames").join(&raw.name).join(name);
        camera(
            document,
            &cameras_key,
            name,
            &folder,
            [count, raw.exposures_ms.len()],
            raw.full_scale_dn.as_ref(),
        )
    };
    Ok(RecordedProjector {
        name: raw.name.clone(),
        width_px: raw.width_px,
        height_px: raw.height_px,
        sequence: raw.sequence.clone(),
        exposures_ms: raw.exposures_ms.clone(),
        cameras: raw.cameras.iter().map(camera).collect::<Result<_, _>>()?,
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
    [count, exposures]: [usize; 2],
    full_scale: Option<&FullScale>,
) -> Result<RecordedCamera, FileError> {
    if !folder.is_dir() {
        let problem = Problem::Missing(format!("the folder {} of camera \"{name}\"", folder.display()));
        return Err(document.fault(key, problem, "frames lie in frames/<projector>/<camera>/000.png"));
    }
    let mut all = list_frames(folder, count, exposures.max(1))?;
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

/// Frame and exposure of a file's name: `007` or `007_2`.
fn numbers(stem: &str, exposures: usize) -> Option<[usize; 2]> {
    let (frame, exposure) = match stem.split_once('_') {
        Some((frame, exposure)) => (frame, exposure.parse().ok().filter(|e| *e > 0 && *e < exposures)?),
        None => (stem, 0),
    };
    let number = frame.parse::<usize>().ok()?;
    let written = if exposure == 0 { format!("{number:03}") } else { format!("{number:03}_{exposure}") };
    (written == stem).then_some([number, exposure])
}

/// Frames 000 … count − 1 of each exposure, each there once, and no other image.
fn list_frames(folder: &Path, count: usize, exposures: usize) -> Result<Vec<Vec<PathBuf>>, FileError> {
    let mut all: Vec<Vec<Option<PathBuf>>> = vec![vec![None; count]; exposures];
    for path in images(folder)? {
        let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("");
        match numbers(stem, exposures) {
            Some([number, exposure]) if number < count => {
                let found = &mut all[exposure];
                if let Some(first) = &found[number] {
                    let problem = Problem::Disagreement {
                        what: "frames",
                        here: format!("{} is frame {number}", path.display()),
                        there: format!("so is {}", first.display()),
                    };
                    return Err(FileError::new(folder, problem, "remove one of them"));
                }
                found[number] = Some(path);
            }
            Some(_) => {
                let problem = Problem::Disagreement {
                    what: "frames and sequence",
                    here: format!("this is frame {stem}"),
                    there: format!(
                        "the sequence of recording.toml has {count} frames, 000 … {:03}",
                        count - 1
                    ),
                };
                return Err(FileError::new(&path, problem, "correct the sequence, or remove the frame"));
            }
            None => {
                let problem = Problem::Value {
                    value: format!("\"{stem}\""),
                    limit: "frames are named by their number: 000.png, 001.png, …".into(),
                };
                return Err(FileError::new(&path, problem, "rename or remove it"));
            }
        }
    }
    all.into_iter().enumerate().map(|(exposure, found)| complete(folder, exposure, found)).collect()
}

fn complete(folder: &Path, exposure: usize, found: Vec<Option<PathBuf>>) -> Result<Vec<PathBuf>, FileError> {
    let count = found.len();
    let there = found.iter().flatten().count();
    let missing: Vec<String> =
        found.iter().enumerate().filter(|(_, f)| f.is_none()).map(|(i, _)| format!("{i:03}")).collect();
    if missing.is_empty() {
        return Ok(found.into_iter().flatten().collect());
    }
    let shown = list(missing.iter().take(8).map(String::as_str));
    let problem = Problem::Disagreement {
        what: "frames and sequence",
        here: match exposure {
            0 => format!("{there} frames are here (missing: {shown})"),
            _ => format!(
                "{there} frames of exposure {exposure} are here (missing: {shown}, each with _{exposure})"
            ),
        },
        there: format!("the sequence of recording.toml has {count}"),
    };
    Err(FileError::new(folder, problem, "record or copy again, or correct the sequence"))
}

/// Image files of a folder in the order of their names; hidden ones (a copy going on, a desktop's notes) do not count.
fn images(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let io = |source| FileError::io(folder, "list the folder", source);
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        let hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        if ["png", "tif", "tiff"].contains(&extension.as_str()) && !hidden {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// The head that all frames of a camera share.
fn equal_headers(frames: &[PathBuf]) -> Result<ImageHeader, FileError> {
    let mut first: Option<(ImageHeader, &PathBuf)> = None;
    for path in frames {
        let head = read_header(path)?;
        let Some((expected, reference)) = first else {
            first = Some((head, path));
            continue;
        };
        let same = |head: ImageHeader| (head.width_px, head.height_px, head.bits);
        if same(head) != same(expected) {
            let problem = Problem::Disagreement {
                what: "frames",
                here: format!("this one is {}", describe(head)),
                there: format!("{} is {}", reference.display(), describe(expected)),
            };
            return Err(FileError::new(path, problem, "all frames of a camera have one size and depth"));
        }
    }
    // The sequence has at least one frame, and every frame was found.
    first
        .map(|(head, _)| head)
        .ok_or_else(|| FileError::new(Path::new(""), Problem::Missing("a frame".into()), ""))
}

fn describe(head: ImageHeader) -> String {
    format!("{} × {} px of {} bits", head.width_px, head.height_px, head.bits)
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

pub(super) fn fit(recording: &Recording, rig_file: &RigFile) -> Result<RecordedRig, FileError> {
    for (index, projector) in recording.projectors.iter().enumerate() {
        for (number, camera) in projector.cameras.iter().enumerate() {
            let key = format!("projector[{index}].cameras[{number}]");
            same_camera(recording, rig_file, &key, camera)?;
        }
        if let Some(geometry) = rig_file.rig.projector(&projector.name) {
            let found = [projector.width_px, projector.height_px];
            let expected = [geometry.width_px, geometry.height_px];
            same_size(recording, rig_file, &format!("projector[{index}]"), &projector.name, found, expected)?;
        }
    }
    let seen = |view: &str| {
        rig_file.rig.projector(view).is_some()
            || recording.projectors.iter().any(|p| p.camera(view).is_some())
    };
    let together = |pair: &fringe::rig::Pair| {
        let by = |view: &str, p: &RecordedProjector| p.camera(view).is_some() || p.name == view;
        recording.projectors.iter().any(|p| {
            (pair.projector.is_empty() || p.name == pair.projector) && by(&pair.left, p) && by(&pair.right, p)
        })
    };
    let recorded = |pair: &fringe::rig::Pair| seen(&pair.left) && seen(&pair.right) && together(pair);
    let (present, absent_pairs) = rig_file.rig.pairs.iter().cloned().partition::<Vec<_>, _>(recorded);
    if present.is_empty() {
        return Err(no_pair(recording, rig_file));
    }
    let mut rig = fringe::rig::Rig { pairs: present, ..rig_file.rig.clone() };
    recording.resolve(&rig_file.path, &mut rig)?;
    Ok(RecordedRig { rig, absent_pairs })
}

fn same_camera(
    recording: &Recording,
    rig_file: &RigFile,
    key: &str,
    camera: &RecordedCamera,
) -> Result<(), FileError> {
    let known = rig_file.rig.cameras.iter().map(|c| c.name.as_str());
    let Some(geometry) = rig_file.rig.camera(&camera.name) else {
        let problem =
            Problem::UnknownName { kind: "camera", name: camera.name.clone(), known: list(known.clone()) };
        let fallback = format!("name a camera of {}", rig_file.path.display());
        let remedy = did_you_mean(&camera.name, known, &fallback);
        return Err(recording.document.fault(key, problem, remedy));
    };
    let found = [camera.width_px, camera.height_px];
    same_size(recording, rig_file, key, &camera.name, found, [geometry.width_px, geometry.height_px])
}

fn same_size(
    recording: &Recording,
    rig_file: &RigFile,
    key: &str,
    name: &str,
    found: [u32; 2],
    expected: [u32; 2],
) -> Result<(), FileError> {
    if found == expected {
        return Ok(());
    }
    let problem = Problem::Disagreement {
        what: "sizes",
        here: format!("\"{name}\" was recorded with {} × {} px", found[0], found[1]),
        there: format!("{} × {} px in {}", expected[0], expected[1], rig_file.path.display()),
    };
    Err(recording.document.fault(key, problem, "use the rig file of this camera and this image size"))
}

fn no_pair(recording: &Recording, rig_file: &RigFile) -> FileError {
    let pairs = rig_file.rig.pairs.iter().map(|p| format!("{} = {} + {}", p.name, p.left, p.right));
    let pairs: Vec<String> = pairs.collect();
    let seen: Vec<String> = recording
        .projectors
        .iter()
        .map(|p| format!("{} lit {}", p.name, list(p.cameras.iter().map(|c| c.name.as_str()))))
        .collect();
    let problem = Problem::Disagreement {
        what: "pairs and recording",
        here: format!("pairs of {}: {}", rig_file.path.display(), list(pairs.iter().map(String::as_str))),
        there: format!("the recording has {}", seen.join("; ")),
    };
    let remedy = "add a [[pair]] of two cameras that one projector lit";
    recording.document.fault("projector", problem, remedy)
}
