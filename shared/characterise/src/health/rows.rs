//! Equations of the matches of a pair: residuals with their derivatives.

use super::matches::Match;
use super::parameters::{COUNT, Sensitivity};
use crate::calibration::PARAMETERS;
use fringe::geometry::camera::Camera;
use nalgebra::{Point2, Vector3};
use rayon::prelude::*;

/// Unknowns of the joint fit: three rotations, two shifts across the baseline, the focal length.
pub(super) const UNKNOWNS: usize = 6;

/// Causes by themselves: three rotations, three shifts, the focal length.
pub(super) const CAUSES: [(&str, &str); 7] = [
    ("rotation about x", "rad"),
    ("rotation about y", "rad"),
    ("rotation about z", "rad"),
    ("shift along x", "mm"),
    ("shift along y", "mm"),
    ("shift along z", "mm"),
    ("focal length", "1"),
];

/// A residual with its derivatives, all over its standard deviation.
#[derive(Debug, Clone)]
pub(super) struct Row {
    /// Epipolar residual over its standard deviation.
    pub error: f64,
    /// By the unknowns of the joint fit.
    pub by: [f64; UNKNOWNS],
    /// By the causes one by one.
    pub cause: [f64; CAUSES.len()],
    /// By the rig file's parameters.
    pub file: [f64; 2 * COUNT],
    /// Standard deviation of the residual, px.
    pub sigma_px: f64,
    /// Part of the image, for sums over neighbours.
    pub tile: u64,
}

/// Side of a tile, px: eight windows.
const TILE_PX: f64 = 40.0;

/// Standard deviations below this are those of ideal data, px.
const LEAST_SIGMA_PX: f64 = 1e-6;

/// Residuals with derivatives, in the order of the matches.
pub(super) fn rows(left: &Camera, right: &Camera, matches: &[Match]) -> Vec<Row> {
    let sensitivity = Sensitivity::new(left, right);
    let across = across(&sensitivity.baseline());
    let place = |name: &str| PARAMETERS.iter().position(|known| *known == name).unwrap_or(0) + COUNT;
    let pose = ["rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm"].map(place);
    let focal = [place("fx_px"), place("fy_px")];
    let row = |m: &Match| {
        let answer = sensitivity.at(m.left, m.right)?;
        let [a, b] = answer.slope;
        let c = &m.covariance_px2;
        let variance = a * a * c[(0, 0)] + a * b * (c[(0, 1)] + c[(1, 0)]) + b * b * c[(1, 1)];
        let sigma_px = variance.sqrt().max(LEAST_SIGMA_PX);
        // The true state is larger than the file's by the drift, so the residual falls.
        let own = pose.map(|at| -answer.by[at] / sigma_px);
        let zoom =
            -(right.focal_px[0] * answer.by[focal[0]] + right.focal_px[1] * answer.by[focal[1]]) / sigma_px;
        let along = |direction: &Vector3<f64>| (0..3).map(|i| direction[i] * own[3 + i]).sum::<f64>();
        sigma_px.is_finite().then(|| Row {
            error: answer.error_px / sigma_px,
            by: [own[0], own[1], own[2], along(&across[0]), along(&across[1]), zoom],
            cause: [own[0], own[1], own[2], own[3], own[4], own[5], zoom],
            file: answer.by.map(|by| by / sigma_px),
            sigma_px,
            tile: tile(m.left),
        })
    };
    // Collected in order: no result depends on the number of threads.
    matches.par_iter().map(row).collect::<Vec<_>>().into_iter().flatten().collect()
}

fn tile(at: Point2<f64>) -> u64 {
    let part = |v: f64| (v / TILE_PX).max(0.0) as u64;
    (part(at.y) << 32) | part(at.x)
}

/// Two directions across the baseline, the first one as upright as can be.
fn across(baseline: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let along = baseline.try_normalize(1e-12).unwrap_or_else(Vector3::x);
    let start = if along.y.abs() < 0.9 { Vector3::y() } else { Vector3::x() };
    let first = (start - along * along.dot(&start)).try_normalize(1e-12).unwrap_or_else(Vector3::y);
    [first, along.cross(&first)]
}
