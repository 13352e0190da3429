//! Which devices of a rig the poses of the target connect, and what is missing where they do not.
//!
//! Two devices are connected when both see the target in one pose, or are connected to others that do. Of a target with faces they may
//! see different ones. Where the place of these on the target is adjusted, a single pose tells either the place of the faces or that of
//! the devices; a second pose, turned against the first one, tells both (as for a hand and an eye, AX = XB).

use super::CalibrationError;
use super::model::Board;
use super::observations::Observations;
use super::start::ViewHomography;
use std::collections::{BTreeMap, BTreeSet};

/// Poses that two parts of a rig must share when each sees other faces, whose places are adjusted.
const TO_FIND_FACES: usize = 2;

/// Sets that are joined one by one.
struct Groups(Vec<usize>);

impl Groups {
    fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// Joins the sets of two members; whether they were apart.
    fn join(&mut self, a: usize, b: usize) -> bool {
        let (from, to) = (self.0[a].max(self.0[b]), self.0[a].min(self.0[b]));
        for group in &mut self.0 {
            if *group == from {
                *group = to;
            }
        }
        from != to
    }

    fn roots(&self) -> BTreeSet<usize> {
        self.0.iter().copied().collect()
    }
}

/// Which faces are adjusted: of those that are seen all but the certified ones; the first one, where none is.
pub(super) fn adjusted_faces(observations: &Observations, seen: &[ViewHomography]) -> Vec<bool> {
    let is_seen = |face: usize| seen.iter().any(|s| s.face == face);
    let fixed = (0..observations.faces.len()).any(|face| is_seen(face) && observations.faces[face].fixed);
    let held = if fixed { None } else { (0..observations.faces.len()).find(|face| is_seen(*face)) };
    (0..observations.faces.len())
        .map(|face| is_seen(face) && !observations.faces[face].fixed && held != Some(face))
        .collect()
}

/// Refuses devices that no common pose connects, naming the groups and what would connect them.
pub(super) fn connected(
    observations: &Observations,
    board: &Board,
    seen: &[ViewHomography],
) -> Result<(), CalibrationError> {
    let groups = joined(observations, seen);
    let roots = groups.roots();
    if roots.len() < 2 {
        return Ok(());
    }
    let devices = observations.devices.iter().enumerate();
    let names = |root: &usize| -> Vec<String> {
        let own = devices.clone().filter(|(number, _)| groups.0[*number] == *root);
        own.map(|(_, device)| device.name.clone()).collect()
    };
    let hints = hints(observations, board, seen, &groups);
    Err(CalibrationError::Unconnected { groups: roots.iter().map(names).collect(), hints })
}

/// The devices, joined by what they see.
fn joined(observations: &Observations, seen: &[ViewHomography]) -> Groups {
    let mut devices = Groups::new(observations.devices.len());
    let adjusted = adjusted_faces(observations, seen);
    let mut faces = Groups::new(adjusted.len().max(1));
    let known: Vec<usize> = (0..adjusted.len()).filter(|face| !adjusted[*face]).collect();
    for pair in known.windows(2) {
        faces.join(pair[0], pair[1]);
    }
    let same_pose =
        || seen.iter().flat_map(|a| seen.iter().filter(|b| b.pose == a.pose).map(move |b| (a, b)));
    for (a, b) in same_pose().filter(|(a, b)| a.face == b.face) {
        devices.join(a.device, b.device);
    }
    loop {
        let mut changed = false;
        // What one part of the rig sees in one pose tells how faces lie to each other, and known faces connect parts of the rig.
        for (a, b) in same_pose() {
            if devices.0[a.device] == devices.0[b.device] {
                changed |= faces.join(a.face, b.face);
            } else if faces.0[a.face] == faces.0[b.face] {
                changed |= devices.join(a.device, b.device);
            }
        }
        if !changed {
            changed = join_by_turning(&mut devices, &mut faces, same_pose());
        }
        if !changed {
            return devices;
        }
    }
}

/// Joins the first two parts that share enough poses to find how their faces lie to each other.
fn join_by_turning<'a>(
    devices: &mut Groups,
    faces: &mut Groups,
    pairs: impl Iterator<Item = (&'a ViewHomography, &'a ViewHomography)>,
) -> bool {
    let mut poses: BTreeMap<[usize; 4], BTreeSet<usize>> = BTreeMap::new();
    for (a, b) in pairs.filter(|(a, b)| devices.0[a.device] < devices.0[b.device]) {
        let ends = [devices.0[a.device], faces.0[a.face], devices.0[b.device], faces.0[b.face]];
        poses.entry(ends).or_default().insert(a.pose);
    }
    let found = poses.iter().find(|(_, poses)| poses.len() >= TO_FIND_FACES);
    let Some(([device, face, other, other_face], _)) = found else { return false };
    faces.join(*face, *other_face);
    devices.join(*device, *other)
}

/// What is nearest to a connection: poses that parts of the rig share already, and views with too few points.
fn hints(
    observations: &Observations,
    board: &Board,
    seen: &[ViewHomography],
    groups: &Groups,
) -> Vec<String> {
    let mut hints = Vec::new();
    for (pose, name) in observations.poses.iter().enumerate() {
        let own = || seen.iter().filter(|s| s.pose == pose);
        let roots: BTreeSet<usize> = own().map(|s| groups.0[s.device]).collect();
        if roots.len() > 1 {
            hints.push(format!(
                "{name} is seen by several groups, but on faces whose places on the target only a further such pose, turned against \
                 it, would tell"
            ));
        }
        for view in observations.views.iter().filter(|v| v.pose == pose) {
            let device = &observations.devices[view.device].name;
            let usable = own().any(|s| s.device == view.device);
            if !usable && roots.iter().any(|root| *root != groups.0[view.device]) {
                let most = board.on_face(board.main_face(&view.image_points), &view.image_points).len();
                hints.push(format!(
                    "{name} would connect {device}, which sees {most} points of a face there, needs {}",
                    super::homography::MIN_IMAGE_POINTS
                ));
            }
        }
    }
    hints.truncate(4);
    if hints.is_empty() {
        let poses = |root: &usize| -> String {
            let own: BTreeSet<usize> =
                seen.iter().filter(|s| groups.0[s.device] == *root).map(|s| s.pose).collect();
            let names: Vec<&str> = own.iter().map(|pose| observations.poses[*pose].as_str()).collect();
            match names.as_slice() {
                [first, .., last] if names.len() > 3 => format!("{first} … {last} ({} poses)", names.len()),
                _ => names.join(", "),
            }
        };
        let of = |root: &usize| format!("[{}] alone sees {}", observations.devices[*root].name, poses(root));
        let all: Vec<String> = groups.roots().iter().map(of).collect();
        hints.push(format!("the group of {}", all.join(", that of ")));
    }
    hints
}
