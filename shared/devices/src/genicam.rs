//! A GigE Vision camera: found by address or serial number, set, and triggered by software or by the projector.
//!
//! Each setting is read back and compared. A frame is accepted only if it is complete, of the expected size and format, and
//! carries the number after the last one.

use crate::device::{Camera, CameraState, LinkCounts};
use crate::error::DeviceError;
use cell::configuration::GenicamCamera;
use cell::pixel_format::PixelFormat;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;
use telegenic::gige::GigeConfig;
use telegenic::gige::discovery::{
    DiscoveredDevice, DiscoveryConfig, NetworkAdapter, discover, enumerate_adapters,
};
use telegenic::gige::stream::{Frame, FrameChannel, FrameStatus, StreamChannel};
use telegenic::{GenICamera, SocketOption, StreamConfig};

/// How long devices may take to answer a search: the standard lets them wait for a second.
const SEARCH: Duration = Duration::from_millis(1200);

/// A frame must arrive so long after its exposure ended, beside the time of the transfer.
const PATIENCE: Duration = Duration::from_secs(3);

/// Frames that the receiver keeps.
const BUFFERS: usize = 4;

/// Block numbers of 16 bits run from 1 to 65535.
const LAST_BLOCK: u64 = 65_535;

/// A device that answered a search.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct FoundCamera {
    /// Address of the device.
    pub address: Ipv4Addr,
    /// Serial number of the device.
    pub serial: String,
    /// Name that a person gave it; may be empty.
    pub user_name: String,
    /// Manufacturer of the device.
    pub manufacturer: String,
    /// Model of the device.
    pub model: String,
    /// Version of the device.
    pub version: String,
    /// Hardware address, hexadecimal bytes.
    pub mac: String,
}

/// Searches all network adapters for cameras; sorted by address.
///
/// # Errors
/// No adapter can be used.
pub fn find_cameras() -> Result<Vec<FoundCamera>, DeviceError> {
    let fail = |e: &dyn std::fmt::Display| DeviceError::Frame(format!("searching for cameras: {e}"));
    let mut adapters = enumerate_adapters().map_err(|e| fail(&e))?;
    // Simulated cameras are on this computer.
    adapters.push(NetworkAdapter {
        name: "lo".to_owned(),
        ip: Ipv4Addr::LOCALHOST,
        netmask: Ipv4Addr::new(255, 0, 0, 0),
        broadcast: Ipv4Addr::new(127, 255, 255, 255),
    });
    let config =
        DiscoveryConfig { adapters: Some(adapters), recv_window: SEARCH, ..DiscoveryConfig::default() };
    let found = discover(&config).map_err(|e| fail(&e))?;
    let mut cameras: Vec<FoundCamera> = found.iter().map(describe).collect();
    cameras.sort_by_key(|camera| camera.address);
    Ok(cameras)
}

fn describe(device: &DiscoveredDevice) -> FoundCamera {
    let info = &device.info;
    FoundCamera {
        address: info.ip,
        serial: info.serial.clone(),
        user_name: info.user_defined_name.clone(),
        manufacturer: info.manufacturer.clone(),
        model: info.model.clone(),
        version: info.device_version.clone(),
        mac: info.mac.map(|byte| format!("{byte:02x}")).join(":"),
    }
}

/// The camera of a capture stage.
pub(crate) struct GenicamDevice {
    name: String,
    device: GenICamera,
    // Stopped by being dropped, before the device is.
    stream: StreamChannel,
    frames: FrameChannel,
    size_px: [u32; 2],
    format: PixelFormat,
    patience: Duration,
    last: u64,
    /// Frames of a cycle that the projector fires; 0: each is triggered by software.
    fired: usize,
    /// Frames that were taken in this cycle.
    taken: usize,
    has_temperature: bool,
    /// A command was not answered.
    mute: bool,
}

