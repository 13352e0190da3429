//! Levenberg–Marquardt on the normal equations, then the rounds that find outliers and noise.

use super::datum::Datum;
use super::homography::MIN_IMAGE_POINTS;
use super::model::{DEVICE, FACE, State, compose, motion, moved};
use super::normal::{Normal, Step};
use super::problem::Problem;
use super::settings::CalibrationSettings;
use fringe::math::statistics::median;
use nalgebra::Vector3;

/// Most iterations of one solution; from Zhang's start eight to fifteen are needed.
const MAX_ITERATIONS: usize = 100;

/// Damping of the first step: the start is good to a few per cent.
const FIRST_DAMPING: f64 = 1e-3;

/// A step whose square in standard deviations of all parameters together is less than this ends the iteration: 1e-4
/// standard deviations.
const SETTLED: f64 = 1e-8;

/// A step that changes the cost by less than this part of it ends the iteration, too: image points are rounded at 1e-12 px, so of 1e5
/// residuals of 5e-3 px the cost resolves 1e-12. That part is a step of 1e-3 standard deviations.
const RESOLVED: f64 = 1e-11;

/// Residuals below this are rounding, px: exact data must not be outliers of each other.
const ROUNDING_PX: f64 = 1e-7;

/// Rounds of reweighting; the set of outliers settles after three to five.
const MAX_ROUNDS: usize = 20;

/// Where an adjustment ended.
#[derive(Debug, Clone)]
pub(super) struct Solved {
    /// Parameters at the minimum.
    pub state: State,
    /// Normal equations at these parameters.
    pub normal: Normal,
    /// Accepted and refused steps.
    pub iterations: usize,
    /// Whether the last step was below the noise.
    pub settled: bool,
}

/// Minimises the weighted sum of squares; `None` when the start itself has no residuals.
pub(super) fn solve(problem: &Problem, start: State, weights: &[f64], most: usize) -> Option<Solved> {
    let normal = problem.normal(&start, weights)?;
    let used = weights.iter().filter(|w| **w > 0.0).count();
    let parameters = problem.parameters() + 6 * normal.poses.iter().flatten().count();
    let freedom = (2 * used).saturating_sub(parameters).max(1) as f64;
    let floor =
        2.0 * weights.iter().zip(&problem.whiten).map(|(w, l)| w * (l[0] * ROUNDING_PX).powi(2)).sum::<f64>();
    let mut solved = Solved { state: start, normal, iterations: 0, settled: false };
    let mut damping = FIRST_DAMPING;
    while solved.iterations < most && damping < 1e10 {
        solved.iterations += 1;
        let variance = solved.normal.cost.max(floor) / freedom;
        let short = (SETTLED * variance).max(RESOLVED * solved.normal.cost);
        // The undamped step decides whether it has settled: a damped one is short for other reasons.
        let last = solved.normal.step(problem.ridge).filter(|step| solved.normal.length(step) <= short);
        let Some(step) = last.clone().or_else(|| solved.normal.step(damping)) else {
            damping *= 10.0;
            continue;
        };
        let state = stepped(problem, &solved.state, &step);
        let cost = problem.cost(&state, weights);
        if cost <= solved.normal.cost || (last.is_some() && cost.is_finite()) {
            let Some(normal) = problem.normal(&state, weights) else { break };
            let settled = last.is_some();
            solved = Solved { state, normal, iterations: solved.iterations, settled };
            damping = (damping * 0.1).max(1e-12);
        } else {
            damping = (damping * 10.0).max(1e-6);
        }
        if solved.settled {
            break;
        }
    }
    Some(solved)
}

/// The state after a step.
pub(super) fn stepped(problem: &Problem, state: &State, step: &Step) -> State {
    let value = |column: &Option<usize>| column.map_or(0.0, |c| step.devices[c]);
    let cameras = state.cameras.iter().zip(&problem.columns).map(|(camera, columns)| {
        let mut local = [0.0; DEVICE];
        for (entry, column) in local.iter_mut().zip(columns) {
            *entry = value(column);
        }
        moved(camera, &local)
    });
    let boards = state.boards.iter().zip(&step.poses).map(|(board, step)| match (board, step) {
        (Some(board), Some(step)) => Some(compose(board, &motion(step))),
        _ => *board,
    });
    let mut shape = state.shape.clone();
    for (face, column) in shape.faces.iter_mut().zip(&problem.faces) {
        if let Some(first) = *column {
            *face = compose(face, &motion(&step.devices[first..first + FACE]));
        }
    }
    for (entry, column) in shape.warp_mm.iter_mut().zip(problem.columns.last().into_iter().flatten()) {
        *entry += value(column);
    }
    if let Some(datum) = &problem.datum {
        let first = step.devices.len() - datum.size();
        for (offset, step) in shape.offsets_mm.iter_mut().zip(step.devices[first..].chunks_exact(3)) {
            *offset += Vector3::from_column_slice(step);
        }
    }
    State { cameras: cameras.collect(), boards: boards.collect(), shape }
}

/// Robust variance of each device's whitened residuals: the median of the squares over that of χ² with two degrees.
pub(super) fn robust_variances(problem: &Problem, state: &State) -> (Vec<f64>, Vec<f64>) {
    let squares = problem.squares(state);
    let variances = (0..state.cameras.len())
        .map(|device| {
            let own = problem.views.iter().filter(|v| v.device == device);
            let mut own: Vec<f64> = own.flat_map(|v| squares[v.start..v.end].iter().copied()).collect();
            median(&mut own).unwrap_or(0.0) / (2.0 * std::f64::consts::LN_2)
        })
        .collect();
    (squares, variances)
}

