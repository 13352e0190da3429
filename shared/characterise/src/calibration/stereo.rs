//! Two devices against each other: relative pose, essential and fundamental matrix, epipolar residuals.
//!
//! Rectifying rotations and the baseline frame stand in [`fringe::rectify`].

use super::covariance::Gauge;
use super::model::{DEVICE, FURTHER, INTRINSIC, Ideal, POSE, compose};
use super::result::{Calibration, Residual, ViewReport};
use fringe::geometry::camera::Camera;
use fringe::math::linear::Dense;
use nalgebra::{Isometry3, Matrix3, Point2, Vector2, Vector3};

/// Right from left with its matrices; pixels for `fundamental` are without distortion.
#[derive(Debug, Clone, PartialEq)]
pub struct StereoGeometry {
    /// R = R_r R_lᵀ, T = T_r − R T_l (eq. 5.1, 5.2), mm.
    pub right_from_left: Isometry3<f64>,
    /// E = [T]× R, for ideal normalised coordinates: x_rᵀ E x_l = 0; scaled with T in mm.
    pub essential: Matrix3<f64>,
    /// F = K_r⁻ᵀ E K_l⁻¹, for pixels that the lens did not distort.
    pub fundamental: Matrix3<f64>,
    left: Camera,
    right: Camera,
}

/// A relative pose with its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativePose {
    /// Pose of the left device in the frame of the right one.
    pub right_from_left: Isometry3<f64>,
    /// Covariance of (ω, τ) in X ↦ exp(ω) X + τ in the right device's frame; rad and mm.
    pub covariance: [[f64; POSE]; POSE],
}

/// Epipolar residuals of the target's points that two devices saw in the same poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpipolarResiduals {
    /// Number of points used.
    pub count: usize,
    /// Mean of the signed Sampson distances, px.
    pub mean_px: f64,
    /// Root mean square, px: with independent noise σ in each coordinate it is σ.
    pub rms_px: f64,
    /// Largest absolute one, px.
    pub max_px: f64,
}

impl StereoGeometry {
    /// For two checked cameras.
    pub fn new(left: &Camera, right: &Camera) -> Self {
        let right_from_left = compose(&right.camera_from_world, &left.camera_from_world.inverse());
        let rotation = right_from_left.rotation.to_rotation_matrix().into_inner();
        let essential = right_from_left.translation.vector.cross_matrix() * rotation;
        let fundamental = inverse_matrix(right).transpose() * essential * inverse_matrix(left);
        Self { right_from_left, essential, fundamental, left: left.clone(), right: right.clone() }
    }

    /// F with its last entry 1, as OpenCV writes it; as it is where that entry vanishes.
    pub fn fundamental_scaled(&self) -> Matrix3<f64> {
        let last = self.fundamental[(2, 2)];
        if last.abs() > f64::EPSILON * self.fundamental.amax() {
            self.fundamental / last
        } else {
            self.fundamental
        }
    }

    /// Signed first-order distance of a pair of pixels (as seen, distorted) from fulfilling the epipolar constraint, px
    /// (Sampson); `None` where a lens model folds over or the points are the epipoles.
    pub fn epipolar_error_px(&self, left: Point2<f64>, right: Point2<f64>) -> Option<f64> {
        self.ideal_error_px(self.left.normalised_from_pixel(left)?, self.right.normalised_from_pixel(right)?)
    }

    /// The ideal points of a pair of pixels with their derivatives; `None` where a lens model folds over.
    pub(crate) fn ideal(&self, left: Point2<f64>, right: Point2<f64>) -> Option<[Ideal; 2]> {
        Some([Ideal::new(&self.left, left)?, Ideal::new(&self.right, right)?])
    }

    /// [`Self::epipolar_error_px`] of the pixels that a lens without distortion would give ideal points.
    pub(crate) fn ideal_error_px(&self, left: Vector2<f64>, right: Vector2<f64>) -> Option<f64> {
        self.straight_error_px(&straight(&self.left, left), &straight(&self.right, right))
    }

