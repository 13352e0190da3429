//! The straight line in space.

use nalgebra::{Point3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::adjust::Model;
use super::axis::{Axis, worst_tilt_rad};
use super::centred::Principal;
use super::chart::{ChartCovariance, Effect, charted, tilts};
use super::form::{Form, Residuals};
use super::solve::solve;
use super::{FitError, FitSettings, Support};

const ELEMENT: &str = "line";

/// A line fitted to points, with uncertainties.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LineFit {
    /// Point of the line nearest to the centroid of the points, mm.
    pub axis_point_mm: [f64; 3],
    /// Unit direction; its largest component is positive.
    pub axis_direction: [f64; 3],
    /// Points and form. The residual is the distance from the line, without sign, so the range is that of distances.
    #[serde(flatten)]
    pub form: Form,
    /// Diameter of the cylinder about the line that holds all points used, mm.
    pub straightness_mm: f64,
    /// Standard uncertainty of the line's place at `axis_point_mm` in its worst direction, mm.
    pub u_axis_point_mm: f64,
    /// Standard uncertainty of the direction about its worst axis, rad.
    pub u_axis_direction_rad: f64,
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

/// Fits a line.
///
/// # Errors
/// Fewer than 3 points, coincident points, points without a longest direction; see [`FitError`].
pub fn line(points: &[Point3<f64>], settings: &FitSettings) -> Result<LineFit, FitError> {
    let solution = solve(ELEMENT, 3, points, settings, start)?;
    let (axis, covariance) = (solution.model.0, solution.covariance);
    let ([first, second], [e1, e2]) = (tilts(&axis.tangents), axis.tangents);
    let effects = [first, second, Effect::shift(e1), Effect::shift(e2)];
    let sign = if axis.direction[axis.direction.iamax()] < 0.0 { -1.0 } else { 1.0 };
    let farthest = solution.residuals.of_used().iter().copied().fold(0.0, f64::max);
    Ok(LineFit {
        axis_point_mm: (solution.centroid + axis.point).into(),
        axis_direction: (axis.direction * sign).into(),
        form: solution.form,
        straightness_mm: 2.0 * farthest,
        u_axis_point_mm: worst_tilt_rad(covariance.fixed_view::<2, 2>(2, 2).into_owned()),
        u_axis_direction_rad: worst_tilt_rad(covariance.fixed_view::<2, 2>(0, 0).into_owned()),
        support: solution.support,
        chart: charted(&effects, &covariance),
        residuals: solution.residuals,
    })
}

/// Parameters: two tilts, two shifts. Each point has two residuals, its components across the line.
#[derive(Debug, Clone)]
struct Line(Axis);

impl Model<4> for Line {
    const ROWS: usize = 2;

    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        self.0.see(point).radius
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 4>)) {
        let arm = point - self.0.point;
        let height = arm.dot(&self.0.direction);
        let [e1, e2] = &self.0.tangents;
        add(arm.dot(e1), &SVector::from([-height, 0.0, -1.0, 0.0]));
        add(arm.dot(e2), &SVector::from([0.0, -height, 0.0, -1.0]));
    }

    fn moved(&self, step: &SVector<f64, 4>) -> Self {
        Self(self.0.moved([step[0], step[1]], [step[2], step[3]]).0)
    }
}

/// Start (and, but for rounding, solution): the axis of largest extent through the centroid.
fn start(points: &[Vector3<f64>]) -> Result<Line, FitError> {
    let principal = Principal::new(points);
    if principal.coincident() {
        return Err(FitError::Degenerate { element: ELEMENT, why: "all points coincide" });
    }
    Ok(Line(Axis::new(Vector3::zeros(), principal.axes.column(2).into_owned())))
}
