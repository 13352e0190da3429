//! A GenICam camera: found by address or serial number, set, and triggered by software or by the projector.
//!
//! Each setting is read back and compared. A frame is accepted only if it is complete, of the expected size and format, and
//! carries the number after the last one.

#[cfg(feature = "aravis")]
mod aravis_link;
mod connect;
mod found;
mod gige_link;
mod link;
mod search;
mod settings;
#[cfg(test)]
mod tests;

use crate::device::{Camera, CameraState};
use crate::error::DeviceError;
use cell::genicam_camera::GenicamCamera;
use link::Received;
use settings::Settings;
use std::time::Duration;
use telegenic::gige::proto::gvsp::PixelFormat;

pub(crate) use connect::connect;
pub use connect::missing_feature;
pub use found::{FoundCamera, Place};
pub(crate) use link::{LEAST_SOCKET_BYTES, Link, Streaming, exposure_key};
pub use search::{find_cameras, place_of};

/// A frame must arrive so long after its exposure ended, beside the time of the transfer.
const PATIENCE: Duration = Duration::from_secs(3);

/// Frames that the receiver keeps.
const BUFFERS: usize = 4;

/// A camera as the cell wants it.
#[derive(Debug, Clone)]
pub(crate) struct WantedCamera {
    /// Name of the camera in the configuration.
    pub name: String,
    /// How it is found and set.
    pub settings: GenicamCamera,
    /// Columns and rows of a frame, px.
    pub size_px: [u32; 2],
    /// Frames of a cycle that the projector fires; 0: each is triggered by software.
    pub fired: usize,
}

/// The camera of a capture stage.
pub(crate) struct GenicamDevice {
    wanted: WantedCamera,
    link: Box<dyn Link>,
    patience: Duration,
    /// Number of the frame before; absent: the camera may have counted before this process began.
    last: Option<u64>,
    /// Frames that were taken in this cycle.
    taken: usize,
    has_temperature: bool,
    /// A command was not answered.
    mute: bool,
}

impl GenicamDevice {
    /// Takes control of the camera, sets it and starts the acquisition; its clock may take `clock_wait` until it follows the network's.
    pub fn new(wanted: WantedCamera, clock_wait: Duration) -> Result<Self, DeviceError> {
        let name = &wanted.name;
        let fail =
            |what: &str, reason: String| DeviceError::Frame(format!("camera \"{name}\": {what}: {reason}"));
        let place = search::place(&wanted)?;
        let mut link = connect(&place).map_err(|e| fail(&format!("connecting to {place}"), e))?;
        let exposure = Settings::of(&mut *link, name).apply(&wanted, clock_wait)?;
        let bytes = wanted.size_px[0] as usize * wanted.size_px[1] as usize * 2;
        let payload = link.integer("PayloadSize").map_err(|e| fail("PayloadSize", e))?;
        let streaming = Streaming {
            payload: payload.max(0) as usize,
            // A sequence that runs by itself does not wait for its frames to be taken.
            buffers: BUFFERS + wanted.fired,
            // A whole frame may wait while the receiver does not run.
            socket_bytes: (2 * bytes).max(LEAST_SOCKET_BYTES),
            packet_bytes: wanted.settings.packet_bytes,
            packet_delay_ticks: wanted.settings.packet_delay_ticks,
        };
        link.open(streaming).map_err(|e| fail("opening the stream", e))?;
        Settings::of(&mut *link, name).check_stream(&wanted)?;
        let has_temperature = link.has("DeviceTemperature");
        link.execute("AcquisitionStart").map_err(|e| fail("AcquisitionStart", e))?;
        Ok(Self {
            wanted,
            link,
            patience: PATIENCE + exposure,
            last: None,
            taken: 0,
            has_temperature,
            mute: false,
        })
    }

    /// Whether the camera no longer answers, or another client took it.
    pub fn is_lost(&self) -> bool {
        self.mute || !self.link.is_connected()
    }

