//! What lies in front of each payload.
//!
//! Every header is plain numbers, aligned to a cache line: the payload behind it is then aligned to 64 bytes as well,
//! without the 64-fold segment that `payload_alignment` would make of a byte slice.
//! Indices count in the order of the config: cameras, projectors and pairs of the rig, activations of the schedule.

use crate::error::MessageError;
use fringe::cloud::Point;
use fringe::pattern::Axis;
use fringe::phase::PhaseInfo;
use iceoryx2::prelude::ZeroCopySend;

/// Longest text in an event, bytes: a report with a hundred overlaps fits.
pub const MAX_TEXT_BYTES: usize = 16 * 1024;

/// Largest result that the inspection may send, bytes: 1 MB is ten thousand features.
pub const MAX_RESULT_BYTES: usize = 1 << 20;

/// Bytes per pixel of a phase map: phase, sigma, modulation as f32, validity as u8.
pub const PHASE_BYTES_PER_PX: usize = 13;

/// A header tells its cycle and how long its payload has to be.
pub trait Header: ZeroCopySend + std::fmt::Debug + Clone + Copy + Default + 'static {
    /// The cycle that the message belongs to.
    fn cycle(&self) -> u64;

    /// Length of the payload that belongs to this header, bytes.
    ///
    /// # Errors
    /// A header that no payload can satisfy.
    fn payload_bytes(&self) -> Result<usize, MessageError>;
}

/// Supervisor to all stages. No payload.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Control.2")]
pub struct Control {
    /// The cycle to start or abort; meaningless for shutdown.
    pub cycle: u64,
    /// One of [`Command`].
    pub command: u32,
    /// The recipe of the cycle to start, counted in the configuration.
    pub recipe: u32,
}

/// What the supervisor wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Command {
    /// To the stages of the acquisition: begin the cycle; forget older ones.
    Start = 1,
    /// Forget the cycle.
    Abort = 2,
    /// Leave.
    Shutdown = 3,
    /// Connect to senders and receivers that came since, then report ready with the same number as cycle.
    Connect = 4,
    /// To the stages of the evaluation: begin the cycle; forget older ones.
    Evaluate = 5,
}

impl Control {
    /// A message.
    pub fn new(command: Command, cycle: u64) -> Self {
        Self { cycle, command: command as u32, recipe: 0 }
    }

    /// What it wants.
    ///
    /// # Errors
    /// [`MessageError::Value`] for a number that is no command.
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

/// Projection to capture: the pattern stands, expose. And back: exposed. No payload.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Trigger.1")]
pub struct Trigger {
    /// Cycle.
    pub cycle: u64,
    /// When the pattern stood, or the exposure ended (monotonic clock), ns.
    pub t_ns: u64,
    /// Which projector shows it.
    pub projector: u32,
    /// Frame number in the projector's sequence.
    pub frame: u32,
    /// Which camera has exposed; [`Trigger::ALL`] on the way to the cameras.
    pub camera: u32,
}

impl Trigger {
    /// Every camera of the projector.
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
#[type_name("fringecell.Frame.1")]
pub struct Frame {
    /// Cycle.
    pub cycle: u64,
    /// End of the exposure (monotonic clock), ns.
    pub t_ns: u64,
    /// Which camera.
    pub camera: u32,
    /// Which projector was lit.
    pub projector: u32,
    /// Frame number in the projector's sequence.
    pub frame: u32,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// 1 or 2.
    pub bytes_per_px: u32,
    /// Grey value of a full pixel.
    pub full_scale_dn: u32,
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
    /// Cycle.
    pub cycle: u64,
    /// End of the last exposure that it was made of, ns.
    pub t_ns: u64,
    /// Projector pixels per 2π.
    pub period_px: f64,
    /// Which camera.
    pub camera: u32,
    /// Which projector was lit.
    pub projector: u32,
    /// 0 along columns (x), 1 along rows (y).
    pub axis: u32,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Pixels that may be used.
    pub valid_count: u32,
}

impl Phase {
    /// The number of an axis.
    pub fn axis_number(axis: Axis) -> u32 {
        match axis {
            Axis::X => 0,
            Axis::Y => 1,
        }
    }

    /// Size, axis and period as the mathematics wants them.
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

/// Points of one pair, or of the fused cloud.
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Cloud.1")]
pub struct Cloud {
    /// Cycle.
    pub cycle: u64,
    /// End of the last exposure that it was made of, ns.
    pub t_ns: u64,
    /// Which pair; [`Cloud::FUSED`] for all of them.
    pub pair: u32,
    /// Points that the payload has room for.
    pub capacity: u32,
    /// Points that are there.
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
    /// Cycle.
    pub cycle: u64,
    /// End of the last exposure of the cycle, ns.
    pub t_last_frame_ns: u64,
    /// When the verdict stood, ns.
    pub t_ns: u64,
    /// Length of the JSON text.
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

/// Stage to supervisor: where it stands. The payload is a text, for a failure its reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Event.3")]
pub struct Event {
    /// Cycle; 0 outside of cycles.
    pub cycle: u64,
    /// Hash of what the activation gave (xxh3, 128 bits), high half.
    pub hash_high: u64,
    /// Low half.
    pub hash_low: u64,
    /// Start of the activation's work, ns.
    pub start_ns: u64,
    /// End of it, ns.
    pub end_ns: u64,
    /// How long the stage waited for the input before, ns.
    pub wait_ns: u64,
    /// Bytes that it gave.
    pub bytes: u64,
    /// Of the time from start to end: handing outputs over, waiting for room included, ns.
    pub send_ns: u64,
    /// Processor time of the whole process since its last report, ns.
    pub cpu_ns: u64,
    /// Which stage, counted in the schedule.
    pub stage: u32,
    /// One of [`EventKind`].
    pub kind: u32,
    /// Which activation of the schedule.
    pub activation: u32,
    /// Length of the text.
    pub text_bytes: u32,
    /// Process that sent it: an event of a dead predecessor is then known as such.
    pub pid: u32,
    /// A count that goes with the activation: valid pixels, points; stale messages for a failure.
    pub count: u32,
    /// Page faults without disk since the last report.
    pub minor_faults: u32,
    /// Page faults with disk since the last report.
    pub major_faults: u32,
    /// Context switches by waiting since the last report.
    pub voluntary_switches: u32,
    /// Context switches against its will since the last report.
    pub involuntary_switches: u32,
    /// Heap allocations since the last report; counted only in builds with the feature `count-allocations`.
    pub allocations: u32,
    /// Messages sent since the last report.
    pub messages: u32,
}

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum EventKind {
    /// All ports stand, the driver works; the cycle field answers the last [`Command::Connect`], 0 at first.
    Ready = 1,
    /// An activation is done.
    Done = 2,
    /// The cycle cannot be finished; the text says why.
    Failed = 3,
}

impl Event {
    /// What happened.
    ///
    /// # Errors
    /// [`MessageError::Value`] for a number that is no kind.
    pub fn kind(&self) -> Result<EventKind, MessageError> {
        match self.kind {
            1 => Ok(EventKind::Ready),
            2 => Ok(EventKind::Done),
            3 => Ok(EventKind::Failed),
            other => Err(value("kind", other.into(), "1 ready, 2 done, 3 failed")),
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

/// A text travels in at least one byte, since an empty payload cannot be loaned.
fn text_length(text_bytes: u32, limit: usize) -> Result<usize, MessageError> {
    if text_bytes as usize > limit {
        return Err(MessageError::Count { used: text_bytes.into(), capacity: limit as u64 });
    }
    Ok((text_bytes as usize).max(1))
}
