//! Directions on a sphere: how much of it is covered, and the 25 representative points.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use crate::fit::{SphereFit, tangents};
use fringe::math;

/// Bands of equal area between the poles, and sectors of each: patches of 1/128 of the surface.
const BANDS: usize = 8;
const SECTORS: usize = 16;

/// Points within this angle of a direction make its representative point.
const NEAR_DEG: f64 = 6.0;

/// Rings of ISO 10360-5: angle from the pole and turn, in degrees, and points.
const RINGS: [(f64, f64, usize); 5] =
    [(0.0, 0.0, 1), (22.5, 0.0, 4), (45.0, 22.5, 8), (67.5, 45.0, 4), (90.0, 0.0, 8)];

/// Share of the sphere's patches of equal area that hold a point.
pub(super) fn coverage(fit: &SphereFit, points: &[Point3<f64>]) -> f64 {
    let mut seen = [false; BANDS * SECTORS];
    for point in points {
        let Some(out) = (point - fit.center()).try_normalize(0.0) else { continue };
        let band = (0.5 * (out.z + 1.0) * BANDS as f64) as usize;
        let sector = ((math::atan2(out.y, out.x) + PI) / TAU * SECTORS as f64) as usize;
        if let Some(patch) = seen.get_mut(band.min(BANDS - 1) * SECTORS + sector.min(SECTORS - 1)) {
            *patch = true;
        }
    }
    seen.iter().filter(|s| **s).count() as f64 / seen.len() as f64
}

/// Middle direction of points on a sphere: of one view, the line of sight against which the sensor looked.
pub(super) fn middle_direction(fit: &SphereFit, points: &[Point3<f64>]) -> Vector3<f64> {
    let sum: Vector3<f64> = points.iter().filter_map(|p| (p - fit.center()).try_normalize(0.0)).sum();
    sum.try_normalize(1e-6 * points.len() as f64).unwrap_or(Vector3::z())
}

/// 25 representative points of the pattern about `pole`: in each direction the mean radial distance of the points near it.
///
/// # Errors
/// The number of directions without points.
pub(super) fn representative(
    fit: &SphereFit,
    points: &[Point3<f64>],
    pole: &Vector3<f64>,
) -> Result<Vec<Point3<f64>>, usize> {
    let [e1, e2] = tangents(pole);
    let near = math::cos(NEAR_DEG.to_radians());
    let arms: Vec<(Vector3<f64>, f64)> = points
        .iter()
        .filter_map(|p| {
            let arm = p - fit.center();
            Some((arm.try_normalize(0.0)?, arm.norm()))
        })
        .collect();
    let found: Vec<Option<Point3<f64>>> = directions()
        .map(|direction| {
            let direction = e1 * direction.x + e2 * direction.y + pole * direction.z;
            let radii = arms.iter().filter(|(out, _)| out.dot(&direction) >= near).map(|(_, radius)| *radius);
            let (count, sum) = radii.fold((0_usize, 0.0), |(count, sum), radius| (count + 1, sum + radius));
            (count > 0).then(|| fit.center() + direction * (sum / count as f64))
        })
        .collect();
    let missing = found.iter().filter(|point| point.is_none()).count();
    if missing > 0 { Err(missing) } else { Ok(found.into_iter().flatten().collect()) }
}

fn directions() -> impl Iterator<Item = Vector3<f64>> {
    RINGS.iter().flat_map(|(polar_deg, turn_deg, count)| {
        (0..*count).map(move |i| {
            let polar = polar_deg.to_radians();
            let azimuth = turn_deg.to_radians() + TAU * i as f64 / *count as f64;
            let ring = math::sin(polar);
            Vector3::new(ring * math::cos(azimuth), ring * math::sin(azimuth), math::cos(polar))
        })
    })
}
