//! What a projector that this computer drives itself has to do.

use crate::error::DeviceError;

/// One projector with its sequence.
pub trait Light {
    /// Shows a frame of the sequence, counted from 0; returns when its light stands.
    ///
    /// # Errors
    /// The device is gone or shows something else.
    fn show(&mut self, frame: usize) -> Result<(), DeviceError>;

    /// Shows the whole sequence once in the device's own time, and fires the cameras with each frame; returns at the start.
    ///
    /// # Errors
    /// The device cannot do that, or is gone.
    fn run(&mut self) -> Result<(), DeviceError> {
        Err(DeviceError::Missing("projector that shows its sequence by itself"))
    }

    /// Shows nothing: another projector has its turn.
    ///
    /// # Errors
    /// The device is gone.
    fn darken(&mut self) -> Result<(), DeviceError>;
}
