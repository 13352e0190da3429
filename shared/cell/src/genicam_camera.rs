//! A GenICam camera as the configuration describes it.

use crate::pixel_format::PixelFormat;
use std::net::IpAddr;

/// By which way a GenICam camera is reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Transport {
    /// GigE Vision, without a system library.
    #[default]
    Gige,
    /// GigE Vision by the system library Aravis.
    Aravis,
    /// USB3 Vision by the system library Aravis.
    Usb3,
}

impl Transport {
    /// All ways, in the order in which messages name them.
    pub const ALL: [Self; 3] = [Self::Gige, Self::Aravis, Self::Usb3];

    /// Name in the configuration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gige => "gige",
            Self::Aravis => "aravis",
            Self::Usb3 => "usb3",
        }
    }
}

/// How a GenICam camera is found and set.
#[derive(Debug, Clone, PartialEq)]
pub struct GenicamCamera {
    /// By which way it is reached.
    pub transport: Transport,
    /// Address of the device; absent: the serial number counts.
    pub address: Option<IpAddr>,
    /// Serial number, or the name that a person gave the device.
    pub serial: Option<String>,
    /// Format of the pixels.
    pub pixel_format: PixelFormat,
    /// Exposure time, µs; absent: as the camera is.
    pub exposure_us: Option<f64>,
    /// Gain, dB; absent: as the camera is.
    pub gain_db: Option<f64>,
    /// First column and row of the window on the sensor, px; absent: as the camera is.
    pub offset_px: Option<[u32; 2]>,
    /// Size of a packet, headers included, bytes; absent: the largest that arrives.
    pub packet_bytes: Option<u16>,
    /// Pause between two packets, ticks of the camera's clock; absent: as the camera is.
    pub packet_delay_ticks: Option<u32>,
    /// Whether the camera's clock follows that of the network (PTP); absent: as the camera is.
    pub ptp: Option<bool>,
    /// Input that the projector fires, where it shows its sequence in its own time.
    pub trigger_line: String,
}
