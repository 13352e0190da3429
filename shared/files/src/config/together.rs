//! Which projectors show at the same time: groups that the configuration names, or those that the scene of the twin allows. Light that
//! meets is allowed where the steps of both projectors tell it apart.

use super::TwinConfig;
use super::raw::RawTogether;
use super::values::value;
use crate::document::Document;
use crate::error::{FileError, Problem, list};
use crate::scene_file::parse_unchanged_scene;
use cell::configuration::{Configuration, Driver, ProjectorConfig, TriggerMode};
use cell::together::groups;
use fringe::pattern::are_apart;
use twin::{Twin, TwinError};

/// Key of the configuration.
const KEY: &str = "schedule.together";

/// Every so many pixels along both axes a camera is asked whose light it sees.
const STEP_PX: usize = 4;

/// A camera that looks at one projector and sees light of another one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Meeting {
    /// Indices of both projectors, the one that the camera looks at first.
    pub projectors: [usize; 2],
    /// Name of the camera.
    pub camera: String,
    /// Of the pixels asked that see the part: those that the other projector lights, and all.
    pub pixels: [usize; 2],
}

/// All meetings of a cell with the scene of its twin, where the part stands in the first cycle.
///
/// # Errors
/// A scene that cannot be used, a rig without the devices of the cell.
pub fn meetings(
    document: &Document,
    cell: &Configuration,
    twin: &TwinConfig,
) -> Result<Vec<Meeting>, FileError> {
    let fault = |error: TwinError| document.fault("twin", Problem::Unsupported(error.to_string()), "");
    let scene = parse_unchanged_scene(&twin.scene, &twin.meshes)?;
    let twin = Twin::new(&scene, twin.settings.clone(), &twin.rig).map_err(fault)?;
    let mut meetings = Vec::new();
    for (number, projector) in cell.projectors.iter().enumerate() {
        for (other, light) in cell.projectors.iter().enumerate().filter(|(other, _)| *other != number) {
            for camera in &projector.cameras {
                let (lit, seen) = twin.lit_pixels(camera, &light.name, 0, STEP_PX).map_err(fault)?;
                if lit > 0 {
                    let (projectors, camera) = ([number, other], camera.clone());
                    meetings.push(Meeting { projectors, camera, pixels: [lit, seen] });
                }
            }
        }
    }
    Ok(meetings)
}

/// The groups that a configuration asks for; none where it asks for none. Projectors that no group names show alone.
pub(super) fn together(
    document: &Document,
    raw: Option<&RawTogether>,
    cell: &Configuration,
    twin: Option<&TwinConfig>,
) -> Result<Vec<Vec<usize>>, FileError> {
    let found = match raw {
        None => return Ok(Vec::new()),
        Some(RawTogether::Groups(names)) => named(document, names, &cell.projectors)?,
        Some(RawTogether::Word(word)) if word == "auto" => auto(document, cell, twin)?,
        Some(RawTogether::Word(word)) => {
            let problem = value(format!("{word:?}"), "\"auto\", or a list of lists of projectors");
            return Err(document.fault(KEY, problem, "leave it out to show one projector after another"));
        }
    };
    check(document, &found, &cell.projectors)?;
    Ok(found)
}

/// The groups by name, each projector once.
fn named(
    document: &Document,
    names: &[Vec<String>],
    projectors: &[ProjectorConfig],
) -> Result<Vec<Vec<usize>>, FileError> {
    let mut known = Vec::new();
    let mut index = |name: &String| {
        let found = projectors.iter().position(|p| p.name == *name).ok_or_else(|| {
            let names = list(projectors.iter().map(|p| p.name.as_str()));
            let problem = Problem::UnknownName { kind: "projector", name: name.clone(), known: names };
            document.fault(KEY, problem, "name projectors of this configuration")
        })?;
        if known.contains(&found) {
            let problem = Problem::Duplicate { kind: "projector", name: name.clone() };
            return Err(document.fault(KEY, problem, "each projector may be in one group"));
        }
        known.push(found);
        Ok(found)
    };
    names.iter().map(|group| group.iter().map(&mut index).collect()).collect()
}

/// The groups that take fewest frames, of projectors that do not meet on the part of the twin's scene, or are told apart by their steps.
fn auto(
    document: &Document,
    cell: &Configuration,
    twin: Option<&TwinConfig>,
) -> Result<Vec<Vec<usize>>, FileError> {
    let Some(twin) = twin else {
        let problem = Problem::Unsupported("without a [twin] nothing tells which light meets".into());
        let remedy = "record a trial in which each projector lights all cameras; `fringecell schedule --trial` finds the groups";
        return Err(document.fault(KEY, problem, remedy));
    };
    let meetings = meetings(document, cell, twin)?;
    let frames: Vec<usize> = cell.projectors.iter().map(ProjectorConfig::frames).collect();
    let meet = |a: usize, b: usize| {
        let (one, other) = (&cell.projectors[a], &cell.projectors[b]);
        let shared = one.cameras.iter().any(|c| other.cameras.contains(c));
        let met = || meetings.iter().any(|m| m.projectors == [a, b] || m.projectors == [b, a]);
        shared || (!are_apart(&one.sequence, &other.sequence) && met())
    };
    Ok(groups(&frames, &meet))
}

/// What no group can hold, whatever the part: a camera that looks at two of them, and projectors that keep their own time.
fn check(
    document: &Document,
    groups: &[Vec<usize>],
    projectors: &[ProjectorConfig],
) -> Result<(), FileError> {
    for group in groups.iter().filter(|group| group.len() > 1) {
        for (place, a) in group.iter().enumerate() {
            let projector = &projectors[*a];
            if projector.trigger != TriggerMode::Stepped
                || !matches!(projector.driver, Driver::Twin | Driver::Recording)
            {
                let problem = Problem::Unsupported(format!(
                    "projector \"{}\" (driver \"{}\", trigger \"{}\") cannot show together with others yet",
                    projector.name,
                    projector.driver.name(),
                    projector.trigger.name()
                ));
                return Err(document.fault(KEY, problem, "take it out of its group"));
            }
            for b in &group[place + 1..] {
                let shared = projector.cameras.iter().find(|camera| projectors[*b].cameras.contains(*camera));
                if let Some(camera) = shared {
                    let problem = Problem::Unsupported(format!(
                        "projectors \"{}\" and \"{}\" meet in camera \"{camera}\", which looks at both",
                        projector.name, projectors[*b].name
                    ));
                    return Err(document.fault(KEY, problem, "put them into different groups"));
                }
            }
        }
    }
    Ok(())
}
