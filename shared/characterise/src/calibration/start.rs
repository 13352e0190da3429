//! Start values of each device by itself, and whether its poses determine it at all.

use super::CalibrationError;
use super::adjust::{approach, robust_variances, solve};
use super::homography::homography;
use super::model::{Board, DEVICE, Shape, State, compose};
use super::observations::{Device, DeviceKind, ImagePoint, Observations};
use super::problem::{Problem, ViewRange, columns};
use super::settings::{CalibrationSettings, LensFamily, LensModel, TargetShape};
use super::zhang::{candidates, fisheyes, normal_lens, pose};
use fringe::geometry::camera::Camera;
use fringe::math;
use fringe::math::linear::Factor;
use nalgebra::{Isometry3, Matrix3};

/// Two views leave focal length and principal point correlated; a third one separates them.
const MIN_VIEWS: usize = 3;

/// A focal length known worse than this is not known: 5 % of 500 mm are 25 mm.
const OPEN_FOCAL: f64 = 0.05;

/// A principal point known worse than this part of the image size is not known.
const OPEN_CENTRE: f64 = 0.1;

/// Tilts within less than this, rad (10°), count as parallel.
const PARALLEL_RAD: f64 = 0.175;

/// A start whose residuals are below this part of the image size is near enough; no other one is tried.
const NEAR: f64 = 1e-3;

/// A view with a homography, or what a view shows of one face of a target.
#[derive(Debug, Clone)]
pub(super) struct ViewHomography {
    /// Index into the views given.
    pub view: usize,
    /// Index of the device.
    pub device: usize,
    /// Index of the pose.
    pub pose: usize,
    /// Face of the target; 0 without faces.
    pub face: usize,
    /// Pixel ← target about its centre.
    pub homography: Matrix3<f64>,
    /// Start value of the pose of the board, or of the middle of the face.
    pub device_from_board: Isometry3<f64>,
}

/// The lens model of a device.
pub(super) fn lens(observations: &Observations, device: usize, settings: &CalibrationSettings) -> LensModel {
    match observations.devices[device].kind {
        DeviceKind::Camera => settings.camera,
        DeviceKind::Projector => settings.projector,
    }
}

/// All views that have a homography; of a target with faces one for each face that a view shows.
pub(super) fn usable(observations: &Observations, board: &Board) -> Vec<ViewHomography> {
    let seen = observations.views.iter().enumerate().flat_map(|(number, view)| {
        (0..board.declared.len().max(1)).filter_map(move |face| {
            Some(ViewHomography {
                view: number,
                device: view.device,
                pose: view.pose,
                face,
                homography: homography(&board.points, &board.on_face(face, &view.image_points))?,
                device_from_board: Isometry3::identity(),
            })
        })
    });
    seen.collect()
}

/// One for each view, with the pose of the whole target by the face of which most points are seen.
pub(super) fn of_target(
    observations: &Observations,
    board: &Board,
    seen: Vec<ViewHomography>,
) -> Vec<ViewHomography> {
    if board.declared.is_empty() {
        return seen;
    }
    let points = |s: &ViewHomography| board.on_face(s.face, &observations.views[s.view].image_points).len();
    let mut whole: Vec<ViewHomography> = Vec::new();
    for one in seen.chunk_by(|a, b| a.view == b.view) {
        let Some(best) = one.iter().rev().max_by_key(|s| points(s)) else { continue };
        let device_from_board = compose(&best.device_from_board, &board.declared[best.face].inverse());
        whole.push(ViewHomography { device_from_board, ..best.clone() });
    }
    whole
}

/// Refuses devices with too few views.
pub(super) fn enough_views(
    observations: &Observations,
    seen: &[ViewHomography],
) -> Result<(), CalibrationError> {
    for (number, device) in observations.devices.iter().enumerate() {
        let views = seen.iter().filter(|s| s.device == number).count();
        if views < MIN_VIEWS {
            return Err(CalibrationError::TooFewPoses {
                device: device.name.clone(),
                views,
                needs: MIN_VIEWS,
            });
        }
    }
    Ok(())
}

/// Characterises one device by itself; the poses of its views are written into `seen`.
pub(super) fn start(
    observations: &Observations,
    board: &Board,
    device: usize,
    seen: &mut [ViewHomography],
    settings: &CalibrationSettings,
) -> Result<Camera, CalibrationError> {
    let own: Vec<usize> = (0..seen.len()).filter(|i| seen[*i].device == device).collect();
    let lens = lens(observations, device, settings).to_begin_with();
    let problem = alone(observations, board, &own, seen, lens);
    let homographies: Vec<Matrix3<f64>> = own.iter().map(|i| seen[*i].homography).collect();
    let candidates: Vec<(Camera, Vec<Matrix3<f64>>)> = if lens.family == LensFamily::Fisheye {
        let shown = |i: &usize| board.on_face(seen[*i].face, &observations.views[seen[*i].view].image_points);
        let views: Vec<Vec<ImagePoint>> = own.iter().map(shown).collect();
        let views: Vec<&[ImagePoint]> = views.iter().map(Vec::as_slice).collect();
        fisheyes(&observations.devices[device], &board.points, &views)
    } else {
        let cameras = candidates(&observations.devices[device], &homographies).into_iter();
        cameras.map(|camera| (camera, homographies.clone())).collect()
    };
    let mut ranked: Vec<(f64, State)> = candidates
        .into_iter()
        .filter_map(|(camera, homographies)| {
            let boards: Option<Vec<_>> = homographies.iter().map(|h| pose(&camera, h).map(Some)).collect();
            let state = State { cameras: vec![camera], boards: boards?, shape: Shape::default() };
            Some((robust_variances(&problem, &state).1[0], state))
        })
        .collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut best: Option<(f64, State)> = None;
    let own_device = &observations.devices[device];
    let near_px = NEAR * f64::from(own_device.width_px);
    for (_, state) in ranked {
        let Some(state) = approach(&problem, state) else { continue };
        let variance = robust_variances(&problem, &state).1[0];
        if best.as_ref().is_none_or(|(least, _)| variance < *least) {
            best = Some((variance, state));
        }
        let whiten = problem.whiten.first().map_or(1.0, |w| w[0]);
        if best.as_ref().is_some_and(|(least, _)| least.sqrt() < near_px * whiten) {
            break;
        }
    }
    let Some((variance, state)) = best else {
        return Err(CalibrationError::NoConvergence { stage: own_device.name.clone(), iterations: 0 });
    };
    determined(own_device, &problem, &homographies, &state, variance)?;
    for (i, board) in own.iter().zip(&state.boards) {
        seen[*i].device_from_board = board.unwrap_or_else(Isometry3::identity);
    }
    state.cameras.into_iter().next().ok_or(CalibrationError::Empty)
}

