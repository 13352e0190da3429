//! A GigE Vision camera without a system library.

use super::link::{LAST_BLOCK, Link, REQUEST_RATIO, RETENTION, Received, Streaming, text};
use crate::device::LinkCounts;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use telegenic::gige::GigeConfig;
use telegenic::gige::stream::{Frame, FrameChannel, FrameStatus, StreamChannel};
use telegenic::{GenICamera, PacketSize, ResponseHandle, SocketOption, StreamConfig};

/// Longest time for an answer about a register.
const ANSWER: Duration = Duration::from_secs(2);

/// The stream of a camera; stopped by being dropped.
struct Open {
    channel: StreamChannel,
    frames: FrameChannel,
}

/// A camera that this process controls.
pub(crate) struct GigeLink {
    // Before the device, so that it is dropped first.
    stream: Option<Open>,
    device: GenICamera,
}

/// A frame that the receiver lends.
struct Lent(Arc<Frame>);

impl AsRef<[u8]> for Lent {
    fn as_ref(&self) -> &[u8] {
        self.0.data()
    }
}

impl GigeLink {
    /// Takes control of the camera at an address.
    pub fn connect(address: IpAddr) -> Result<Self, String> {
        let mut device = GenICamera::with_config(GigeConfig::new(address));
        device.connect().map_err(text)?;
        Ok(Self { stream: None, device })
    }
}

impl Link for GigeLink {
    fn identity(&mut self) -> [String; 2] {
        let told = self.device.transport().device_info();
        told.map_or([const { String::new() }; 2], |info| [info.model.clone(), info.serial.clone()])
    }

    fn has(&self, key: &str) -> bool {
        self.device.has_feature(key)
    }

    fn execute(&mut self, key: &str) -> Result<(), String> {
        self.device.execute(key).map_err(text)
    }

    fn integer(&mut self, key: &str) -> Result<i64, String> {
        self.device.get_integer(key).map_err(text)
    }

    fn set_integer(&mut self, key: &str, value: i64) -> Result<(), String> {
        self.device.set_integer(key, value).map_err(text)
    }

    fn integer_limits(&mut self, key: &str) -> Option<[i64; 3]> {
        let (least, most) = self.device.integer_bounds(key).ok()?;
        Some([least, most, self.device.integer_increment(key).unwrap_or(1)])
    }

    fn float(&mut self, key: &str) -> Result<f64, String> {
        self.device.get_float(key).map_err(text)
    }

    fn set_float(&mut self, key: &str, value: f64) -> Result<(), String> {
        self.device.set_float(key, value).map_err(text)
    }

    fn float_limits(&mut self, key: &str) -> Option<[f64; 2]> {
        self.device.float_bounds(key).ok().map(|(least, most)| [least, most])
    }

    fn entry(&mut self, key: &str) -> Result<String, String> {
        self.device.get_enum(key).map_err(text)
    }

    fn set_entry(&mut self, key: &str, value: &str) -> Result<(), String> {
        self.device.set_enum(key, value).map_err(text)
    }

    fn entries(&mut self, key: &str) -> Option<Vec<String>> {
        self.device.enum_entries(key).ok()
    }

    fn switch(&mut self, key: &str) -> Result<bool, String> {
        self.device.get_boolean(key).map_err(text)
    }

    fn set_switch(&mut self, key: &str, value: bool) -> Result<(), String> {
        self.device.set_boolean(key, value).map_err(text)
    }

    fn forget(&mut self) {
        let _ = self.device.invalidate_caches();
    }

    fn register(&self, register: u32) -> Result<u32, String> {
        let answer = self.device.transport().read_register(register).map_err(text)?;
        ResponseHandle::wait_timeout(&answer, ANSWER).map_err(text)
    }

    fn open(&mut self, streaming: Streaming) -> Result<(), String> {
        let mut stream = StreamConfig::new();
        stream.payload_size = Some(streaming.payload);
        stream.n_buffers = streaming.buffers;
        stream.stream_socket = vec![SocketOption::RecvBuffer(streaming.socket_bytes)];
        stream.packet_request_ratio = REQUEST_RATIO;
        stream.frame_retention = RETENTION;
        stream.packet_delay = streaming.packet_delay_ticks;
        stream.packet_size = streaming.packet_bytes.map_or(PacketSize::Auto, PacketSize::Fixed);
        let channel = self.device.transport().open_stream(stream).map_err(text)?;
        let frames = channel.subscribe(streaming.buffers);
        self.stream = Some(Open { channel, frames });
        Ok(())
    }

    fn packet_bytes(&self) -> Option<u16> {
        self.stream.as_ref().map(|open| open.channel.packet_size())
    }

    fn next(&mut self, patience: Duration) -> Option<Received> {
        let frame = self.stream.as_ref()?.frames.wait_for(patience)?;
        let whole = frame.status == FrameStatus::Complete;
        Some(Received {
            id: frame.frame_id,
            fault: (!whole).then(|| format!("{:?}, {} bytes", frame.status, frame.received_size)),
            size_px: [frame.width, frame.height],
            pixel_format: frame.pixel_format.0,
            pixels: Box::new(Lent(frame)),
        })
    }

    fn discard(&mut self) -> Vec<u64> {
        let frames = self.stream.as_ref().map(|open| open.frames.recv_all());
        frames.unwrap_or_default().iter().map(|frame| frame.frame_id).collect()
    }

    fn due(&self, last: u64, _got: u64) -> u64 {
        if last == LAST_BLOCK { 1 } else { last + 1 }
    }

    fn counts(&self) -> LinkCounts {
        let Some(open) = &self.stream else { return LinkCounts::default() };
        let stats = open.channel.stats();
        LinkCounts {
            packets: stats.packets,
            lost_packets: stats.missing_packets,
            resent_packets: stats.resent_packets,
            dropped_packets: stats.socket_drops,
            incomplete_frames: stats.failed_frames + stats.timed_out_frames + stats.aborted_frames,
        }
    }

    fn is_connected(&self) -> bool {
        self.device.is_connected()
    }
}
