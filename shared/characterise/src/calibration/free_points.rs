//! The points of a target that are adjusted: a block each, and the datum that holds them.

use super::datum::Datum;
use super::model::POSE;
use fringe::math::linear::dot;
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// What belongs to one point of the target.
#[derive(Debug, Clone)]
pub(super) struct PointBlock {
    /// Normal matrix of the point, 3 × 3, without the datum.
    pub matrix: Matrix3<f64>,
    /// Right side of the point, Jᵀr.
    pub right: Vector3<f64>,
    /// Coupling to the reduced parameters that see it, by their column.
    pub by_device: BTreeMap<usize, Vector3<f64>>,
    /// Coupling to the poses that show it, 6 × 3.
    pub by_pose: BTreeMap<usize, [Vector3<f64>; POSE]>,
}

impl PointBlock {
    /// A point that nothing shows yet.
    pub fn new() -> Self {
        Self {
            matrix: Matrix3::zeros(),
            right: Vector3::zeros(),
            by_device: BTreeMap::new(),
            by_pose: BTreeMap::new(),
        }
    }
}

/// The points of a target with the datum that holds them.
#[derive(Debug, Clone)]
pub(super) struct Points {
    /// In the order of the target.
    pub blocks: Vec<PointBlock>,
    /// Seven rows over the coordinates of all points.
    pub rows: Vec<Vec<f64>>,
    /// Weight c of each row.
    pub held: f64,
    /// Added to each diagonal entry: it holds points that no view shows.
    pub unseen: f64,
}

impl Points {
    /// Sums of all points, with the datum that goes with them.
    pub fn new(blocks: Vec<PointBlock>, datum: &Datum) -> Self {
        let trace: f64 = blocks.iter().map(|b| b.matrix.trace()).sum();
        let seen: Vec<bool> = blocks.iter().map(|b| b.matrix.trace() > 0.0).collect();
        let (rows, held, unseen) = datum.held(trace, &seen);
        Self { blocks, rows, held, unseen }
    }

    /// c |H δ|² + the weight of points that no view shows.
    pub fn datum_length(&self, steps: &[f64]) -> f64 {
        let of_rows: f64 = self.rows.iter().map(|row| dot(row, steps).powi(2)).sum();
        self.held * of_rows + self.unseen * dot(steps, steps)
    }

    /// A point's part of a datum row.
    pub fn part(&self, row: usize, point: usize) -> Vector3<f64> {
        Vector3::from_column_slice(&self.rows[row][3 * point..3 * point + 3])
    }
}
