//! A point of a surface: where a line meets the plane of the points about it.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::chart::{ChartCovariance, Effect, charted};
use super::form::{Form, Residuals};
use super::{FitError, FitSettings, Support, plane};

/// Cosine between line and normal below which the point depends on the tilt more than on the surface.
const STEEPEST: f64 = 0.5;

/// A point of a surface, known along the line that it was taken on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PointFit {
    /// The point on the line, mm.
    pub point_mm: [f64; 3],
    /// Unit direction of the line: the nominal normal.
    pub normal: [f64; 3],
    /// Points of the disc and their form about its plane.
    #[serde(flatten)]
    pub form: Form,
    /// Standard uncertainty along the line, mm.
    pub u_mm: f64,
    /// What the uncertainty rests on.
    #[serde(flatten)]
    pub support: Support,
    /// Covariance in the common chart.
    #[serde(skip)]
    pub chart: ChartCovariance,
    /// Residual of each point given.
    #[serde(skip)]
    pub residuals: Residuals,
}

/// The point where a line through a point along a unit direction meets the surface.
///
/// # Errors
/// Fewer than 4 points, collinear points, a surface that runs along the line; see [`FitError`].
pub fn surface_point(
    points: &[Point3<f64>],
    on_line: &Point3<f64>,
    direction: &Vector3<f64>,
    settings: &FitSettings,
) -> Result<PointFit, FitError> {
    let fit = plane(points, settings)?.towards(direction);
    let cosine = fit.normal_vector().dot(direction);
    if cosine < STEEPEST {
        return Err(FitError::Degenerate {
            element: "point",
            why: "the surface is tilted by more than 60° to the normal",
        });
    }
    let found = on_line - direction * (fit.distance_mm(on_line) / cosine);
    let u_mm = fit.u_at_mm(&found) / cosine;
    let variance = nalgebra::SMatrix::<f64, 1, 1>::new(u_mm * u_mm);
    Ok(PointFit {
        point_mm: found.coords.into(),
        normal: (*direction).into(),
        form: fit.form,
        u_mm,
        support: fit.support,
        chart: charted(&[Effect::shift(*direction)], &variance),
        residuals: fit.residuals,
    })
}
