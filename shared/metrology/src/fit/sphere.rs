//! The sphere, of free or given diameter.

use crate::spread::some_of;
use nalgebra::{Matrix4, Point3, SVector, Vector3, Vector4};
use serde::{Deserialize, Serialize};

use super::adjust::{Model, Until, adjust, normal};
use super::centred::{Centred, Principal, check_spatial, extent_mm, mean};
use super::chart::{ChartCovariance, Effect, charted};
use super::form::{Form, Residuals};
use super::solve::{Solution, solve};
use super::{FitError, FitSettings, Support};

const ELEMENT: &str = "sphere";

/// A radius beyond this many extents: the points show no curvature (a sagitta below 1e-5 of their extent).
pub(super) const LARGEST_RADIUS_RATIO: f64 = 1e5;

/// A radius less certain than this part of itself is no measurement: its curvature is not three standard uncertainties
/// away from that of a plane.
const LARGEST_U_RATIO: f64 = 1.0 / 3.0;

/// Points thinner than this part of their extent pass for a plane's (a cap of 12° half angle).
const FLAT_SHARE: f64 = 0.05;

/// So many points suffice for a start: they give it to some hundredths of their noise.
const START_POINTS: usize = 16_384;

const FLAT_POINTS: &str = "their curvature does not stand out of their noise; are they points of a plane? a wider cap or a given diameter helps";

/// A sphere fitted to points, with uncertainties.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SphereFit {
    /// Centre of the sphere, mm.
    pub center_mm: [f64; 3],
    /// Diameter of the sphere, mm.
    pub diameter_mm: f64,
    /// Points used and form deviation.
    #[serde(flatten)]
    pub form: Form,
    /// Standard uncertainty of the centre, mm.
    pub u_center_mm: [f64; 3],
    /// Standard uncertainty of the diameter, mm; 0 when it was given.
    pub u_diameter_mm: f64,
    /// What the uncertainties rest on.
    #[serde(flatten)]
    pub support: Support,
    /// Covariance of (x, y, z, radius), mm².
    #[serde(skip)]
    pub covariance_mm2: Matrix4<f64>,
    /// Residual of each point given.
    #[serde(skip)]
    pub residuals: Residuals,
}

impl SphereFit {
    /// Centre as a point.
    pub fn center(&self) -> Point3<f64> {
        Point3::from(self.center_mm)
    }

    /// Covariance of centre and diameter in the common chart.
    pub fn chart(&self) -> ChartCovariance {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()].map(Effect::shift);
        charted(&[x, y, z, Effect::sizes([2.0, 0.0])], &self.covariance_mm2)
    }

    /// Standard uncertainty of g · (centre, radius), mm.
    pub fn u_along_mm(&self, gradient: &Vector4<f64>) -> f64 {
        (self.covariance_mm2 * gradient).dot(gradient).max(0.0).sqrt()
    }
}

/// Fits a sphere of free diameter.
///
/// # Errors
/// Fewer than 5 points, coplanar points, no convergence; see [`FitError`].
pub fn sphere(points: &[Point3<f64>], settings: &FitSettings) -> Result<SphereFit, FitError> {
    let solution = solve(ELEMENT, 5, points, settings, algebraic).map_err(|error| flat_or(error, points))?;
    let radius = solution.model.radius;
    let extent_mm = extent_mm(points.iter().map(|p| &p.coords), &solution.centroid);
    if !radius.is_finite() || radius >= LARGEST_RADIUS_RATIO * extent_mm {
        return Err(FitError::Degenerate { element: ELEMENT, why: "the points show no curvature" });
    }
    let covariance = solution.covariance;
    // A patch of a plane has a best sphere too, of any radius that its noise happens to bend it to.
    if covariance[(3, 3)].max(0.0).sqrt() > LARGEST_U_RATIO * radius.abs() {
        return Err(FitError::Degenerate { element: ELEMENT, why: FLAT_POINTS });
    }
    Ok(result(solution.centroid + solution.model.center, radius, covariance, solution))
}

/// A sphere whose radius diverges: reported as a plane when the points are flat.
fn flat_or(error: FitError, points: &[Point3<f64>]) -> FitError {
    let FitError::NoConvergence { .. } = error else { return error };
    match Centred::new(ELEMENT, points).map(|centred| Principal::new(&centred.points).extents_mm) {
        Ok(extents) if extents[0] < FLAT_SHARE * extents[2] => {
            FitError::Degenerate { element: ELEMENT, why: FLAT_POINTS }
        }
        _ => error,
    }
}

