//! The plane.

use nalgebra::{Matrix3, Point3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::adjust::Model;
use super::centred::Principal;
use super::chart::{ChartCovariance, Effect, charted, tilts};
use super::form::{Form, Residuals};
use super::normal::tangents;
use super::solve::solve;
use super::{FitError, FitSettings, Support};

const ELEMENT: &str = "plane";

/// A fitted plane: the points x with normal · x = `offset_mm`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlaneFit {
    /// Unit normal; its largest component is positive (see [`PlaneFit::towards`]).
    pub normal: [f64; 3],
    /// Signed distance of the plane from the origin along the normal, mm.
    pub offset_mm: f64,
    /// Centroid of the points used, mm. It lies in the plane.
    pub centroid_mm: [f64; 3],
    /// Points and form; the range is the flatness about the least-squares plane.
    #[serde(flatten)]
    pub form: Form,
    /// Standard uncertainty of the plane's place at the centroid, along the normal, mm.
    pub u_centroid_mm: f64,
    /// Standard uncertainty of `offset_mm`, mm (the tilt acts on it over the distance to the origin).
    pub u_offset_mm: f64,
    /// Standard uncertainty of the normal about the direction in which it is largest, rad.
    pub u_normal_rad: f64,
    /// What the uncertainties rest on.
    #[serde(flatten)]
    pub support: Support,
    /// Directions of the two tilts of the covariance.
    #[serde(skip)]
    tangents: [Vector3<f64>; 2],
    /// Where the third parameter, the offset, is meant.
    #[serde(skip)]
    origin: Vector3<f64>,
    /// Covariance of (tilt 1, tilt 2, offset at `origin`).
    #[serde(skip)]
    covariance: Matrix3<f64>,
    /// Residual of each point given.
    #[serde(skip)]
    pub residuals: Residuals,
}

impl PlaneFit {
    /// Normal as a vector.
    pub fn normal_vector(&self) -> Vector3<f64> {
        Vector3::from(self.normal)
    }

    /// Signed distance of a point, mm.
    pub fn distance_mm(&self, point: &Point3<f64>) -> f64 {
        // About the centroid: a far origin would cost digits.
        self.normal_vector().dot(&(point - Point3::from(self.centroid_mm)))
    }

    /// Standard uncertainty of the plane's place under (or above) a point, along the normal, mm.
    pub fn u_at_mm(&self, point: &Point3<f64>) -> f64 {
        let arm = point.coords - self.origin;
        let gradient = Vector3::new(self.tangents[0].dot(&arm), self.tangents[1].dot(&arm), -1.0);
        (self.covariance * gradient).dot(&gradient).max(0.0).sqrt()
    }

    /// Standard uncertainty of the normal's component along a unit vector that is perpendicular to it, rad.
    pub fn u_tilt_rad(&self, direction: &Vector3<f64>) -> f64 {
        let gradient = Vector3::new(self.tangents[0].dot(direction), self.tangents[1].dot(direction), 0.0);
        (self.covariance * gradient).dot(&gradient).max(0.0).sqrt()
    }

    /// Covariance of the plane's place at its centroid and of its normal in the common chart.
    pub fn chart(&self) -> ChartCovariance {
        self.chart_at(&Point3::from(self.centroid_mm))
    }

    /// The same with the plane's place at another point.
    pub fn chart_at(&self, point: &Point3<f64>) -> ChartCovariance {
        let [e1, e2] = self.tangents;
        // The normal of the parameters; this one may have been turned since.
        let normal = e1.cross(&e2);
        let arm = point.coords - self.origin;
        let [first, second] = tilts(&self.tangents);
        let tilt = |turn: Effect, along: f64| Effect { shift: normal * -along, ..turn };
        let effects = [tilt(first, e1.dot(&arm)), tilt(second, e2.dot(&arm)), Effect::shift(normal)];
        charted(&effects, &self.covariance)
    }

    /// Takes over another plane through a point, with the covariance of its tilts and of its offset there.
    pub(super) fn take(
        &mut self,
        point: Vector3<f64>,
        normal: Vector3<f64>,
        tangents: [Vector3<f64>; 2],
        covariance: Matrix3<f64>,
    ) {
        (self.normal, self.tangents, self.covariance) = (normal.into(), tangents, covariance);
        (self.origin, self.centroid_mm) = (point, point.into());
        self.offset_mm = normal.dot(&point);
        self.u_centroid_mm = self.u_at_mm(&Point3::from(point));
        self.u_offset_mm = self.u_at_mm(&Point3::origin());
        self.u_normal_rad = worst_tilt_rad(&covariance);
    }

