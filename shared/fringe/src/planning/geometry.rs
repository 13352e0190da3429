//! From the uncertainty of a projector coordinate to that of a point, in the middle of what two views see.

use crate::geometry::camera::{Camera, Ray};
use crate::pattern::Axis;
use crate::surface::SurfaceSettings;
use nalgebra::{Matrix2, Point2, Point3, Vector3};
use serde::Serialize;
use std::f64::consts::TAU;

/// Variance of a match in units of that of a phase: the left pixel's own, and the right one's read from a quadratic over 4 × 4 pixels
/// (the mean over all places between pixels).
const MATCHED: f64 = 1.0 + 0.242;
/// Step of the difference quotients, mm.
const STEP_MM: f64 = 0.01;

/// How the uncertainty of coordinates becomes that of a point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Depth {
    /// Uncertainty of the point per projector pixel of uncertainty of the coordinate, µm.
    pub um_per_px: f64,
    /// Variance of the noise that the smoothing of points leaves: 1 for points as they are.
    pub noise_share: f64,
    /// Whether errors of the pattern cancel: two cameras see the same error at the same place.
    pub pattern_cancels: bool,
}

impl Depth {
    /// Standard uncertainty of a point, µm.
    pub fn u_point_um(&self, noise_rad: f64, pattern_rad: f64, period_px: f64) -> f64 {
        let pattern = if self.pattern_cancels { 0.0 } else { pattern_rad * pattern_rad };
        let variance = self.noise_share * noise_rad * noise_rad + pattern;
        variance.sqrt() * period_px / TAU * self.um_per_px
    }
}

/// Projector pixels per pixel of a camera, on a surface in the middle of what both see.
pub fn projector_px_per_camera_px(camera: &Camera, projector: &Camera) -> Option<f64> {
    let at = middle_mm(camera, projector)?;
    let px_per_mm = |view: &Camera| view.focal_px[0] / (view.centre_mm() - at).norm();
    Some(px_per_mm(projector) / px_per_mm(camera))
}

/// Where the middle rays of two views come nearest to each other.
pub fn middle_mm(left: &Camera, right: &Camera) -> Option<Point3<f64>> {
    let (a, b) = (axis(left)?, axis(right)?);
    let (u, v) = (a.direction.normalize(), b.direction.normalize());
    let between = b.origin_mm - a.origin_mm;
    let c = u.dot(&v);
    let sine2 = 1.0 - c * c;
    // Parallel rays have no point of their own.
    if sine2 < 1e-9 {
        return None;
    }
    let along = (between.dot(&u) - between.dot(&v) * c) / sine2;
    (along > 0.0).then(|| a.origin_mm + u * along)
}

fn axis(camera: &Camera) -> Option<Ray> {
    let centre = |n: u32| 0.5 * (f64::from(n) - 1.0);
    camera.ray(Point2::new(centre(camera.width_px), centre(camera.height_px)))
}

/// Change of a view's pixel per mm of a point along a unit vector.
fn rate(view: &Camera, at: &Point3<f64>, along: &Vector3<f64>) -> Option<nalgebra::Vector2<f64>> {
    let (far, near) = (view.project(&(at + along * STEP_MM))?, view.project(&(at - along * STEP_MM))?);
    Some((far - near) / (2.0 * STEP_MM))
}

fn towards(view: &Camera, at: &Point3<f64>) -> Vector3<f64> {
    (view.centre_mm() - at).normalize()
}

/// A place of a surface and its unit normal, towards the views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Position in the world frame, mm.
    pub at: Point3<f64>,
    /// Unit normal of the surface there.
    pub normal: Vector3<f64>,
}

impl Place {
    /// Two unit vectors along the surface.
    fn along(&self) -> [Vector3<f64>; 2] {
        let least = if self.normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
        let side = self.normal.cross(&least).try_normalize(1e-12).unwrap_or_else(Vector3::z);
        [side, self.normal.cross(&side)]
    }
}

