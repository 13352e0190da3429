//! The cylinder.

use nalgebra::{Point3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::adjust::{Model, Until, adjust};
use super::axis::{Axis, best_of, directions, thinned, worst_tilt_rad};
use super::centred::Principal;
use super::chart::{ChartCovariance, Effect, charted, tilts};
use super::circle::algebraic_circle;
use super::form::{Form, Residuals};
use super::plane::refuse_flat;
use super::solve::solve;
use super::sphere::LARGEST_RADIUS_RATIO;
use super::{FitError, FitSettings, Support};

const ELEMENT: &str = "cylinder";

/// A cylinder fitted to points, with uncertainties.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CylinderFit {
    /// Point of the axis nearest to the centroid of the points, mm.
    pub axis_point_mm: [f64; 3],
    /// Unit direction of the axis; its largest component is positive.
    pub axis_direction: [f64; 3],
    /// Diameter of the cylinder, mm.
    pub diameter_mm: f64,
    /// Points used and form deviation.
    #[serde(flatten)]
    pub form: Form,
    /// Standard uncertainty of the axis' place at `axis_point_mm`, across the axis in its worst direction, mm.
    pub u_axis_point_mm: f64,
    /// Standard uncertainty of the direction about its worst axis, rad.
    pub u_axis_direction_rad: f64,
    /// Standard uncertainty of the diameter, mm.
    pub u_diameter_mm: f64,
    /// What the uncertainties rest on.
    #[serde(flatten)]
    pub support: Support,
    /// Covariance of point, direction and sizes in the common chart.
    #[serde(skip)]
    pub chart: ChartCovariance,
    /// Residual of each point given.
    #[serde(skip)]
    pub residuals: Residuals,
}

/// Fits a cylinder.
///
/// # Errors
/// Fewer than 6 points, points on one line or in one plane, no convergence; see [`FitError`].
pub fn cylinder(points: &[Point3<f64>], settings: &FitSettings) -> Result<CylinderFit, FitError> {
    let solution = solve(ELEMENT, 6, points, settings, start)?;
    refuse_flat(ELEMENT, points, &solution.form, settings)?;
    let (axis, covariance) = (solution.model.axis, solution.covariance);
    let ([first, second], [e1, e2]) = (tilts(&axis.tangents), axis.tangents);
    let effects = [first, second, Effect::shift(e1), Effect::shift(e2), Effect::sizes([2.0, 0.0])];
    let sign = if axis.direction[axis.direction.iamax()] < 0.0 { -1.0 } else { 1.0 };
    Ok(CylinderFit {
        axis_point_mm: (solution.centroid + axis.point).into(),
        axis_direction: (axis.direction * sign).into(),
        diameter_mm: 2.0 * solution.model.radius,
        form: solution.form,
        u_axis_point_mm: worst_tilt_rad(covariance.fixed_view::<2, 2>(2, 2).into_owned()),
        u_axis_direction_rad: worst_tilt_rad(covariance.fixed_view::<2, 2>(0, 0).into_owned()),
        u_diameter_mm: 2.0 * covariance[(4, 4)].max(0.0).sqrt(),
        support: solution.support,
        chart: charted(&effects, &covariance),
        residuals: solution.residuals,
    })
}

/// Parameters: two tilts, two shifts, radius.
#[derive(Debug, Clone)]
pub(super) struct Cylinder {
    pub axis: Axis,
    pub radius: f64,
}

impl Model<5> for Cylinder {
    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        self.axis.see(point).radius - self.radius
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 5>)) {
        let seen = self.axis.see(point);
        let [a, b] = seen.out;
        // A tilt moves the axis at height h by h per radian, a shift by one; the surface moves with it.
        let derivatives = SVector::from([-seen.height * a, -seen.height * b, -a, -b, -1.0]);
        add(seen.radius - self.radius, &derivatives);
    }

    fn moved(&self, step: &SVector<f64, 5>) -> Self {
        let (axis, _) = self.axis.moved([step[0], step[1]], [step[2], step[3]]);
        Self { axis, radius: self.radius + step[4] }
    }
}

/// The least-squares cylinder as a start for others.
pub(super) fn fitted(points: &[Vector3<f64>]) -> Result<Cylinder, FitError> {
    Ok(adjust(ELEMENT, start(points)?, points, Until::Settled)?.model)
}

/// Start: for many directions the algebraic circle of the points seen along them; the best few adjusted.
fn start(points: &[Vector3<f64>]) -> Result<Cylinder, FitError> {
    let principal = Principal::new(points);
    principal.check_spatial(ELEMENT)?;
    let thin = thinned(points);
    let candidates = directions(points).into_iter().filter_map(|direction| {
        let (point, radius) = algebraic_circle(&thin, &direction)?;
        Some(Cylinder { axis: Axis::new(point, direction), radius })
    });
    let best = best_of(ELEMENT, candidates, &thin);
    // Candidates of endless radius are planes in disguise.
    best.filter(|m| m.radius.abs() < LARGEST_RADIUS_RATIO * principal.extents_mm[2])
        .ok_or(FitError::Degenerate { element: ELEMENT, why: "the points show no curvature" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::adjust::tests::derivatives_agree;

    #[test]
    fn derivatives_agree_with_differences() {
        let axis = Axis::new(Vector3::new(0.2, -0.3, 0.5), Vector3::new(0.6, 0.0, -0.8));
        derivatives_agree(&Cylinder { axis, radius: 2.0 });
    }
}
