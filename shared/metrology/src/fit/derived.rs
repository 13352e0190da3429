//! Quantities between fitted elements, with standard uncertainties from the elements' covariances.
//!
//! Elements come from different points, so their errors count as independent of one another; what they share
//! (calibration, temperature) is no part of these figures.

use nalgebra::{Matrix3, Point3, Vector3, Vector4};
use serde::Serialize;

use super::axis::worst_tilt_rad;
use super::normal::tangents;
use super::{PlaneFit, SphereFit};
use fringe::math;

/// A value with its standard uncertainty, both in the unit that the function states.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Derived {
    /// Value of the derived quantity, mm or rad.
    pub value: f64,
    /// Standard uncertainty in the unit of the value.
    pub u: f64,
}

impl Derived {
    /// From independent contributions to the uncertainty.
    fn new(value: f64, contributions: [f64; 2]) -> Self {
        let [a, b] = contributions;
        Self { value, u: (a * a + b * b).sqrt() }
    }
}

/// Distance of two spheres' centres, mm: |c₂ − c₁|; u² = dᵀ (C₁ + C₂) d along the unit vector d between them.
pub fn centre_distance_mm(a: &SphereFit, b: &SphereFit) -> Derived {
    let between = b.center() - a.center();
    let distance = between.norm();
    let d = (between / distance).push(0.0);
    Derived::new(distance, [a.u_along_mm(&d), b.u_along_mm(&d)])
}

/// Distance from the first plane to the centroid of the second one's points, along the first one's normal, mm.
///
/// Two measured planes are never parallel, so a distance needs a place: the centroid, where the second plane is known
/// best. Both planes' places there are uncertain; exchanging the planes gives another number.
pub fn plane_distance_mm(first: &PlaneFit, second: &PlaneFit) -> Derived {
    let centroid = second.centroid_mm.into();
    Derived::new(first.distance_mm(&centroid), [first.u_at_mm(&centroid), second.u_centroid_mm])
}

/// Angle between the normals of two planes, rad, 0 … π: from sine and cosine both, since the arc cosine loses small
/// angles. Each normal's tilt counts in the plane of the two, and near 0° and 180°, where tilts across that plane turn it, all of it.
pub fn plane_angle_rad(a: &PlaneFit, b: &PlaneFit) -> Derived {
    let (n1, n2) = (a.normal_vector(), b.normal_vector());
    let axis = n1.cross(&n2);
    let sine = axis.norm();
    // Parallel normals have no plane of their own, and any stands for it.
    let unit = if sine > 1e-9 { axis / sine } else { tangents(&n1)[0] };
    let squared = |u: [f64; 2]| u[0] * u[0] + u[1] * u[1];
    let along = squared([a.u_tilt_rad(&unit.cross(&n1)), b.u_tilt_rad(&unit.cross(&n2))]);
    let across = squared([a.u_tilt_rad(&unit), b.u_tilt_rad(&unit)]);
    let variance = along + share_across(sine * sine, across) * across;
    Derived { value: math::atan2(sine, n1.dot(&n2)), u: variance.sqrt() }
}

/// Share of the variance across a vector that counts in the uncertainty of its length, by the square of that length: far from zero none. Near zero noise across
/// the vector lengthens it, and the root mean square about the true length holds all of it.
pub fn share_across(square: f64, across: f64) -> f64 {
    let far = 4.0 * across;
    if square <= far { 1.0 } else { (far / square) * (far / square) }
}

/// Distance of a point from a plane along its normal, mm, with the point's covariance in mm².
pub fn height_mm(plane: &PlaneFit, point: &Point3<f64>, covariance_mm2: &Matrix3<f64>) -> Derived {
    let n = plane.normal_vector();
    let u_point = (covariance_mm2 * n).dot(&n).max(0.0).sqrt();
    Derived::new(plane.distance_mm(point), [plane.u_at_mm(point), u_point])
}

/// Top of a sphere over a plane, mm: distance of the centre plus the radius. Centre and radius are correlated, hence
/// one gradient for both.
pub fn sphere_height_mm(top: &SphereFit, base: &PlaneFit) -> Derived {
    let n = base.normal_vector();
    let height = base.distance_mm(&top.center()) + 0.5 * top.diameter_mm;
    Derived::new(height, [base.u_at_mm(&top.center()), top.u_along_mm(&Vector4::new(n.x, n.y, n.z, 1.0))])
}

