//! What the adjustment is given: devices, a target, and where each device saw (or lit) which point of the target.

use super::CalibrationError;
use nalgebra::{Isometry3, Matrix2, Point2, Point3};
use std::collections::BTreeSet;

/// Fewest points of a target: four determine a homography, the rest checks it.
pub(super) const MIN_TARGET_POINTS: usize = 6;

/// A target may be this uneven (largest |z| over its extent) and still start from homographies.
const MAX_RELIEF: f64 = 0.05;

/// Camera, or projector as an inverse camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    /// A camera, which sees the target.
    Camera,
    /// Lights the target; its pixels come from the phase at the target's points.
    Projector,
}

/// A camera or projector to be characterised.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Device {
    /// Name of the device, unique.
    pub name: String,
    /// Whether it is a camera or a projector.
    pub kind: DeviceKind,
    /// Columns of the image, px.
    pub width_px: u32,
    /// Rows of the image, px.
    pub height_px: u32,
}

/// One point of the target in one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagePoint {
    /// Index of the point in [`Observations::target_mm`].
    pub index: usize,
    /// Where it was seen.
    pub pixel: Point2<f64>,
    /// Covariance of `pixel`, px². Only ratios matter when the noise is estimated.
    pub covariance_px2: Matrix2<f64>,
    /// The camera in which the projector's coordinate at the point was read.
    pub link: Option<Link>,
}

/// How a projector's pixel hangs on the pixel in which a camera saw the same point in the same pose.
///
/// The light is read where the camera found the point, so that the camera's error e goes into the projector's pixel as S e.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Index of the camera into [`Observations::devices`].
    pub device: usize,
    /// S: projector pixels per camera pixel.
    pub slopes: Matrix2<f64>,
    /// Covariance of the reading alone, px², without what the camera's error brings.
    pub covariance_px2: Matrix2<f64>,
}

/// One device and one pose of the target.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Index of the device in [`Observations::devices`].
    pub device: usize,
    /// Index of the pose in [`Observations::poses`].
    pub pose: usize,
    /// What was seen; part of the target is enough.
    pub image_points: Vec<ImagePoint>,
    /// Whether the indices may be turned by 180° (a target without marks).
    pub may_be_turned: bool,
}

/// A flat part of a target that has several, such as a side of a cube.
#[derive(Debug, Clone, PartialEq)]
pub struct Face {
    /// Name of the face, for messages.
    pub name: String,
    /// Its first point in [`Observations::target_mm`]; the next face begins after its last.
    pub first: usize,
    /// Where the face is on the target: as declared, or near enough to start from.
    pub target_from_face: Isometry3<f64>,
    /// Whether that is certified; the others are adjusted.
    pub fixed: bool,
}

/// Everything that was observed.
#[derive(Debug, Clone, PartialEq)]
pub struct Observations {
    /// Cameras and projectors, in any order.
    pub devices: Vec<Device>,
    /// Points of the target, mm in its own frame; flat (z small against x and y). Of a target with faces: face by face, each in the
    /// frame of its own.
    pub target_mm: Vec<Point3<f64>>,
    /// Faces of the target in the order of their points; empty for a single flat one.
    pub faces: Vec<Face>,
    /// Names of the poses, for messages.
    pub poses: Vec<String>,
    /// At most one view for each device and pose.
    pub views: Vec<View>,
}

impl Observations {
    /// Checks indices, numbers and the target.
    ///
    /// # Errors
    /// Names the first thing that is wrong.
    pub fn check(&self) -> Result<(), CalibrationError> {
        if self.devices.is_empty() || self.views.is_empty() {
            return Err(CalibrationError::Empty);
        }
        let mut names = BTreeSet::new();
        for device in &self.devices {
            let (width_px, height_px) = (device.width_px, device.height_px);
            if !(2..=65_535).contains(&width_px) || !(2..=65_535).contains(&height_px) {
                return Err(CalibrationError::Size { device: device.name.clone(), width_px, height_px });
            }
            if !names.insert(&device.name) {
                return Err(CalibrationError::Duplicate(device.name.clone()));
            }
        }
        self.check_target()?;
        let mut seen = BTreeSet::new();
        for (number, view) in self.views.iter().enumerate() {
            self.check_view(number, view)?;
            if !seen.insert((view.device, view.pose)) {
                return Err(CalibrationError::Duplicate(self.view_name(view)));
            }
        }
        Ok(())
    }

    /// The face of a point; 0 of a target without faces.
    pub fn face_of(&self, index: usize) -> usize {
        self.faces.iter().rposition(|face| face.first <= index).unwrap_or(0)
    }

