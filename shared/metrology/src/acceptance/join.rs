//! The motion between two views, from the centres of reference spheres.

use nalgebra::{Matrix3, Point3, Vector3};

use fringe::geometry::pose::Pose;

/// Sweeps of the singular value decomposition; a 3 × 3 matrix needs a few.
const SWEEPS: usize = 100;

/// Motion that brings `from` onto `to` with the least sum of squared distances, and the root mean square of what remains,
/// mm (K. S. Arun, T. S. Huang, S. D. Blostein, IEEE PAMI 9(5), 1987). `None` for fewer than three points, or points on
/// a line.
pub(super) fn motion(from: &[Point3<f64>], to: &[Point3<f64>]) -> Option<(Pose, f64)> {
    let n = from.len();
    if n < 3 || n != to.len() {
        return None;
    }
    let mean = |points: &[Point3<f64>]| points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n as f64;
    let (from_mean, to_mean) = (mean(from), mean(to));
    let cross: Matrix3<f64> =
        from.iter().zip(to).map(|(a, b)| (b.coords - to_mean) * (a.coords - from_mean).transpose()).sum();
    let svd = cross.try_svd(true, true, f64::EPSILON, SWEEPS)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    // Two directions at least, else the points may turn about their line.
    if svd.singular_values[1] <= 1e-9 * svd.singular_values[0] {
        return None;
    }
    let mirror = Vector3::new(1.0, 1.0, (u * v_t).determinant().signum());
    let rotation = u * Matrix3::from_diagonal(&mirror) * v_t;
    let pose = Pose { rotation, translation: to_mean - rotation * from_mean };
    let squares: f64 =
        from.iter().zip(to).map(|(a, b)| (pose.point(&a.coords) - b.coords).norm_squared()).sum();
    Some((pose, (squares / n as f64).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, UnitQuaternion};

    #[test]
    fn a_motion_is_found_and_a_line_is_refused() {
        let from = [[0.0, 0.0, 0.0], [30.0, 1.0, 2.0], [-4.0, 25.0, 3.0], [5.0, 6.0, 20.0]].map(Point3::from);
        let turn = UnitQuaternion::from_euler_angles(0.3, -1.1, 2.5);
        let truth = Isometry3::from_parts(Vector3::new(5.0, -7.0, 11.0).into(), turn);
        let to = from.map(|p| truth * p);
        let (pose, rms) = motion(&from, &to).unwrap();
        assert!(rms < 1e-13);
        assert!((pose.isometry().to_homogeneous() - truth.to_homogeneous()).amax() < 1e-13);
        assert!(motion(&from[..2], &to[..2]).is_none());
        let line = [1.0, 2.0, 5.0].map(|x| Point3::new(x, 2.0 * x, 0.0));
        assert!(motion(&line, &line).is_none());
    }
}
