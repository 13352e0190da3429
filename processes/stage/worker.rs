//! The interface between the main loop of a stage and the kinds of stages.

use super::fault::Fault;
use super::link::Link;
use ipc::IpcError;

/// The work of one kind of stage.
pub trait Worker {
    /// Connects the inboxes to publishers that joined since.
    fn connect(&self) -> Result<(), IpcError>;

    /// Starts a cycle and drops what is left of an older one.
    fn begin(&mut self, link: &mut Link) -> Result<(), Fault>;

    /// Handles one message or one activation; `false` if there is nothing to do.
    fn step(&mut self, link: &mut Link) -> Result<bool, Fault>;

    /// Drops the aborted cycle.
    fn forget(&mut self);

    /// When to call [`Self::step`] without a notification (monotonic clock, ns).
    fn due_ns(&self) -> Option<u64> {
        None
    }
}
