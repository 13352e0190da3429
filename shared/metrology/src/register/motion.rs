//! The normal equations of a small motion, and which parts of it they determine.

use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

use crate::fit::{Normal, eigen};
use fringe::geometry::pose::Pose;
use fringe::math;

/// Mean squared sensitivity of the distances to a motion of 1 mm below which the motion is not determined, whatever the
/// points: a slope of 0.1 %.
const LEAST_SENSITIVITY: f64 = 1e-6;

/// As many times the variance of the normals: noise tilts the normals of a plane and makes it look bent.
const NOISE_FACTOR: f64 = 10.0;

/// A rotation vector about `centre`, in units of 1/`arm_mm`, and a translation, mm.
pub(super) type Motion = SVector<f64, 6>;

/// Equations about a centre with rotations measured in mm at an arm, so that all six unknowns are comparable.
#[derive(Debug, Clone, Copy)]
pub(super) struct Equations {
    pub normal: Normal<6>,
    pub centre: Point3<f64>,
    pub arm_mm: f64,
}

/// Principal motions of the alignment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Principal {
    /// Mean squared sensitivities, ascending.
    pub values: SVector<f64, 6>,
    /// Unit motions in the columns.
    pub vectors: SMatrix<f64, 6, 6>,
    /// Below this sensitivity a motion is not determined.
    pub limit: f64,
}

impl Equations {
    /// Derivatives of the distance along `normal` of a point at `place`.
    pub fn derivatives(
        centre: &Point3<f64>,
        arm_mm: f64,
        place: &Point3<f64>,
        normal: &Vector3<f64>,
    ) -> Motion {
        let turn = (place - centre).cross(normal) / arm_mm;
        SVector::from([turn.x, turn.y, turn.z, normal.x, normal.y, normal.z])
    }

    /// Principal motions of the equations, when normals have a variance of slope, rad².
    pub fn principal(&self, normal_variance: f64) -> Principal {
        let rows = self.normal.rows.max(1) as f64;
        let (values, vectors) = eigen(&(self.normal.symmetric() / rows));
        Principal { values, vectors, limit: LEAST_SENSITIVITY.max(NOISE_FACTOR * normal_variance) }
    }

    /// The least-squares motion within the determined directions.
    pub fn step(&self, principal: &Principal) -> Motion {
        let rows = self.normal.rows.max(1) as f64;
        principal.determined().fold(Motion::zeros(), |sum, i| {
            let direction = principal.vectors.column(i).into_owned();
            sum - direction * (direction.dot(&self.normal.gradient) / (rows * principal.values[i]))
        })
    }

    /// Size of a motion in standard deviations of the pose, for independent residuals.
    pub fn in_sigmas(&self, principal: &Principal, motion: &Motion) -> f64 {
        let rows = self.normal.rows as f64;
        let variance = self.normal.sum / (rows - 6.0).max(1.0);
        let along = |i: usize| principal.vectors.column(i).dot(motion);
        let square: f64 =
            principal.determined().map(|i| along(i) * along(i) * rows * principal.values[i]).sum();
        (square / variance.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// The motion as a pose.
    pub fn pose(&self, motion: &Motion) -> Pose {
        let turn = Vector3::new(motion[0], motion[1], motion[2]) / self.arm_mm;
        let rotation = rotation(&turn);
        let shift = Vector3::new(motion[3], motion[4], motion[5]);
        Pose { rotation, translation: self.centre.coords - rotation * self.centre.coords + shift }
    }
}

impl Principal {
    /// Numbers of the determined motions.
    pub fn determined(&self) -> impl Iterator<Item = usize> + '_ {
        (0..6).filter(|i| self.values[*i] > self.limit)
    }

    /// Numbers of the others.
    pub fn free(&self) -> impl Iterator<Item = usize> + '_ {
        (0..6).filter(|i| self.values[*i] <= self.limit)
    }
}

/// Rotation by a vector: Rodrigues' formula.
pub(super) fn rotation(turn: &Vector3<f64>) -> Matrix3<f64> {
    let angle = turn.norm();
    if angle == 0.0 {
        return Matrix3::identity();
    }
    let (sine, cosine) = math::sincos(angle);
    let axis = turn / angle;
    let cross = axis.cross_matrix();
    orthonormal(&(Matrix3::identity() + cross * sine + cross * cross * (1.0 - cosine)))
}

/// The matrix with its rounding errors removed (Gram & Schmidt): products of many rotations stay rotations.
pub(super) fn orthonormal(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    let x: Vector3<f64> = matrix.column(0).into_owned();
    let x = x / x.norm();
    let y: Vector3<f64> = matrix.column(1).into_owned();
    let y = y - x * x.dot(&y);
    let y = y / y.norm();
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}
