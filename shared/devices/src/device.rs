//! What a camera and a projector have to do.

use crate::error::DeviceError;
use serde::{Deserialize, Serialize};

/// What a camera tells of itself beside its frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraState {
    /// Temperature of the device, °C; absent where it has no such sensor.
    pub temperature_c: Option<f64>,
    /// Counts of the link since the start of the stage; absent without a network.
    pub link: Option<LinkCounts>,
}

/// What came over the network from a camera, and what did not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkCounts {
    /// Packets that arrived whole.
    pub packets: u64,
    /// Packets that were lost for good.
    pub lost_packets: u64,
    /// Packets that arrived after they were asked for again.
    pub resent_packets: u64,
    /// Packets that the computer dropped because its receive buffer was full.
    pub dropped_packets: u64,
    /// Frames that were closed without all their packets.
    pub incomplete_frames: u64,
}

/// A camera that takes frames on a trigger.
pub trait Camera: Send {
    /// A cycle starts: the part stands.
    ///
    /// # Errors
    /// There is no part for this cycle.
    fn begin(&mut self, cycle: u64) -> Result<(), DeviceError>;

    /// Takes the frame of a projector's sequence straight into shared memory: width · height · `bytes_per_px` bytes.
    ///
    /// # Errors
    /// The frame cannot be had, or is of another size than `out`.
    fn expose(&mut self, projector: usize, frame: usize, out: &mut [u8]) -> Result<(), DeviceError>;

    /// Sets the exposure time; returns the time that the device took, µs.
    ///
    /// # Errors
    /// The device has no exposure time, or refuses this one.
    fn set_exposure_us(&mut self, _exposure_us: f64) -> Result<f64, DeviceError> {
        Err(DeviceError::Frame(
            "this camera has no exposure time to set: its frames are a recording".to_owned(),
        ))
    }

    /// What the device tells of itself; what it does not tell is absent.
    fn state(&mut self) -> CameraState {
        CameraState::default()
    }
}

/// A projector, or all of them when they share one driver.
pub trait Projector {
    /// Prepares the projector for a new cycle, counted from 0.
    ///
    /// # Errors
    /// The device is not ready.
    fn begin(&mut self, cycle: u64, now_ns: u64) -> Result<(), DeviceError>;

    /// When the next pattern may be shown, if it has to wait.
    fn due_ns(&self) -> Option<u64>;

    /// Shows a pattern.
    ///
    /// # Errors
    /// The device refuses.
    fn show(&mut self, projector: usize, frame: usize, now_ns: u64) -> Result<(), DeviceError>;
}
