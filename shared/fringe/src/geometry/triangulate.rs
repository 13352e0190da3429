//! A point from two image points, for calibration and benchmarks: the clouds come from the matched phase (`surface`). Linear, then corrected so that the reprojection error is least.
//!
//! The linear part is the midpoint of the common perpendicular of both rays, which is exact when they meet. Noise in the
//! pixels makes them pass each other; the point that the pixels make most likely is then the one with the least sum
//! of squared reprojection errors (Hartley & Sturm 1997), found here by Gauss–Newton on the full camera models: one
//! step suffices for pixel noise (as in Lindstrom 2010), the second only proves it.

use crate::geometry::camera::{Camera, Ray};
use nalgebra::{Matrix2x3, Matrix3, Matrix3x4, Point2, Point3, Vector2, Vector3};

/// Rays closer to parallel than this (sine of the angle) do not make a point.
const MIN_SINE: f64 = 1e-6;

/// A triangulated point and how far it misses its image points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangulated {
    /// The corrected point, mm in the world frame.
    pub position_mm: Point3<f64>,
    /// The linear point, mm in the world frame.
    pub linear_mm: Point3<f64>,
    /// Root of the sum of squared reprojection errors of the corrected point, px.
    pub reprojection_px: f64,
    /// The same of the linear point, px.
    pub linear_reprojection_px: f64,
}

/// The point halfway between two rays where they come closest; `None` for parallel rays and behind either origin.
pub fn midpoint(a: &Ray, b: &Ray) -> Option<Point3<f64>> {
    let between = b.origin_mm - a.origin_mm;
    let cosine = a.direction.dot(&b.direction);
    // |d_a × d_b|² is exact for small angles, 1 − cos² is not.
    let sine2 = a.direction.cross(&b.direction).norm_squared();
    let (along_a, along_b) = (between.dot(&a.direction), between.dot(&b.direction));
    let (s, t) = ((along_a - cosine * along_b) / sine2, (cosine * along_a - along_b) / sine2);
    let ahead = sine2 > MIN_SINE * MIN_SINE && s > 0.0 && t > 0.0;
    ahead.then(|| nalgebra::center(&(a.origin_mm + a.direction * s), &(b.origin_mm + b.direction * t)))
}

/// Triangulates a pixel of each of two cameras (or projectors).
///
/// `None` for pixels without a ray, parallel rays, or a point behind a camera.
pub fn triangulate(a: (&Camera, Point2<f64>), b: (&Camera, Point2<f64>)) -> Option<Triangulated> {
    let linear_mm = midpoint(&a.0.ray(a.1)?, &b.0.ray(b.1)?)?;
    let linear_reprojection_px = reprojection(&linear_mm, &[a, b])?;
    let mut best = (linear_mm, linear_reprojection_px);
    for _ in 0..2 {
        let Some(moved) = gauss_newton(&best.0, &[a, b]) else { break };
        match reprojection(&moved, &[a, b]) {
            Some(error) if error < best.1 => best = (moved, error),
            _ => break,
        }
    }
    Some(Triangulated { position_mm: best.0, linear_mm, reprojection_px: best.1, linear_reprojection_px })
}

fn reprojection(at: &Point3<f64>, sights: &[(&Camera, Point2<f64>); 2]) -> Option<f64> {
    let mut sum = 0.0;
    for (camera, pixel) in sights {
        sum += (camera.project(at)? - pixel).norm_squared();
    }
    Some(sum.sqrt())
}

/// One step of (JᵀJ) δ = Jᵀ r over both views.
fn gauss_newton(at: &Point3<f64>, sights: &[(&Camera, Point2<f64>); 2]) -> Option<Point3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (camera, pixel) in sights {
        let (projected, jacobian) = project_with_jacobian(camera, at)?;
        normal += jacobian.transpose() * jacobian;
        right += jacobian.transpose() * (pixel - projected);
    }
    Some(at + normal.cholesky()?.solve(&right))
}

/// The pixels of a point in two cameras, and how the triangulated point follows them: (JᵀJ)⁻¹ Jᵀ of both cameras, 3 × 4, mm per px along
/// x and y of the first and of the second; `None` behind a camera, or where both rays are one.
pub fn point_by_pixels(
    cameras: [&Camera; 2],
    at: &Point3<f64>,
) -> Option<([Point2<f64>; 2], Matrix3x4<f64>)> {
    let [first, second] = cameras.map(|camera| project_with_jacobian(camera, at));
    let (first, second) = (first?, second?);
    let pixels = [first.0, second.0];
    let (first, second) = (first.1.transpose(), second.1.transpose());
    let normal = (first * first.transpose() + second * second.transpose()).cholesky()?;
    let mut both = Matrix3x4::zeros();
    both.fixed_view_mut::<3, 2>(0, 0).copy_from(&first);
    both.fixed_view_mut::<3, 2>(0, 2).copy_from(&second);
    Some((pixels, normal.solve(&both)))
}

