//! The circle in space.

use nalgebra::{Point3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::adjust::{Model, Until, adjust};
use super::axis::Axis;
use super::centred::{Principal, tree};
use super::chart::{ChartCovariance, Effect, charted, tilts};
use super::form::{Form, Residuals};
use super::normal::{Normal, tangents};
use super::solve::solve;
use super::sphere::{LARGEST_RADIUS_RATIO, polar};
use super::{FitError, FitSettings, Support};

const ELEMENT: &str = "circle";

/// A circle fitted to points in space, with uncertainties.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CircleFit {
    /// Centre of the circle, mm.
    pub center_mm: [f64; 3],
    /// Unit normal of its plane; its largest component is positive.
    pub normal: [f64; 3],
    /// Diameter of the circle, mm.
    pub diameter_mm: f64,
    /// Points and form. The residual is the distance in space from the circle, negative inside.
    #[serde(flatten)]
    pub form: Form,
    /// Standard uncertainties of the centre along x, y and z, mm.
    pub u_center_mm: [f64; 3],
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

/// Fits a circle: the sum of squared distances in space is least (not that of projections into a plane fitted before).
///
/// # Errors
/// Fewer than 4 points, collinear points, no convergence; see [`FitError`].
pub fn circle(points: &[Point3<f64>], settings: &FitSettings) -> Result<CircleFit, FitError> {
    let solution = solve(ELEMENT, 4, points, settings, start)?;
    let model = solution.model;
    let [first, second] = tilts(&model.tangents);
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()].map(Effect::shift);
    let effects = [first, second, x, y, z, Effect::sizes([2.0, 0.0])];
    let sign = if model.normal[model.normal.iamax()] < 0.0 { -1.0 } else { 1.0 };
    Ok(CircleFit {
        center_mm: (solution.centroid + model.center).into(),
        normal: (model.normal * sign).into(),
        diameter_mm: 2.0 * model.radius,
        form: solution.form,
        u_center_mm: [2, 3, 4].map(|i| solution.covariance[(i, i)].max(0.0).sqrt()),
        u_diameter_mm: 2.0 * solution.covariance[(5, 5)].max(0.0).sqrt(),
        support: solution.support,
        chart: charted(&effects, &solution.covariance),
        residuals: solution.residuals,
    })
}

/// Parameters: two tilts, centre, radius. Each point has two residuals: along the normal and radially in the plane.
#[derive(Debug, Clone)]
pub(super) struct Circle {
    pub center: Vector3<f64>,
    pub normal: Vector3<f64>,
    pub tangents: [Vector3<f64>; 2],
    pub radius: f64,
}

impl Model<6> for Circle {
    const ROWS: usize = 2;

    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        let arm = point - self.center;
        let height = arm.dot(&self.normal);
        let radial = (arm - self.normal * height).norm() - self.radius;
        let distance = (height * height + radial * radial).sqrt();
        if radial < 0.0 { -distance } else { distance }
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 6>)) {
        let arm = point - self.center;
        let height = arm.dot(&self.normal);
        let (distance, out) = polar(&(arm - self.normal * height));
        let [e1, e2] = &self.tangents;
        let (a, b) = (out.dot(e1), out.dot(e2));
        let n = &self.normal;
        add(height, &SVector::from([arm.dot(e1), arm.dot(e2), -n.x, -n.y, -n.z, 0.0]));
        // The normal tilts towards e1 by dα: the in-plane part loses height · dα along it.
        let derivatives = [-height * a, -height * b, -out.x, -out.y, -out.z, -1.0];
        add(distance - self.radius, &SVector::from(derivatives));
    }

    fn moved(&self, step: &SVector<f64, 6>) -> Self {
        let tilted = self.normal + self.tangents[0] * step[0] + self.tangents[1] * step[1];
        let normal = tilted / tilted.norm();
        let center = self.center + Vector3::new(step[2], step[3], step[4]);
        Self { center, normal, tangents: tangents(&normal), radius: self.radius + step[5] }
    }
}

/// A circle in a plane that stands still, seen along its normal. Parameters: two shifts in the plane, radius.
#[derive(Debug, Clone)]
pub(super) struct Ring(pub Circle);

impl Model<3> for Ring {
    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        let arm = point - self.0.center;
        (arm - self.0.normal * arm.dot(&self.0.normal)).norm() - self.0.radius
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 3>)) {
        let arm = point - self.0.center;
        let (distance, out) = polar(&(arm - self.0.normal * arm.dot(&self.0.normal)));
        let [e1, e2] = &self.0.tangents;
        add(distance - self.0.radius, &Vector3::new(-out.dot(e1), -out.dot(e2), -1.0));
    }

    fn moved(&self, step: &SVector<f64, 3>) -> Self {
        let mut circle = self.0.clone();
        circle.center += circle.tangents[0] * step.x + circle.tangents[1] * step.y;
        circle.radius += step.z;
        Self(circle)
    }
}

/// The least-squares circle, its plane held.
pub(super) fn ring(points: &[Vector3<f64>]) -> Result<Ring, FitError> {
    Ok(Ring(adjust(ELEMENT, start(points)?, points, Until::Settled)?.model))
}

/// Start: the algebraic circle in the plane of least extent.
fn start(points: &[Vector3<f64>]) -> Result<Circle, FitError> {
    let principal = Principal::new(points);
    if principal.collinear() {
        return Err(FitError::Degenerate { element: ELEMENT, why: "they lie on one line" });
    }
    let normal: Vector3<f64> = principal.axes.column(0).into_owned();
    let (center, radius) = algebraic_circle(points, &normal)
        .filter(|(_, radius)| *radius < LARGEST_RADIUS_RATIO * principal.extents_mm[2])
        .ok_or(FitError::Degenerate { element: ELEMENT, why: "the points show no curvature" })?;
    Ok(Circle { center, normal, tangents: tangents(&normal), radius })
}

/// The algebraic circle of the points seen along a unit direction: x² + y² = 2ux + 2vy + k. Returns its centre in the
/// plane through the origin, and its radius; `None` when the points seen so lie on one line.
pub(super) fn algebraic_circle(
    points: &[Vector3<f64>],
    direction: &Vector3<f64>,
) -> Option<(Vector3<f64>, f64)> {
    let [e1, e2] = Axis::new(Vector3::zeros(), *direction).tangents;
    let normal: Normal<3> = tree(
        points,
        &|leaf| {
            let mut sums = Normal::zero();
            for p in leaf {
                let (x, y) = (p.dot(&e1), p.dot(&e2));
                sums.add(-(x * x + y * y), &Vector3::new(2.0 * x, 2.0 * y, 1.0));
            }
            sums
        },
        &|a: Normal<3>, b: Normal<3>| a.join(&b),
    );
    let step = normal.step(0.0)?;
    let radius = (step.z + step.x * step.x + step.y * step.y).max(0.0).sqrt();
    Some((e1 * step.x + e2 * step.y, radius))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::adjust::tests::derivatives_agree;

    #[test]
    fn derivatives_agree_with_differences() {
        let normal = Vector3::new(0.6, 0.0, -0.8);
        let center = Vector3::new(0.2, -0.3, 0.5);
        let circle = Circle { center, normal, tangents: tangents(&normal), radius: 2.0 };
        derivatives_agree(&circle);
        derivatives_agree(&Ring(circle));
    }
}
