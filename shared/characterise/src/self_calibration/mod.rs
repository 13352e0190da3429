//! A camera and a projector from what one recording of any object shows, up to scale: no target, no rig.
//!
//! Where two axes were projected, each camera pixel is a correspondence. All of them together determine the fundamental matrix: seven
//! numbers. Five of them are the relative pose without its length; the two that remain are the focal lengths, if principal points,
//! square pixels and lenses without distortion are assumed. What the assumptions cost is stated beside the noise.
//!
//! 1. Fundamental matrix: eight points, least median of squares, then weighted least squares ([`fundamental`]).
//! 2. Refused where a homography explains the correspondences as well: a plane determines nothing.
//! 3. Focal lengths from the matrix in closed form (Bougnoux 1998), else from a grid of starts; pose from the essential matrix.
//! 4. Adjustment of all seven by the reprojection error to first order (Sampson), which is the bundle adjustment with the points
//!    eliminated; robust weights; covariance. Refused where focal lengths remain open, as where both optical axes meet.
//!
//! Source: Hartley, Zisserman, "Multiple View Geometry", 2003, 9.6, 11.4, 19.

mod adjust;
mod fundamental;
#[cfg(test)]
mod tests;

use fringe::geometry::camera::Camera;
use fringe::math::statistics::sigma_by_median;
use nalgebra::{Matrix3, Point2, Vector3};
use thiserror::Error;

/// Distance of both optical centres that the result has, mm: the true one cannot be seen.
pub const BASELINE_MM: f64 = 100.0;

/// Fewest correspondences: a hundred for each of the seven numbers.
const LEAST: usize = 700;
/// Correspondences that are used, taken evenly: more only hide what their errors have in common.
const MOST: usize = 4000;
/// A homography must be so many times worse than the epipolar geometry, in robust standard deviations.
const RELIEF: f64 = 4.0;
/// Largest relative standard uncertainty of a focal length by noise.
const OPEN: f64 = 0.05;
/// Largest part of correspondences that contradict the result.
const CONTRADICTING: f64 = 0.3;
/// Assumed standard uncertainty of the camera's principal point, of its image's width and height.
const U_CENTRE: f64 = 0.02;
/// The same of the projector, whose lens is often shifted along the image's height.
const U_PROJECTOR_CENTRE: [f64; 2] = [0.02, 0.1];

/// A pixel of the camera and the pixel of the projector that lights it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correspondence {
    /// Pixel of the camera, px.
    pub camera: Point2<f64>,
    /// Pixel of the projector, px.
    pub projector: Point2<f64>,
    /// Standard uncertainties of the projector's pixel along both axes, px.
    pub sigma_px: [f64; 2],
}

/// Why nothing can be calibrated.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum SelfCalibrationError {
    /// Too few pixels have coordinates along both axes.
    #[error("{found} pixels have projector coordinates along both axes, needs {LEAST}")]
    Few {
        /// Number of correspondences that were given.
        found: usize,
    },
    /// The correspondences agree with no epipolar geometry.
    #[error("the correspondences agree with no epipolar geometry: are axes and sizes right?")]
    NoGeometry,
    /// One plane explains everything.
    #[error(
        "what was recorded is a plane to {plane_px:.2} px (noise {noise_px:.2} px), which determines no focal length; record something \
         with relief"
    )]
    Plane {
        /// Robust standard deviation from a homography, px of the projector.
        plane_px: f64,
        /// Robust standard deviation from the epipolar lines, px of the projector.
        noise_px: f64,
    },
    /// Focal lengths and pose cannot be told apart.
    #[error(
        "the focal lengths are open ({what}): the optical axes nearly meet, or the relief is too low; use a calibration target"
    )]
    Open {
        /// What was found, with its uncertainty.
        what: String,
    },
}

/// A focal length with its standard uncertainties.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FocalLength {
    /// Focal length along both axes, px.
    pub px: f64,
    /// Standard uncertainty by noise, px.
    pub u_noise_px: f64,
    /// Standard uncertainty by the assumed principal points, px.
    pub u_centres_px: f64,
}

/// A camera and a projector, up to scale.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfCalibration {
    /// The camera, whose frame is the world.
    pub camera: Camera,
    /// The projector, [`BASELINE_MM`] from the camera.
    pub projector: Camera,
    /// Focal lengths of camera and projector.
    pub focal: [FocalLength; 2],
    /// Angle between both optical axes, rad.
    pub angle_rad: f64,
    /// Correspondences used, and how many of them contradict.
    pub used: usize,
    /// Correspondences that contradict the result.
    pub outliers: usize,
    /// Robust standard deviation from the epipolar lines, px of the projector.
    pub residual_px: f64,
    /// Robust standard deviation from the best homography, px of the projector: how much relief there is.
    pub relief_px: f64,
}

