//! The cone (one nappe; points are taken to lie on the side of the apex where the surface is).

use nalgebra::{Point3, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::adjust::Model;
use super::axis::{Axis, best_of, directions, thinned, u_point_mm, worst_tilt_rad};
use super::centred::{check_spatial, scatter, tree};
use super::chart::{ChartCovariance, Effect, charted, tilts};
use super::form::{Form, Residuals};
use super::normal::Normal;
use super::plane::refuse_flat;
use super::solve::solve;
use super::{FitError, FitSettings, Support};
use fringe::math;

const ELEMENT: &str = "cone";

/// Smallest half angle, rad: below it the apex lies a million radii away, and a cylinder is meant.
const SMALLEST_ANGLE_RAD: f64 = 1e-6;

/// A cone fitted to points, with uncertainties.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ConeFit {
    /// Point of the axis nearest to the centroid of the points, mm.
    pub axis_point_mm: [f64; 3],
    /// Unit direction of the axis, from the apex into the body.
    pub axis_direction: [f64; 3],
    /// Diameter of the section through `axis_point_mm`, mm.
    pub diameter_mm: f64,
    /// Angle between axis and surface, deg.
    pub half_angle_deg: f64,
    /// Apex of the cone, mm.
    pub apex_mm: [f64; 3],
    /// Points used and form deviation.
    #[serde(flatten)]
    pub form: Form,
    /// Standard uncertainty of the axis' place at `axis_point_mm`, across the axis in its worst direction, mm.
    pub u_axis_point_mm: f64,
    /// Standard uncertainty of the direction about its worst axis, rad.
    pub u_axis_direction_rad: f64,
    /// Standard uncertainties of the apex along x, y and z, mm.
    pub u_apex_mm: [f64; 3],
    /// Standard uncertainty of `diameter_mm`, mm.
    pub u_diameter_mm: f64,
    /// Standard uncertainty of the half angle, deg.
    pub u_half_angle_deg: f64,
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

/// Fits a cone.
///
/// # Errors
/// Fewer than 7 points, points on one line or in one plane or on a cylinder, no convergence; see [`FitError`].
pub fn cone(points: &[Point3<f64>], settings: &FitSettings) -> Result<ConeFit, FitError> {
    let solution = solve(ELEMENT, 7, points, settings, start)?;
    refuse_flat(ELEMENT, points, &solution.form, settings)?;
    let covariance = solution.covariance;
    // Before the axis is turned: the covariance belongs to these parameters.
    let apex_by_parameters = solution.model.apex_by_parameters();
    let effects = solution.model.effects();
    let model = solution.model.widening();
    if model.angle_rad < SMALLEST_ANGLE_RAD {
        return Err(FitError::Degenerate { element: ELEMENT, why: "they lie on a cylinder" });
    }
    let (sin, cos) = math::sincos(model.angle_rad);
    let radius = model.reach / cos;
    let point = solution.centroid + model.axis.point;
    // radius = reach / cos ψ: d radius = d reach / cos ψ + reach sin ψ / cos² ψ · dψ.
    let by_angle = model.reach * sin / (cos * cos);
    let variance = (covariance[(4, 4)] / cos + 2.0 * covariance[(4, 5)] * by_angle) / cos
        + covariance[(5, 5)] * by_angle * by_angle;
    Ok(ConeFit {
        axis_point_mm: point.into(),
        axis_direction: model.axis.direction.into(),
        diameter_mm: 2.0 * radius,
        half_angle_deg: model.angle_rad.to_degrees(),
        apex_mm: (point - model.axis.direction * (model.reach / sin)).into(),
        form: solution.form,
        u_axis_point_mm: worst_tilt_rad(covariance.fixed_view::<2, 2>(2, 2).into_owned()),
        u_axis_direction_rad: worst_tilt_rad(covariance.fixed_view::<2, 2>(0, 0).into_owned()),
        u_apex_mm: u_point_mm(&apex_by_parameters, &covariance),
        u_diameter_mm: 2.0 * variance.max(0.0).sqrt(),
        u_half_angle_deg: covariance[(5, 5)].max(0.0).sqrt().to_degrees(),
        support: solution.support,
        chart: charted(&effects, &covariance),
        residuals: solution.residuals,
    })
}

/// Parameters: two tilts, two shifts, reach, half angle.
///
/// With the point at distance ρ from the axis and height h above the axis' point, the signed orthogonal distance is
/// ρ cos ψ − h sin ψ − s; s is the distance of the axis' point from the surface, the `reach`.
#[derive(Debug, Clone)]
struct Cone {
    axis: Axis,
    reach: f64,
    angle_rad: f64,
}

impl Cone {
    /// Change of the apex by each parameter: it lies reach / sin ψ before the axis' point.
    fn apex_by_parameters(&self) -> SMatrix<f64, 3, 6> {
        let ([e1, e2], direction) = (self.axis.tangents, self.axis.direction);
        let (sin, cos) = math::sincos(self.angle_rad);
        let before = self.reach / sin;
        let by_reach = direction * (-1.0 / sin);
        let by_angle = direction * (before * cos / sin);
        SMatrix::from_columns(&[e1 * -before, e2 * -before, e1, e2, by_reach, by_angle])
    }

    /// What the parameters do in the common chart; its sizes are the diameter at the axis' point and the half angle, rad.
    fn effects(&self) -> [Effect; 6] {
        let ([first, second], [e1, e2]) = (tilts(&self.axis.tangents), self.axis.tangents);
        let (sin, cos) = math::sincos(self.angle_rad);
        let by_reach = Effect::sizes([2.0 / cos, 0.0]);
        let by_angle =
            Effect::sizes([2.0 * self.reach * sin / (cos * cos), if sin < 0.0 { -1.0 } else { 1.0 }]);
        [first, second, Effect::shift(e1), Effect::shift(e2), by_reach, by_angle]
    }

    /// The same cone with the axis pointing to where it widens.
    fn widening(&self) -> Self {
        if self.angle_rad >= 0.0 {
            return self.clone();
        }
        let axis = Axis::new(self.axis.point, -self.axis.direction);
        Self { axis, reach: self.reach, angle_rad: -self.angle_rad }
    }
}

impl Model<6> for Cone {
    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        let seen = self.axis.see(point);
        let (sin, cos) = math::sincos(self.angle_rad);
        seen.radius * cos - seen.height * sin - self.reach
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 6>)) {
        let seen = self.axis.see(point);
        let (sin, cos) = math::sincos(self.angle_rad);
        // A tilt towards the point by 1 rad: ρ falls by h, h rises by ρ.
        let tilt = -(seen.height * cos + seen.radius * sin);
        let [a, b] = seen.out;
        let widen = -(seen.radius * sin + seen.height * cos);
        let residual = seen.radius * cos - seen.height * sin - self.reach;
        add(residual, &SVector::from([tilt * a, tilt * b, -cos * a, -cos * b, -1.0, widen]));
    }

    fn moved(&self, step: &SVector<f64, 6>) -> Self {
        let (axis, slid) = self.axis.moved([step[0], step[1]], [step[2], step[3]]);
        let angle_rad = self.angle_rad + step[5];
        Self { axis, reach: self.reach + step[4] + slid * math::sin(angle_rad), angle_rad }
    }
}

