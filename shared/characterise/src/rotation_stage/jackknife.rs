//! The uncertainty of an axis from estimates that each leave out a block of the object (the grouped jackknife).
//!
//! The alignment of two views takes thousands of points; their noise, and what else is wrong with them (interpolation, edges, curvature), is
//! alike among neighbours, and alike in all views. Motions between the views that err in the same way make an axis that is wrong
//! and fits them, so that residuals do not show it. An estimate without a block lacks what is wrong there: with K estimates
//! the variance is (K − 1)/K Σ (x̂ₖ − x̄)² (J. W. Tukey, Ann. Math. Stat. 29, 1958; B. Efron, The jackknife, 1982, ch. 3).

use super::{StageCalibration, StageError};
use nalgebra::{Matrix2, Vector2, Vector3};

/// The calibration with the uncertainty of the jackknife where that is larger than its own.
///
/// # Errors
/// Fewer than two estimates.
pub fn jackknife(
    found: &StageCalibration,
    without: &[StageCalibration],
) -> Result<StageCalibration, StageError> {
    if without.len() < 2 {
        return Err(StageError::Few { views: without.len(), needed: 2 });
    }
    let middle = Vector3::from(found.point_mm);
    let axis = Vector3::from(found.direction);
    let least = axis.iamin();
    let side = axis.cross(&Vector3::ith(least, 1.0)).normalize();
    let other = axis.cross(&side);
    let across = |v: Vector3<f64>| Vector2::new(side.dot(&v), other.dot(&v));
    let tilts: Vec<_> = without.iter().map(|one| across(Vector3::from(one.direction))).collect();
    // All axes where they pass the plane through the same point.
    let places: Vec<_> = without.iter().map(|one| across(one.axis().foot(&middle) - middle)).collect();
    let (tilt, place) = (worst(&tilts), worst(&places));
    Ok(StageCalibration {
        u_point_mm: found.u_point_mm.max(place),
        u_direction_rad: found.u_direction_rad.max(tilt),
        ..*found
    })
}

/// Standard deviation of the jackknife in the worst direction.
fn worst(estimates: &[Vector2<f64>]) -> f64 {
    let count = estimates.len() as f64;
    let mean = estimates.iter().sum::<Vector2<f64>>() / count;
    let scatter: Matrix2<f64> = estimates.iter().map(|e| (e - mean) * (e - mean).transpose()).sum();
    let (trace, determinant) = (scatter.trace(), scatter.determinant());
    let largest = 0.5 * (trace + (trace * trace - 4.0 * determinant).max(0.0).sqrt());
    ((count - 1.0) / count * largest).max(0.0).sqrt()
}
