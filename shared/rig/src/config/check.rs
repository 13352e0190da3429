//! From what is written to what is meant.

use super::raw::{RawConfig, RawLimits, RawProjector};
use super::{
    CONFIG_FORMAT, CameraConfig, Config, Driver, Limits, ProjectorConfig, RecordingConfig, ScheduleConfig,
    TextFile, TwinConfig,
};
use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean};
use crate::hash::sha256_hex;
use crate::name::{check_name, duplicate};
use crate::rig_file::{RigFile, read_rig, resolve_pairs, unknown};
use crate::sequence::{check_absolute, check_sequence};
use fringe::camera::Camera;
use fringe::rig::Rig;
use std::path::{Path, PathBuf};

/// Longest time that a limit may be set to, ms: a day. Longer ones are typing errors.
const TIME_LIMIT_MS: u64 = 86_400_000;

pub(super) fn load(path: &Path) -> Result<Config, FileError> {
    let document = Document::read(path)?;
    let raw: RawConfig = document.parse(CONFIG_FORMAT)?;
    check_cell_name(&document, &raw.name)?;
    let rig_file = referenced(&document, "rig", &raw.rig, read_rig)?;
    let cameras = cameras(&document, &raw, &rig_file)?;
    let recording = recording(&document, &raw)?;
    let projectors = projectors(&document, &raw, &cameras)?;
    let rig = pairs(&document, &raw, &rig_file, &projectors)?;
    check_use(&document, &rig, &cameras)?;
    let twin = twin(&document, &raw, &rig_file)?;
    check_drivers(&document, &raw, &cameras, &projectors)?;
    if let Some(twin) = &twin {
        check_twin(&document, &rig, twin, &cameras, &projectors)?;
    }
    let plan =
        raw.plan.as_ref().map(|plan| referenced(&document, "plan", plan, TextFile::read)).transpose()?;
    Ok(Config {
        sha256: sha256_hex(document.text.as_bytes()),
        name: raw.name.clone(),
        cycles: cycles(&document, raw.cycles)?,
        rig,
        rig_path: rig_file.path,
        rig_sha256: rig_file.sha256,
        plan,
        limits: limits(&document, &raw.limits)?,
        projectors,
        cameras,
        decode: raw.decode,
        matching: raw.matching,
        fusion: raw.fusion,
        twin,
        recording,
        schedule: schedule(&document, raw.schedule.cores, raw.schedule.pin)?,
        document,
    })
}

fn value(found: impl std::fmt::Display, limit: impl Into<String>) -> Problem {
    Problem::Value { value: found.to_string(), limit: limit.into() }
}

fn check_cell_name(document: &Document, name: &str) -> Result<(), FileError> {
    let letter = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if (1..=32).contains(&name.len()) && name.chars().all(letter) {
        return Ok(());
    }
    let problem = value(format!("{name:?}"), "a cell name has 1 to 32 of the characters a-z, 0-9 and '-'");
    Err(document.fault("name", problem, "it becomes the name of a folder and of services"))
}

fn cycles(document: &Document, cycles: Option<u32>) -> Result<Option<u32>, FileError> {
    match cycles {
        Some(0) => {
            let problem = value(0, "at least 1");
            Err(document.fault("cycles", problem, "leave the key out to run until stopped"))
        }
        other => Ok(other),
    }
}

/// Reads a file that the document names, relative to it.
fn referenced<T>(
    document: &Document,
    key: &str,
    target: &str,
    read: impl Fn(&Path) -> Result<T, FileError>,
) -> Result<T, FileError> {
    let path = resolve(document, key, target)?;
    if !path.exists() {
        let problem = Problem::Missing(format!("the file {}", path.display()));
        return Err(document.fault(key, problem, "paths are relative to the file that names them"));
    }
    read(&path)
}

fn resolve(document: &Document, key: &str, target: &str) -> Result<PathBuf, FileError> {
    let folder = document.path.parent().unwrap_or(Path::new(""));
    std::path::absolute(folder.join(target)).map_err(|source| {
        let problem = Problem::Io { action: "resolve the path", source };
        document.fault(key, problem, "")
    })
}

fn driver(document: &Document, key: &str, name: &str) -> Result<Driver, FileError> {
    const KNOWN: [&str; 2] = ["twin", "recording"];
    match name {
        "twin" => Ok(Driver::Twin),
        "recording" => Ok(Driver::Recording),
        "genicam" | "lightcrafter" | "screen" => {
            let problem = Problem::Unsupported(format!("driver \"{name}\" is not part of this version"));
            Err(document.fault(key, problem, "use \"twin\" or \"recording\""))
        }
        _ => Err(unknown(document, key, "driver", name, KNOWN)),
    }
}

