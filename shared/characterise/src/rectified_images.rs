//! Rectified images as OpenCV defines them (`stereoRectify` with its defaults: zero disparity at infinity, no scaling).
//!
//! The cell never resamples a phase map and does not need this; other programs do, and Q of thesis eq. 2.99 belongs to it.
//! Source: OpenCV 5, calib3d, `stereoRectify` (Bouguet's method): each view is turned by half the relative rotation, then
//! both so that the baseline lies along the nearer image axis. Deviation: corners are undistorted in double precision.

use crate::calibration::{StereoGeometry, rotation, rotation_vector};
use fringe::geometry::camera::Camera;
use fringe::math;
use fringe::rectify::{MIN_BASELINE_MM, RectifyError};
use nalgebra::{Matrix3, Matrix3x4, Matrix4, Point2, Vector2, Vector3};

/// Rotations, projection matrices and the matrix Q of a rectified pair.
#[derive(Debug, Clone, PartialEq)]
pub struct RectifiedImages {
    /// R1, R2: rectified from left, rectified from right.
    pub rectified_from_view: [Matrix3<f64>; 2],
    /// P1, P2: rectified pixel from point in the left rectified frame, px and mm.
    pub projection: [Matrix3x4<f64>; 2],
    /// Q (eq. 2.99): (x, y, disparity, 1) of the left rectified image to homogeneous X in the left rectified frame, mm.
    pub q: Matrix4<f64>,
}

impl RectifiedImages {
    /// For two checked cameras; the images are as large as the left one.
    ///
    /// # Errors
    /// No baseline, or no corner with a ray.
    pub fn new(left: &Camera, right: &Camera) -> Result<Self, RectifyError> {
        let right_from_left = StereoGeometry::new(left, right).right_from_left;
        let half =
            rotation(rotation_vector(&right_from_left.rotation) * -0.5).to_rotation_matrix().into_inner();
        let shift = half * right_from_left.translation.vector;
        let baseline_mm = shift.norm();
        // Written so that a NaN is refused too.
        if baseline_mm.is_nan() || baseline_mm < MIN_BASELINE_MM {
            return Err(RectifyError::NoBaseline { baseline_mm });
        }
        let axis = usize::from(shift.x.abs() <= shift.y.abs());
        let to_axis = turn_to_axis(&shift, axis);
        let rectified_from_view = [to_axis * half.transpose(), to_axis * half];
        let along = (rectified_from_view[1] * right_from_left.translation.vector)[axis];
        let focal_px = 0.5 * (left.focal_px[1 - axis] + right.focal_px[1 - axis]);
        // The centre of the last pixel.
        let last = Vector2::new(f64::from(left.width_px - 1), f64::from(left.height_px - 1));
        let mut centre = Vector2::zeros();
        for (side, camera, turn) in
            [("left", left, &rectified_from_view[0]), ("right", right, &rectified_from_view[1])]
        {
            let mean = mean_corner(camera, turn, last).ok_or(RectifyError::NoRays { side })?;
            // Both views get one principal point, the mean of what each would need.
            centre += (last / 2.0 - mean * focal_px) / 2.0;
        }
        let first =
            Matrix3x4::new(focal_px, 0.0, centre.x, 0.0, 0.0, focal_px, centre.y, 0.0, 0.0, 0.0, 1.0, 0.0);
        let mut second = first;
        second[(axis, 3)] = along * focal_px;
        let mut q = Matrix4::identity();
        q[(0, 3)] = -centre.x;
        q[(1, 3)] = -centre.y;
        q[(2, 2)] = 0.0;
        q[(2, 3)] = focal_px;
        q[(3, 2)] = -1.0 / along;
        q[(3, 3)] = 0.0;
        Ok(Self { rectified_from_view, projection: [first, second], q })
    }
}

/// The smallest rotation that lays the shift along an image axis, keeping its sense.
fn turn_to_axis(shift: &Vector3<f64>, axis: usize) -> Matrix3<f64> {
    let along = Vector3::ith(axis, if shift[axis] > 0.0 { 1.0 } else { -1.0 });
    let normal = shift.cross(&along);
    let angle = math::acos((shift[axis].abs() / shift.norm()).min(1.0));
    let vector = normal.try_normalize(0.0).map_or(Vector3::zeros(), |n| n * angle);
    rotation(vector).to_rotation_matrix().into_inner()
}

