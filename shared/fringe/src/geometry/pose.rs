//! A rigid motion as matrix and vector, for loops over many points.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::math;

/// x ↦ R x + t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation matrix R of X' = R X + t.
    pub rotation: Matrix3<f64>,
    /// Translation t of X' = R X + t, mm.
    pub translation: Vector3<f64>,
}

impl Pose {
    /// The motion of an isometry.
    pub fn new(isometry: &Isometry3<f64>) -> Self {
        let rotation = isometry.rotation.to_rotation_matrix().into_inner();
        Self { rotation, translation: isometry.translation.vector }
    }

    /// The motion as an isometry.
    pub fn isometry(&self) -> Isometry3<f64> {
        let rotation = Rotation3::from_matrix_unchecked(self.rotation);
        Isometry3::from_parts(
            Translation3::from(self.translation),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }

    /// A point after the motion, mm.
    #[inline]
    pub fn point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }

    /// The inverse of the motion.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// First `other`, then `self`.
    #[must_use]
    pub fn after(&self, other: &Self) -> Self {
        Self { rotation: self.rotation * other.rotation, translation: self.point(&other.translation) }
    }

    /// Angle of the rotation, rad: from sine and cosine both, since the arc cosine loses small angles.
    pub fn angle_rad(&self) -> f64 {
        let r = &self.rotation;
        let sine = Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]).norm();
        math::atan2(sine, r.trace() - 1.0)
    }
}
