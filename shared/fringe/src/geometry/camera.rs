//! The pinhole camera with the distortion of its [`Lens`]; a projector is the same, read backwards.
//!
//! Source: thesis eq. 2.62–2.73; the distortion has OpenCV's meaning (k1, k2, p1, p2, k3 … there; here k and p apart).

pub use super::lens::{Lens, LensKind};

use nalgebra::{
    Isometry3, Matrix3, Point2, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3,
};
use thiserror::Error;

/// Largest deviation of R·Rᵀ from the identity that a rotation from a file may have.
///
/// Calibration files carry six to eight digits, so valid ones stay below 1e-5; a scaled or sheared matrix does not.
pub const ROTATION_TOLERANCE: f64 = 1e-4;

/// Least and largest focal length, in lengths of the image's longer side: fields from 180° less a tenth of a degree down to
/// two seconds of arc, wider than any lens and narrower than any telescope.
const FOCAL_PER_SIDE: [f64; 2] = [5e-4, 1e5];

/// Largest distance of the principal point from the image's corner, in lengths of the longer side: a small window read out
/// of the corner of a large sensor stays far below.
const OFFSET_PER_SIDE: f64 = 1e4;

/// No camera stands farther from the origin of its world, mm: a kilometre.
const FARTHEST_MM: f64 = 1e6;

/// What is wrong with a camera.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum CameraError {
    /// Image size zero or beyond 65 535.
    #[error("image size {width_px} × {height_px} px is outside 1 … 65535")]
    Size {
        /// Image columns given, px.
        width_px: u32,
        /// Image rows given, px.
        height_px: u32,
    },
    /// Focal length not finite or not positive.
    #[error("focal length {0} px must be a positive number")]
    FocalLength(f64),
    /// A focal length that no image of this size can have.
    #[error("focal length {focal_px} px is outside {least} … {most} px, which an image of this size allows")]
    FocalRange {
        /// Focal length given, px.
        focal_px: f64,
        /// Smallest value accepted, px.
        least: f64,
        /// Largest value accepted, px.
        most: f64,
    },
    /// A parameter that no real camera can have.
    #[error("{name} = {value}: its magnitude must be at most {most} {unit}")]
    Magnitude {
        /// Name of the parameter.
        name: &'static str,
        /// Value of the parameter.
        value: f64,
        /// Largest magnitude accepted, in `unit`.
        most: f64,
        /// Unit of both values.
        unit: &'static str,
    },
    /// A parameter is NaN or infinite.
    #[error("{0} must be a finite number")]
    NotFinite(&'static str),
    /// The rotation is not orthonormal.
    #[error(
        "rotation is not orthonormal: largest entry of R·Rᵀ − 1 is {deviation:.2e}, limit {ROTATION_TOLERANCE:.0e}"
    )]
    NotOrthonormal {
        /// Largest deviation from a rotation.
        deviation: f64,
    },
    /// The rotation has determinant −1.
    #[error("rotation is a mirror (determinant {0:.3}); a camera pose needs determinant +1")]
    Mirrored(f64),
}

/// A half line in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Origin of the ray, mm.
    pub origin_mm: Point3<f64>,
    /// Direction of the ray, unit vector.
    pub direction: Vector3<f64>,
}

/// A camera, or a projector as an inverse camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Number of columns, px.
    pub width_px: u32,
    /// Number of rows, px.
    pub height_px: u32,
    /// Focal lengths fx, fy, px.
    pub focal_px: [f64; 2],
    /// Principal point cx, cy, px.
    pub principal_point_px: [f64; 2],
    /// Skew s of the matrix K = [fx s cx; 0 fy cy; 0 0 1].
    pub skew: f64,
    /// Distortion of the lens.
    pub distortion: Lens,
    /// X_camera = R X_world + t, t in mm.
    pub camera_from_world: Isometry3<f64>,
}