impl GenicamDevice {
    /// Takes control of the camera, sets it and starts the acquisition.
    ///
    /// `fired` frames of a cycle are triggered by the projector; 0: each by software.
    pub fn new(
        name: &str,
        wanted: &GenicamCamera,
        size_px: [u32; 2],
        fired: usize,
    ) -> Result<Self, DeviceError> {
        let fail =
            |what: &str, reason: String| DeviceError::Frame(format!("camera \"{name}\": {what}: {reason}"));
        let address = address(name, wanted)?;
        let mut device = GenICamera::with_config(GigeConfig::new(address));
        device.connect().map_err(|e| fail(&format!("connecting to {address}"), e.to_string()))?;
        let exposure =
            set(&mut device, wanted, size_px, fired > 0).map_err(|(what, reason)| fail(&what, reason))?;
        let bytes = size_px[0] as usize * size_px[1] as usize * 2;
        let payload = device.get_integer("PayloadSize").map_err(|e| fail("PayloadSize", e.to_string()))?;
        let mut stream = StreamConfig::new();
        stream.payload_size = Some(payload.max(0) as usize);
        // A sequence that runs by itself does not wait for its frames to be taken.
        let buffers = BUFFERS + fired;
        stream.n_buffers = buffers;
        // A whole frame may wait while the receiver does not run; lost packets are asked for until all are there.
        stream.stream_socket = vec![SocketOption::RecvBuffer((2 * bytes).max(8 << 20))];
        stream.packet_request_ratio = 2.0;
        stream.frame_retention = Duration::from_millis(500);
        stream.packet_delay = wanted.packet_delay_ticks;
        let channel =
            device.transport().open_stream(stream).map_err(|e| fail("opening the stream", e.to_string()))?;
        let has_temperature = device.has_feature("DeviceTemperature");
        let frames = channel.subscribe(buffers);
        device.execute("AcquisitionStart").map_err(|e| fail("AcquisitionStart", e.to_string()))?;
        Ok(Self {
            name: name.to_owned(),
            device,
            stream: channel,
            frames,
            size_px,
            format: wanted.pixel_format,
            patience: PATIENCE + exposure,
            last: 0,
            fired,
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
        DeviceError::Frame(format!("camera \"{}\": {reason}", self.name))
    }

    /// Which frame of a sequence is due, where the projector counts.
    fn which(&self) -> String {
        if self.fired == 0 {
            return String::new();
        }
        format!(": frame {} of the {} that the projector fires was lost", self.taken + 1, self.fired)
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
        if [frame.width, frame.height] != self.size_px {
            let [width, height] = self.size_px;
            let sizes = format!("{} × {} px, the rig file has {width} × {height}", frame.width, frame.height);
            return Err(self.fault(format!("frame {got} has {sizes}")));
        }
        if frame.pixel_format.0 != self.format.code() {
            let formats = format!("{} where {} was set", frame.pixel_format, self.format.name());
            return Err(self.fault(format!("frame {got} has pixel format {formats}")));
        }
        Ok(frame)
    }
}

impl Camera for GenicamDevice {
    fn begin(&mut self, _cycle: u64) -> Result<(), DeviceError> {
        let complete = self.fired > 0 && self.taken == self.fired;
        self.taken = 0;
        let surplus = if complete { self.frames.recv_all() } else { Vec::new() };
        if let Some(last) = surplus.last() {
            self.last = last.frame_id;
            let (count, fired) = (surplus.len(), self.fired);
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
        let late = if self.fired == 0 { self.frames.recv_all().len() } else { 0 };
        if late > 0 {
            self.last = 0;
            return Err(self.fault(format!("{late} frame(s) came without a trigger")));
        }
        if self.fired == 0
            && let Err(error) = self.device.execute("TriggerSoftware")
        {
            self.mute = true;
            return Err(self.fault(format!("TriggerSoftware: {error}")));
        }
        let frame = self.receive()?;
        self.taken += 1;
        if self.format.unpack(frame.data(), out) {
            Ok(())
        } else {
            Err(self.fault(format!("{} bytes are no frame of {} bytes", frame.data().len(), out.len())))
        }
    }

    fn set_exposure_us(&mut self, exposure_us: f64) -> Result<f64, DeviceError> {
        let key = exposure_key(&self.device);
        let took = set_float(&mut self.device, key, exposure_us);
        let took = took.map_err(|(key, reason)| self.fault(format!("{key}: {reason}")))?;
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

/// The address of the camera: as written, or that of the device with the serial number.
fn address(name: &str, wanted: &GenicamCamera) -> Result<IpAddr, DeviceError> {
    if let Some(address) = wanted.address {
        return Ok(address);
    }
    let serial = wanted.serial.as_deref().unwrap_or_default();
    let found = find_cameras()?;
    if let Some(camera) = found.iter().find(|camera| camera.serial == serial || camera.user_name == serial) {
        return Ok(camera.address.into());
    }
    let known: Vec<String> = found.iter().map(|c| format!("{} at {}", c.serial, c.address)).collect();
    let known = if known.is_empty() { "no camera answers".to_owned() } else { known.join(", ") };
    Err(DeviceError::Frame(format!(
        "camera \"{name}\": no device has the serial number or name \"{serial}\"; found: {known}; see `fringetool cameras`"
    )))
}

/// Sets the camera and reads every setting back; the exposure time.
fn set(
    device: &mut GenICamera,
    wanted: &GenicamCamera,
    size_px: [u32; 2],
    fired: bool,
) -> Result<Duration, (String, String)> {
    let fail = |what: &str| {
        let what = what.to_owned();
        move |e: telegenic::GenicamError| (what, e.to_string())
    };
    for (key, size) in [("Width", size_px[0]), ("Height", size_px[1])] {
        let size = i64::from(size);
        let mut is = device.get_integer(key).map_err(fail(key))?;
        if is != size {
            device.set_integer(key, size).map_err(fail(key))?;
            is = device.get_integer(key).map_err(fail(key))?;
        }
        if is != size {
            return Err((key.to_owned(), format!("is {is}, the rig file has {size}")));
        }
    }
    set_enum(device, "PixelFormat", wanted.pixel_format.name())?;
    if device.has_feature("TriggerSelector") {
        set_enum(device, "TriggerSelector", "FrameStart")?;
    }
    set_enum(device, "TriggerMode", "On")?;
    set_enum(device, "TriggerSource", if fired { &wanted.trigger_line } else { "Software" })?;
    let exposure = exposure_key(device);
    for (key, value) in [(exposure, wanted.exposure_us), ("Gain", wanted.gain_db)] {
        let Some(value) = value else { continue };
        set_float(device, key, value)?;
    }
    let exposure_us = device.get_float(exposure).unwrap_or(0.0);
    Ok(Duration::from_secs_f64(exposure_us.clamp(0.0, 1e7) * 1e-6))
}

/// The feature of the exposure time; older cameras have it by another name.
pub(crate) fn exposure_key(device: &GenICamera) -> &'static str {
    if device.has_feature("ExposureTime") { "ExposureTime" } else { "ExposureTimeAbs" }
}

/// Sets a number, reads it back and compares; the number that the camera took.
fn set_float(device: &mut GenICamera, key: &str, value: f64) -> Result<f64, (String, String)> {
    let fail = |e: telegenic::GenicamError| (key.to_owned(), e.to_string());
    device.set_float(key, value).map_err(fail)?;
    let is = device.get_float(key).map_err(fail)?;
    // Cameras round to their clock and steps.
    if (is - value).abs() > 0.01 * value.abs().max(0.1) {
        return Err((key.to_owned(), format!("is {is} after {value} was set")));
    }
    Ok(is)
}

fn set_enum(device: &mut GenICamera, key: &str, value: &str) -> Result<(), (String, String)> {
    let fail = |e: telegenic::GenicamError| (key.to_owned(), e.to_string());
    if let Err(error) = device.set_enum(key, value) {
        let entries = device.enum_entries(key).unwrap_or_default().join(", ");
        return Err((key.to_owned(), format!("{value} is refused ({error}); the camera has {entries}")));
    }
    let is = device.get_enum(key).map_err(fail)?;
    if is == value { Ok(()) } else { Err((key.to_owned(), format!("is {is} after {value} was set"))) }
}
