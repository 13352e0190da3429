//! A camera on the network that may be lost, and found again at the start of a cycle.

use crate::device::{Camera, CameraState};
use crate::error::DeviceError;
use crate::genicam::GenicamDevice;
use cell::configuration::GenicamCamera;

/// A GenICam camera; after its loss each cycle begins with an attempt to take control of it again.
pub(crate) struct ReconnectingCamera {
    name: String,
    wanted: GenicamCamera,
    size_px: [u32; 2],
    fired: usize,
    /// Absent after the camera was lost.
    device: Option<GenicamDevice>,
}

impl ReconnectingCamera {
    /// Takes control of the camera, sets it and starts the acquisition; `fired` frames of a cycle are triggered by the projector.
    pub fn new(
        name: &str,
        wanted: &GenicamCamera,
        size_px: [u32; 2],
        fired: usize,
    ) -> Result<Self, DeviceError> {
        let device = Some(GenicamDevice::new(name, wanted, size_px, fired)?);
        Ok(Self { name: name.to_owned(), wanted: wanted.clone(), size_px, fired, device })
    }

    /// Lets the camera do something; lost, it is let go of, so that the next cycle finds it anew.
    fn with<T>(
        &mut self,
        work: impl FnOnce(&mut GenicamDevice) -> Result<T, DeviceError>,
    ) -> Result<T, DeviceError> {
        let lost = || DeviceError::Frame(format!("camera \"{}\": the connection was lost", self.name));
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
            self.device = Some(GenicamDevice::new(&self.name, &self.wanted, self.size_px, self.fired)?);
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
