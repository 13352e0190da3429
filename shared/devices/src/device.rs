//! What a camera and a projector have to do.

use crate::error::DeviceError;

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