fn cameras(document: &Document, raw: &RawConfig, rig: &RigFile) -> Result<Vec<CameraConfig>, FileError> {
    let names = raw.camera.iter().map(|camera| camera.name.as_str());
    if let Some((index, name)) = duplicate(names) {
        let problem = Problem::Duplicate { kind: "camera", name: name.to_owned() };
        return Err(document.fault(
            &format!("camera[{index}].name"),
            problem,
            "rename or remove one of them",
        ));
    }
    let known: Vec<&str> = rig.rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
    raw.camera
        .iter()
        .enumerate()
        .map(|(index, camera)| {
            let key = |part: &str| format!("camera[{index}].{part}");
            let Some(geometry) = rig.rig.camera(&camera.name) else {
                let remedy = format!("the rig is {}; {}", rig.path.display(), "name one of its cameras");
                let problem = Problem::UnknownName {
                    kind: "camera",
                    name: camera.name.clone(),
                    known: crate::error::list(known.iter().copied()),
                };
                let remedy = did_you_mean(&camera.name, known.iter().copied(), &remedy);
                return Err(document.fault(&key("name"), problem, remedy));
            };
            Ok(CameraConfig {
                name: camera.name.clone(),
                driver: driver(document, &key("driver"), &camera.driver)?,
                width_px: geometry.width_px,
                height_px: geometry.height_px,
            })
        })
        .collect()
}

fn recording(document: &Document, raw: &RawConfig) -> Result<Option<RecordingConfig>, FileError> {
    let Some(recording) = &raw.recording else { return Ok(None) };
    let rate_hz = recording.rate_hz;
    if !(0.0..=100_000.0).contains(&rate_hz) {
        let problem = value(rate_hz, "0 … 100000 frames per second");
        return Err(document.fault("recording.rate_hz", problem, "0 plays as fast as possible"));
    }
    let path = referenced(document, "recording.path", &recording.path, |path| Ok(path.to_owned()))?;
    Ok(Some(RecordingConfig { path, rate_hz, repeat: recording.repeat }))
}

fn projectors(
    document: &Document,
    raw: &RawConfig,
    cameras: &[CameraConfig],
) -> Result<Vec<ProjectorConfig>, FileError> {
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
    raw.projector
        .iter()
        .enumerate()
        .map(|(index, projector)| one_projector(document, &format!("projector[{index}]"), projector, cameras))
        .collect()
}

fn one_projector(
    document: &Document,
    key: &str,
    raw: &RawProjector,
    cameras: &[CameraConfig],
) -> Result<ProjectorConfig, FileError> {
    check_name(&raw.name).map_err(|problem| document.fault(&format!("{key}.name"), problem, ""))?;
    let needed = |part: &str| {
        let problem = Problem::Missing(format!("{part} of projector \"{}\"", raw.name));
        document.fault(key, problem, format!("add {part} = …"))
    };
    let projector = ProjectorConfig {
        name: raw.name.clone(),
        driver: driver(document, &format!("{key}.driver"), &raw.driver)?,
        width_px: raw.width_px.ok_or_else(|| needed("width_px"))?,
        height_px: raw.height_px.ok_or_else(|| needed("height_px"))?,
        cameras: raw.cameras.clone().ok_or_else(|| needed("cameras"))?,
        sequence: raw.sequence.clone().ok_or_else(|| needed("sequence"))?,
    };
    let size_px = [projector.width_px, projector.height_px];
    check_sequence(document, key, size_px, &projector.sequence)?;
    check_absolute(document, key, size_px, &projector.sequence)?;
    check_lookers(document, key, &projector, cameras)?;
    Ok(projector)
}