/// Fits the centre of a sphere of known diameter.
///
/// # Errors
/// Fewer than 4 points, coplanar points, a diameter that is not positive; see [`FitError`].
pub fn sphere_of_diameter(
    points: &[Point3<f64>],
    diameter_mm: f64,
    settings: &FitSettings,
) -> Result<SphereFit, FitError> {
    check_diameter(diameter_mm)?;
    let solution = solve(ELEMENT, 4, points, settings, |centred| {
        let free = algebraic(centred)?;
        Ok(FixedSphere { center: free.center, radius: 0.5 * diameter_mm })
    })?;
    let covariance = Matrix4::from_fn(|r, c| if r < 3 && c < 3 { solution.covariance[(r, c)] } else { 0.0 });
    Ok(result(solution.centroid + solution.model.center, 0.5 * diameter_mm, covariance, solution))
}

/// Centre of a sphere of known diameter from a start that is known too: for the coarse search, where the points are
/// soiled and the algebraic start would follow the dirt.
///
/// # Errors
/// See [`FitError`].
pub(crate) fn sphere_centre_near(
    points: &[Point3<f64>],
    diameter_mm: f64,
    start_mm: &Point3<f64>,
) -> Result<Point3<f64>, FitError> {
    check_diameter(diameter_mm)?;
    if points.len() < 4 {
        return Err(FitError::TooFewPoints { element: ELEMENT, points: points.len(), needs: 4 });
    }
    let centred = Centred::new(ELEMENT, points)?;
    let start = FixedSphere { center: start_mm.coords - centred.centroid, radius: 0.5 * diameter_mm };
    let adjusted = adjust(ELEMENT, start, &centred.points, Until::Settled)?;
    Ok(Point3::from(centred.centroid + adjusted.model.center))
}

/// Refuses a diameter that no sphere has.
fn check_diameter(diameter_mm: f64) -> Result<(), FitError> {
    if diameter_mm > 0.0 && diameter_mm <= super::COORDINATE_LIMIT_MM {
        return Ok(());
    }
    Err(FitError::Setting { key: "diameter_mm", value: diameter_mm, limits: "0 … 1e7 mm, zero excluded" })
}

/// Assembles the result from the adjustment.
fn result<M, const P: usize>(
    center: Vector3<f64>,
    radius: f64,
    covariance_mm2: Matrix4<f64>,
    solution: Solution<M, P>,
) -> SphereFit {
    let u = covariance_mm2.diagonal().map(|v| v.max(0.0).sqrt());
    SphereFit {
        center_mm: center.into(),
        diameter_mm: 2.0 * radius,
        form: solution.form,
        u_center_mm: [u.x, u.y, u.z],
        u_diameter_mm: 2.0 * u.w,
        support: solution.support,
        covariance_mm2,
        residuals: solution.residuals,
    }
}

/// A sphere with free radius; parameters: centre, radius.
#[derive(Debug, Clone)]
pub(super) struct FreeSphere {
    pub center: Vector3<f64>,
    pub radius: f64,
}

impl Model<4> for FreeSphere {
    #[inline(always)]
    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        (point - self.center).norm() - self.radius
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 4>)) {
        let (distance, away) = polar(&(point - self.center));
        add(distance - self.radius, &Vector4::new(-away.x, -away.y, -away.z, -1.0));
    }

    fn moved(&self, step: &SVector<f64, 4>) -> Self {
        Self { center: self.center + step.xyz(), radius: self.radius + step.w }
    }
}

/// A sphere of fixed radius; parameters: centre.
#[derive(Debug, Clone)]
struct FixedSphere {
    center: Vector3<f64>,
    radius: f64,
}

impl Model<3> for FixedSphere {
    #[inline(always)]
    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        (point - self.center).norm() - self.radius
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 3>)) {
        let (distance, away) = polar(&(point - self.center));
        add(distance - self.radius, &-away);
    }

    fn moved(&self, step: &SVector<f64, 3>) -> Self {
        Self { center: self.center + step, radius: self.radius }
    }
}

/// Length and direction; a vector without length has the direction zero, so that it pulls nowhere.
#[inline(always)]
pub(super) fn polar(vector: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let length = vector.norm();
    let inverse = if length > 0.0 { 1.0 / length } else { 0.0 };
    (length, vector * inverse)
}