/// Start: for many directions the algebraic cone along them; the best few adjusted.
fn start(points: &[Vector3<f64>]) -> Result<Cone, FitError> {
    check_spatial(ELEMENT, points, &scatter(points))?;
    let thin = thinned(points);
    let candidates = directions(points).into_iter().filter_map(|d| algebraic(&thin, d));
    best_of(ELEMENT, candidates, &thin).ok_or(FitError::NoConvergence { element: ELEMENT, iterations: 0 })
}

/// The algebraic cone along a direction: x² + y² = 2ux + 2vy + k + 2mh + wh², linear in u, v, k, m, w; then the radius
/// is R² = k + u² + v² and the slope tan ψ = m/R (w = tan² ψ is left free, which keeps the system linear).
fn algebraic(points: &[Vector3<f64>], direction: Vector3<f64>) -> Option<Cone> {
    let frame = Axis::new(Vector3::zeros(), direction);
    let [e1, e2] = frame.tangents;
    let normal: Normal<5> = tree(
        points,
        &|leaf| {
            let mut sums = Normal::zero();
            for p in leaf {
                let (x, y, h) = (p.dot(&e1), p.dot(&e2), p.dot(&direction));
                sums.add(-(x * x + y * y), &SVector::from([2.0 * x, 2.0 * y, 1.0, 2.0 * h, h * h]));
            }
            sums
        },
        &|a: Normal<5>, b: Normal<5>| a.join(&b),
    );
    let step = normal.step(0.0)?;
    let radius = (step[2] + step[0] * step[0] + step[1] * step[1]).max(0.0).sqrt();
    let angle_rad = math::atan2(step[3], radius);
    let axis = Axis::new(e1 * step[0] + e2 * step[1], direction);
    (radius > 0.0).then(|| Cone { axis, reach: radius * math::cos(angle_rad), angle_rad })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::adjust::tests::derivatives_agree;

    #[test]
    fn derivatives_agree_with_differences() {
        let axis = Axis::new(Vector3::new(0.2, -0.3, 0.5), Vector3::new(0.6, 0.0, -0.8));
        derivatives_agree(&Cone { axis: axis.clone(), reach: 2.0, angle_rad: 0.4 });
        derivatives_agree(&Cone { axis, reach: 2.0, angle_rad: -1.1 });
    }
}
