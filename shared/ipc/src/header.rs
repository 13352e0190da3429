//! Message headers.
//!
//! Every header consists of plain numbers and is aligned to a cache line. The payload behind it is then aligned to 64 bytes
//! as well; `payload_alignment` would need a segment 64 times as large for a byte slice.
//! Indices follow the order of the configuration for cameras and projectors, of the rig for pairs, of the schedule for
//! activations.

use crate::error::MessageError;
use fringe::cloud::Point;
use fringe::pattern::Axis;
use fringe::phase::{PHASE_BYTES_PER_PX, PhaseInfo};
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

/// Command of the supervisor to all stages. No payload.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Control.2")]
pub struct Control {
    /// Cycle to start or abort; number of the request for connect; unused for shutdown.
    pub cycle: u64,
    /// The number of a [`Command`].
    pub command: u32,
    /// Index of the recipe of the cycle to start, in the order of the configuration.
    pub recipe: u32,
}

/// Commands of the supervisor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Command {
    /// To the acquisition stages: start the cycle and drop older ones.
    Start = 1,
    /// Drop the cycle and wait for the next.
    Abort = 2,
    /// End the process of the stage.
    Shutdown = 3,
    /// Connect to senders and receivers that joined since, then report ready with the same number as cycle.
    Connect = 4,
    /// To the evaluation stages: start the cycle and drop older ones.
    Evaluate = 5,
}

impl Control {
    /// A command for a cycle, with the first recipe.
    pub fn new(command: Command, cycle: u64) -> Self {
        Self { cycle, command: command as u32, recipe: 0 }
    }

    /// The command.
    ///
    /// # Errors
    /// [`MessageError::Value`] for an unknown number.
    pub fn command(&self) -> Result<Command, MessageError> {
        match self.command {
            1 => Ok(Command::Start),
            2 => Ok(Command::Abort),
            3 => Ok(Command::Shutdown),
            4 => Ok(Command::Connect),
            5 => Ok(Command::Evaluate),
            other => {
                Err(value("command", other.into(), "1 start, 2 abort, 3 shutdown, 4 connect, 5 evaluate"))
            }
        }
    }
}

impl Header for Control {
    fn cycle(&self) -> u64 {
        self.cycle
    }

    fn payload_bytes(&self) -> Result<usize, MessageError> {
        Ok(1)
    }
}

/// Projection to capture: the pattern is shown, expose. Capture to projection: exposed. No payload.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Trigger.1")]
pub struct Trigger {
    /// Cycle, from 1; 0 is outside of cycles.
    pub cycle: u64,
    /// Time when the pattern was shown or the exposure ended (monotonic clock), ns.
    pub t_ns: u64,
    /// Index of the projector.
    pub projector: u32,
    /// Frame number in the projector's sequence.
    pub frame: u32,
    /// Index of the camera that exposed; [`Trigger::ALL`] in a message to the cameras.
    pub camera: u32,
}

impl Trigger {
    /// All cameras of the projector.
    pub const ALL: u32 = u32::MAX;
}

impl Header for Trigger {
    fn cycle(&self) -> u64 {
        self.cycle
    }

    fn payload_bytes(&self) -> Result<usize, MessageError> {
        Ok(1)
    }
}

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

/// Report of a stage to the supervisor. The payload is a text: a report as JSON, or the reason of a failure.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Event.3")]
pub struct Event {
    /// Cycle; 0 outside of cycles.
    pub cycle: u64,
    /// Hash of the output of the activation (xxh3, 128 bits), high half.
    pub hash_high: u64,
    /// Low half of the hash.
    pub hash_low: u64,
    /// Start of the activation, ns.
    pub start_ns: u64,
    /// End of the activation, ns.
    pub end_ns: u64,
    /// Time that the stage waited for its inputs, ns.
    pub wait_ns: u64,
    /// Size of the output, bytes.
    pub bytes: u64,
    /// Part of the time from start to end for sending, including waiting for full buffers, ns.
    pub send_ns: u64,
    /// Processor time of all threads of the process since its last report, ns.
    pub cpu_ns: u64,
    /// Index of the stage in the schedule.
    pub stage: u32,
    /// The number of an [`EventKind`].
    pub kind: u32,
    /// Index of the activation in the schedule.
    pub activation: u32,
    /// Length of the text, bytes.
    pub text_bytes: u32,
    /// Process id of the sender: identifies events of a stage that was replaced since.
    pub pid: u32,
    /// Valid pixels or points of the output; for a failure, the stale messages so far.
    pub count: u32,
    /// Page faults without disk access since the last report.
    pub minor_faults: u32,
    /// Page faults with disk access since the last report.
    pub major_faults: u32,
    /// Voluntary context switches (waiting) since the last report.
    pub voluntary_switches: u32,
    /// Involuntary context switches since the last report.
    pub involuntary_switches: u32,
    /// Heap allocations since the last report; counted only in builds with the feature `count-allocations`.
    pub allocations: u32,
    /// Messages sent since the last report.
    pub messages: u32,
}

/// Kinds of events that stages report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum EventKind {
    /// All ports exist and the driver works. The cycle field repeats the number of [`Command::Connect`]; 0 after the start.
    Ready = 1,
    /// An activation is done.
    Done = 2,
    /// The cycle cannot be completed; the text gives the reason.
    Failed = 3,
    /// A part of the text of the next `Done`, which carries the last part.
    Part = 4,
}

impl Event {
    /// The kind.
    ///
    /// # Errors
    /// [`MessageError::Value`] for an unknown number.
    pub fn kind(&self) -> Result<EventKind, MessageError> {
        match self.kind {
            1 => Ok(EventKind::Ready),
            2 => Ok(EventKind::Done),
            3 => Ok(EventKind::Failed),
            4 => Ok(EventKind::Part),
            other => Err(value("kind", other.into(), "1 ready, 2 done, 3 failed, 4 part of a text")),
        }
    }
}

impl Header for Event {
    fn cycle(&self) -> u64 {
        self.cycle
    }

    fn payload_bytes(&self) -> Result<usize, MessageError> {
        text_length(self.text_bytes, MAX_TEXT_BYTES)
    }
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
