//! What the adjustment gives.

use super::covariance::{Covariance, Gauge};
use super::model::DEVICE;
use super::observations::DeviceKind;
use fringe::geometry::camera::Camera;
use nalgebra::{Isometry3, Point2, Point3};

/// A calibrated device with its uncertainties.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedDevice {
    /// Name of the device as given.
    pub name: String,
    /// Whether it is a camera or a projector.
    pub kind: DeviceKind,
    /// Intrinsics, lens and pose in the world frame.
    pub camera: Camera,
    /// Root of the mean squared *distance* between seen and modelled pixel over the points used (OpenCV's convention;
    /// √2 times the standard deviation of one coordinate).
    pub rms_reprojection_px: f64,
    /// Number of views used.
    pub views: usize,
    /// Number of points used.
    pub points: usize,
    /// Number of points rejected as outliers.
    pub outliers: usize,
    /// Root of the variance component: by how much the residuals exceed the given covariances; of a projector that cameras
    /// read, what remains of its residuals without the cameras' own errors beside that of the reading ([`super::Link`]).
    pub noise_factor: f64,
    /// Standard uncertainties in the order of [`super::PARAMETERS`]; extrinsics relative to the first device.
    pub standard_uncertainty: [f64; DEVICE],
}

/// Bend of the target: z = x_mm (1 − ξ²) + y_mm (1 − η²), ξ and η from −1 to 1 over its points (as in mrcal).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Warp {
    /// Rise of the middle over the edges along x, mm.
    pub x_mm: f64,
    /// Rise of the middle over the edges along y, mm.
    pub y_mm: f64,
    /// Standard uncertainties of both components, mm.
    pub u_mm: [f64; 2],
}

/// One point of one view after the adjustment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Point of the target (after turning).
    pub index: usize,
    /// Where it was seen.
    pub pixel: Point2<f64>,
    /// Seen − modelled, px; `None` behind the device.
    pub error_px: Option<[f64; 2]>,
    /// False for an outlier.
    pub used: bool,
}

/// A view after the adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewReport {
    /// Index into the views given.
    pub view: usize,
    /// Index of the device.
    pub device: usize,
    /// Index of the pose.
    pub pose: usize,
    /// Whether the indices were turned by 180°.
    pub turned: bool,
    /// Root mean squared distance over the points used; 0 where none is.
    pub rms_px: f64,
    /// Residuals of all points of the view.
    pub residuals: Vec<Residual>,
}

/// A point that was rejected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outlier {
    /// Index into the views given.
    pub view: usize,
    /// Point of the target (after turning).
    pub index: usize,
    /// Seen − modelled, px; `None` behind the device.
    pub error_px: Option<[f64; 2]>,
}

/// Where a face of the target was found, in the target's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FacePlace {
    /// Name of the face.
    pub name: String,
    /// Whether its place was adjusted; else it stands where it was declared.
    pub adjusted: bool,
    /// Middle of the face, mm.
    pub middle_mm: [f64; 3],
    /// How far that is from where it was declared, mm.
    pub shift_mm: f64,
    /// Angle by which the face is turned against its declaration, rad.
    pub turn_rad: f64,
}

/// The calibrated rig with its covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// In the order given.
    pub devices: Vec<CalibratedDevice>,
    /// world_from_board of each pose; `None` for one that no usable view shows.
    pub boards: Vec<Option<Isometry3<f64>>>,
    /// Bend of the target, when it was adjusted.
    pub warp: Option<Warp>,
    /// Root mean square of the shifts that single target points ask for, over the standard uncertainty of such a shift:
    /// near 1 when the target is as declared (and bent), by far more when its points should be adjusted too
    /// ([`super::TargetShape::Free`]); 0 when they were.
    pub target_misfit: f64,
    /// Places of the target's faces; empty for a single flat target, and where each point of it was adjusted.
    pub faces: Vec<FacePlace>,
    /// Target points as adjusted, mm in the target's frame.
    pub target_mm: Vec<Point3<f64>>,
    /// Views used, in the order given.
    pub views: Vec<ViewReport>,
    /// Views (indices) left out: too few points, or points on a line.
    pub unused_views: Vec<usize>,
    /// Points rejected as outliers.
    pub outliers: Vec<Outlier>,
    /// Covariance of the devices.
    pub covariance: Covariance,
    /// Root of the weighted sum of squares over the degrees of freedom; near 1 when the noise was estimated.
    pub sigma0: f64,
    /// Degrees of freedom: rows less parameters.
    pub degrees_of_freedom: usize,
    /// Iterations of the final adjustment.
    pub iterations: usize,
}

impl Calibration {
    /// The view (index into [`Self::views`]) with the largest root mean squared distance over its device's.
    ///
    /// Cameras and projectors have different noise, so the ratio is compared.
    pub fn worst_view(&self) -> Option<usize> {
        let ratio = |v: &ViewReport| v.rms_px / self.devices[v.device].rms_reprojection_px.max(1e-300);
        (0..self.views.len()).max_by(|a, b| {
            // Of equal ones the first.
            ratio(&self.views[*a]).total_cmp(&ratio(&self.views[*b])).then(b.cmp(a))
        })
    }

    /// A device by name.
    pub fn device(&self, name: &str) -> Option<&CalibratedDevice> {
        self.devices.iter().find(|d| d.name == name)
    }

    /// Standard uncertainties of a device's parameters when the mean of the boards is held.
    pub fn uncertainty_in_volume(&self, device: usize) -> [f64; DEVICE] {
        self.covariance.standard_uncertainty(Gauge::Boards, device)
    }
}