/// The pixel of a world point and its derivative by the point, px per mm; `None` behind the camera.
pub fn project_with_jacobian(
    camera: &Camera,
    world_mm: &Point3<f64>,
) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
    let inside = camera.camera_from_world * world_mm;
    if inside.z <= 1e-9 {
        return None;
    }
    let ideal = Vector2::new(inside.x / inside.z, inside.y / inside.z);
    let pixel = camera.pixel_from_normalised(ideal);
    let lens = camera.distortion.jacobian(ideal);
    let [fx, fy] = camera.focal_px;
    let by_ideal = nalgebra::Matrix2::new(fx, camera.skew, 0.0, fy) * lens;
    let perspective = Matrix2x3::new(1.0, 0.0, -ideal.x, 0.0, 1.0, -ideal.y) / inside.z;
    let rotation = camera.camera_from_world.rotation.to_rotation_matrix();
    Some((pixel, by_ideal * perspective * rotation.matrix()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Noise, looking, rig};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn exact_pixels_give_the_exact_point(x in -60.0_f64..60.0, y in -40.0_f64..40.0, z in -40.0_f64..40.0) {
            let [left, right, projector] = rig(1124, 750);
            let truth = Point3::new(x, y, z);
            for (a, b) in [(&left, &right), (&left, &projector), (&projector, &right)] {
                let found = triangulate((a, a.project(&truth).unwrap()), (b, b.project(&truth).unwrap())).unwrap();
                prop_assert!((found.position_mm - truth).norm() < 1e-8, "{:?} beside {}", found, truth);
            }
        }

        /// Pixels that move take the point along by the derivative, up to the square of their motion.
        #[test]
        fn pixels_that_move_take_the_point_along(
            x in -60.0_f64..60.0, y in -40.0_f64..40.0, z in -40.0_f64..40.0, by in prop::array::uniform4(-0.1_f64..0.1),
        ) {
            let [left, right, _] = rig(1124, 750);
            let truth = Point3::new(x, y, z);
            let pixels = [&left, &right].map(|camera| camera.project(&truth).unwrap());
            let (a, b) = (pixels[0] + Vector2::new(by[0], by[1]), pixels[1] + Vector2::new(by[2], by[3]));
            let found = triangulate((&left, a), (&right, b)).unwrap().position_mm;
            let (seen, mm_per_px) = point_by_pixels([&left, &right], &truth).unwrap();
            let along = mm_per_px * nalgebra::Vector4::from(by);
            prop_assert_eq!(seen, pixels);
            prop_assert!((found - truth - along).norm() < 1e-3 * along.norm() + 1e-9, "{found:?}, {along:?}");
        }

        /// The correction lowers the reprojection error, and no point nearby has a lower one.
        #[test]
        fn the_correction_finds_the_least_error(x in -60.0_f64..60.0, z in -40.0_f64..40.0, seed in any::<u64>()) {
            let [left, right, _] = rig(1124, 750);
            let truth = Point3::new(x, 5.0, z);
            let mut noise = Noise(seed);
            let mut seen = |camera: &Camera| {
                camera.project(&truth).unwrap() + Vector2::new(noise.gauss(), noise.gauss()) * 0.5
            };
            let (a, b) = ((&left, seen(&left)), (&right, seen(&right)));
            let found = triangulate(a, b).unwrap();
            prop_assert!(found.reprojection_px <= found.linear_reprojection_px);
            for axis in 0..3 {
                for step in [-1e-3, 1e-3] {
                    let mut beside = found.position_mm;
                    beside[axis] += step;
                    prop_assert!(reprojection(&beside, &[a, b]).unwrap() > found.reprojection_px);
                }
            }
        }
    }

    /// With unequal distances the midpoint is not the best point: the correction has work to do.
    #[test]
    fn the_midpoint_is_beaten_by_the_correction() {
        let near = looking([-150.0, 0.0, 200.0], [0.0; 3], [1.0, 0.0, 0.0], 1124, 750);
        let far = looking([400.0, 0.0, 800.0], [0.0; 3], [1.0, 0.0, 0.0], 1124, 750);
        let truth = Point3::new(5.0, 3.0, -4.0);
        let a = (&near, near.project(&truth).unwrap() + Vector2::new(0.0, 2.0));
        let b = (&far, far.project(&truth).unwrap() - Vector2::new(0.0, 2.0));
        let found = triangulate(a, b).unwrap();
        assert!(found.reprojection_px < 0.95 * found.linear_reprojection_px, "{found:?}");
    }

    #[test]
    fn parallel_and_diverging_rays_give_no_point() {
        let ray = |x: f64, direction: Vector3<f64>| Ray {
            origin_mm: Point3::new(x, 0.0, 0.0),
            direction: direction.normalize(),
        };
        assert_eq!(midpoint(&ray(0.0, Vector3::z()), &ray(10.0, Vector3::z())), None);
        let (out_left, out_right) = (Vector3::new(-0.1, 0.0, 1.0), Vector3::new(0.1, 0.0, 1.0));
        assert_eq!(midpoint(&ray(0.0, out_left), &ray(10.0, out_right)), None, "they meet behind");
        assert!(midpoint(&ray(0.0, out_right), &ray(10.0, out_left)).is_some());
    }

    #[test]
    fn the_jacobian_agrees_with_differences() {
        let [left, ..] = rig(1124, 750);
        let at = Point3::new(30.0, -20.0, 15.0);
        let (_, jacobian) = project_with_jacobian(&left, &at).unwrap();
        for axis in 0..3 {
            let step = Vector3::ith(axis, 1e-4);
            let numeric = (left.project(&(at + step)).unwrap() - left.project(&(at - step)).unwrap()) / 2e-4;
            assert!((numeric - jacobian.column(axis)).norm() < 1e-6);
        }
    }
}
