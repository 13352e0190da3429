//! Message headers.
//!
//! Every header consists of plain numbers and is aligned to a cache line. The payload behind it is then aligned to 64 bytes
//! as well; `payload_alignment` would need a segment 64 times as large for a byte slice.
//! Indices follow the order of the configuration for cameras and projectors, of the rig for pairs, of the schedule for
//! activations.

mod control;
mod data;
mod link;

pub use control::{Command, Control, Event, EventKind, Trigger};
pub use data::{Cloud, Frame, Outcome, Phase};
pub use link::{LINK_BYTES, Link, LinkKind};

use crate::error::MessageError;
use iceoryx2::prelude::ZeroCopySend;

/// Longest text in one event, bytes; longer ones travel in parts ([`crate::long_text`]).
pub const MAX_TEXT_BYTES: usize = 16 * 1024;

/// Largest result that the inspection may send, bytes: 1 MB is ten thousand features.
pub const MAX_RESULT_BYTES: usize = 1 << 20;

/// What every header states: its cycle and the length of its payload.
pub trait Header: ZeroCopySend + std::fmt::Debug + Clone + Copy + Default + 'static {
    /// The cycle that the message belongs to.
    fn cycle(&self) -> u64;

    /// Length of the payload that belongs to this header, bytes.
    ///
    /// # Errors
    /// A header with impossible sizes.
    fn payload_bytes(&self) -> Result<usize, MessageError>;
}

fn value(key: &'static str, value: u64, allowed: &'static str) -> MessageError {
    MessageError::Value { key, value, allowed }
}

fn area(width_px: u32, height_px: u32, bytes_per_px: usize) -> Result<usize, MessageError> {
    (width_px as usize)
        .checked_mul(height_px as usize)
        .and_then(|pixels| pixels.checked_mul(bytes_per_px))
        .ok_or(MessageError::Overflow(width_px.into(), height_px.into()))
}

/// A text has a payload of at least one byte: an empty payload cannot be loaned.
fn text_length(text_bytes: u32, limit: usize) -> Result<usize, MessageError> {
    if text_bytes as usize > limit {
        return Err(MessageError::Count { used: text_bytes.into(), capacity: limit as u64 });
    }
    Ok((text_bytes as usize).max(1))
}
