//! The axis of a body of rotation, and candidates for its direction.

use nalgebra::{Matrix2, SMatrix, Vector3};

use super::adjust::{Model, Until, adjust};
use super::centred::Principal;
use super::normal::tangents;
use super::sphere::polar;
use crate::spread::some_of;
use fringe::math;

/// Directions tried over the half sphere besides the principal axes: some 16° apart, inside the basin of a cylinder.
const DIRECTIONS: u32 = 96;

/// Points that the search for a start looks at.
const SEARCH_POINTS: usize = 400;

/// Candidates that are adjusted in the search.
const CANDIDATES: usize = 8;

/// A line with a chart of two tilts and two shifts.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    /// Point of the axis nearest to the origin.
    pub point: Vector3<f64>,
    /// Direction of the axis, unit vector.
    pub direction: Vector3<f64>,
    /// Directions of tilts and shifts.
    pub tangents: [Vector3<f64>; 2],
}

/// A point seen from an axis.
pub(super) struct AxialPoint {
    /// Distance from the axis.
    pub radius: f64,
    /// Coordinate along the axis.
    pub height: f64,
    /// Components of the outward unit vector along the two tangents.
    pub out: [f64; 2],
}

impl Axis {
    /// The line through a point along a unit direction.
    pub fn new(point: Vector3<f64>, direction: Vector3<f64>) -> Self {
        let foot = point - direction * point.dot(&direction);
        Self { point: foot, direction, tangents: tangents(&direction) }
    }

    /// A point in the axis' cylindrical coordinates.
    pub fn see(&self, point: &Vector3<f64>) -> AxialPoint {
        let arm = point - self.point;
        let height = arm.dot(&self.direction);
        let (radius, out) = polar(&(arm - self.direction * height));
        AxialPoint { radius, height, out: [out.dot(&self.tangents[0]), out.dot(&self.tangents[1])] }
    }

    /// The axis after tilts (rad) and shifts, and how far its reference point slid along it.
    pub fn moved(&self, tilts: [f64; 2], shifts: [f64; 2]) -> (Self, f64) {
        let [e1, e2] = &self.tangents;
        let tilted = self.direction + e1 * tilts[0] + e2 * tilts[1];
        let point = self.point + e1 * shifts[0] + e2 * shifts[1];
        let axis = Self::new(point, tilted / tilted.norm());
        let slid = (axis.point - point).dot(&axis.direction);
        (axis, slid)
    }
}

/// Standard uncertainty of a direction about its worst axis, from the covariance of its two tilts.
pub(super) fn worst_tilt_rad(tilts: Matrix2<f64>) -> f64 {
    let (trace, determinant) = (tilts.trace(), tilts.determinant());
    (0.5 * (trace + (trace * trace - 4.0 * determinant).max(0.0).sqrt())).max(0.0).sqrt()
}

/// Standard uncertainties of a point along x, y and z, from its change by each parameter and their covariance, mm.
pub(super) fn u_point_mm<const P: usize>(
    by: &SMatrix<f64, 3, P>,
    covariance: &SMatrix<f64, P, P>,
) -> [f64; 3] {
    let variances = (by * covariance * by.transpose()).diagonal();
    [0, 1, 2].map(|i| variances[i].max(0.0).sqrt())
}

/// At most [`SEARCH_POINTS`] points, evenly from the whole.
pub(super) fn thinned(points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    some_of(points, SEARCH_POINTS)
}

/// Principal axes, then a Fibonacci lattice over the half sphere.
pub(super) fn directions(points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let principal = Principal::new(points).axes;
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let lattice = (0..DIRECTIONS).map(|i| {
        let z = (f64::from(i) + 0.5) / f64::from(DIRECTIONS);
        let (sin, cos) = math::sincos(golden * f64::from(i));
        let across = (1.0 - z * z).sqrt();
        Vector3::new(across * cos, across * sin, z)
    });
    principal.column_iter().map(nalgebra::Matrix::into_owned).chain(lattice).collect()
}

/// Adjusts the candidates of smallest sum of squares on the thinned points and returns the best model.
pub(super) fn best_of<M: Model<P>, const P: usize>(
    element: &'static str,
    candidates: impl Iterator<Item = M>,
    thin: &[Vector3<f64>],
) -> Option<M> {
    let squares = |model: &M| thin.iter().map(|p| model.deviation(p)).map(|d| d * d).sum::<f64>();
    let mut ranked: Vec<(f64, M)> =
        candidates.map(|m| (squares(&m), m)).filter(|(sum, _)| sum.is_finite()).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    ranked.truncate(CANDIDATES);
    let adjusted = ranked.into_iter().filter_map(|(_, m)| adjust(element, m, thin, Until::Settled).ok());
    adjusted.min_by(|a, b| a.normal.sum.total_cmp(&b.normal.sum)).map(|best| best.model)
}