/// Direction of the line from one point to another, by its angles with the coordinate axes (thesis eq. 4.3–4.6).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DirectionAngles {
    /// cos α, cos β, cos γ (eq. 4.3–4.5).
    pub cosines: [f64; 3],
    /// α, β, γ, rad.
    pub angles_rad: [f64; 3],
    /// Sensitivities of the cosines (eq. 4.6): row i holds ∂ cosᵢ / ∂(x₂, y₂, z₂), 1/mm; those by the first point are
    /// their negatives.
    pub sensitivities_per_mm: [[f64; 3]; 3],
    /// Standard uncertainties of α, β, γ, rad.
    pub u_angles_rad: [f64; 3],
}

/// Angles of the line between two points with their covariances, mm². `None` when the points coincide.
///
/// With the unit vector d and the distance L: ∂ cosᵢ / ∂xⱼ = (δᵢⱼ − dᵢ dⱼ) / L, and dα = −d(cos α) / sin α. Along an
/// axis sin α is 0 and α cannot fall: the worst direction across stands in, 1/L of its uncertainty.
///
/// The thesis takes the points for the middles of two planes and the result for the angle between the planes, and a
/// sensitivity for an uncertainty; an angle between planes is [`plane_angle_rad`].
pub fn direction_angles(
    points: [&Point3<f64>; 2],
    covariances_mm2: [&Matrix3<f64>; 2],
) -> Option<DirectionAngles> {
    let between = points[1] - points[0];
    let length = between.norm();
    let d = between / length;
    if !d.iter().all(|v| v.is_finite()) {
        return None;
    }
    let covariance = covariances_mm2[0] + covariances_mm2[1];
    let sensitivity = (Matrix3::identity() - d * d.transpose()) / length;
    let mut angles_rad = [0.0; 3];
    let mut u_angles_rad = [0.0; 3];
    for axis in 0..3 {
        let row: Vector3<f64> = sensitivity.row(axis).transpose();
        // |row| = sin α / L.
        let sine = row.norm() * length;
        angles_rad[axis] = math::atan2(sine, d[axis]);
        u_angles_rad[axis] = if sine > 1e-9 {
            (covariance * row).dot(&row).max(0.0).sqrt() / sine
        } else {
            let [e1, e2] = tangents(&d);
            let across = |a: &Vector3<f64>, b: &Vector3<f64>| (covariance * a).dot(b);
            let (c11, c12, c22) = (across(&e1, &e1), across(&e1, &e2), across(&e2, &e2));
            worst_tilt_rad(nalgebra::Matrix2::new(c11, c12, c12, c22)) / length
        };
    }
    let sensitivities_per_mm = [0, 1, 2].map(|i| [0, 1, 2].map(|j| sensitivity[(i, j)]));
    Some(DirectionAngles { cosines: d.into(), angles_rad, sensitivities_per_mm, u_angles_rad })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::tests::Noise;
    use crate::fit::{FitSettings, plane, sphere};

    /// A patch of 60 points with noise of 20 µm about a plane through `at` with the unit normal `n`.
    fn patch(noise: &mut Noise, at: Vector3<f64>, n: Vector3<f64>) -> PlaneFit {
        let [e1, e2] = tangents(&n);
        let mut coordinate = || 20.0 * noise.uniform() - 10.0;
        let places: Vec<[f64; 2]> = (0..60).map(|_| [coordinate(), coordinate()]).collect();
        let point = |[a, b]: [f64; 2]| Point3::from(at + e1 * a + e2 * b + n * (0.02 * noise.normal()));
        let points: Vec<Point3<f64>> = places.into_iter().map(point).collect();
        plane(&points, &FitSettings::default()).unwrap().towards(&n)
    }

    /// A cap of 150 points with radial noise of 20 µm.
    fn cap(noise: &mut Noise, centre: Vector3<f64>) -> SphereFit {
        let mut points = Vec::new();
        while points.len() < 150 {
            let direction = noise.direction();
            if direction.z > 0.2 {
                points.push(Point3::from(centre + direction * (10.0 + 0.02 * noise.normal())));
            }
        }
        sphere(&points, &FitSettings::default()).unwrap()
    }

    /// Name, true value, and one measurement of each quantity.
    fn measured(seed: u64) -> Vec<(&'static str, f64, Derived)> {
        let mut noise = Noise(seed);
        let tilted = Vector3::new(0.6, 0.0, 0.8);
        let base = patch(&mut noise, Vector3::new(0.0, 0.0, 400.0), Vector3::z());
        let step = patch(&mut noise, Vector3::new(30.0, 5.0, 408.0), Vector3::z());
        let wedge = patch(&mut noise, Vector3::new(-30.0, 0.0, 405.0), tilted);
        let (a, b) = (
            cap(&mut noise, Vector3::new(40.0, 0.0, 420.0)),
            cap(&mut noise, Vector3::new(-40.0, 60.0, 420.0)),
        );
        let covariance = |s: &SphereFit| s.covariance_mm2.fixed_view::<3, 3>(0, 0).into_owned();
        let angles =
            direction_angles([&a.center(), &b.center()], [&covariance(&a), &covariance(&b)]).unwrap();
        vec![
            ("distance of centres", 100.0, centre_distance_mm(&a, &b)),
            ("distance of planes", 8.0, plane_distance_mm(&base, &step)),
            ("angle of planes", math::atan2(0.6, 0.8), plane_angle_rad(&base, &wedge)),
            ("height of a centre", 20.0, height_mm(&base, &a.center(), &covariance(&a))),
            ("height of a sphere", 30.0, sphere_height_mm(&a, &base)),
            (
                "alpha",
                math::atan2(60.0, -80.0),
                Derived { value: angles.angles_rad[0], u: angles.u_angles_rad[0] },
            ),
            (
                "gamma",
                std::f64::consts::FRAC_PI_2,
                Derived { value: angles.angles_rad[2], u: angles.u_angles_rad[2] },
            ),
        ]
    }

    /// The angle of parallel planes is the length of a tilt both ways: its root mean square over 500 repeats is known to 2.5 %.
    #[test]
    fn angles_of_parallel_planes_are_off_by_what_is_stated() {
        let (mut squares, mut stated) = (0.0, 0.0);
        for seed in 0..500 {
            let mut noise = Noise(seed);
            let base = patch(&mut noise, Vector3::new(0.0, 0.0, 400.0), Vector3::z());
            let step = patch(&mut noise, Vector3::new(30.0, 5.0, 408.0), Vector3::z());
            let angle = plane_angle_rad(&base, &step);
            squares += angle.value * angle.value;
            stated += angle.u * angle.u;
            // One plane has no angle to itself, and is as uncertain in every direction.
            let none = plane_angle_rad(&base, &base);
            assert!(none.value == 0.0 && none.u > base.u_normal_rad, "{none:?}");
        }
        let ratio = f64::sqrt(squares / stated);
        assert!((0.92..1.08).contains(&ratio), "error over stated = {ratio}");
    }

    /// Stated uncertainties beside the scatter of 500 repeats, known to 3.2 %; the limits are three of that.
    #[test]
    fn propagated_uncertainties_meet_the_scatter() {
        let runs: Vec<_> = (0..500).map(measured).collect();
        for quantity in 0..runs[0].len() {
            let (name, truth, _) = runs[0][quantity];
            let count = runs.len() as f64;
            let mean = runs.iter().map(|r| r[quantity].2.value).sum::<f64>() / count;
            let squares = runs.iter().map(|r| (r[quantity].2.value - mean).powi(2)).sum::<f64>();
            let scatter = (squares / (count - 1.0)).sqrt();
            let stated = (runs.iter().map(|r| r[quantity].2.u.powi(2)).sum::<f64>() / count).sqrt();
            assert!((mean - truth).abs() < 4.0 * scatter / count.sqrt(), "{name}: {mean} for {truth}");
            let ratio = scatter / stated;
            assert!((0.9..1.1).contains(&ratio), "{name}: scatter / stated = {ratio}");
        }
    }

    #[test]
    fn sensitivities_agree_with_differences_and_along_an_axis_the_angle_stays_defined() {
        let (a, b) = (Point3::new(1.0, -2.0, 3.0), Point3::new(4.0, 5.0, -6.0));
        let covariance = Matrix3::from_diagonal(&Vector3::new(1e-4, 4e-4, 9e-4));
        let zero = Matrix3::zeros();
        let here = direction_angles([&a, &b], [&zero, &covariance]).unwrap();
        for axis in 0..3 {
            let mut ahead = b;
            ahead[axis] += 1e-6;
            let there = direction_angles([&a, &ahead], [&zero, &zero]).unwrap();
            for i in 0..3 {
                let numeric = (there.cosines[i] - here.cosines[i]) / 1e-6;
                assert!((numeric - here.sensitivities_per_mm[i][axis]).abs() < 1e-7);
            }
        }
        let along = direction_angles([&a, &(a + Vector3::x() * 50.0)], [&zero, &covariance]).unwrap();
        assert_eq!(along.angles_rad[0], 0.0);
        assert!((along.u_angles_rad[0] - 0.03 / 50.0).abs() < 1e-15);
        assert!(direction_angles([&a, &a], [&zero, &zero]).is_none());
    }
}
