//! Whether a rig file is of the cameras and projectors that a recording saw.

use super::{RecordedCamera, RecordedProjector, RecordedRig, Recording};
use crate::error::{FileError, Problem, did_you_mean, list};
use crate::rig_file::RigFile;

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
    let together = |pair: &fringe::geometry::rig::Pair| {
        let by = |view: &str, p: &RecordedProjector| p.camera(view).is_some() || p.name == view;
        recording.projectors.iter().any(|p| {
            (pair.projector.is_empty() || p.name == pair.projector) && by(&pair.left, p) && by(&pair.right, p)
        })
    };
    let recorded =
        |pair: &fringe::geometry::rig::Pair| seen(&pair.left) && seen(&pair.right) && together(pair);
    let (present, absent_pairs) = rig_file.rig.pairs.iter().cloned().partition::<Vec<_>, _>(recorded);
    if present.is_empty() {
        return Err(no_pair(recording, rig_file));
    }
    let mut rig = fringe::geometry::rig::Rig { pairs: present, ..rig_file.rig.clone() };
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
