//! Headers of frames, phases, clouds and results.

use super::{Header, MAX_RESULT_BYTES, area, text_length, value};
use crate::error::MessageError;
use fringe::cloud::Point;
use fringe::pattern::Axis;
use fringe::phase::{PHASE_BYTES_PER_PX, PhaseInfo};
use iceoryx2::prelude::ZeroCopySend;

/// One image of one camera.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Frame.2")]
pub struct Frame {
    /// Cycle, from 1; 0 is outside of cycles.
    pub cycle: u64,
    /// End of the exposure (monotonic clock), ns.
    pub t_ns: u64,
    /// Hash of the pixels (xxh3, 128 bits), high half.
    pub hash_high: u64,
    /// Low half of the hash.
    pub hash_low: u64,
    /// Index of the camera.
    pub camera: u32,
    /// Index of the projector that was on.
    pub projector: u32,
    /// Frame number in the projector's sequence.
    pub frame: u32,
    /// Columns of the image, px.
    pub width_px: u32,
    /// Rows of the image, px.
    pub height_px: u32,
    /// Bytes per pixel, 1 or 2.
    pub bytes_per_px: u32,
    /// Grey value of a saturated pixel, digital numbers.
    pub full_scale_dn: u32,
}

impl Frame {
    /// Sets the hash of the pixels (xxh3, 128 bits).
    pub fn set_hash(&mut self, hash: u128) {
        (self.hash_high, self.hash_low) = ((hash >> 64) as u64, hash as u64);
    }
}

impl Header for Frame {
    fn cycle(&self) -> u64 {
        self.cycle
    }

    fn payload_bytes(&self) -> Result<usize, MessageError> {
        if !matches!(self.bytes_per_px, 1 | 2) {
            return Err(value("bytes_per_px", self.bytes_per_px.into(), "1, 2"));
        }
        let full_scale_limit = if self.bytes_per_px == 1 { 255 } else { 65_535 };
        if self.full_scale_dn == 0 || self.full_scale_dn > full_scale_limit {
            return Err(value("full_scale_dn", self.full_scale_dn.into(), "1 … 255 or 65535"));
        }
        area(self.width_px, self.height_px, self.bytes_per_px as usize)
    }
}

/// One absolute phase map of one camera and one axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Phase.1")]
pub struct Phase {
    /// Cycle, from 1; 0 is outside of cycles.
    pub cycle: u64,
    /// End of the last exposure used, ns.
    pub t_ns: u64,
    /// Period of the finest fringes: projector pixels per 2π.
    pub period_px: f64,
    /// Index of the camera.
    pub camera: u32,
    /// Index of the projector that was on.
    pub projector: u32,
    /// 0 along columns (x), 1 along rows (y).
    pub axis: u32,
    /// Columns of the map, px.
    pub width_px: u32,
    /// Rows of the map, px.
    pub height_px: u32,
    /// Number of valid pixels.
    pub valid_count: u32,
}

impl Phase {
    /// The number of an axis in a header.
    pub fn axis_number(axis: Axis) -> u32 {
        match axis {
            Axis::X => 0,
            Axis::Y => 1,
        }
    }

    /// Size, axis and period for `fringe`.
    ///
    /// # Errors
    /// [`MessageError::Value`] for an unknown axis.
    pub fn info(&self) -> Result<PhaseInfo, MessageError> {
        let axis = match self.axis {
            0 => Axis::X,
            1 => Axis::Y,
            other => return Err(value("axis", other.into(), "0 x, 1 y")),
        };
        Ok(PhaseInfo { width_px: self.width_px, height_px: self.height_px, axis, period_px: self.period_px })
    }
}

impl Header for Phase {
    fn cycle(&self) -> u64 {
        self.cycle
    }

    fn payload_bytes(&self) -> Result<usize, MessageError> {
        area(self.width_px, self.height_px, PHASE_BYTES_PER_PX)
    }
}

/// Points of one pair, or the fused cloud.
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Cloud.1")]
pub struct Cloud {
    /// Cycle, from 1; 0 is outside of cycles.
    pub cycle: u64,
    /// End of the last exposure used, ns.
    pub t_ns: u64,
    /// Index of the pair; [`Cloud::FUSED`] for the fused cloud.
    pub pair: u32,
    /// Capacity of the payload, points.
    pub capacity: u32,
    /// Number of points in the payload.
    pub points: u32,
}

impl Cloud {
    /// The pair number of a fused cloud.
    pub const FUSED: u32 = u32::MAX;
}

impl Header for Cloud {
    fn cycle(&self) -> u64 {
        self.cycle
    }

    fn payload_bytes(&self) -> Result<usize, MessageError> {
        if self.points > self.capacity {
            return Err(MessageError::Count { used: self.points.into(), capacity: self.capacity.into() });
        }
        let point_bytes = size_of::<Point>();
        (self.capacity as usize)
            .checked_mul(point_bytes)
            .ok_or(MessageError::Overflow(self.capacity.into(), point_bytes as u64))
    }
}

/// Inspection to the supervisor: features and verdict as JSON.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Outcome.1")]
pub struct Outcome {
    /// Cycle, from 1; 0 is outside of cycles.
    pub cycle: u64,
    /// End of the last exposure of the cycle, ns.
    pub t_last_frame_ns: u64,
    /// Time of the verdict, ns.
    pub t_ns: u64,
    /// Length of the JSON text, bytes.
    pub text_bytes: u32,
}

impl Header for Outcome {
    fn cycle(&self) -> u64 {
        self.cycle
    }

    fn payload_bytes(&self) -> Result<usize, MessageError> {
        text_length(self.text_bytes, MAX_RESULT_BYTES)
    }
}
