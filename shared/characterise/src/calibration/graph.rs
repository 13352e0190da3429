//! One global frame from views of single devices, with boards that may be read the other way round.

use super::model::{compose, rotation_vector};
use super::observations::Observations;
use super::start::ViewHomography;
use nalgebra::{Isometry3, UnitQuaternion};

/// Two start values of a device's pose that differ by more than this (rad, and part of the distance) contradict.
const TOLERANCE: f64 = 0.1;

/// Start values in the frame of the first device.
#[derive(Debug, Clone)]
pub(super) struct Placed {
    /// Poses of the devices, device_from_world.
    pub devices: Vec<Isometry3<f64>>,
    /// world_from_board of each pose that was seen.
    pub boards: Vec<Option<Isometry3<f64>>>,
    /// Whether the indices of each view of `seen` were turned by 180°.
    pub turned: Vec<bool>,
}

/// A pose while devices are added.
#[derive(Debug, Clone, Default)]
struct Pose {
    /// Pose of the board, world_from_board.
    placed: Option<Isometry3<f64>>,
    /// Whether a view whose indices are sure has fixed the orientation.
    sure: bool,
}

/// Places devices one by one, each by the agreement of all poses that it shares with those before.
///
/// A view that may be turned offers two device poses; the right ones of all poses agree, the wrong ones scatter by half
/// a turn about as many board normals. With a single common pose there is nothing to agree with, and the indices stay.
pub(super) fn place(observations: &Observations, seen: &[ViewHomography]) -> Placed {
    let mut poses = vec![Pose::default(); observations.poses.len()];
    let mut devices: Vec<Option<Isometry3<f64>>> = vec![None; observations.devices.len()];
    let mut turned = vec![false; seen.len()];
    while let Some(device) = next(&devices, &poses, observations, seen) {
        let placed = agreed(device, &poses, observations, seen);
        devices[device] = Some(placed);
        for number in (0..seen.len()).filter(|i| seen[*i].device == device) {
            settle(number, &placed, &mut poses, &mut turned, observations, seen);
        }
    }
    Placed {
        devices: devices.into_iter().map(|d| d.unwrap_or_else(Isometry3::identity)).collect(),
        boards: poses.into_iter().map(|p| p.placed).collect(),
        turned,
    }
}

/// The device that is not placed yet and shares most poses with those that are, of a target with faces most points; the first one to
/// begin with.
fn next(
    devices: &[Option<Isometry3<f64>>],
    poses: &[Pose],
    observations: &Observations,
    seen: &[ViewHomography],
) -> Option<usize> {
    // A view of a face that is seen at a slant has few points, and its pose is worth less.
    let worth = |s: &ViewHomography| match observations.faces.len() {
        0 => 1,
        _ => observations.views[s.view].image_points.len(),
    };
    let shared = |d: usize| -> usize {
        seen.iter().filter(|s| s.device == d && poses[s.pose].placed.is_some()).map(worth).sum()
    };
    let open = (0..devices.len()).filter(|d| devices[*d].is_none());
    open.map(|d| (shared(d), d)).max_by_key(|(count, d)| (*count, std::cmp::Reverse(*d))).map(|(_, d)| d)
}

/// device_from_world by one view, with its indices as they are or turned.
fn board_pose(view: &ViewHomography, board: &Isometry3<f64>, turn: bool) -> Isometry3<f64> {
    let own = if turn { compose(&view.device_from_board, &half_turn()) } else { view.device_from_board };
    compose(&own, &board.inverse())
}

/// Which turns a view may have against its pose.
fn turns(view: &ViewHomography, poses: &[Pose], observations: &Observations) -> &'static [bool] {
    if observations.views[view.view].may_be_turned || !poses[view.pose].sure {
        &[false, true]
    } else {
        &[false]
    }
}

/// The device pose that most poses agree on.
fn agreed(
    device: usize,
    poses: &[Pose],
    observations: &Observations,
    seen: &[ViewHomography],
) -> Isometry3<f64> {
    let options: Vec<Vec<Isometry3<f64>>> = seen
        .iter()
        .filter(|s| s.device == device)
        .filter_map(|s| {
            let board = poses[s.pose].placed?;
            Some(turns(s, poses, observations).iter().map(|turn| board_pose(s, &board, *turn)).collect())
        })
        .collect();
    let mut best = (f64::INFINITY, Isometry3::identity());
    for candidate in options.iter().flatten() {
        let nearest =
            |own: &Vec<Isometry3<f64>>| own.iter().map(|o| distance(candidate, o)).fold(TOLERANCE, f64::min);
        let disagreement: f64 = options.iter().map(nearest).sum();
        if disagreement < best.0 {
            best = (disagreement, *candidate);
        }
    }
    best.1
}

/// Orients one view of a placed device, and places its pose when it is new.
fn settle(
    number: usize,
    device: &Isometry3<f64>,
    poses: &mut [Pose],
    turned: &mut [bool],
    observations: &Observations,
    seen: &[ViewHomography],
) {
    let view = &seen[number];
    let may = observations.views[view.view].may_be_turned;
    let Some(board) = poses[view.pose].placed else {
        poses[view.pose] =
            Pose { placed: Some(compose(&device.inverse(), &view.device_from_board)), sure: !may };
        return;
    };
    let off = |turn: bool| distance(device, &board_pose(view, &board, turn));
    let turn = turns(view, poses, observations).len() > 1 && off(true) < off(false);
    if may {
        turned[number] = turn;
        return;
    }
    if turn {
        // The indices of this view are sure: those of all views before were the wrong way round.
        poses[view.pose].placed = Some(compose(&board, &half_turn()));
        for (flag, other) in turned.iter_mut().zip(seen) {
            // Only ambiguous views can have come before: a sure one would have fixed the orientation.
            if other.pose == view.pose && observations.views[other.view].may_be_turned {
                *flag = !*flag;
            }
        }
    }
    poses[view.pose].sure = true;
}

/// Angle (rad) plus distance over the depth.
fn distance(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    let angle = rotation_vector(&a.rotation.rotation_to(&b.rotation)).norm();
    let (from, to) = (a.translation.vector, b.translation.vector);
    angle + (from - to).norm() / from.norm().max(to.norm()).max(1.0)
}

/// By 180° about the target's z axis.
fn half_turn() -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(0.0, 0.0, 0.0, 1.0));
    Isometry3::from_parts(nalgebra::Translation3::identity(), rotation)
}