/// Mean of the rectified normalised coordinates of the image's four corners.
fn mean_corner(camera: &Camera, turn: &Matrix3<f64>, last: Vector2<f64>) -> Option<Vector2<f64>> {
    let mut sum = Vector2::zeros();
    for (x, y) in [(0.0, 0.0), (last.x, 0.0), (0.0, last.y), (last.x, last.y)] {
        let ideal = camera.normalised_from_pixel(Point2::new(x, y))?;
        let turned = turn * Vector3::new(ideal.x, ideal.y, 1.0);
        sum += turned.xy() / turned.z;
    }
    Some(sum / 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::synthetic::rig;
    use nalgebra::{Point3, Vector4};

    /// A point's disparity in the rectified images gives the point back by Q, in rows of one ordinate.
    #[test]
    fn q_gives_the_point_of_a_disparity() {
        let [left, right, _] = rig(1124, 750);
        let images = RectifiedImages::new(&left, &right).unwrap();
        for world in [Point3::new(0.0, 0.0, 0.0), Point3::new(40.0, -20.0, 30.0)] {
            let pixels = [(&left, 0), (&right, 1)].map(|(camera, side)| {
                let seen = images.rectified_from_view[side] * (camera.camera_from_world * world).coords;
                let p = &images.projection[0];
                let at = p.fixed_columns::<3>(0) * (seen / seen.z);
                (at, seen)
            });
            let [(l, seen), (r, _)] = pixels;
            assert!((l.y - r.y).abs() < 1e-9, "{l} beside {r}");
            let point = images.q * Vector4::new(l.x, l.y, l.x - r.x, 1.0);
            assert!((point.xyz() / point.w - seen).norm() < 1e-8);
            let projected = images.projection[1] * seen.push(1.0);
            assert!((projected.x / projected.z - r.x).abs() < 1e-8);
        }
    }

    /// Figures of OpenCV 5.0.0 (`cv2.stereoRectify(M1, D1, M2, D2, (640, 480), R, T)`) for a pair one above the other.
    /// OpenCV undistorts the corners in single precision, hence the tolerance.
    #[test]
    fn opencv_gives_the_same_for_an_upright_pair() {
        let camera = |focal_px: [f64; 2], camera_from_world| Camera {
            width_px: 640,
            height_px: 480,
            focal_px,
            principal_point_px: [321.0, 241.0],
            skew: 0.0,
            distortion: fringe::geometry::camera::Lens::default(),
            camera_from_world,
        };
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(0.02, -0.2, 0.03));
        let pose = nalgebra::Isometry3::from_parts(Vector3::new(5.0, -90.0, 7.0).into(), turn);
        let left = camera([1001.0, 1001.0], nalgebra::Isometry3::identity());
        let images = RectifiedImages::new(&left, &camera([1002.0, 1000.0], pose)).unwrap();
        let expected = Matrix3::new(
            0.994_227_330,
            0.032_865_143,
            -0.102_136_665,
            -0.041_903_529,
            0.995_269_884,
            -0.087_646_744,
            0.098_773_024,
            0.091_420_675,
            0.990_901_685,
        );
        assert!((images.rectified_from_view[0] - expected).amax() < 1e-9);
        let q = &images.q;
        assert!((q[(0, 3)] + 323.183_479).abs() < 1e-4 && (q[(1, 3)] + 329.266_335).abs() < 1e-4, "{q}");
        assert!(
            (q[(2, 3)] - 1001.5).abs() < 1e-9 && (q[(3, 2)] - 0.011_060_701_788_398).abs() < 1e-12,
            "{q}"
        );
        let p = &images.projection[1];
        assert!((p[(1, 3)] + 90_545.791_683).abs() < 1e-5 && p[(0, 3)] == 0.0, "{p}");
    }

    #[test]
    fn one_view_twice_has_no_baseline() {
        let [left, ..] = rig(640, 480);
        assert!(matches!(RectifiedImages::new(&left, &left), Err(RectifyError::NoBaseline { .. })));
    }
}
