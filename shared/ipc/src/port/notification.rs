//! Notifications: wake the one process that listens.

use crate::error::IpcError;
use iceoryx2::port::listener::Listener as IoxListener;
use iceoryx2::port::notifier::Notifier as IoxNotifier;
use iceoryx2::prelude::ipc;
use std::time::Duration;

/// The receiving end: its process sleeps on it.
#[derive(Debug)]
pub struct Listener {
    pub(super) owner: String,
    pub(super) port: IoxListener<ipc::Service>,
}

impl Listener {
    /// Sleeps until a notification arrives or the timeout is over; returns at once if one arrived since the last call.
    /// Returns whether a notification arrived.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn wait(&self, timeout: Duration) -> Result<bool, IpcError> {
        use iceoryx2::port::listener::ListenerWaitError;
        // A socket takes a timeout of zero as "no timeout".
        let notified = if timeout.is_zero() {
            self.port.try_wait(|_| {})
        } else {
            self.port.timed_wait(|_| {}, timeout)
        };
        match notified {
            Ok(count) => Ok(count > 0),
            Err(ListenerWaitError::InterruptSignal) => Ok(false),
            Err(e) => Err(IpcError::service("waiting for notifications of", &self.owner, e)),
        }
    }
}

/// The sending end: wakes the listening process.
#[derive(Debug)]
pub struct Notifier {
    pub(super) port: IoxNotifier<ipc::Service>,
}

impl Notifier {
    /// Wakes the listener, or makes its next wait return at once.
    pub fn notify(&self) {
        // Without a listener the process is dead; the supervisor detects that by itself.
        let _ = self.port.notify();
    }
}
