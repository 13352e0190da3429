//! Who a simulated camera is, and what is particular about it.

use cell::pixel_format::PixelFormat;
use std::net::Ipv4Addr;

/// How the device identifies itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Address of the device.
    pub address: Ipv4Addr,
    /// Hardware address; unique on the network.
    pub mac: [u8; 6],
    /// Serial number, up to 15 characters.
    pub serial: String,
    /// Name that a person gave it, up to 15 characters.
    pub user_name: String,
    /// Columns of a frame, px.
    pub width_px: u32,
    /// Rows of a frame, px.
    pub height_px: u32,
    /// Grey value of a full pixel: 255, 1023, 4095 or 65535.
    pub full_scale_dn: u16,
}

impl Identity {
    /// The smallest format of whole bytes that holds the grey values.
    pub(super) fn pixel_format(&self) -> PixelFormat {
        let formats = [PixelFormat::Mono8, PixelFormat::Mono10, PixelFormat::Mono12];
        let holds = |format: &PixelFormat| self.full_scale_dn <= format.full_scale_dn();
        formats.into_iter().find(holds).unwrap_or(PixelFormat::Mono16)
    }

    /// Bytes of a pixel.
    pub(super) fn bytes_per_px(&self) -> u32 {
        if self.full_scale_dn <= 255 { 1 } else { 2 }
    }

    /// Bytes of a frame of the whole sensor.
    pub fn frame_bytes(&self) -> usize {
        self.width_px as usize * self.height_px as usize * self.bytes_per_px() as usize
    }
}

/// What is particular about a camera.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Quirks {
    /// Time constant with which the camera warms up from its start, s; 0: it is warm.
    pub warm_up_s: f32,
    /// Its clock waits for others on the network without end.
    pub no_clock: bool,
    /// Features have the names of before version 2 of the naming convention.
    pub old_names: bool,
    /// This register takes every value and keeps its own.
    pub stuck: Option<u32>,
}