    /// The same plane with its normal turned to the side of a direction.
    #[must_use]
    pub fn towards(mut self, direction: &Vector3<f64>) -> Self {
        if self.normal_vector().dot(direction) < 0.0 {
            self.normal = self.normal.map(|v| -v);
            self.offset_mm = -self.offset_mm;
            // Both tilts and the offset change sign together, so their covariance stays what it was.
            self.residuals.deviation_mm.iter_mut().for_each(|d| *d = -*d);
        }
        self
    }
}

/// Refuses an element of which a plane is the limit (an ever larger radius) when a plane lies nearer to the points: then
/// the adjustment ended somewhere that means nothing.
pub(super) fn refuse_flat(
    element: &'static str,
    points: &[Point3<f64>],
    form: &Form,
    settings: &FitSettings,
) -> Result<(), FitError> {
    let settings =
        FitSettings { max_reject_fraction: settings.max_reject_fraction, ..FitSettings::default() };
    match plane(points, &settings) {
        Ok(flat) if flat.form.form_sigma_mm < form.form_sigma_mm => Err(FitError::Degenerate {
            element,
            why: "a plane is nearer to them; are they points of a plane?",
        }),
        _ => Ok(()),
    }
}

/// Standard uncertainty of the tilt in the direction in which it is largest, rad: of the two tilts that a covariance begins with.
fn worst_tilt_rad(covariance: &Matrix3<f64>) -> f64 {
    let tilt = covariance.fixed_view::<2, 2>(0, 0);
    let (trace, determinant) = (tilt.trace(), tilt.determinant());
    let largest = 0.5 * (trace + (trace * trace - 4.0 * determinant).max(0.0).sqrt());
    largest.max(0.0).sqrt()
}

/// Fits a plane.
///
/// # Errors
/// Fewer than 4 points, collinear points; see [`FitError`].
pub fn plane(points: &[Point3<f64>], settings: &FitSettings) -> Result<PlaneFit, FitError> {
    let solution = solve(ELEMENT, 4, points, settings, principal)?;
    let model = solution.model;
    let centroid = solution.centroid + solution.used_centroid;
    let mut fit = PlaneFit {
        normal: model.normal.into(),
        offset_mm: model.normal.dot(&solution.centroid) + model.offset,
        centroid_mm: centroid.into(),
        form: solution.form,
        u_centroid_mm: 0.0,
        u_offset_mm: 0.0,
        u_normal_rad: worst_tilt_rad(&solution.covariance),
        support: solution.support,
        tangents: model.tangents,
        origin: solution.centroid,
        covariance: solution.covariance,
        residuals: solution.residuals,
    };
    fit.u_centroid_mm = fit.u_at_mm(&Point3::from(centroid));
    fit.u_offset_mm = fit.u_at_mm(&Point3::origin());
    let mut largest_axis = Vector3::zeros();
    largest_axis[model.normal.iamax()] = 1.0;
    Ok(fit.towards(&largest_axis))
}

/// Parameters: two tilts of the normal along the tangents, offset.
#[derive(Debug, Clone)]
pub(super) struct Plane {
    pub normal: Vector3<f64>,
    pub tangents: [Vector3<f64>; 2],
    pub offset: f64,
}

impl Model<3> for Plane {
    #[inline(always)]
    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        self.normal.dot(point) - self.offset
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 3>)) {
        let [e1, e2] = &self.tangents;
        add(self.deviation(point), &Vector3::new(e1.dot(point), e2.dot(point), -1.0));
    }

    fn moved(&self, step: &SVector<f64, 3>) -> Self {
        let tilted = self.normal + self.tangents[0] * step.x + self.tangents[1] * step.y;
        let normal = tilted / tilted.norm();
        Self { normal, tangents: tangents(&normal), offset: self.offset + step.z }
    }
}

/// Start (and, but for rounding, solution): the axis of least extent through the centroid.
pub(super) fn principal(points: &[Vector3<f64>]) -> Result<Plane, FitError> {
    let principal = Principal::new(points);
    if principal.coincident() {
        return Err(FitError::Degenerate { element: ELEMENT, why: "all points coincide" });
    }
    if principal.collinear() {
        return Err(FitError::Degenerate { element: ELEMENT, why: "they lie on one line" });
    }
    let normal: Vector3<f64> = principal.axes.column(0).into_owned();
    Ok(Plane { normal, tangents: tangents(&normal), offset: 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::adjust::tests::derivatives_agree;

    #[test]
    fn derivatives_agree_with_differences() {
        let normal = Vector3::new(0.6, 0.0, -0.8);
        derivatives_agree(&Plane { normal, tangents: tangents(&normal), offset: 0.3 });
    }
}
