//! What can go wrong between two processes.

use std::path::PathBuf;
use thiserror::Error;

/// A failure of shared memory, of a peer, or of the place where the cell lives.
#[derive(Debug, Error)]
pub enum IpcError {
    /// The name cannot stand in a path or a service name.
    #[error("cell name \"{0}\": use 1 to 32 of a–z, 0–9, '-' and '_', beginning with a letter or digit")]
    CellName(String),
    /// Another supervisor holds the lock.
    #[error(
        "cell '{cell}' is already running, pid {pid}; stop it with `fringecell stop --cell {cell}`, or name this one differently"
    )]
    Running {
        /// The cell.
        cell: String,
        /// Its supervisor.
        pid: String,
    },
    /// A file of the runtime root cannot be used.
    #[error("{path}: {action} failed")]
    File {
        /// The file.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// Why it failed.
        source: std::io::Error,
    },
    /// The messages of the schedule do not fit in shared memory.
    #[error(
        "/dev/shm has {free_mb} MB free, the buffers of this cell need up to {needed_mb} MB; enlarge it (docker run --shm-size, mount -o remount,size=…) or reduce the image size"
    )]
    Space {
        /// Free now.
        free_mb: u64,
        /// Worst case of the schedule.
        needed_mb: u64,
    },
    /// iceoryx2 refused.
    #[error("{what} \"{name}\": {reason}")]
    Service {
        /// What was tried.
        what: &'static str,
        /// Topic, bell or node.
        name: String,
        /// iceoryx2's word for it.
        reason: String,
    },
    /// Fewer receivers than the topology has.
    #[error("\"{topic}\" reached {reached} of {expected} receivers")]
    NotReached {
        /// Topic.
        topic: String,
        /// How many got it.
        reached: usize,
        /// How many should.
        expected: usize,
    },
    /// A receiver did not make room.
    #[error("\"{topic}\": a receiver's buffer of {buffer} messages stayed full for {waited_ms} ms")]
    Full {
        /// Topic.
        topic: String,
        /// Messages the buffer holds.
        buffer: usize,
        /// How long the sender waited.
        waited_ms: u64,
    },
    /// A header that contradicts its payload or the schedule.
    #[error("message on \"{topic}\" is not credible")]
    Message {
        /// Topic.
        topic: String,
        /// What contradicts.
        source: MessageError,
    },
}

impl IpcError {
    /// iceoryx2 refused `what` for `name`.
    pub(crate) fn service(what: &'static str, name: &str, reason: impl std::fmt::Debug) -> Self {
        Self::Service { what, name: name.to_owned(), reason: format!("{reason:?}") }
    }
}

/// What contradicts in a message.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum MessageError {
    /// Payload and header disagree.
    #[error("the header announces {announced} bytes, the payload has {present}")]
    Length {
        /// By the header.
        announced: usize,
        /// In shared memory.
        present: usize,
    },
    /// Sizes whose product does not fit.
    #[error("the sizes {0} × {1} overflow")]
    Overflow(u64, u64),
    /// A number outside its set.
    #[error("{key} = {value} is not one of {allowed}")]
    Value {
        /// Field of the header.
        key: &'static str,
        /// Its value.
        value: u64,
        /// What it may be.
        allowed: &'static str,
    },
    /// More used than there is.
    #[error("{used} points in a payload for {capacity}")]
    Count {
        /// Said to be used.
        used: u64,
        /// Room.
        capacity: u64,
    },
    /// The payload does not start where its numbers need it.
    #[error("the payload is not aligned for its numbers")]
    Alignment,
    /// Not text.
    #[error("the text is not UTF-8")]
    Text,
}