/// The adjustment of one device; its poses are its views in order, of a target with faces each face of a view.
fn alone<'a>(
    observations: &Observations,
    board: &'a Board,
    own: &[usize],
    seen: &[ViewHomography],
    lens: LensModel,
) -> Problem<'a> {
    let (mut views, mut image_points) = (Vec::new(), Vec::new());
    for (pose, i) in own.iter().enumerate() {
        let start = image_points.len();
        // What a projector's image points are linked to is not part of this.
        image_points.extend(
            board
                .on_face(seen[*i].face, &observations.views[seen[*i].view].image_points)
                .into_iter()
                .map(|s| ImagePoint { link: None, ..s }),
        );
        views.push(ViewRange { device: 0, pose, start, end: image_points.len() });
    }
    Problem::new(board, views, image_points, columns(&[lens], TargetShape::Flat))
}

/// Refuses a device whose intrinsics its poses leave open.
fn determined(
    device: &Device,
    problem: &Problem,
    homographies: &[Matrix3<f64>],
    state: &State,
    variance: f64,
) -> Result<(), CalibrationError> {
    let limit = 25.0 * variance.max(1e-24);
    let weights: Vec<f64> = problem
        .squares(state)
        .iter()
        .map(|s| if *s <= limit { 1.0 / variance.max(1e-24) } else { 0.0 })
        .collect();
    let solved = solve(problem, state.clone(), &weights, 3);
    let u = solved.and_then(|s| {
        let inverses = s.normal.pose_inverses(0.0).ok()?;
        let (matrix, _) = s.normal.reduced(&inverses, 0.0);
        let covariance = Factor::new(&matrix).ok()?.inverse();
        let mut u = [0.0; DEVICE];
        for (entry, column) in u.iter_mut().zip(&problem.columns[0]) {
            *entry = column.map_or(0.0, |c| covariance.at(c, c).sqrt());
        }
        Some(u)
    });
    let what = match u {
        None => Some("it at all (the normal equations are singular)".to_owned()),
        Some(u) => open(&state.cameras[0], &u),
    };
    let Some(what) = what else { return Ok(()) };
    // Tilts follow from the perspective once the focal length is given; an open one may be off by any factor.
    let normal = normal_lens(device);
    let boards: Vec<Isometry3<f64>> = homographies.iter().filter_map(|h| pose(&normal, h)).collect();
    let (device, views) = (device.name.clone(), problem.views.len());
    Err(CalibrationError::Degenerate { device, views, what, remedy: remedy(boards.iter()) })
}

/// Names the intrinsic parameter that is undetermined, given standard uncertainties in the order of the model.
pub(super) fn open(camera: &Camera, u: &[f64]) -> Option<String> {
    let size = 0.5 * f64::from(camera.width_px + camera.height_px);
    let values =
        [camera.focal_px[0], camera.focal_px[1], camera.principal_point_px[0], camera.principal_point_px[1]];
    let limits = [OPEN_FOCAL * values[0], OPEN_FOCAL * values[1], OPEN_CENTRE * size, OPEN_CENTRE * size];
    let names =
        ["the focal length fx", "the focal length fy", "the principal point cx", "the principal point cy"];
    (0..4)
        .find(|i| u[*i].is_nan() || u[*i] > limits[*i])
        .map(|i| format!("{} ({:.1} ± {:.1} px, limit ± {:.1} px)", names[i], values[i], u[i], limits[i]))
}

/// The remedy, by the directions in which the target faced the device.
pub(super) fn remedy<'a>(boards: impl Iterator<Item = &'a Isometry3<f64>>) -> String {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for board in boards {
        let normal = board.rotation * nalgebra::Vector3::<f64>::z();
        // A turn about the image's x axis moves the normal along y, and the other way round.
        for (axis, part) in [normal.y, normal.x].into_iter().enumerate() {
            let tilt = math::atan2(part * normal.z.signum(), normal.z.abs());
            low[axis] = low[axis].min(tilt);
            high[axis] = high[axis].max(tilt);
        }
    }
    let name = ["x axis (horizontal in the image)", "y axis (vertical in the image)"];
    let parallel: Vec<&str> = (0..2).filter(|i| high[*i] - low[*i] < PARALLEL_RAD).map(|i| name[i]).collect();
    if parallel.is_empty() {
        return "add poses that are tilted by 20° to 45° in other directions and fill the image".into();
    }
    format!(
        "tilt the board about its {} by 20° to 45° to either side in some poses",
        parallel.join(" and its ")
    )
}
