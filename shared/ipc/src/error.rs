//! Errors of the communication between processes.

use std::path::PathBuf;
use thiserror::Error;

/// An error of shared memory, of another process, or of the runtime folder of a cell.
#[derive(Debug, Error)]
pub enum IpcError {
    /// The name cannot be part of a path or a service name.
    #[error("cell name \"{0}\": {rule}", rule = fringe::text::CELL_NAME)]
    CellName(String),
    /// Another supervisor runs this cell.
    #[error(
        "cell '{cell}' is already running, pid {pid}; stop it with `fringecell stop --cell {cell}`, or choose another name with --cell"
    )]
    Running {
        /// Name of the cell.
        cell: String,
        /// Process id of its supervisor.
        pid: String,
    },
    /// There is no folder for shared memory.
    #[error(
        "/dev/shm is missing, where the processes of a cell share memory; mount it: mount -t tmpfs -o mode=1777 tmpfs /dev/shm, in a container with --shm-size"
    )]
    NoSharedMemory,
    /// A file of the runtime folder cannot be used.
    #[error("{path}: {action} failed")]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The operation, as "opening".
        action: &'static str,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// Another user may control a file of the runtime folder or of the shared memory.
    #[error("{path}: {reason}; it is not used; remove it, or choose another cell name with --cell")]
    Untrusted {
        /// Path of the file.
        path: PathBuf,
        /// Why it is not trusted.
        reason: String,
    },
    /// The buffers of the schedule do not fit in shared memory.
    #[error(
        "/dev/shm has {free_mb} MB free, the buffers of this cell need up to {needed_mb} MB; enlarge it (docker run --shm-size, mount -o remount,size=…) or reduce the image size{left}"
    )]
    Space {
        /// Free shared memory in `/dev/shm`, MB.
        free_mb: u64,
        /// Space for all buffers of the schedule, MB.
        needed_mb: u64,
        /// What killed cells left, and how to free it; empty where they left nothing.
        left: String,
    },
    /// iceoryx2 reported an error.
    #[error("{what} \"{name}\": {reason}")]
    Service {
        /// The operation that failed.
        what: &'static str,
        /// Name of the topic, of the process that is notified, or of the node.
        name: String,
        /// The error of iceoryx2.
        reason: String,
    },
    /// Some receivers of the schedule did not get a message.
    #[error("a message on \"{topic}\" reached {reached} of {expected} receivers")]
    NotReached {
        /// Name of the topic.
        topic: String,
        /// Receivers that got the message.
        reached: usize,
        /// Receivers in the schedule.
        expected: usize,
    },
    /// The buffer of a receiver stayed full.
    #[error("\"{topic}\": a receiver's buffer of {buffer} messages stayed full for {waited_ms} ms")]
    Full {
        /// Name of the topic.
        topic: String,
        /// Capacity of the buffer, messages.
        buffer: usize,
        /// Time that the sender waited, ms.
        waited_ms: u64,
    },
    /// A message whose header contradicts its payload or the schedule.
    #[error("invalid message on \"{topic}\"")]
    Message {
        /// Name of the topic.
        topic: String,
        /// How header and payload contradict each other.
        source: MessageError,
    },
}

impl IpcError {
    /// The operation `what` failed for `name`.
    pub(crate) fn service(what: &'static str, name: &str, reason: impl std::fmt::Debug) -> Self {
        Self::Service { what, name: name.to_owned(), reason: format!("{reason:?}") }
    }
}

/// Why a message is invalid.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum MessageError {
    /// The payload does not have the length of the header.
    #[error("the header states {announced} bytes, the payload has {present}")]
    Length {
        /// Length stated by the header, bytes.
        announced: usize,
        /// Length of the payload, bytes.
        present: usize,
    },
    /// Width and height whose product overflows.
    #[error("the size {0} × {1} overflows")]
    Overflow(u64, u64),
    /// A field has a value that is not allowed.
    #[error("{key} = {value} is not allowed; allowed: {allowed}")]
    Value {
        /// Name of the field.
        key: &'static str,
        /// The value of the field.
        value: u64,
        /// The values that are allowed.
        allowed: &'static str,
    },
    /// More points or bytes than the payload has.
    #[error("the header states {used} points or bytes, the payload has {capacity}")]
    Count {
        /// Number stated by the header.
        used: u64,
        /// Capacity of the payload.
        capacity: u64,
    },
    /// The pixels are not those that the camera gave.
    #[error("its pixels were changed in shared memory")]
    Changed,
    /// The payload is not aligned for its element type.
    #[error("the payload is not aligned for its element type")]
    Alignment,
    /// The text is not UTF-8.
    #[error("the text is not UTF-8")]
    Text,
}
