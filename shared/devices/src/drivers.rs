//! Registered drivers: which type drives a camera or a projector of the configuration.

use crate::device::{Camera, Projector};
use crate::error::DeviceError;
use crate::load::LoadedCell;
use crate::{recording, twin_camera};
use cell::configuration::Driver;

/// Opens the camera of a capture stage with the driver of its configuration.
///
/// # Errors
/// A driver that does not open.
pub fn camera(cell: &LoadedCell, camera: usize) -> Result<Box<dyn Camera>, DeviceError> {
    Ok(match cell.config.cameras[camera].driver {
        Driver::Twin => Box::new(twin_camera::TwinCamera::new(cell, camera)?),
        Driver::Recording => Box::new(recording::RecordedCamera::new(cell, camera)?),
    })
}

/// The projectors of the cell.
pub fn projector(cell: &LoadedCell) -> Box<dyn Projector> {
    let rate_hz = cell.file.recording.as_ref().map_or(0.0, |r| r.rate_hz);
    // Frames of the twin and of a recording already contain the projected light; only the pace remains.
    Box::new(recording::Pace::new(rate_hz))
}
