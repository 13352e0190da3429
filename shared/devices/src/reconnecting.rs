//! A camera that may be lost, and found again at the start of a cycle.

use crate::device::{Camera, CameraState};
use crate::error::DeviceError;
use crate::genicam::{GenicamDevice, WantedCamera};
use std::time::Duration;

/// Longest time at the start until a camera's clock follows the network's.
const CLOCK_WAIT: Duration = Duration::from_secs(10);

/// A GenICam camera; after its loss each cycle begins with an attempt to take control of it again.
pub(crate) struct ReconnectingCamera {
    wanted: WantedCamera,
    /// Absent after the camera was lost.
    device: Option<GenicamDevice>,
}

impl ReconnectingCamera {
    /// Takes control of the camera, sets it and starts the acquisition.
    pub fn new(wanted: WantedCamera) -> Result<Self, DeviceError> {
        let device = Some(GenicamDevice::new(wanted.clone(), CLOCK_WAIT)?);
        Ok(Self { wanted, device })
    }

    /// Lets the camera do something; lost, it is let go of, so that the next cycle finds it anew.
    fn with<T>(
        &mut self,
        work: impl FnOnce(&mut GenicamDevice) -> Result<T, DeviceError>,
    ) -> Result<T, DeviceError> {
        let lost = || DeviceError::Frame(format!("camera \"{}\": the connection was lost", self.wanted.name));
        let device = self.device.as_mut().ok_or_else(lost)?;
        let done = work(device);
        if done.is_err() && device.is_lost() {
            self.device = None;
        }
        done
    }
}

impl Camera for ReconnectingCamera {
    fn begin(&mut self, cycle: u64) -> Result<(), DeviceError> {
        if self.device.is_none() {
            // A cycle does not wait for the clock: the next one finds it further.
            self.device = Some(GenicamDevice::new(self.wanted.clone(), Duration::ZERO)?);
        }
        self.with(|device| device.begin(cycle))
    }

    fn expose(&mut self, projector: usize, frame: usize, out: &mut [u8]) -> Result<(), DeviceError> {
        self.with(|device| device.expose(projector, frame, out))
    }

    fn set_exposure_us(&mut self, exposure_us: f64) -> Result<f64, DeviceError> {
        self.with(|device| device.set_exposure_us(exposure_us))
    }

    fn state(&mut self) -> CameraState {
        self.device.as_mut().map_or_else(CameraState::default, Camera::state)
    }
}