impl Camera {
    /// Checks sizes and numbers.
    ///
    /// # Errors
    /// Names the first parameter that no real camera can have.
    pub fn check(&self) -> Result<(), CameraError> {
        let (width_px, height_px) = (self.width_px, self.height_px);
        if !(1..=65_535).contains(&width_px) || !(1..=65_535).contains(&height_px) {
            return Err(CameraError::Size { width_px, height_px });
        }
        if let Some(bad) = self.focal_px.iter().find(|f| !f.is_finite() || **f <= 0.0) {
            return Err(CameraError::FocalLength(*bad));
        }
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let named: [(&'static str, bool); 7] = [
            ("principal point", finite(&self.principal_point_px)),
            ("skew", self.skew.is_finite()),
            ("distortion k", finite(&self.distortion.k)),
            ("distortion p", finite(&self.distortion.p)),
            ("distortion k", finite(&self.distortion.more_k)),
            ("distortion s", finite(&self.distortion.prism)),
            ("translation", finite(self.camera_from_world.translation.vector.as_slice())),
        ];
        named.iter().find(|(_, ok)| !ok).map_or(Ok(()), |(name, _)| Err(CameraError::NotFinite(name)))?;
        self.check_magnitudes()
    }

    /// Numbers that are finite and yet mean nothing: a slip of the decimal point or of the unit.
    fn check_magnitudes(&self) -> Result<(), CameraError> {
        let side_px = f64::from(self.width_px.max(self.height_px));
        let (least, most) = (side_px * FOCAL_PER_SIDE[0], side_px * FOCAL_PER_SIDE[1]);
        if let Some(focal_px) = self.focal_px.into_iter().find(|f| !(least..=most).contains(f)) {
            return Err(CameraError::FocalRange { focal_px, least, most });
        }
        let [fx, fy] = self.focal_px;
        let [cx, cy] = self.principal_point_px;
        let far_px = side_px * OFFSET_PER_SIDE;
        let t = self.camera_from_world.translation.vector;
        let named = [
            ("principal point", cx, far_px, "px"),
            ("principal point", cy, far_px, "px"),
            ("skew", self.skew, fx.max(fy), "px"),
            ("translation", t.x, FARTHEST_MM, "mm"),
            ("translation", t.y, FARTHEST_MM, "mm"),
            ("translation", t.z, FARTHEST_MM, "mm"),
        ];
        named
            .into_iter()
            .find(|(_, value, most, _)| value.abs() > *most)
            .map_or(Ok(()), |(name, value, most, unit)| {
                Err(CameraError::Magnitude { name, value, most, unit })
            })
    }

    /// Mean of both focal lengths, px; a pixel of the image plane at unit distance is its inverse long.
    #[inline]
    pub fn mean_focal_px(&self) -> f64 {
        0.5 * (self.focal_px[0] + self.focal_px[1])
    }

    /// The camera matrix K, px.
    pub fn matrix(&self) -> Matrix3<f64> {
        let [fx, fy] = self.focal_px;
        let [cx, cy] = self.principal_point_px;
        Matrix3::new(fx, self.skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    }

    /// Distorted normalised coordinates to pixel.
    #[inline(always)]
    pub fn pixel_from_distorted(&self, distorted: Vector2<f64>) -> Point2<f64> {
        Point2::new(
            self.focal_px[0] * distorted.x + self.skew * distorted.y + self.principal_point_px[0],
            self.focal_px[1] * distorted.y + self.principal_point_px[1],
        )
    }

    /// Pixel to distorted normalised coordinates.
    pub fn distorted_from_pixel(&self, pixel: Point2<f64>) -> Vector2<f64> {
        let y = (pixel.y - self.principal_point_px[1]) / self.focal_px[1];
        Vector2::new((pixel.x - self.principal_point_px[0] - self.skew * y) / self.focal_px[0], y)
    }

    /// Ideal normalised coordinates (X/Z, Y/Z in the camera frame) to pixel.
    pub fn pixel_from_normalised(&self, ideal: Vector2<f64>) -> Point2<f64> {
        self.pixel_from_distorted(self.distortion.distort(ideal))
    }

    /// Pixel to ideal normalised coordinates; `None` where the lens model folds over.
    pub fn normalised_from_pixel(&self, pixel: Point2<f64>) -> Option<Vector2<f64>> {
        self.distortion.undistort(self.distorted_from_pixel(pixel))
    }

    /// World point (mm) to pixel; `None` behind the camera. The pixel may lie outside the image.
    pub fn project(&self, world_mm: &Point3<f64>) -> Option<Point2<f64>> {
        let camera_mm = self.camera_from_world * world_mm;
        (camera_mm.z > 1e-9).then(|| {
            self.pixel_from_normalised(Vector2::new(camera_mm.x / camera_mm.z, camera_mm.y / camera_mm.z))
        })
    }

    /// Whether a pixel lies on the sensor (its outer half pixels included).
    pub fn contains(&self, pixel: Point2<f64>) -> bool {
        pixel.x >= -0.5
            && pixel.y >= -0.5
            && pixel.x <= f64::from(self.width_px) - 0.5
            && pixel.y <= f64::from(self.height_px) - 0.5
    }

    /// Squared ideal radius beyond which nothing lies on the chip, with a margin of 10 %.
    ///
    /// Far outside of its chip the polynomial of a lens turns back, and points at the side would seem to lie in the image.
    pub fn reach2(&self) -> f64 {
        let (right, bottom) = (f64::from(self.width_px) - 0.5, f64::from(self.height_px) - 0.5);
        // The farthest border point is a corner or, under strong distortion, near one: 16 steps along each side find it.
        let at = |i: u32, end: f64| -0.5 + (end + 0.5) * f64::from(i) / 16.0;
        let border = (0..=16).flat_map(|i| {
            let (x, y) = (at(i, right), at(i, bottom));
            [(x, -0.5), (x, bottom), (-0.5, y), (right, y)]
        });
        border
            .filter_map(|(x, y)| self.normalised_from_pixel(Point2::new(x, y)))
            .map(|ideal| 1.21 * ideal.norm_squared())
            .fold(0.0, f64::max)
    }

    /// Optical centre in the world frame, mm.
    pub fn centre_mm(&self) -> Point3<f64> {
        self.camera_from_world.inverse() * Point3::origin()
    }

    /// The line of sight of a pixel in the world frame; `None` where the lens model folds over.
    pub fn ray(&self, pixel: Point2<f64>) -> Option<Ray> {
        Some(self.ray_through(self.normalised_from_pixel(pixel)?))
    }

    /// The line of sight of an ideal point (without the lens, at distance 1) in the world frame.
    pub fn ray_through(&self, ideal: Vector2<f64>) -> Ray {
        let direction = self.camera_from_world.rotation.inverse() * Vector3::new(ideal.x, ideal.y, 1.0);
        Ray { origin_mm: self.centre_mm(), direction: direction.normalize() }
    }
}

/// A pose from a rotation matrix (row by row) and a translation in mm.
///
/// The nearest rotation is taken, so that the digits lost in a file do not leave a sheared frame.
///
/// # Errors
/// A matrix that is no rotation: mirrored, scaled, sheared, or not finite.
pub fn pose(rotation: [[f64; 3]; 3], translation_mm: [f64; 3]) -> Result<Isometry3<f64>, CameraError> {
    let matrix = Matrix3::from_row_slice(rotation.as_flattened());
    if matrix.iter().any(|v| !v.is_finite()) {
        return Err(CameraError::NotFinite("rotation"));
    }
    if translation_mm.iter().any(|v| !v.is_finite()) {
        return Err(CameraError::NotFinite("translation"));
    }
    let deviation = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    if deviation > ROTATION_TOLERANCE {
        return Err(CameraError::NotOrthonormal { deviation });
    }
    let determinant = matrix.determinant();
    if determinant < 0.0 {
        return Err(CameraError::Mirrored(determinant));
    }
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(orthonormal(matrix)));
    Ok(Isometry3::from_parts(Translation3::from(Vector3::from(translation_mm)), rotation))
}

/// The rotation nearest to a matrix that is almost one (its polar factor).
fn orthonormal(matrix: Matrix3<f64>) -> Matrix3<f64> {
    let mut nearest = matrix;
    // Newton iteration for the polar factor, R ← (R + R⁻ᵀ)/2: quadratic, so four steps pass 1e-16 from 1e-4.
    for _ in 0..4 {
        if let Some(inverse) = nearest.try_inverse() {
            nearest = (nearest + inverse.transpose()) * 0.5;
        }
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens() -> Lens {
        Lens::brown_conrady([-0.12, 0.08, -0.01], [4e-4, -3e-4])
    }

    #[test]
    fn a_pixel_and_its_ray_agree() {
        let camera = Camera {
            width_px: 1124,
            height_px: 750,
            focal_px: [2330.0, 2328.0],
            principal_point_px: [560.0, 377.0],
            skew: 0.3,
            distortion: lens(),
            camera_from_world: Isometry3::new(Vector3::new(10.0, -20.0, 500.0), Vector3::new(0.1, 0.5, -0.3)),
        };
        camera.check().unwrap();
        let pixel = Point2::new(931.25, 77.5);
        let ray = camera.ray(pixel).unwrap();
        let again = camera.project(&(ray.origin_mm + ray.direction * 480.0)).unwrap();
        assert!((again - pixel).amax() < 1e-9);
    }

    #[test]
    fn parameters_that_no_camera_has_are_refused() {
        let good = Camera {
            width_px: 168,
            height_px: 112,
            focal_px: [350.0, 349.0],
            principal_point_px: [84.0, 56.0],
            skew: 0.0,
            distortion: lens(),
            camera_from_world: Isometry3::translation(0.0, 0.0, 500.0),
        };
        good.check().unwrap();
        for focal in [1e-300, 1e-3, 1e8, 1e300] {
            let camera = Camera { focal_px: [350.0, focal], ..good.clone() };
            assert!(matches!(camera.check(), Err(CameraError::FocalRange { .. })), "{focal}");
        }
        let at = |x: f64| Isometry3::translation(x, 0.0, 0.0);
        for (bad, name) in [
            (Camera { principal_point_px: [84.0, -1e300], ..good.clone() }, "principal point"),
            (Camera { skew: 1e10, ..good.clone() }, "skew"),
            (Camera { camera_from_world: at(-2e6), ..good.clone() }, "translation"),
        ] {
            assert!(bad.check().unwrap_err().to_string().contains(name));
        }
    }

    #[test]
    fn poses_that_are_none_are_refused() {
        let mirror = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert!(matches!(pose(mirror, [0.0; 3]), Err(CameraError::Mirrored(_))));
        let scaled = [[1.1, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert!(matches!(pose(scaled, [0.0; 3]), Err(CameraError::NotOrthonormal { .. })));
        let broken = [[f64::NAN, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert!(matches!(pose(broken, [0.0; 3]), Err(CameraError::NotFinite(_))));
    }
}
