//! What stands between the cell and its hardware: cameras and projectors, real or not.
//!
//! Everything behind a driver cannot tell which one it was.

mod device;
mod recording;
mod twin;

pub use device::{Camera, Format, Projector};

use crate::graph::Cell;
use anyhow::Result;
use files::config::Driver;

/// The camera of a capture stage.
///
/// # Errors
/// A driver that does not open.
pub fn camera(cell: &Cell, camera: usize) -> Result<Box<dyn Camera>> {
    Ok(match cell.config.cameras[camera].driver {
        Driver::Twin => Box::new(twin::TwinCamera::new(cell, camera)?),
        Driver::Recording => Box::new(recording::RecordedCamera::new(cell, camera)?),
    })
}

/// The projectors of the cell.
pub fn projector(cell: &Cell) -> Box<dyn Projector> {
    let rate_hz = cell.config.recording.as_ref().map_or(0.0, |r| r.rate_hz);
    // The light of the twin and of a recording is in the frames; only the pace is left.
    Box::new(recording::Pace::new(rate_hz))
}
