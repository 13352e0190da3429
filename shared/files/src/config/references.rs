//! What the parts of a cell say of each other: every pair has its cameras and its light, every camera has a pair.

use super::TwinConfig;
use super::projector_relations::check_generated;
use super::raw::RawConfig;
use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean, list};
use crate::rig_file::{RigFile, resolve_pairs, unknown};
use cell::configuration::{CameraConfig, Configuration, Driver, ProjectorConfig};
use cell::graph::Graph;
use cell::schedule::Schedule;
use cell::{Options, ScheduleError};
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::Rig;

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
    let lit: Vec<_> = projectors.iter().map(|p| (p.name.as_str(), p.cameras.as_slice())).collect();
    resolve_pairs(&rig_file.path, &mut rig, &lit)?;
    Ok(rig)
}

/// Plans the cell, as `run` and `schedule` will, and points to the key of what is wrong.
pub(super) fn check_graph(
    document: &Document,
    rig_file: &RigFile,
    cell: &Configuration,
) -> Result<(), FileError> {
    let planned = Graph::new(cell, &Options::default()).and_then(|graph| Schedule::new(&graph));
    let Err(error) = planned else { return Ok(()) };
    let projector = |name: &str, part: &str| {
        let index = cell.projectors.iter().position(|p| p.name == name).unwrap_or_default();
        format!("projector[{index}].{part}")
    };
    let camera = |name: &str| {
        let index = cell.cameras.iter().position(|c| c.name == name).unwrap_or_default();
        format!("camera[{index}]")
    };
    let key = match &error {
        ScheduleError::NoProjector { pair, projector } => {
            let known = cell.projectors.iter().map(|projector| projector.name.as_str());
            let problem = Problem::UnknownName {
                kind: "projector",
                name: projector.clone(),
                known: list(known.clone()),
            };
            let remedy = did_you_mean(projector, known, "name a [[projector]] of the cell");
            return Err(FileError::new(&rig_file.path, problem, remedy).at(format!("pair {pair}: projector")));
        }
        ScheduleError::Empty(what) => (*what).to_owned(),
        ScheduleError::NoHost { .. } => "host".to_owned(),
        ScheduleError::NoCamera { .. } | ScheduleError::TooLarge { .. } => "camera".to_owned(),
        ScheduleError::Unseen(name) | ScheduleError::Gap { projector: name, .. } => {
            projector(name, "cameras")
        }
        ScheduleError::NoPhase { projector: name, .. } => projector(name, "sequence"),
        ScheduleError::Dark(name) | ScheduleError::Unused { camera: name, .. } => camera(name),
        ScheduleError::Deadline { .. } | ScheduleError::Projected { .. } => {
            "limits.cycle_deadline_ms".to_owned()
        }
    };
    Err(document.fault(&key, Problem::Schedule(error), ""))
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
        let agree = |camera: Driver| match camera {
            // Their frames contain the light of their own projectors.
            Driver::Twin | Driver::Recording => projector.driver == camera,
            Driver::Genicam => projector.driver.is_light(),
            Driver::Network | Driver::Screen | Driver::LightCrafter => false,
        };
        if let Some(other) = lookers.find(|camera| !agree(camera.driver)) {
            let problem = Problem::Disagreement {
                what: "drivers",
                here: format!("projector \"{}\" has \"{}\"", projector.name, projector.driver.name()),
                there: format!(
                    "camera \"{}\", which takes its frames, has \"{}\"",
                    other.name,
                    other.driver.name()
                ),
            };
            let remedy = "give both the same driver; cameras with \"genicam\" need a projector with \"screen\", \
                          \"lightcrafter\" or \"network\"";
            return Err(document.fault(&key, problem, remedy));
        }
        if let Some(other) =
            projectors[..index].iter().find(|other| other.trigger.name() != projector.trigger.name())
        {
            let problem = Problem::Disagreement {
                what: "triggers",
                here: format!("projector \"{}\" is {}", projector.name, projector.trigger.name()),
                there: format!("projector \"{}\" {}", other.name, other.trigger.name()),
            };
            let remedy = "a camera has one trigger source: give all projectors the same trigger";
            return Err(document.fault(&format!("projector[{index}].trigger"), problem, remedy));
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
    for (index, projector) in projectors.iter().enumerate().filter(|(_, p)| p.driver == Driver::Twin) {
        let truth = twin.rig.projector(&projector.name);
        let shown = Some([projector.width_px, projector.height_px]);
        same_size(document, twin, ("projector", &projector.name), shown, truth)?;
        check_generated(document, (index, projector))?;
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
