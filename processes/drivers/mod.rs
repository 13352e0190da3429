//! What stands between the cell and its hardware: cameras and projectors, real or not.
//!
//! Everything behind a driver cannot tell which one it was.

mod recording;
mod twin;

use crate::graph::Cell;
use anyhow::Result;
use rig::config::Driver;

/// How a camera delivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Format {
    /// 1 or 2.
    pub bytes_per_px: u32,
    /// Grey value of a full pixel.
    pub full_scale_dn: u16,
}

impl Format {
    /// Whole bytes for a full scale.
    pub fn of(full_scale_dn: u16) -> Self {
        Self { bytes_per_px: if full_scale_dn > 255 { 2 } else { 1 }, full_scale_dn }
    }
}

/// A camera.
pub trait Camera {
    /// A cycle starts: the part stands.
    fn begin(&mut self, cycle: u64) -> Result<()>;

    /// Takes the frame of a projector's sequence straight into shared memory: width · height · `bytes_per_px` bytes.
    fn expose(&mut self, projector: usize, frame: usize, out: &mut [u8]) -> Result<()>;
}

/// A projector, or all of them when they share one driver.
pub trait Projector {
    /// A cycle starts.
    fn begin(&mut self, now_ns: u64);

    /// When the next pattern may be shown, if it has to wait.
    fn due_ns(&self) -> Option<u64>;

    /// Shows a pattern.
    fn show(&mut self, projector: usize, frame: usize, now_ns: u64) -> Result<()>;
}

/// The camera of a capture stage.
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
