//! A camera by the system library Aravis: USB3 Vision, or GigE Vision.

use super::found::FoundCamera;
use super::link::{LAST_BLOCK, Link, REQUEST_RATIO, RETENTION, Received, Streaming, text};
use crate::device::LinkCounts;
use aravis::glib::prelude::{Cast as _, ObjectExt as _};
use aravis::prelude::*;
use aravis::{
    Buffer, BufferPayloadType, BufferStatus, Camera, Device, GvDevice, GvPacketSizeAdjustment, GvStream,
    GvStreamOption, GvStreamSocketBuffer, RegisterCachePolicy, Stream, UvDevice, UvInterface, glib,
};
use cell::genicam_camera::Transport;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use telegenic::gige::proto::bootstrap::STREAM_CHANNEL_PACKET_DELAY;

/// The library's lists of devices are not made for two threads.
static LISTS: Mutex<()> = Mutex::new(());

/// A camera that this process controls.
pub(crate) struct AravisLink {
    // Before the device, so that it is dropped first.
    stream: Option<Stream>,
    camera: Camera,
    device: Device,
    /// The same device, if it is on the network.
    network: Option<GvDevice>,
    /// The camera does not answer, or another client took it.
    lost: Arc<AtomicBool>,
}

/// Cameras on USB that this user may open.
pub(super) fn usb_cameras() -> Vec<FoundCamera> {
    let _lists = LISTS.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(usb) = UvInterface::instance() else { return Vec::new() };
    usb.update_device_list();
    let text = |text: Option<glib::GString>| text.map_or_else(String::new, Into::into);
    let camera = |number| FoundCamera {
        transport: Transport::Usb3.name(),
        address: None,
        serial: text(usb.device_serial_nbr(number)),
        user_name: String::new(),
        manufacturer: text(usb.device_vendor(number)),
        model: text(usb.device_model(number)),
        version: String::new(),
        mac: String::new(),
        usb_id: text(usb.device_id(number)),
    };
    let mut cameras: Vec<FoundCamera> = (0..usb.n_devices()).map(camera).collect();
    cameras.sort_by(|a, b| a.serial.cmp(&b.serial));
    cameras
}

impl AravisLink {
    /// Takes control of the camera that the library knows by this name or address.
    pub fn connect(transport: Transport, name: &str) -> Result<Self, String> {
        let camera = {
            let _lists = LISTS.lock().unwrap_or_else(PoisonError::into_inner);
            Camera::new(Some(name)).map_err(text)?
        };
        let device = camera.device().ok_or("Aravis gives no device")?;
        let network = device.clone().downcast::<GvDevice>().ok();
        let is_meant = if transport == Transport::Usb3 { device.is::<UvDevice>() } else { network.is_some() };
        if !is_meant {
            return Err(format!("Aravis finds another kind of device by the name {name}"));
        }
        // What is read back comes from the camera.
        device.set_register_cache_policy(RegisterCachePolicy::Disable);
        let lost = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&lost);
        device.connect_control_lost(move |_| told.store(true, Ordering::Relaxed));
        Ok(Self { stream: None, camera, device, network, lost })
    }

    /// Before the stream opens: which packets it has.
    fn set_packets(&self, streaming: &Streaming) -> Result<(), String> {
        let Some(network) = &self.network else { return Ok(()) };
        // Sockets need no right that a user lacks, and see packets on loopback.
        network.set_stream_options(GvStreamOption::PACKET_SOCKET_DISABLED);
        if let Some(bytes) = streaming.packet_bytes {
            network.set_packet_size_adjustment(GvPacketSizeAdjustment::Never);
            network.set_packet_size(bytes.into()).map_err(text)?;
        } else {
            network.set_packet_size_adjustment(GvPacketSizeAdjustment::Always);
        }
        if let Some(ticks) = streaming.packet_delay_ticks {
            network.write_register(STREAM_CHANNEL_PACKET_DELAY.into(), ticks).map_err(text)?;
        }
        Ok(())
    }
}

impl Drop for AravisLink {
    fn drop(&mut self) {
        // A camera that is lost would be waited for.
        if self.stream.is_some() && self.is_connected() {
            let _ = self.camera.stop_acquisition();
        }
    }
}

/// What a buffer holds.
fn received(buffer: &Buffer) -> Received {
    let (id, status, payload) = (buffer.frame_id(), buffer.status(), buffer.payload_type());
    let is_image = matches!(payload, BufferPayloadType::Image | BufferPayloadType::ExtendedChunkData);
    let fault = match status {
        // The library gives no size of a part that is not there.
        BufferStatus::Success if is_image && buffer.n_parts() == 1 => None,
        BufferStatus::Success => {
            Some(format!("{} parts of {payload:?} where an image was due", buffer.n_parts()))
        }
        status => Some(format!("{status:?}")),
    };
    if fault.is_some() {
        return Received { id, fault, size_px: [0, 0], pixel_format: 0, pixels: Box::new(Vec::new()) };
    }
    Received {
        id,
        fault,
        size_px: [buffer.image_width(), buffer.image_height()].map(|size| size.max(0) as u32),
        pixel_format: buffer.image_pixel_format().raw(),
        pixels: Box::new(buffer.image_data()),
    }
}