fn check_lookers(
    document: &Document,
    key: &str,
    projector: &ProjectorConfig,
    cameras: &[CameraConfig],
) -> Result<(), FileError> {
    let key = format!("{key}.cameras");
    if projector.cameras.is_empty() {
        let problem = Problem::Missing(format!("a camera that looks while \"{}\" is on", projector.name));
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

/// The rig with the pairs that the cell runs, each with its projector.
fn pairs(
    document: &Document,
    raw: &RawConfig,
    rig_file: &RigFile,
    projectors: &[ProjectorConfig],
) -> Result<Rig, FileError> {
    let mut rig = rig_file.rig.clone();
    if let Some(wanted) = &raw.pairs {
        let known = rig_file.rig.pairs.iter().map(|pair| pair.name.as_str());
        for (index, name) in wanted.iter().enumerate() {
            if !rig_file.rig.pairs.iter().any(|pair| pair.name == *name) {
                return Err(unknown(document, &format!("pairs[{index}]"), "pair", name, known));
            }
        }
        rig.pairs.retain(|pair| wanted.contains(&pair.name));
    }
    if rig.pairs.is_empty() {
        let problem = Problem::Missing(format!("a [[pair]] in {}", rig_file.path.display()));
        return Err(document.fault("pairs", problem, "a cell matches at least one pair"));
    }
    for pair in &rig.pairs {
        check_pair_cameras(document, raw, rig_file, pair)?;
    }
    let lit: Vec<_> = projectors.iter().map(|p| (p.name.as_str(), p.cameras.as_slice())).collect();
    resolve_pairs(&rig_file.path, &mut rig, &lit)?;
    for pair in &rig.pairs {
        check_pair_light(document, rig_file, pair, projectors)?;
    }
    Ok(rig)
}

fn check_pair_cameras(
    document: &Document,
    raw: &RawConfig,
    rig_file: &RigFile,
    pair: &fringe::rig::Pair,
) -> Result<(), FileError> {
    let views = [&pair.left, &pair.right].into_iter();
    let mut cameras = views.filter(|view| rig_file.rig.camera(view).is_some());
    let absent = cameras.find(|view| !raw.camera.iter().any(|camera| camera.name == **view));
    let Some(absent) = absent else { return Ok(()) };
    let problem = Problem::Disagreement {
        what: "pair and cameras",
        here: format!("pair \"{}\" of {} needs camera \"{absent}\"", pair.name, rig_file.path.display()),
        there: "this cell has no such [[camera]]".into(),
    };
    let remedy = format!("add the camera, or list pairs = […] without \"{}\"", pair.name);
    Err(document.fault("camera", problem, remedy))
}

fn check_pair_light(
    document: &Document,
    rig_file: &RigFile,
    pair: &fringe::rig::Pair,
    projectors: &[ProjectorConfig],
) -> Result<(), FileError> {
    let Some(index) = projectors.iter().position(|projector| projector.name == pair.projector) else {
        let known = projectors.iter().map(|projector| projector.name.as_str());
        let key = format!("pair {}: projector", pair.name);
        let problem = Problem::UnknownName {
            kind: "projector",
            name: pair.projector.clone(),
            known: crate::error::list(known.clone()),
        };
        let remedy = did_you_mean(&pair.projector, known, "name a [[projector]] of the cell");
        return Err(FileError::new(&rig_file.path, problem, remedy).at(key));
    };
    let views = [&pair.left, &pair.right].into_iter();
    let mut cameras = views.filter(|view| rig_file.rig.camera(view).is_some());
    let Some(dark) = cameras.find(|view| !projectors[index].cameras.contains(view)) else { return Ok(()) };
    let problem = Problem::Disagreement {
        what: "pair and projector",
        here: format!("cameras = [{}] look at \"{}\"", projectors[index].cameras.join(", "), pair.projector),
        there: format!("pair \"{}\" needs \"{dark}\" to look at it", pair.name),
    };
    let remedy = format!("add \"{dark}\" to the cameras, or change the pair's projector in the rig file");
    Err(document.fault(&format!("projector[{index}].cameras"), problem, remedy))
}

/// A camera that no pair uses would take frames for nobody.
fn check_use(document: &Document, rig: &Rig, cameras: &[CameraConfig]) -> Result<(), FileError> {
    for (index, camera) in cameras.iter().enumerate() {
        if !rig.pairs.iter().any(|pair| pair.left == camera.name || pair.right == camera.name) {
            let problem = Problem::Unsupported(format!("camera \"{}\" belongs to no pair", camera.name));
            let remedy = "remove it, or add a [[pair]] to the rig file";
            return Err(document.fault(&format!("camera[{index}]"), problem, remedy));
        }
    }
    Ok(())
}

fn twin(document: &Document, raw: &RawConfig, measured: &RigFile) -> Result<Option<TwinConfig>, FileError> {
    let Some(twin) = &raw.twin else { return Ok(None) };
    let scene = referenced(document, "twin.scene", &twin.scene, TextFile::read)?;
    let truth = match &twin.rig {
        Some(path) => referenced(document, "twin.rig", path, read_rig)?,
        None => measured.clone(),
    };
    Ok(Some(TwinConfig {
        scene,
        rig: truth.rig,
        rig_path: truth.path,
        seed: twin.seed,
        settings: twin.settings.clone(),
    }))
}

/// Light and eyes of one projection come from the same world, and the table of that world is there.
fn check_drivers(
    document: &Document,
    raw: &RawConfig,
    cameras: &[CameraConfig],
    projectors: &[ProjectorConfig],
) -> Result<(), FileError> {
    for (index, projector) in projectors.iter().enumerate() {
        let key = format!("projector[{index}].driver");
        let (table, present) = match projector.driver {
            Driver::Twin => ("[twin]", raw.twin.is_some()),
            Driver::Recording => ("[recording]", raw.recording.is_some()),
        };
        if !present {
            let problem = Problem::Missing(format!("the table {table}, which this driver needs,"));
            return Err(document.fault(&key, problem, format!("add {table}")));
        }
        let mut lookers = cameras.iter().filter(|camera| projector.cameras.contains(&camera.name));
        if let Some(other) = lookers.find(|camera| camera.driver != projector.driver) {
            let problem = Problem::Disagreement {
                what: "drivers",
                here: format!("projector \"{}\" has {:?}", projector.name, projector.driver),
                there: format!("camera \"{}\", which looks at it, has {:?}", other.name, other.driver),
            };
            return Err(document.fault(&key, problem, "give both the same driver"));
        }
    }
    Ok(())
}

fn check_twin(
    document: &Document,
    rig: &Rig,
    twin: &TwinConfig,
    cameras: &[CameraConfig],
    projectors: &[ProjectorConfig],
) -> Result<(), FileError> {
    for camera in cameras.iter().filter(|camera| camera.driver == Driver::Twin) {
        let truth = twin.rig.camera(&camera.name);
        let measured = rig.camera(&camera.name).map(size);
        same_size(document, twin, ("camera", &camera.name), measured, truth)?;
    }
    for projector in projectors.iter().filter(|projector| projector.driver == Driver::Twin) {
        let truth = twin.rig.projector(&projector.name);
        let shown = Some([projector.width_px, projector.height_px]);
        same_size(document, twin, ("projector", &projector.name), shown, truth)?;
    }
    Ok(())
}

fn size(camera: &Camera) -> [u32; 2] {
    [camera.width_px, camera.height_px]
}

fn same_size(
    document: &Document,
    twin: &TwinConfig,
    (kind, name): (&'static str, &str),
    here: Option<[u32; 2]>,
    truth: Option<&Camera>,
) -> Result<(), FileError> {
    let Some(truth) = truth else {
        let problem =
            Problem::Missing(format!("{kind} \"{name}\" in the twin's rig {}", twin.rig_path.display()));
        return Err(document.fault("twin.rig", problem, format!("the twin needs every {kind} of the cell")));
    };
    let there = size(truth);
    match here {
        Some(here) if here != there => {
            let problem = Problem::Disagreement {
                what: "sizes",
                here: format!("{kind} \"{name}\" has {} × {} px in this cell", here[0], here[1]),
                there: format!("{} × {} px in {}", there[0], there[1], twin.rig_path.display()),
            };
            Err(document.fault("twin.rig", problem, "make them equal"))
        }
        _ => Ok(()),
    }
}

fn limits(document: &Document, raw: &RawLimits) -> Result<Limits, FileError> {
    let time = |key: &str, given: Option<u64>, default: u64| match given.unwrap_or(default) {
        good @ 1..=TIME_LIMIT_MS => Ok(good),
        bad => {
            let problem = value(bad, format!("1 … {TIME_LIMIT_MS} ms"));
            Err(document.fault(&format!("limits.{key}"), problem, format!("the default is {default}")))
        }
    };
    let restarts = raw.restarts_max.unwrap_or(5);
    let Some(restarts_max) = u32::try_from(restarts).ok().filter(|count| *count <= 1000) else {
        return Err(document.fault("limits.restarts_max", value(restarts, "0 … 1000"), "the default is 5"));
    };
    let limits = Limits {
        stage_budget_ms: time("stage_budget_ms", raw.stage_budget_ms, 5_000)?,
        cycle_deadline_ms: time("cycle_deadline_ms", raw.cycle_deadline_ms, 20_000)?,
        start_ms: time("start_ms", raw.start_ms, 20_000)?,
        stop_ms: time("stop_ms", raw.stop_ms, 3_000)?,
        restarts_max,
        restart_window_ms: time("restart_window_ms", raw.restart_window_ms, 60_000)?,
    };
    if limits.stage_budget_ms > limits.cycle_deadline_ms {
        let problem = Problem::Disagreement {
            what: "limits",
            here: format!("a stage may take {} ms", limits.stage_budget_ms),
            there: format!("the whole cycle must end within {} ms", limits.cycle_deadline_ms),
        };
        return Err(document.fault("limits.stage_budget_ms", problem, "raise cycle_deadline_ms"));
    }
    Ok(limits)
}

fn schedule(document: &Document, cores: Option<u32>, pin: Option<bool>) -> Result<ScheduleConfig, FileError> {
    let cores = cores.unwrap_or(2);
    if !(1..=1024).contains(&cores) {
        return Err(document.fault("schedule.cores", value(cores, "1 … 1024"), "the default is 2"));
    }
    Ok(ScheduleConfig { cores, pin: pin.unwrap_or(false) })
}