    /// The points in the frame of the target, where its faces are as declared, mm.
    pub(super) fn placed_mm(&self) -> Vec<Point3<f64>> {
        let placed = |(index, point): (usize, &Point3<f64>)| match self.faces.get(self.face_of(index)) {
            Some(face) => face.target_from_face * point,
            None => *point,
        };
        self.target_mm.iter().enumerate().map(placed).collect()
    }

    /// "cam1 in pose3"; valid after [`Self::check`].
    pub(super) fn view_name(&self, view: &View) -> String {
        format!("{} in {}", self.devices[view.device].name, self.poses[view.pose])
    }

    fn check_target(&self) -> Result<(), CalibrationError> {
        let starts = self.faces.iter().map(|face| face.first);
        let ends = starts.clone().skip(1).chain([self.target_mm.len()]);
        if self.faces.is_empty() {
            return check_flat(&self.target_mm);
        }
        if self.faces[0].first != 0 {
            let what = format!("its first face begins at point {}, must be 0", self.faces[0].first);
            return Err(CalibrationError::Target { what });
        }
        for (face, (start, end)) in self.faces.iter().zip(starts.zip(ends)) {
            let points = self.target_mm.get(start..end).unwrap_or_default();
            check_flat(points).map_err(|error| match error {
                CalibrationError::Target { what } => {
                    CalibrationError::Target { what: format!("face \"{}\": {what}", face.name) }
                }
                other => other,
            })?;
        }
        Ok(())
    }

    fn check_view(&self, number: usize, view: &View) -> Result<(), CalibrationError> {
        if view.device >= self.devices.len() || view.pose >= self.poses.len() {
            return Err(CalibrationError::Index {
                view: number,
                what: format!("device {} or pose {}", view.device, view.pose),
            });
        }
        let mut indices = BTreeSet::new();
        for image_point in &view.image_points {
            if image_point.index >= self.target_mm.len() || !indices.insert(image_point.index) {
                return Err(CalibrationError::Index {
                    view: number,
                    what: format!("point {}", image_point.index),
                });
            }
            if let Some(link) = &image_point.link
                && (self.devices[view.device].kind != DeviceKind::Projector
                    || self.devices.get(link.device).is_none_or(|d| d.kind != DeviceKind::Camera))
            {
                let what = format!("a camera {} that read this projector", link.device);
                return Err(CalibrationError::Index { view: number, what });
            }
            let linked = image_point.link.as_ref().is_none_or(|link| {
                link.slopes.iter().all(|v| v.is_finite() && v.abs() < 1e9)
                    && is_covariance(&link.covariance_px2)
            });
            let finite = image_point.pixel.iter().all(|v| v.is_finite() && v.abs() < 1e9);
            if !(finite && linked && is_covariance(&image_point.covariance_px2)) {
                return Err(CalibrationError::ImagePoint {
                    view: self.view_name(view),
                    index: image_point.index,
                    pixel: [image_point.pixel.x, image_point.pixel.y],
                });
            }
        }
        Ok(())
    }
}

fn is_covariance(c: &Matrix2<f64>) -> bool {
    c.iter().all(|v| v.is_finite() && v.abs() < 1e9)
        && c.m11 > 1e-18
        && c.m11 * c.m22 - c.m12 * c.m21 > 1e-9 * c.m11 * c.m22
        && (c.m12 - c.m21).abs() <= 1e-9 * (c.m11 + c.m22)
}

/// Refuses points that are too few, that are no lengths, on a line, or uneven.
fn check_flat(target_mm: &[Point3<f64>]) -> Result<(), CalibrationError> {
    let points = target_mm.len();
    if points < MIN_TARGET_POINTS {
        return Err(CalibrationError::Target { what: format!("{points} points, needs {MIN_TARGET_POINTS}") });
    }
    let extent = |axis: usize| {
        let values = target_mm.iter().map(|p| p[axis]);
        let low = values.clone().fold(f64::INFINITY, f64::min);
        values.fold(f64::NEG_INFINITY, f64::max) - low
    };
    if target_mm.iter().any(|p| p.iter().any(|v| !v.is_finite() || v.abs() > 1e7)) {
        return Err(CalibrationError::Target { what: "a coordinate is not a length in mm".into() });
    }
    let (x, y, z) = (extent(0), extent(1), extent(2));
    if x <= 0.0 || y <= 0.0 {
        return Err(CalibrationError::Target { what: "all points lie on a line".into() });
    }
    if z > MAX_RELIEF * x.min(y) {
        return Err(CalibrationError::Target {
            what: format!("it is not flat: z spans {z:.3} mm, limit {:.3} mm", MAX_RELIEF * x.min(y)),
        });
    }
    Ok(())
}
