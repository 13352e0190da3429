//! What the loop of a stage asks of the kind of stage.

use super::fault::Fault;
use super::link::Link;
use ipc::IpcError;

/// The work of one kind of stage.
pub trait Worker {
    /// Connects the inboxes to senders that came since.
    fn connect(&self) -> Result<(), IpcError>;

    /// A cycle starts; whatever an older one left is forgotten.
    fn begin(&mut self, link: &mut Link) -> Result<(), Fault>;

    /// Takes one message or does one activation; `false` when there is nothing to do.
    fn step(&mut self, link: &mut Link) -> Result<bool, Fault>;

    /// A cycle was aborted.
    fn forget(&mut self);

    /// When to be called although nobody rings (monotonic clock, ns).
    fn due_ns(&self) -> Option<u64> {
        None
    }
}