/// A few rounds with Cauchy weights, which approach the solution in spite of wrong points.
pub(super) fn approach(problem: &Problem, mut state: State) -> Option<State> {
    for most in [8, 8, 12, 20] {
        let (squares, variances) = robust_variances(problem, &state);
        let mut weights = vec![0.0; squares.len()];
        for view in &problem.views {
            let scale = 4.0 * variances[view.device];
            for number in view.start..view.end {
                let square = squares[number];
                // An image point behind its device would make the cost infinite; it has no weight until it is in front.
                weights[number] =
                    if square.is_finite() { 1.0 / (1.0 + square / scale.max(1e-24)) } else { 0.0 };
            }
        }
        state = solve(problem, state, &weights, most)?.state;
    }
    Some(state)
}

/// The final solution and what it was weighted with.
#[derive(Debug, Clone)]
pub(super) struct Weighted {
    /// The last solution of the rounds.
    pub solved: Solved,
    /// Weight of each image point; 0 marks an outlier.
    pub weights: Vec<f64>,
    /// Variance factor of each device.
    pub variances: Vec<f64>,
    /// Iterations of all rounds together.
    pub iterations: usize,
}

/// Least squares without the outliers: rounds of rejection and of variance components until neither changes.
pub(super) fn weighted(problem: &Problem, start: State, settings: &CalibrationSettings) -> Option<Weighted> {
    let (squares, mut variances) = robust_variances(problem, &start);
    let mut used = accepted(problem, &squares, &variances, settings);
    variances = variances.iter().map(|v| v.max(1e-24)).collect();
    let mut state = start;
    let (mut iterations, mut round) = (0, 0);
    loop {
        round += 1;
        let weights = weights(problem, &used, &variances, settings.estimate_noise);
        let solved = solve(problem, state, &weights, MAX_ITERATIONS)?;
        iterations += solved.iterations;
        let components = components(problem, &solved, &used)?;
        let (squares, robust) = robust_variances(problem, &solved.state);
        let next = accepted(problem, &squares, &robust, settings);
        let steady = components.iter().zip(&variances).all(|(a, b)| (a / b - 1.0).abs() < 1e-3);
        if (next == used && (steady || !settings.estimate_noise)) || round >= MAX_ROUNDS {
            return Some(Weighted { solved, weights, variances: components, iterations });
        }
        state = solved.state;
        used = next;
        variances = components;
    }
}

fn weights(problem: &Problem, used: &[bool], variances: &[f64], estimate: bool) -> Vec<f64> {
    let mut weights = vec![0.0; used.len()];
    for view in &problem.views {
        for number in view.start..view.end {
            if used[number] {
                weights[number] = if estimate { 1.0 / variances[view.device] } else { 1.0 };
            }
        }
    }
    weights
}

/// Which image points are no outliers.
fn accepted(
    problem: &Problem,
    squares: &[f64],
    variances: &[f64],
    settings: &CalibrationSettings,
) -> Vec<bool> {
    let mut used = vec![false; squares.len()];
    let limit = settings.outlier_limit * settings.outlier_limit;
    for view in &problem.views {
        for number in view.start..view.end {
            let rounding = 100.0 * (ROUNDING_PX * problem.whiten[number][0]).powi(2);
            used[number] = squares[number] <= (limit * variances[view.device]).max(rounding);
        }
    }
    drop_remnants(problem, &mut used);
    // Light read where a camera was wrong about the point is that of another place.
    for (number, link) in problem.links.iter().enumerate() {
        used[number] &= link.as_ref().is_none_or(|l| used[l.image_point]);
    }
    drop_remnants(problem, &mut used);
    used
}

/// What is left of a view that is wrong as a whole fits by chance.
fn drop_remnants(problem: &Problem, used: &mut [bool]) {
    for view in &problem.views {
        let own = &mut used[view.start..view.end];
        if own.iter().filter(|u| **u).count() < MIN_IMAGE_POINTS {
            own.fill(false);
        }
    }
}

/// Variance component of each device: its sum of squares over its redundancy (Förstner's simplified estimator).
///
/// A device's redundancy is its number of rows less its own parameters less its share in each pose,
/// tr(V⁻¹ V_device); these shares add up to six for each pose, so that the redundancies add up to the degrees of freedom.
/// Points of the target that are adjusted are shared by the information about them.
fn components(problem: &Problem, solved: &Solved, used: &[bool]) -> Option<Vec<f64>> {
    let inverses = solved.normal.pose_inverses(0.0).ok()?;
    let squares = problem.squares(&solved.state);
    let mut sums = vec![0.0; solved.state.cameras.len()];
    let mut freedom: Vec<f64> =
        (0..sums.len()).map(|d| -(problem.columns[d].iter().flatten().count() as f64)).collect();
    for (view, share) in problem.views.iter().zip(&solved.normal.shares) {
        for number in (view.start..view.end).filter(|n| used[*n]) {
            sums[view.device] += squares[number];
            freedom[view.device] += 2.0;
        }
        if let Some(inverse) = &inverses[view.pose] {
            let product = inverse.times(share);
            freedom[view.device] -= (0..product.rows).map(|i| product.at(i, i)).sum::<f64>();
        }
    }
    if let Some(datum) = &problem.datum {
        let all: f64 = solved.normal.point_shares.iter().sum();
        let each = (datum.size() - Datum::HELD) as f64 / all.max(1e-300);
        for (view, share) in problem.views.iter().zip(&solved.normal.point_shares) {
            freedom[view.device] -= share * each;
        }
    }
    Some(sums.iter().zip(&freedom).map(|(s, f)| (s / f.max(1.0)).max(1e-24)).collect())
}
