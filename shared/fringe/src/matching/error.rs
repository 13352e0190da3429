//! Why maps or cameras cannot be matched, and the checks that find out.

use crate::geometry::camera::{Camera, CameraError};
use crate::pattern::Axis;
use crate::phase::PhaseView;
use crate::rectify::RectifyError;
use thiserror::Error;

/// Why a pair cannot be matched.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum MatchError {
    /// A camera with impossible numbers.
    #[error("{side} view of the pair")]
    Camera {
        /// Which view: "left" or "right".
        side: &'static str,
        /// The fault of the camera parameters.
        source: CameraError,
    },
    /// The cameras do not make a pair.
    #[error("geometry of the pair")]
    Geometry(#[from] RectifyError),
    /// A setting out of its limits.
    #[error("{key} = {value} is outside its limits: {limits}")]
    Setting {
        /// Name as in the configuration.
        key: &'static str,
        /// The value that was given.
        value: f64,
        /// The values that are allowed.
        limits: &'static str,
    },
    /// A map does not belong to its camera.
    #[error(
        "the {side} phase map has {map_px:?} px, its camera {camera_px:?} px: decode frames of the calibrated size, \
         or calibrate at this one"
    )]
    Size {
        /// Which view: "left" or "right".
        side: &'static str,
        /// Columns, rows of the map.
        map_px: [u32; 2],
        /// Columns, rows of the camera.
        camera_px: [u32; 2],
    },
    /// A plane of a map is too short or too long.
    #[error(
        "the {side} phase map's plane `{plane}` has {length} values where {expected} pixels need one each"
    )]
    Plane {
        /// Which view: "left" or "right".
        side: &'static str,
        /// Name of the plane.
        plane: &'static str,
        /// Values in the plane.
        length: usize,
        /// Pixels of the map.
        expected: usize,
    },
    /// The maps have different projector axes.
    #[error(
        "the left phase map is along projector axis {left:?}, the right one along {right:?}: both must have the same axis"
    )]
    Axis {
        /// Of the left map.
        left: Axis,
        /// Of the right map.
        right: Axis,
    },
    /// A map has another axis than the one it was given for.
    #[error("a phase map of projector axis {found:?} was given for axis {wanted:?}")]
    WrongAxis {
        /// What it was given for.
        wanted: Axis,
        /// Projector axis that the map was decoded for.
        found: Axis,
    },
    /// The maps have different fringe periods.
    #[error(
        "the left phase map has a period of {left_px} projector px, the right one {right_px}: both must be decoded \
         from the same sequence"
    )]
    Period {
        /// Of the left map.
        left_px: f64,
        /// Of the right map.
        right_px: f64,
    },
    /// The caller's buffer cannot take a full image.
    #[error("the output buffer holds {capacity} points, a full image needs {needed}")]
    BufferTooSmall {
        /// Length of the buffer.
        capacity: usize,
        /// Points that a full image needs.
        needed: usize,
    },
    /// The views of a pair have no phase along the same axis.
    #[error(
        "no phase was given that matching can use: the views need one along the same projector axis, x or y"
    )]
    NoPhase,
}

/// Checks that a map has the size of its camera and complete planes.
pub(crate) fn check_map(side: &'static str, map: &PhaseView, camera: &Camera) -> Result<(), MatchError> {
    let map_px = [map.info.width_px, map.info.height_px];
    let camera_px = [camera.width_px, camera.height_px];
    if map_px != camera_px {
        return Err(MatchError::Size { side, map_px, camera_px });
    }
    let expected = map.info.len();
    let planes = [
        ("phase_rad", map.phase_rad.len()),
        ("sigma_rad", map.sigma_rad.len()),
        ("modulation", map.modulation.len()),
        ("valid", map.valid.len()),
    ];
    if let Some((plane, length)) = planes.into_iter().find(|(_, length)| *length != expected) {
        return Err(MatchError::Plane { side, plane, length, expected });
    }
    let period = map.info.period_px;
    if !(period.is_finite() && period > 0.0) {
        return Err(MatchError::Setting { key: "period_px", value: period, limits: "a positive number" });
    }
    Ok(())
}
