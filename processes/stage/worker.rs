//! The interface between the main loop of a stage and the kinds of stages.

use super::context::StageContext;
use super::fault::Fault;
use ipc::IpcError;

/// The work of one kind of stage.
pub trait Worker {
    /// Connects the inboxes to publishers that joined since.
    fn connect(&mut self) -> Result<(), IpcError>;

    /// Starts a cycle and drops what is left of an older one.
    fn begin(&mut self, context: &mut StageContext) -> Result<(), Fault>;

    /// Handles one message or one activation; `false` if there is nothing to do.
    fn step(&mut self, context: &mut StageContext) -> Result<bool, Fault>;

    /// Is called between cycles, at the times of [`Self::due_ns`] and with every notification.
    fn idle(&mut self, _context: &mut StageContext) -> Result<(), Fault> {
        Ok(())
    }

    /// Drops the aborted cycle.
    fn forget(&mut self);

    /// When to call [`Self::step`] without a notification (monotonic clock, ns).
    fn due_ns(&self) -> Option<u64> {
        None
    }
}