/// The least-squares sphere as a start for others.
pub(super) fn fitted(points: &[Vector3<f64>]) -> Result<FreeSphere, FitError> {
    Ok(adjust(ELEMENT, algebraic(points)?, points, Until::Settled)?.model)
}

/// Algebraic start: of many points by some of them, where these determine a sphere.
fn algebraic(points: &[Vector3<f64>]) -> Result<FreeSphere, FitError> {
    if points.len() > START_POINTS {
        let mut some = some_of(points, START_POINTS);
        let middle = mean(&some, |p| *p);
        for point in &mut some {
            *point -= middle;
        }
        if let Ok(FreeSphere { center, radius }) = algebraic_of_all(&some) {
            return Ok(FreeSphere { center: center + middle, radius });
        }
    }
    algebraic_of_all(points)
}

/// |p|² = 2 c·p + (R² − c²) is linear in c and the bracket.
fn algebraic_of_all(points: &[Vector3<f64>]) -> Result<FreeSphere, FitError> {
    let start = Algebraic(Vector4::zeros());
    let normal = normal(&start, points);
    let scatter = normal.symmetric().fixed_view::<3, 3>(0, 0) / 4.0;
    check_spatial(ELEMENT, points, &scatter)?;
    let step = normal.step(0.0).ok_or_else(|| super::adjust::singular(ELEMENT))?;
    let Algebraic(parameters) = start.moved(&step);
    let center = parameters.xyz();
    Ok(FreeSphere { center, radius: (parameters.w + center.norm_squared()).max(0.0).sqrt() })
}

/// A sphere by its algebraic distance, mm²; parameters: c and R² − c².
#[derive(Clone)]
struct Algebraic(Vector4<f64>);

impl Model<4> for Algebraic {
    #[inline(always)]
    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        2.0 * self.0.xyz().dot(point) + self.0.w - point.norm_squared()
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 4>)) {
        add(self.deviation(point), &Vector4::new(2.0 * point.x, 2.0 * point.y, 2.0 * point.z, 1.0));
    }

    fn moved(&self, step: &SVector<f64, 4>) -> Self {
        Self(self.0 + step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::adjust::tests::derivatives_agree;
    use crate::fit::tests::Noise;

    /// Points of a cap of a sphere of 10 mm, `along` from the pole (1) to the half angle (0), with noise along the radius, in mm.
    fn cap(
        count: usize,
        half_angle: f64,
        noise_mm: f64,
        along: impl Fn(usize, f64) -> f64,
    ) -> Vec<Point3<f64>> {
        let mut noise = Noise(7);
        let least = fringe::math::cos(half_angle);
        (0..count)
            .map(|i| {
                let up = least + (1.0 - least) * along(i, noise.uniform());
                let (sin, cos) = fringe::math::sincos(std::f64::consts::TAU * noise.uniform());
                let (radius, out) = (10.0 + noise_mm * noise.normal(), (1.0 - up * up).sqrt());
                Point3::new(radius * out * cos, radius * out * sin, radius * up)
            })
            .collect()
    }

    /// Proves: many points give the sphere that they show, within four of its uncertainties: also where every fourth one lies on one circle,
    /// as those of a column may, and on a flat cap whose noise is half of its height.
    #[test]
    fn many_points_do_not_need_a_start_that_some_of_them_give() {
        let count = 4 * START_POINTS;
        let clouds = [
            cap(count, 1.0, 0.01, |_, up| up),
            cap(count, 1.0, 0.01, |i, up| if i % 4 == 0 { 0.5 } else { up }),
            cap(count, 0.1, 0.02, |_, up| up),
        ];
        for (number, points) in clouds.iter().enumerate() {
            let fit = sphere(points, &FitSettings::default()).unwrap();
            let error = (fit.diameter_mm - 20.0).abs();
            assert!(error < 4.0 * fit.u_diameter_mm, "{number}: {error} of {}", fit.u_diameter_mm);
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let center = Vector3::new(0.2, -0.3, 0.5);
        derivatives_agree(&FreeSphere { center, radius: 2.0 });
        derivatives_agree(&FixedSphere { center, radius: 2.0 });
        derivatives_agree(&Algebraic(Vector4::new(0.2, -0.3, 0.5, 4.0)));
    }
}