impl Link for AravisLink {
    fn identity(&mut self) -> [String; 2] {
        let text = |told: Result<glib::GString, glib::Error>| told.map_or_else(|_| String::new(), Into::into);
        [text(self.camera.model_name()), text(self.camera.device_serial_number())]
    }

    fn has(&self, key: &str) -> bool {
        self.device.feature(key).is_some()
    }

    fn execute(&mut self, key: &str) -> Result<(), String> {
        // The library knows what some makes need beside the command.
        match key {
            "AcquisitionStart" => self.camera.start_acquisition(),
            "AcquisitionStop" => self.camera.stop_acquisition(),
            _ => self.device.execute_command(key),
        }
        .map_err(text)
    }

    fn integer(&mut self, key: &str) -> Result<i64, String> {
        self.device.integer_feature_value(key).map_err(text)
    }

    fn set_integer(&mut self, key: &str, value: i64) -> Result<(), String> {
        self.device.set_integer_feature_value(key, value).map_err(text)
    }

    fn integer_limits(&mut self, key: &str) -> Option<[i64; 3]> {
        let (least, most) = self.device.integer_feature_bounds(key).ok()?;
        Some([least, most, self.device.integer_feature_increment(key).unwrap_or(1)])
    }

    fn float(&mut self, key: &str) -> Result<f64, String> {
        self.device.float_feature_value(key).map_err(text)
    }

    fn set_float(&mut self, key: &str, value: f64) -> Result<(), String> {
        self.device.set_float_feature_value(key, value).map_err(text)
    }

    fn float_limits(&mut self, key: &str) -> Option<[f64; 2]> {
        self.device.float_feature_bounds(key).ok().map(|(least, most)| [least, most])
    }

    fn entry(&mut self, key: &str) -> Result<String, String> {
        self.device.string_feature_value(key).map(Into::into).map_err(text)
    }

    fn set_entry(&mut self, key: &str, value: &str) -> Result<(), String> {
        self.device.set_string_feature_value(key, value).map_err(text)
    }

    fn entries(&mut self, key: &str) -> Option<Vec<String>> {
        let entries = self.device.dup_available_enumeration_feature_values_as_strings(key).ok()?;
        Some(entries.into_iter().map(Into::into).collect())
    }

    fn switch(&mut self, key: &str) -> Result<bool, String> {
        self.device.boolean_feature_value(key).map_err(text)
    }

    fn set_switch(&mut self, key: &str, value: bool) -> Result<(), String> {
        self.device.set_boolean_feature_value(key, value).map_err(text)
    }

    fn forget(&mut self) {
        // Nothing is remembered: see `connect`.
    }

    fn register(&self, register: u32) -> Result<u32, String> {
        self.device.read_register(register.into()).map(|(_, value)| value).map_err(text)
    }

    fn open(&mut self, streaming: Streaming) -> Result<(), String> {
        self.set_packets(&streaming)?;
        let stream = self.camera.create_stream().map_err(text)?;
        if let Some(network) = stream.downcast_ref::<GvStream>() {
            network.set_socket_buffer(GvStreamSocketBuffer::Fixed);
            network.set_socket_buffer_size(streaming.socket_bytes.min(i32::MAX as usize) as i32);
            network.set_packet_request_ratio(REQUEST_RATIO);
            network.set_frame_retention(RETENTION.as_micros() as u32);
        }
        for _ in 0..streaming.buffers {
            stream.push_buffer(Buffer::new_allocate(streaming.payload));
        }
        self.stream = Some(stream);
        Ok(())
    }

    fn packet_bytes(&self) -> Option<u16> {
        self.stream.as_ref()?;
        self.network.as_ref()?.packet_size().ok()?.try_into().ok()
    }

    fn next(&mut self, patience: Duration) -> Option<Received> {
        let stream = self.stream.as_ref()?;
        let buffer = stream.timeout_pop_buffer(patience.as_micros() as u64)?;
        let received = received(&buffer);
        stream.push_buffer(buffer);
        Some(received)
    }

    fn discard(&mut self) -> Vec<u64> {
        let Some(stream) = &self.stream else { return Vec::new() };
        let mut ids = Vec::new();
        while let Some(buffer) = stream.try_pop_buffer() {
            ids.push(buffer.frame_id());
            stream.push_buffer(buffer);
        }
        ids
    }

    fn due(&self, last: u64, got: u64) -> u64 {
        if self.network.is_some() && last == LAST_BLOCK && got == 1 { 1 } else { last + 1 }
    }

    fn counts(&self) -> LinkCounts {
        let Some(stream) = &self.stream else { return LinkCounts::default() };
        let (_, failures, underruns) = stream.statistics();
        let mut counts = LinkCounts { incomplete_frames: failures, ..LinkCounts::default() };
        if let Some(network) = stream.downcast_ref::<GvStream>() {
            // Frames without a buffer. On USB the library counts here how often it looked for one.
            counts.incomplete_frames += underruns;
            (counts.resent_packets, counts.lost_packets) = network.statistics();
            counts.packets = stream.info_uint64_by_name("n_received_packets");
        }
        counts
    }

    fn is_connected(&self) -> bool {
        !self.lost.load(Ordering::Relaxed)
    }
}
