//! A rotation stage: views of a part at known angles, brought together by the axis about which it turned (thesis section 3.1).
//!
//! The axis is found without markers, from what the views themselves show: the centre of a sphere that stands on the stage
//! ([`axis_from_places`]), or the motions that bring views of any object onto each other ([`axis_from_motions`]).
//!
//! # Convention
//! A stage at angle θ has turned the part by +θ about the axis, right-handed about its direction, away from where it stood at
//! angle 0. So [`StageAxis::back`] of θ brings a view at θ to where the part stood at 0.

mod adjust;
mod error;
mod jackknife;
#[cfg(test)]
mod tests;

pub use error::StageError;
pub use jackknife::jackknife;

use adjust::{Freedom, Observation, adjust};
use fringe::geometry::pose::Pose;
use fringe::math;
use nalgebra::{Matrix3, Point3, Vector3};
use serde::Serialize;

/// Fewest views of a sphere: two places leave the direction of the axis open.
const LEAST_PLACES: usize = 3;

/// Points on a unit tetrahedron, at which the motions of an object are compared.
const TETRAHEDRON: [[f64; 3]; 4] = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];

/// Where a stage turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageAxis {
    /// A point of the axis, mm in the world frame.
    pub point_mm: Point3<f64>,
    /// Unit vector along it.
    pub direction: Vector3<f64>,
}

/// A calibrated axis and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StageCalibration {
    /// The point of the axis nearest to what was seen, mm.
    pub point_mm: [f64; 3],
    /// Direction of the axis, unit vector.
    pub direction: [f64; 3],
    /// Standard uncertainty of the point across the axis, the worst direction, mm; from the residuals, or from what parts of the
    /// object show where that is more ([`jackknife`]).
    pub u_point_mm: f64,
    /// Standard uncertainty of the direction, the worst tilt, rad; as above.
    pub u_direction_rad: f64,
    /// Root mean square residual of the places or of the motions at the object's size, per coordinate, mm.
    pub rms_mm: f64,
    /// Number of views used.
    pub views: usize,
    /// Largest distance of the observed points from the axis, mm: the lever arm that determines the axis.
    pub arm_mm: f64,
}

impl StageCalibration {
    /// The axis without its uncertainties.
    pub fn axis(&self) -> StageAxis {
        StageAxis { point_mm: self.point_mm.into(), direction: self.direction.into() }
    }
}

impl StageAxis {
    /// What the stage does to the part when it turns by an angle.
    pub fn turn(&self, angle_rad: f64) -> Pose {
        let rotation = rotation(&self.direction, angle_rad);
        Pose { rotation, translation: self.point_mm.coords - rotation * self.point_mm.coords }
    }

    /// What brings a view at an angle to where the part stood at angle 0.
    pub fn back(&self, angle_rad: f64) -> Pose {
        self.turn(-angle_rad)
    }

    /// Foot of a point on the axis.
    fn foot(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.point_mm.coords + self.direction * self.direction.dot(&(point - self.point_mm.coords))
    }
}

/// Rotation about a unit vector (Rodrigues).
pub fn rotation(axis: &Vector3<f64>, angle_rad: f64) -> Matrix3<f64> {
    let (sine, cosine) = math::sincos(angle_rad);
    let cross = axis.cross_matrix();
    Matrix3::identity() + cross * sine + cross * cross * (1.0 - cosine)
}

/// The axis from the places (world, mm) of one and the same point, such as the centre of a sphere, at several angles (rad).
///
/// # Errors
/// Fewer than three views, angles or places that leave the axis open (one angle, a point on the axis, angles half a turn apart).
pub fn axis_from_places(views: &[(f64, Point3<f64>)]) -> Result<StageCalibration, StageError> {
    if views.len() < LEAST_PLACES {
        return Err(StageError::Few { views: views.len(), needed: LEAST_PLACES });
    }
    check(views.iter().map(|(angle_rad, at)| (*angle_rad, at.coords)))?;
    let mean = views.iter().map(|(_, at)| at.coords).sum::<Vector3<f64>>() / views.len() as f64;
    // The area swept by the places, each seen from their mean, in the order of the angles: twice the area vector of a polygon.
    let mut order: Vec<&(f64, Point3<f64>)> = views.iter().collect();
    order.sort_by(|a, b| math::wrap_positive_rad(a.0).total_cmp(&math::wrap_positive_rad(b.0)));
    let next = order.iter().cycle().skip(1);
    let area: Vector3<f64> =
        order.iter().zip(next).map(|(a, b)| (a.1.coords - mean).cross(&(b.1.coords - mean))).sum();
    let spread = views.iter().map(|(_, at)| (at.coords - mean).norm()).fold(0.0, f64::max);
    // Collinear places sweep none: their triangle's height would be below a thousandth of its length.
    let direction = area
        .try_normalize(1e-3 * spread * spread)
        .filter(|_| spread > 1e-9)
        .ok_or(StageError::Open { why: "the positions are on a line or in one place" })?;
    let first = views[0];
    let observations: Vec<Observation> = views[1..]
        .iter()
        .map(|(angle_rad, at)| Observation {
            angle_rad: angle_rad - first.0,
            from: first.1.coords,
            to: at.coords,
            point: Some(0),
        })
        .collect();
    adjust(&observations, direction, views.len(), mean, Freedom::Places)
}

/// The axis from motions that bring the view at an angle (rad) onto the view at angle 0, compared at four points
/// `size_mm` about `centre_mm`, the middle of the object.
///
/// # Errors
/// No motion, or angles that leave the axis open: all of them whole or half turns.
pub fn axis_from_motions(
    motions: &[(f64, Pose)],
    centre_mm: &Point3<f64>,
    size_mm: f64,
) -> Result<StageCalibration, StageError> {
    if motions.is_empty() {
        return Err(StageError::Few { views: 1, needed: 2 });
    }
    check(motions.iter().map(|(angle_rad, pose)| (*angle_rad, pose.point(&centre_mm.coords))))?;
    if !(size_mm > 0.0 && size_mm.is_finite()) {
        return Err(StageError::Number);
    }
    // R − Rᵀ holds 2 sin θ times the axis; motions back turn by −θ.
    let sum: Vector3<f64> = motions
        .iter()
        .map(|(angle_rad, pose)| {
            let r = &pose.rotation;
            let twice = Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
            -math::sin(*angle_rad) * twice
        })
        .sum();
    let direction =
        sum.try_normalize(1e-3).ok_or(StageError::Open { why: "all angles are near whole or half turns" })?;
    let observations: Vec<Observation> = motions
        .iter()
        .flat_map(|(angle_rad, pose)| {
            TETRAHEDRON.map(|corner| {
                let from = centre_mm.coords + Vector3::from(corner) * (size_mm / 3.0_f64.sqrt());
                Observation { angle_rad: -angle_rad, from, to: pose.point(&from), point: None }
            })
        })
        .collect();
    adjust(&observations, direction, motions.len() + 1, centre_mm.coords, Freedom::Motions)
}

fn check(mut views: impl Iterator<Item = (f64, Vector3<f64>)>) -> Result<(), StageError> {
    let finite =
        |(angle_rad, at): (f64, Vector3<f64>)| angle_rad.is_finite() && at.iter().all(|v| v.is_finite());
    if views.all(finite) { Ok(()) } else { Err(StageError::Number) }
}
