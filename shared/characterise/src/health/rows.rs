//! Equations of the matches of a pair: residuals with their derivatives.

use super::matches::Match;
use super::parameters::{COUNT, Sensitivity};
use super::state::POSE;
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
pub(super) struct Row<const N: usize, const P: usize> {
    /// Epipolar residual over its standard deviation.
    pub error: f64,
    /// By the unknowns of the joint fit.
    pub by: [f64; N],
    /// By the causes one by one.
    pub cause: [f64; CAUSES.len()],
    /// By the rig file's parameters.
    pub file: [f64; P],
    /// Standard deviation of the residual, px.
    pub sigma_px: f64,
    /// Part of the image, for sums over neighbours.
    pub tile: u64,
}

/// A residual of two views.
pub(super) type PairRow = Row<UNKNOWNS, { 2 * COUNT }>;

/// Side of a tile, px: eight windows.
const TILE_PX: f64 = 40.0;

/// Standard deviations below this are those of ideal data, px.
pub(super) const LEAST_SIGMA_PX: f64 = 1e-6;

/// Residuals with derivatives, in the order of the matches.
pub(super) fn rows(left: &Camera, right: &Camera, matches: &[Match]) -> Vec<PairRow> {
    let sensitivity = Sensitivity::new(left, right);
    let across = across(&sensitivity.baseline());
    let row = |m: &Match| {
        let answer = sensitivity.at(m.left, m.right)?;
        let [a, b] = answer.slope;
        let c = &m.covariance_px2;
        let variance = a * a * c[(0, 0)] + a * b * (c[(0, 1)] + c[(1, 0)]) + b * b * c[(1, 1)];
        let sigma_px = variance.sqrt().max(LEAST_SIGMA_PX);
        let own: [f64; COUNT] = std::array::from_fn(|k| answer.by[COUNT + k]);
        let cause = own_causes(&own, right).map(|by| by / sigma_px);
        let along = |direction: &Vector3<f64>| (0..3).map(|i| direction[i] * cause[3 + i]).sum::<f64>();
        sigma_px.is_finite().then(|| PairRow {
            error: answer.error_px / sigma_px,
            by: [cause[0], cause[1], cause[2], along(&across[0]), along(&across[1]), cause[6]],
            cause,
            file: answer.by.map(|by| by / sigma_px),
            sigma_px,
            tile: tile(m.left),
        })
    };
    // Collected in order: no result depends on the number of threads.
    matches.par_iter().map(row).collect::<Vec<_>>().into_iter().flatten().collect()
}

/// Derivatives by the causes from those by the parameters of a view in the rig file: the true state is larger than the file's by the drift,
/// so that the residual falls.
pub(super) fn own_causes(by: &[f64; COUNT], view: &Camera) -> [f64; CAUSES.len()] {
    let place = |name: &str| PARAMETERS.iter().position(|known| *known == name).unwrap_or(0);
    let [rx, ry, rz, tx, ty, tz] = POSE.map(|name| -by[place(name)]);
    let zoom = -(view.focal_px[0] * by[place("fx_px")] + view.focal_px[1] * by[place("fy_px")]);
    [rx, ry, rz, tx, ty, tz, zoom]
}

pub(super) fn tile(at: Point2<f64>) -> u64 {
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
