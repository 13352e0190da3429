//! What a camera is, found out by connecting to it as a cell does.

use crate::error::DeviceError;
use crate::genicam::{LEAST_SOCKET_BYTES, Link, Place, Streaming, connect, exposure_key};
use std::net::{IpAddr, UdpSocket};
use telegenic::gige::discovery::enumerate_adapters;

/// What a camera said of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct ProbedCamera {
    /// Model of the device.
    pub model: String,
    /// Serial number of the device.
    pub serial: String,
    /// Columns of a frame as the camera is set, px.
    pub width_px: u32,
    /// Rows of a frame as the camera is set, px.
    pub height_px: u32,
    /// Names of its pixel formats.
    pub pixel_formats: Vec<String>,
    /// Exposure time as the camera is set, µs.
    pub exposure_us: Option<f64>,
    /// Temperature of the device, °C.
    pub temperature_c: Option<f64>,
    /// Largest packet that arrived whole, bytes; absent: none did, or the camera is on USB.
    pub packet_bytes: Option<u16>,
    /// Name of the adapter towards the camera.
    pub adapter: Option<String>,
    /// Largest packet of that adapter, bytes.
    pub mtu: Option<u32>,
}

/// Takes control of a camera, asks what it is, tries packets, and lets go of it.
///
/// # Errors
/// No device answers there, or another program controls it.
pub fn probe_camera(place: &Place) -> Result<ProbedCamera, DeviceError> {
    let mut link = connect(place).map_err(DeviceError::Frame)?;
    let link = &mut *link;
    let mut size = |key| {
        let size = link.integer(key).map_err(|e| DeviceError::Frame(format!("{key}: {e}")))?;
        Ok::<u32, DeviceError>(size.clamp(0, 1 << 20) as u32)
    };
    let (width_px, height_px) = (size("Width")?, size("Height")?);
    let [model, serial] = link.identity();
    let exposure = exposure_key(link);
    let exposure_us = number(link, exposure);
    let temperature_c = number(link, "DeviceTemperature");
    let pixel_formats = link.entries("PixelFormat").unwrap_or_default();
    let (adapter, mtu) = place.address().map_or((None, None), adapter);
    Ok(ProbedCamera {
        model,
        serial,
        width_px,
        height_px,
        pixel_formats,
        exposure_us,
        temperature_c,
        packet_bytes: packet_bytes(link),
        adapter,
        mtu,
    })
}

/// A number that the camera may not have.
fn number(link: &mut dyn Link, key: &str) -> Option<f64> {
    link.has(key).then(|| link.float(key).ok()).flatten().filter(|value| value.is_finite())
}

/// Opens a stream, which finds the largest packets that arrive.
fn packet_bytes(link: &mut dyn Link) -> Option<u16> {
    let streaming = Streaming {
        payload: link.integer("PayloadSize").ok()?.clamp(0, 1 << 32) as usize,
        buffers: 1,
        socket_bytes: LEAST_SOCKET_BYTES,
        packet_bytes: None,
        packet_delay_ticks: None,
    };
    link.open(streaming).ok()?;
    link.packet_bytes()
}

/// Name and largest packet of the adapter that reaches an address.
fn adapter(address: IpAddr) -> (Option<String>, Option<u32>) {
    if address.is_loopback() {
        return (Some("lo".to_owned()), mtu("lo"));
    }
    let own = UdpSocket::bind("0.0.0.0:0").and_then(|socket| {
        // Sends nothing; the system chooses the way.
        socket.connect((address, 9))?;
        socket.local_addr()
    });
    let Ok(own) = own else { return (None, None) };
    let adapters = enumerate_adapters().unwrap_or_default();
    let name =
        adapters.into_iter().find(|adapter| IpAddr::V4(adapter.ip) == own.ip()).map(|adapter| adapter.name);
    let mtu = name.as_deref().and_then(mtu);
    (name, mtu)
}

fn mtu(adapter: &str) -> Option<u32> {
    let text = std::fs::read_to_string(format!("/sys/class/net/{adapter}/mtu")).ok()?;
    text.trim().parse().ok()
}