/// Change of the projector's coordinate per pixel of a camera on a surface, across the fringes: what a blur of the camera is in projector
/// pixels. `None` where either view does not see the surface from its front.
pub fn projector_px_across(camera: &Camera, projector: &Camera, pattern: Axis, place: &Place) -> Option<f64> {
    let [a, b] = place.along();
    let camera_px = Matrix2::from_columns(&[rate(camera, &place.at, &a)?, rate(camera, &place.at, &b)?]);
    let projector_px =
        Matrix2::from_columns(&[rate(projector, &place.at, &a)?, rate(projector, &place.at, &b)?]);
    let row = if pattern == Axis::X { projector_px.row(0) } else { projector_px.row(1) };
    Some((row * camera_px.try_inverse()?).norm())
}

/// Camera and projector: depth along the camera's ray. `None` where the pattern's axis does not determine the depth.
pub fn by_projector(
    camera: &Camera,
    projector: &Camera,
    pattern: Axis,
    surface: &SurfaceSettings,
) -> Option<Depth> {
    let at = middle_mm(camera, projector)?;
    let normal = towards(camera, &at);
    by_projector_at((camera, projector), pattern, surface, &Place { at, normal })
}

/// The same along the normal of a place.
pub fn by_projector_at(
    (camera, projector): (&Camera, &Camera),
    pattern: Axis,
    surface: &SurfaceSettings,
    place: &Place,
) -> Option<Depth> {
    let ray = towards(camera, &place.at);
    let px = rate(projector, &place.at, &ray)?;
    let along = if pattern == Axis::X { px.x } else { px.y };
    let noise_share = surface.noise_share(1.0);
    let um_per_px = 1e3 * ray.dot(&place.normal).abs() / along.abs();
    (along.abs() > 1e-9).then_some(Depth { um_per_px, noise_share, pattern_cancels: false })
}

/// Camera against camera by the phase of a projector, on a surface that faces all three: along its normal.
pub fn by_phase(
    left: &Camera,
    right: &Camera,
    projector: &Camera,
    pattern: Axis,
    surface: &SurfaceSettings,
) -> Option<Depth> {
    let at = middle_mm(left, right)?;
    let (to_left, to_right) = (towards(left, &at), towards(right, &at));
    let normal = (to_left + to_right + towards(projector, &at)).try_normalize(1e-9)?;
    by_phase_at((left, right), projector, pattern, surface, &Place { at, normal })
}

/// The same along the normal of any place.
///
/// Along the line that the epipolar plane cuts into the surface, the phase's noise moves the match by dx_R/du pixels per projector pixel, and a pixel
/// of the match moves the point by ds/dx_R along the left ray.
pub fn by_phase_at(
    (left, right): (&Camera, &Camera),
    projector: &Camera,
    pattern: Axis,
    surface: &SurfaceSettings,
    place: &Place,
) -> Option<Depth> {
    let Place { at, normal } = *place;
    let (to_left, to_right) = (towards(left, &at), towards(right, &at));
    let epipolar = to_left.cross(&to_right).try_normalize(1e-9)?;
    let line = normal.cross(&epipolar).try_normalize(1e-9)?;
    let px = rate(projector, &at, &line)?;
    let along = if pattern == Axis::X { px.x } else { px.y };
    let match_per_mm = rate(right, &at, &line)?.norm();
    let depth = rate(right, &at, &to_left)?.norm();
    let value = MATCHED.sqrt() * match_per_mm / (along.abs() * depth) * to_left.dot(&normal).abs();
    let noise_share = surface.noise_share(1.0 / MATCHED);
    value.is_finite().then_some(Depth { um_per_px: 1e3 * value, noise_share, pattern_cancels: true })
}

/// Noise of both phases of a match as that of two equal ones, rad.
pub fn matched_noise_rad(left_rad: f64, right_rad: f64) -> f64 {
    ((left_rad * left_rad + (MATCHED - 1.0) * right_rad * right_rad) / MATCHED).sqrt()
}
