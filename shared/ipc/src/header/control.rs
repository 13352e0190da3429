//! Headers between the supervisor, the projection and the stages.

use super::{Header, MAX_TEXT_BYTES, text_length, value};
use crate::error::MessageError;
use iceoryx2::prelude::ZeroCopySend;

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
    /// Connect to senders and receivers that joined since and let go of those that ended, then report ready with the same number
    /// as cycle.
    Connect = 4,
    /// To the evaluation stages: start the cycle and drop older ones.
    Evaluate = 5,
    /// Populate the memory of all connections, then report ready with the same number as cycle.
    Populate = 6,
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
            6 => Ok(Command::Populate),
            other => {
                let known = "1 start, 2 abort, 3 shutdown, 4 connect, 5 evaluate, 6 populate";
                Err(value("command", other.into(), known))
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
    /// The host that leads wants this cycle: start it.
    Request = 5,
    /// The host that leads does not want its cycle any more; the text gives the reason.
    Withdraw = 6,
    /// Another run of the host that leads: begin anew, so that its cycles can count from 1; the text says why.
    Renew = 7,
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
            5 => Ok(EventKind::Request),
            6 => Ok(EventKind::Withdraw),
            7 => Ok(EventKind::Renew),
            other => {
                let known = "1 ready, 2 done, 3 failed, 4 part of a text, 5 request, 6 withdraw, 7 renew";
                Err(value("kind", other.into(), known))
            }
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
