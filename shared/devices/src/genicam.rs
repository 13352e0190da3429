//! A GigE Vision camera: found by address or serial number, set, and triggered by software or by the projector.
//!
//! Each setting is read back and compared. A frame is accepted only if it is complete, of the expected size and format, and
//! carries the number after the last one.

mod search;
mod settings;
#[cfg(test)]
mod tests;

use crate::device::{Camera, CameraState, LinkCounts};
use crate::error::DeviceError;
use cell::configuration::GenicamCamera;
use settings::Settings;
use std::sync::Arc;
use std::time::Duration;
use telegenic::gige::GigeConfig;
use telegenic::gige::stream::{Frame, FrameChannel, FrameStatus, StreamChannel};
use telegenic::{GenICamera, PacketSize, SocketOption, StreamConfig};

pub use search::{FoundCamera, choose_camera, find_cameras};
pub(crate) use settings::exposure_key;

/// A frame must arrive so long after its exposure ended, beside the time of the transfer.
const PATIENCE: Duration = Duration::from_secs(3);

/// Frames that the receiver keeps.
const BUFFERS: usize = 4;

/// Block numbers of 16 bits run from 1 to 65535.
const LAST_BLOCK: u64 = 65_535;

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
    device: GenICamera,
    // Stopped by being dropped, before the device is.
    stream: StreamChannel,
    frames: FrameChannel,
    patience: Duration,
    last: u64,
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
        let address = search::address(&wanted)?;
        let mut device = GenICamera::with_config(GigeConfig::new(address));
        device.connect().map_err(|e| fail(&format!("connecting to {address}"), e.to_string()))?;
        let exposure = Settings::of(&mut device, name).apply(&wanted, clock_wait)?;
        let bytes = wanted.size_px[0] as usize * wanted.size_px[1] as usize * 2;
        let payload = device.get_integer("PayloadSize").map_err(|e| fail("PayloadSize", e.to_string()))?;
        let mut stream = StreamConfig::new();
        stream.payload_size = Some(payload.max(0) as usize);
        // A sequence that runs by itself does not wait for its frames to be taken.
        let buffers = BUFFERS + wanted.fired;
        stream.n_buffers = buffers;
        // A whole frame may wait while the receiver does not run; lost packets are asked for until all are there.
        stream.stream_socket = vec![SocketOption::RecvBuffer((2 * bytes).max(8 << 20))];
        stream.packet_request_ratio = 2.0;
        stream.frame_retention = Duration::from_millis(500);
        stream.packet_delay = wanted.settings.packet_delay_ticks;
        stream.packet_size = wanted.settings.packet_bytes.map_or(PacketSize::Auto, PacketSize::Fixed);
        let channel =
            device.transport().open_stream(stream).map_err(|e| fail("opening the stream", e.to_string()))?;
        Settings::of(&mut device, name).check_stream(&wanted)?;
        let has_temperature = device.has_feature("DeviceTemperature");
        let frames = channel.subscribe(buffers);
        device.execute("AcquisitionStart").map_err(|e| fail("AcquisitionStart", e.to_string()))?;
        Ok(Self {
            wanted,
            device,
            stream: channel,
            frames,
            patience: PATIENCE + exposure,
            last: 0,
            taken: 0,
            has_temperature,
            mute: false,
        })
    }

    /// Whether the camera no longer answers, or another client took it.
    pub fn is_lost(&self) -> bool {
        self.mute || !self.device.is_connected()
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
    fn receive(&mut self) -> Result<Arc<Frame>, DeviceError> {
        let Some(frame) = self.frames.wait_for(self.patience) else {
            let seconds = self.patience.as_secs_f64();
            let which = self.which();
            return Err(self.fault(format!("no frame within {seconds:.1} s after the trigger{which}")));
        };
        let expected = if self.last == LAST_BLOCK { 1 } else { self.last + 1 };
        let (got, first) = (frame.frame_id, self.last == 0);
        self.last = got;
        // The camera may have counted before this process began.
        if !first && got != expected {
            let which = self.which();
            return Err(self.fault(format!("frame {got} came where frame {expected} was due{which}")));
        }
        if frame.status != FrameStatus::Complete {
            let reason =
                format!("frame {got} is not complete ({:?}, {} bytes)", frame.status, frame.received_size);
            return Err(self.fault(reason));
        }
        if [frame.width, frame.height] != self.wanted.size_px {
            let [width, height] = self.wanted.size_px;
            let sizes = format!("{} × {} px, the rig file has {width} × {height}", frame.width, frame.height);
            return Err(self.fault(format!("frame {got} has {sizes}")));
        }
        if frame.pixel_format.0 != self.wanted.settings.pixel_format.code() {
            let formats =
                format!("{} where {} was set", frame.pixel_format, self.wanted.settings.pixel_format.name());
            return Err(self.fault(format!("frame {got} has pixel format {formats}")));
        }
        Ok(frame)
    }
}

impl Camera for GenicamDevice {
    fn begin(&mut self, _cycle: u64) -> Result<(), DeviceError> {
        let complete = self.wanted.fired > 0 && self.taken == self.wanted.fired;
        self.taken = 0;
        let surplus = if complete { self.frames.recv_all() } else { Vec::new() };
        if let Some(last) = surplus.last() {
            self.last = last.frame_id;
            let (count, fired) = (surplus.len(), self.wanted.fired);
            return Err(self.fault(format!(
                "{count} more frame(s) came in the last cycle than the {fired} that the projector should have fired"
            )));
        }
        // Frames of a cycle that was broken off.
        while let Some(frame) = self.frames.try_recv() {
            self.last = frame.frame_id;
        }
        Ok(())
    }

    fn expose(&mut self, _projector: usize, _frame: usize, out: &mut [u8]) -> Result<(), DeviceError> {
        let late = if self.wanted.fired == 0 { self.frames.recv_all().len() } else { 0 };
        if late > 0 {
            self.last = 0;
            return Err(self.fault(format!("{late} frame(s) came without a trigger")));
        }
        if self.wanted.fired == 0
            && let Err(error) = self.device.execute("TriggerSoftware")
        {
            self.mute = true;
            return Err(self.fault(format!("TriggerSoftware: {error}")));
        }
        let frame = self.receive()?;
        self.taken += 1;
        if self.wanted.settings.pixel_format.unpack(frame.data(), out) {
            Ok(())
        } else {
            Err(self.fault(format!("{} bytes are no frame of {} bytes", frame.data().len(), out.len())))
        }
    }

    fn set_exposure_us(&mut self, exposure_us: f64) -> Result<f64, DeviceError> {
        let took = Settings::of(&mut self.device, &self.wanted.name).exposure_us(exposure_us)?;
        self.patience = PATIENCE + Duration::from_secs_f64(took.clamp(0.0, 1e7) * 1e-6);
        Ok(took)
    }

    fn state(&mut self) -> CameraState {
        let stats = self.stream.stats();
        let temperature =
            self.has_temperature.then(|| self.device.get_float("DeviceTemperature").ok()).flatten();
        CameraState {
            temperature_c: temperature.filter(|celsius| celsius.is_finite()),
            link: Some(LinkCounts {
                packets: stats.packets,
                lost_packets: stats.missing_packets,
                resent_packets: stats.resent_packets,
                dropped_packets: stats.socket_drops,
                incomplete_frames: stats.failed_frames + stats.timed_out_frames + stats.aborted_frames,
            }),
        }
    }
}
