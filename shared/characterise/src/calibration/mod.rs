//! The joint characterisation: all cameras, all projectors and all board poses in one adjustment, with covariance.
//!
//! Source: thesis 2.3 (Zhang's method, eq. 2.62–2.79; projector as an inverse camera, 2.106–2.109) and 5.3.1 step A.
//! Deviation: the thesis characterises each device by itself and chains the extrinsics through the first board position;
//! here one least-squares adjustment holds all of them, so that the pairs agree, and the covariance is known.
//!
//! 1. Homographies of all views, robust against single wrong points ([`homography`]).
//! 2. Each device by itself: Zhang's closed form or an assumed principal point, then a robust adjustment. A device
//!    that its poses leave open is refused with what is missing.
//! 3. One frame: devices are placed one by one by the agreement of all shared poses, which also settles boards that
//!    were read turned by 180°. No pose need be seen by all devices; parts that nothing connects are named ([`connection`]). A target may
//!    have several flat faces ([`Face`]), of which each device sees others; where they are on the target is adjusted too.
//! 4. Joint Levenberg–Marquardt adjustment with the poses eliminated: first Cauchy weights, then rounds of least
//!    squares in which points beyond `outlier_limit` robust standard deviations are rejected, and each device's noise
//!    is estimated (variance components). A projector read where a camera found the point shares that camera's error: it
//!    enters by what the reading itself adds ([`Link`]).
//! 5. Covariance (JᵀWJ)⁻¹ of all devices, in two gauges.
//!
//! Deterministic: one thread, sums in the order of the views given.

mod adjust;
mod between;
mod connection;
mod covariance;
mod datum;
mod eliminated_points;
mod error;
mod factorised;
mod finish;
mod free_points;
mod graph;
mod held_out;
mod homography;
mod lengths;
mod lens_choice;
mod maps;
mod misfit;
mod model;
mod modes;
mod normal;
mod observations;
mod predict;
mod problem;
mod reading;
mod result;
mod settings;
mod spacing;
mod start;
mod stereo;
mod sums;
#[cfg(test)]
mod tests;
mod validate;
mod zhang;

pub use between::BetweenPoses;
pub use covariance::{COMMON_PARAMETERS, Covariance, Gauge, PARAMETERS};
pub use error::CalibrationError;
pub use held_out::{Fold, HeldOut, HeldOutDevice, hold_out, in_turn};
pub use lengths::MeasuredLength;
pub use lens_choice::{LensChoice, TriedLens, choose_lens};
pub use maps::{MapGrid, UncertaintyMap};
pub(crate) use model::{Ideal, moved, rotation, rotation_vector};
pub use modes::{Followed, Mode, modes};
pub use observations::{Device, DeviceKind, Face, ImagePoint, Link, Observations, View};
pub use predict::PointUncertainty;
pub use reading::{ProjectorReading, projector_pixel};
pub use result::{CalibratedDevice, Calibration, FacePlace, Outlier, Residual, ViewReport, Warp};
pub use settings::{CalibrationSettings, LensFamily, LensModel, TargetShape, WorldFrame};
pub use spacing::{SpacingSettings, SphereSpacing, Volume};
pub use stereo::{EpipolarResiduals, RelativePose, StereoGeometry};
pub use validate::{CrossValidation, DeviceDifference, cross_validate};

use adjust::Weighted;
use datum::Datum;
use finish::Finish;
use fringe::geometry::camera::Camera;
use model::{Board, FACE, Shape, State};
use nalgebra::Vector3;
use problem::{Problem, RIDGE, ViewRange, columns};
use start::{ViewHomography, lens};

