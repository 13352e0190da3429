//! The graph of the cell: every pair has its cameras and its light, every camera has a pair, no gap.

use super::raw::RawConfig;
use super::{CameraConfig, Driver, ProjectorConfig, TwinConfig};
use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean, list};
use crate::rig_file::{RigFile, resolve_pairs, unknown};
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Pair, Rig};
use fringe::pattern::{PatternError, PatternSet};

/// The rig with the pairs that the cell runs, each with its projector.
pub(super) fn pairs(
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
    pair: &Pair,
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
    pair: &Pair,
    projectors: &[ProjectorConfig],
) -> Result<(), FileError> {
    let Some(index) = projectors.iter().position(|projector| projector.name == pair.projector) else {
        let known = projectors.iter().map(|projector| projector.name.as_str());
        let key = format!("pair {}: projector", pair.name);
        let problem = Problem::UnknownName {
            kind: "projector",
            name: pair.projector.clone(),
            known: list(known.clone()),
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
pub(super) fn check_use(document: &Document, rig: &Rig, cameras: &[CameraConfig]) -> Result<(), FileError> {
    for (index, camera) in cameras.iter().enumerate() {
        if !rig.pairs.iter().any(|pair| pair.left == camera.name || pair.right == camera.name) {
            let problem = Problem::Unsupported(format!("camera \"{}\" belongs to no pair", camera.name));
            let remedy = "remove it, or add a [[pair]] to the rig file";
            return Err(document.fault(&format!("camera[{index}]"), problem, remedy));
        }
    }
    Ok(())
}

/// Light and eyes of one projection come from the same world.
pub(super) fn check_drivers(
    document: &Document,
    cameras: &[CameraConfig],
    projectors: &[ProjectorConfig],
) -> Result<(), FileError> {
    for (index, projector) in projectors.iter().enumerate() {
        let key = format!("projector[{index}].driver");
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

pub(super) fn check_twin(
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
        check_generated(document, projectors, projector)?;
    }
    Ok(())
}

/// The twin shows only what it can compute.
fn check_generated(
    document: &Document,
    projectors: &[ProjectorConfig],
    projector: &ProjectorConfig,
) -> Result<(), FileError> {
    let foreign = |set: &PatternSet| matches!(set, PatternSet::Random { .. });
    let Some(set) = projector.sequence.iter().position(foreign) else { return Ok(()) };
    let index = projectors.iter().position(|other| other.name == projector.name).unwrap_or(0);
    let problem = Problem::Pattern(PatternError::NotGenerated("random"));
    let key = format!("projector[{index}].sequence[{set}]");
    Err(document.fault(&key, problem, "remove it from what the twin projects"))
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