    fn fault(&self, reason: impl std::fmt::Display) -> DeviceError {
        DeviceError::Frame(format!("camera \"{}\": {reason}", self.wanted.name))
    }

    /// Which frame of a sequence is due, where the projector counts.
    fn which(&self) -> String {
        if self.wanted.fired == 0 {
            return String::new();
        }
        format!(": frame {} of the {} that the projector fires was lost", self.taken + 1, self.wanted.fired)
    }

    /// The next frame, if it is the one that was triggered.
    fn receive(&mut self) -> Result<Received, DeviceError> {
        let Some(frame) = self.link.next(self.patience) else {
            let seconds = self.patience.as_secs_f64();
            let which = self.which();
            return Err(self.fault(format!("no frame within {seconds:.1} s after the trigger{which}")));
        };
        let got = frame.id;
        let due = self.last.replace(got).map(|last| self.link.due(last, got));
        if let Some(due) = due.filter(|due| *due != got) {
            let which = self.which();
            return Err(self.fault(format!("frame {got} came where frame {due} was due{which}")));
        }
        if let Some(fault) = &frame.fault {
            return Err(self.fault(format!("frame {got} is not complete ({fault})")));
        }
        if frame.size_px != self.wanted.size_px {
            let ([columns, rows], [width, height]) = (frame.size_px, self.wanted.size_px);
            let sizes = format!("{columns} × {rows} px, the rig file has {width} × {height}");
            return Err(self.fault(format!("frame {got} has {sizes}")));
        }
        let wanted = self.wanted.settings.pixel_format;
        if frame.pixel_format != wanted.code() {
            let formats = format!("{} where {} was set", PixelFormat(frame.pixel_format), wanted.name());
            return Err(self.fault(format!("frame {got} has pixel format {formats}")));
        }
        Ok(frame)
    }
}

impl Camera for GenicamDevice {
    fn begin(&mut self, _cycle: u64) -> Result<(), DeviceError> {
        let complete = self.wanted.fired > 0 && self.taken == self.wanted.fired;
        self.taken = 0;
        // Of a cycle that was broken off, or too many.
        let surplus = self.link.discard();
        let Some(last) = surplus.last() else { return Ok(()) };
        self.last = Some(*last);
        if !complete {
            return Ok(());
        }
        let (count, fired) = (surplus.len(), self.wanted.fired);
        Err(self.fault(format!(
            "{count} more frame(s) came in the last cycle than the {fired} that the projector should have fired"
        )))
    }

    fn expose(&mut self, _projector: usize, _frame: usize, out: &mut [u8]) -> Result<(), DeviceError> {
        let late = if self.wanted.fired == 0 { self.link.discard().len() } else { 0 };
        if late > 0 {
            self.last = None;
            return Err(self.fault(format!("{late} frame(s) came without a trigger")));
        }
        if self.wanted.fired == 0
            && let Err(error) = self.link.execute("TriggerSoftware")
        {
            self.mute = true;
            return Err(self.fault(format!("TriggerSoftware: {error}")));
        }
        let frame = self.receive()?;
        self.taken += 1;
        let pixels = (*frame.pixels).as_ref();
        if self.wanted.settings.pixel_format.unpack(pixels, out) {
            Ok(())
        } else {
            Err(self.fault(format!("{} bytes are no frame of {} bytes", pixels.len(), out.len())))
        }
    }

    fn set_exposure_us(&mut self, exposure_us: f64) -> Result<f64, DeviceError> {
        let took = Settings::of(&mut *self.link, &self.wanted.name).exposure_us(exposure_us)?;
        self.patience = PATIENCE + Duration::from_secs_f64(took.clamp(0.0, 1e7) * 1e-6);
        Ok(took)
    }

    fn state(&mut self) -> CameraState {
        let temperature = self.has_temperature.then(|| self.link.float("DeviceTemperature").ok()).flatten();
        CameraState {
            temperature_c: temperature.filter(|celsius| celsius.is_finite()),
            link: Some(self.link.counts()),
        }
    }
}