/// Characterises all devices of a rig.
///
/// # Errors
/// See [`CalibrationError`]; input that is wrong, poses that leave something open, groups that nothing connects.
pub fn calibrate(
    observations: &Observations,
    settings: &CalibrationSettings,
) -> Result<Calibration, CalibrationError> {
    observations.check()?;
    settings.check()?;
    let board = Board::new(observations);
    if observations.views.iter().any(|v| v.may_be_turned) && board.turned().is_none() {
        let what = "a view may be turned by 180°, but the turned target does not meet itself".into();
        return Err(CalibrationError::Target { what });
    }
    let mut seen = start::usable(observations, &board);
    start::enough_views(observations, &seen)?;
    connection::connected(observations, &board, &seen)?;
    let faces = connection::adjusted_faces(observations, &seen);
    let cameras: Result<Vec<Camera>, _> = (0..observations.devices.len())
        .map(|device| start::start(observations, &board, device, &mut seen, settings))
        .collect();
    let mut cameras = cameras?;
    let seen = start::of_target(observations, &board, seen);
    let placed = graph::place(observations, &seen);
    for (device, (camera, device_from_world)) in cameras.iter_mut().zip(&placed.devices).enumerate() {
        camera.camera_from_world = *device_from_world;
        camera.distortion.kind = lens(observations, device, settings).family.kind();
    }
    let mut problem = joint(observations, &board, &seen, &placed.turned, settings);
    problem.adjust_faces(&faces);
    let shape = Shape { faces: board.declared.clone(), ..Shape::default() };
    let state = State { cameras, boards: placed.boards, shape };
    let weighted = adjust::approach(&problem, state)
        .and_then(|state| adjust::weighted(&problem, state, settings))
        .and_then(|weighted| match settings.target {
            TargetShape::Free => free_points(&mut problem, weighted.solved.state, settings),
            TargetShape::Flat | TargetShape::Bent => Some(weighted),
        })
        .ok_or_else(|| CalibrationError::NoConvergence { stage: "joint adjustment".into(), iterations: 0 })?;
    let turned = &placed.turned;
    Finish {
        observations,
        settings,
        board: &board,
        problem: &problem,
        seen: &seen,
        turned,
        weighted: &weighted,
    }
    .run()
}

/// The adjustment of everything.
fn joint<'a>(
    observations: &Observations,
    board: &'a Board,
    seen: &[ViewHomography],
    turned: &[bool],
    settings: &CalibrationSettings,
) -> Problem<'a> {
    let opposite = board.turned();
    let (mut views, mut image_points) = (Vec::with_capacity(seen.len()), Vec::new());
    for (view, turned) in seen.iter().zip(turned) {
        let start = image_points.len();
        for image_point in &observations.views[view.view].image_points {
            let mut image_point = *image_point;
            if let (true, Some(opposite)) = (turned, &opposite) {
                image_point.index = opposite[image_point.index];
            }
            image_points.push(image_point);
        }
        views.push(ViewRange { device: view.device, pose: view.pose, start, end: image_points.len() });
    }
    let lenses: Vec<LensModel> =
        (0..observations.devices.len()).map(|device| lens(observations, device, settings)).collect();
    // Points get free from a target that is nearly right: their own step starts from the bend.
    // The faces of a body are flat; a bend of each hides in where it is.
    let is_flat = settings.target == TargetShape::Flat || !observations.faces.is_empty();
    let target = if is_flat { TargetShape::Flat } else { TargetShape::Bent };
    let quotient = |l: &LensModel| matches!(l.family, LensFamily::Rational | LensFamily::ThinPrism);
    let ridge = if lenses.iter().any(quotient) { RIDGE } else { 0.0 };
    Problem { ridge, ..Problem::new(board, views, image_points, columns(&lenses, target)) }
}

/// Adjusts each point of the target too, from the solution for the bent one; the bend stays what it is, as a reference.
fn free_points(problem: &mut Problem, mut state: State, settings: &CalibrationSettings) -> Option<Weighted> {
    let datum = Datum::new(&problem.board.rigid_points(&state.shape), &problem.board.points);
    // Warp and faces stood last; what they did the points now do one by one.
    let mut stood = FACE * problem.faces.iter().flatten().count();
    for column in problem.columns.last_mut().into_iter().flatten() {
        stood += usize::from(column.take().is_some());
    }
    problem.faces.fill(None);
    problem.unknowns = problem.unknowns + datum.size() - stood;
    problem.datum = Some(datum);
    state.shape.offsets_mm = vec![Vector3::zeros(); problem.board.points.len()];
    adjust::weighted(problem, state, settings)
}