/// Calibrates a camera and a projector from correspondences alone; sizes are columns and rows, px.
///
/// # Errors
/// See [`SelfCalibrationError`].
pub fn self_calibrate(
    all: &[Correspondence],
    camera_px: [u32; 2],
    projector_px: [u32; 2],
) -> Result<SelfCalibration, SelfCalibrationError> {
    let usable = |c: &&Correspondence| {
        let numbers = [c.camera.x, c.camera.y, c.projector.x, c.projector.y, c.sigma_px[0], c.sigma_px[1]];
        numbers.iter().all(|v| v.is_finite()) && c.sigma_px.iter().all(|s| *s > 0.0)
    };
    let usable: Vec<Correspondence> = all.iter().filter(usable).copied().collect();
    if usable.len() < LEAST {
        return Err(SelfCalibrationError::Few { found: usable.len() });
    }
    let every = usable.len().div_ceil(MOST);
    let some: Vec<Correspondence> = usable.into_iter().step_by(every).collect();
    let middle = |[w, h]: [u32; 2]| [0.5 * (f64::from(w) - 1.0), 0.5 * (f64::from(h) - 1.0)];
    let centres = [middle(camera_px), middle(projector_px)];
    let sights = fundamental::Sights::new(&some, centres);
    let matrix = fundamental::robust(&sights).ok_or(SelfCalibrationError::NoGeometry)?;
    let noise_px = spread(&sights, |i| fundamental::distance_px(&matrix, &sights, i));
    let plane = fundamental::homography(&sights).ok_or(SelfCalibrationError::NoGeometry)?;
    let plane_px = spread(&sights, |i| fundamental::off_plane_px(&plane, &sights, i));
    if plane_px < RELIEF * noise_px {
        return Err(SelfCalibrationError::Plane { plane_px, noise_px });
    }
    let sizes = [camera_px, projector_px].map(|[w, h]| 0.5 * f64::from(w + h));
    let found = adjust::adjusted(&matrix, &sights, sizes).ok_or_else(|| SelfCalibrationError::Open {
        what: "none that a lens has agrees with the epipolar geometry".into(),
    })?;
    let open = |i: usize| found.u_log_focal[i].is_nan() || found.u_log_focal[i] >= OPEN;
    if open(0) || open(1) {
        let what = format!(
            "camera {:.0} ± {:.0} px, projector {:.0} ± {:.0} px by noise",
            found.focal_px[0],
            found.focal_px[0] * found.u_log_focal[0],
            found.focal_px[1],
            found.focal_px[1] * found.u_log_focal[1]
        );
        return Err(SelfCalibrationError::Open { what });
    }
    if found.outliers as f64 > CONTRADICTING * some.len() as f64 {
        return Err(SelfCalibrationError::NoGeometry);
    }
    let u_centres = by_centres(&some, centres, [camera_px, projector_px], sizes, &found);
    let focal = [0, 1].map(|i| FocalLength {
        px: found.focal_px[i],
        u_noise_px: found.focal_px[i] * found.u_log_focal[i],
        u_centres_px: u_centres[i],
    });
    let (camera, projector) = found.cameras(centres, [camera_px, projector_px]);
    let axis = found.rotation.transpose() * Vector3::z();
    Ok(SelfCalibration {
        camera,
        projector,
        focal,
        angle_rad: fringe::math::atan2(axis.xy().norm(), axis.z),
        used: some.len(),
        outliers: found.outliers,
        residual_px: noise_px,
        relief_px: plane_px,
    })
}

/// Robust standard deviation over all sights.
fn spread(sights: &fundamental::Sights, of: impl Fn(usize) -> f64) -> f64 {
    let mut values: Vec<f64> = (0..sights.len()).map(of).collect();
    sigma_by_median(&mut values).unwrap_or(f64::INFINITY)
}

/// How far the focal lengths move when each principal point does by its assumed uncertainty; infinite where that leaves no solution.
fn by_centres(
    some: &[Correspondence],
    centres: [[f64; 2]; 2],
    sizes_px: [[u32; 2]; 2],
    sizes: [f64; 2],
    found: &adjust::Adjusted,
) -> [f64; 2] {
    let mut squares = [0.0; 2];
    for (device, part) in [[U_CENTRE; 2], U_PROJECTOR_CENTRE].into_iter().enumerate() {
        for axis in 0..2 {
            let mut moved = centres;
            moved[device][axis] += part[axis] * f64::from(sizes_px[device][axis]);
            let sights = fundamental::Sights::new(some, moved);
            let again = adjust::readjusted(&sights, found, sizes);
            for (i, square) in squares.iter_mut().enumerate() {
                *square +=
                    again.as_ref().map_or(f64::INFINITY, |a| (a.focal_px[i] - found.focal_px[i]).powi(2));
            }
        }
    }
    squares.map(f64::sqrt)
}

/// The matrix of the cross product with a vector.
fn cross(v: &Vector3<f64>) -> Matrix3<f64> {
    v.cross_matrix()
}
