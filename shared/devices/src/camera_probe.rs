//! What a camera on the network is, found out by connecting to it as a cell does.

use crate::error::DeviceError;
use crate::genicam::exposure_key;
use std::net::{IpAddr, UdpSocket};
use telegenic::gige::GigeConfig;
use telegenic::gige::discovery::enumerate_adapters;
use telegenic::{GenICamera, StreamConfig};

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
    /// Largest packet that arrived whole, bytes; absent: none did.
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
pub fn probe_camera(address: IpAddr) -> Result<ProbedCamera, DeviceError> {
    let fail = |e: telegenic::GenicamError| DeviceError::Frame(e.to_string());
    let mut device = GenICamera::with_config(GigeConfig::new(address));
    device.connect().map_err(fail)?;
    let mut size = |key| device.get_integer(key).map(|size| size.clamp(0, 1 << 20) as u32).map_err(fail);
    let (width_px, height_px) = (size("Width")?, size("Height")?);
    let told = device.transport().device_info().map(|info| (info.model.clone(), info.serial.clone()));
    let (model, serial) = told.unwrap_or_default();
    let number = |device: &mut GenICamera, key: &str| {
        device
            .has_feature(key)
            .then(|| device.get_float(key).ok())
            .flatten()
            .filter(|value| value.is_finite())
    };
    let exposure = exposure_key(&device);
    let exposure_us = number(&mut device, exposure);
    let temperature_c = number(&mut device, "DeviceTemperature");
    let pixel_formats = device.enum_entries("PixelFormat").unwrap_or_default();
    let (adapter, mtu) = adapter(address);
    Ok(ProbedCamera {
        model,
        serial,
        width_px,
        height_px,
        pixel_formats,
        exposure_us,
        temperature_c,
        packet_bytes: packet_bytes(&mut device),
        adapter,
        mtu,
    })
}

/// Opens a stream, which finds the largest packets that arrive.
fn packet_bytes(device: &mut GenICamera) -> Option<u16> {
    let mut stream = StreamConfig::new();
    stream.payload_size = Some(device.get_integer("PayloadSize").ok()?.clamp(0, 1 << 32) as usize);
    stream.n_buffers = 1;
    device.transport().open_stream(stream).ok().map(|channel| channel.packet_size())
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