    fn straight_error_px(&self, left: &Vector3<f64>, right: &Vector3<f64>) -> Option<f64> {
        let (in_right, in_left) = (self.fundamental * left, self.fundamental.transpose() * right);
        let slope = (in_right.xy().norm_squared() + in_left.xy().norm_squared()).sqrt();
        let error = right.dot(&in_right) / slope;
        error.is_finite().then_some(error)
    }
}

/// The pixel of an ideal point without the lens's distortion, homogeneous.
fn straight(camera: &Camera, ideal: Vector2<f64>) -> Vector3<f64> {
    camera.matrix() * Vector3::new(ideal.x, ideal.y, 1.0)
}

/// K⁻¹ in closed form: K is upper triangular.
fn inverse_matrix(camera: &Camera) -> Matrix3<f64> {
    let [fx, fy] = camera.focal_px;
    let [cx, cy] = camera.principal_point_px;
    let s = camera.skew;
    Matrix3::new(
        1.0 / fx,
        -s / (fx * fy),
        (s * cy - cx * fy) / (fx * fy),
        0.0,
        1.0 / fy,
        -cy / fy,
        0.0,
        0.0,
        1.0,
    )
}

impl Calibration {
    /// The relative pose of two devices with its covariance; `None` for devices that do not exist.
    ///
    /// δ_rel = δ_right − Ad δ_left with Ad (ω, τ) = (R ω, R τ − R ω × T).
    pub fn relative_pose(&self, left: usize, right: usize) -> Option<RelativePose> {
        let right_camera = &self.devices.get(right)?.camera;
        let pose = compose(
            &right_camera.camera_from_world,
            &self.devices.get(left)?.camera.camera_from_world.inverse(),
        );
        let r = pose.rotation.to_rotation_matrix().into_inner();
        let shift = pose.translation.vector.cross_matrix() * r;
        let rows = Dense::from_fn(POSE, 2 * POSE, |i, j| match (i, j) {
            _ if j >= POSE => f64::from(u8::from(i + POSE == j)),
            (0..3, 0..3) | (3.., 3..) => -r[(i % 3, j % 3)],
            // −(R τ − R ω × T) has + R ω × T = − T × R ω.
            (3.., 0..3) => -shift[(i - 3, j)],
            _ => 0.0,
        });
        let places: Vec<usize> =
            [left, right].iter().flat_map(|d| DEVICE * d + INTRINSIC..DEVICE * d + FURTHER).collect();
        let inner = Dense::from_fn(2 * POSE, 2 * POSE, |i, j| {
            self.covariance.at(Gauge::FirstDevice, places[i], places[j])
        });
        let covariance = rows.sandwich(&inner);
        let covariance = std::array::from_fn(|i| std::array::from_fn(|j| covariance.at(i, j)));
        Some(RelativePose { right_from_left: pose, covariance })
    }

    /// Epipolar residuals of two devices over all poses that both saw; `None` when there is no common point.
    pub fn epipolar_residuals(&self, left: usize, right: usize) -> Option<EpipolarResiduals> {
        let geometry = StereoGeometry::new(&self.devices.get(left)?.camera, &self.devices.get(right)?.camera);
        let mut errors = Vec::new();
        for a in self.views.iter().filter(|v| v.device == left) {
            for b in self.views.iter().filter(|v| v.device == right && v.pose == a.pose) {
                errors.extend(common(a, b).filter_map(|(l, r)| geometry.epipolar_error_px(l.pixel, r.pixel)));
            }
        }
        let count = errors.len();
        (count > 0).then(|| EpipolarResiduals {
            count,
            mean_px: errors.iter().sum::<f64>() / count as f64,
            rms_px: (errors.iter().map(|e| e * e).sum::<f64>() / count as f64).sqrt(),
            max_px: errors.iter().fold(0.0, |worst: f64, e| worst.max(e.abs())),
        })
    }
}

/// Points that two views have in common, outliers left out.
fn common<'a>(a: &'a ViewReport, b: &'a ViewReport) -> impl Iterator<Item = (&'a Residual, &'a Residual)> {
    let used = a.residuals.iter().filter(|r| r.used);
    used.filter_map(|l| b.residuals.iter().find(|r| r.used && r.index == l.index).map(|r| (l, r)))
}
