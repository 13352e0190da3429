//! What stands between the cell and its hardware: cameras and projectors, real or not.
//!
//! Everything behind a driver cannot tell which one it was.

#![forbid(unsafe_code)]

mod device;
mod driven;
mod error;
mod load;
mod recording;
mod twin_camera;
pub mod twin_source;

pub use device::{Camera, Projector};
pub use driven::Driven;
pub use error::DeviceError;
pub use load::{LoadedCell, check, load};

use cell::configuration::Driver;

/// The camera of a capture stage.
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
    // The light of the twin and of a recording is in the frames; only the pace is left.
    Box::new(recording::Pace::new(rate_hz))
}
