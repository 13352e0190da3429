//! Bells: what wakes a process, and what it is woken by.

use crate::error::IpcError;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::ipc;
use std::time::Duration;

/// Wakes its owner.
#[derive(Debug)]
pub struct Bell {
    pub(super) owner: String,
    pub(super) listener: Listener<ipc::Service>,
}

impl Bell {
    /// Sleeps until somebody rings, or has rung since the last call, or the time is over. Says whether it rang.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn wait(&self, timeout: Duration) -> Result<bool, IpcError> {
        use iceoryx2::port::listener::ListenerWaitError;
        // A socket takes a timeout of zero as "for ever".
        let rang = if timeout.is_zero() {
            self.listener.try_wait(|_| {})
        } else {
            self.listener.timed_wait(|_| {}, timeout)
        };
        match rang {
            Ok(count) => Ok(count > 0),
            Err(ListenerWaitError::InterruptSignal) => Ok(false),
            Err(e) => Err(IpcError::service("waiting for bell", &self.owner, e)),
        }
    }
}

/// Rings somebody's bell.
#[derive(Debug)]
pub struct Ringer {
    pub(super) notifier: Notifier<ipc::Service>,
}

impl Ringer {
    /// Wakes the owner, or keeps him from falling asleep.
    pub fn ring(&self) {
        // A bell without listener belongs to a dead process; the supervisor sees that for itself.
        let _ = self.notifier.notify();
    }
}
