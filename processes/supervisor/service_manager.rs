//! Tells the service manager (systemd, `Type=notify`) that the cell is ready, alive, and stopping.
//!
//! Without NOTIFY_SOCKET nothing is sent. The event loop itself sends the signs of life: a supervisor that hangs sends none, and
//! is restarted.

use sd_notify::NotifyState;

/// What was reported to the service manager.
#[derive(Debug)]
pub(super) struct ServiceManager {
    /// Pause between two signs of life, ns: half of what is allowed; `None`: none are expected.
    pause_ns: Option<u64>,
    alive_ns: u64,
    ready: bool,
    status: String,
}

impl ServiceManager {
    pub(super) fn new() -> Self {
        let pause_ns = sd_notify::watchdog_enabled().map(|limit| limit.as_nanos() as u64 / 2);
        Self { pause_ns, alive_ns: 0, ready: false, status: String::new() }
    }

    /// Sends what has changed, and a sign of life when it is due.
    pub(super) fn update(&mut self, now_ns: u64, ready: bool, status: &str) {
        if ready && !self.ready {
            self.ready = true;
            send(NotifyState::Ready);
        }
        if status != self.status {
            status.clone_into(&mut self.status);
            send(NotifyState::Status(status));
        }
        if self.pause_ns.is_some_and(|pause_ns| now_ns.saturating_sub(self.alive_ns) >= pause_ns) {
            self.alive_ns = now_ns;
            send(NotifyState::Watchdog);
        }
    }

    /// Announces that the cell ends.
    pub(super) fn stopping() {
        send(NotifyState::Stopping);
    }
}

fn send(state: NotifyState) {
    // A service manager that is gone is no reason to end a cell.
    if let Err(error) = sd_notify::notify(&[state]) {
        tracing::debug!("the service manager does not listen: {error}");
    }
}
