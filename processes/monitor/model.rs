//! What the monitor knows of the cell, and who hears of it.

use super::MonitorArgs;
use super::cloud;
use crate::feed::{Ended, Scan};
use crate::supervisor::KEPT_CYCLES;
use crate::supervisor::protocol::{StateReport, Status};
use axum::body::Bytes;
use devices::LoadedCell;
use std::collections::VecDeque;
use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use tokio::sync::broadcast;

/// Events that a slow viewer may be behind; then it loads everything anew.
const EVENTS: usize = 64;

/// An event for the viewers.
#[derive(Debug, Clone)]
pub struct Update {
    /// Kind of the event, as the page knows it.
    pub kind: &'static str,
    /// JSON, shared by all viewers.
    pub json: Arc<str>,
}

/// A scan with the cloud as the page loads it.
pub struct ShownScan {
    /// As the supervisor sent it.
    pub scan: Scan,
    /// The cloud with its deviations, shared by all viewers.
    pub packed: Bytes,
}

/// What is known now.
#[derive(Default)]
pub struct Known {
    /// State, job and recipes.
    pub state: Option<StateReport>,
    /// The last cycles, the oldest first.
    pub ended: VecDeque<Arc<Ended>>,
    /// The last scan that came.
    pub scan: Option<Arc<ShownScan>>,
    /// The last answer to `status`, and when it came.
    pub status: Option<(Instant, Arc<Status>)>,
}

/// The cell as the monitor sees it.
pub struct Model {
    /// Configuration, graph and plans.
    pub cell: LoadedCell,
    /// Path of the command socket.
    pub socket: PathBuf,
    /// Output folder of the run.
    pub out: Option<PathBuf>,
    /// Whether the part is simulated by the demo.
    pub demo: bool,
    /// Process id of the supervisor: another one is another run.
    pub run: u32,
    known: Mutex<Known>,
    events: broadcast::Sender<Update>,
    viewers: AtomicUsize,
    /// Whether a scan was asked for and has not come yet.
    asked: AtomicBool,
    supervisor: UnixStream,
}

impl Model {
    /// A model that knows nothing yet.
    pub fn new(cell: LoadedCell, args: &MonitorArgs, socket: PathBuf, supervisor: UnixStream) -> Self {
        Self {
            cell,
            socket,
            out: args.out.clone(),
            demo: args.demo,
            run: args.parent,
            known: Mutex::default(),
            events: broadcast::Sender::new(EVENTS),
            viewers: AtomicUsize::new(0),
            asked: AtomicBool::new(false),
            supervisor,
        }
    }

    /// What is known now. Hold it for a moment only: the supervisor's messages wait meanwhile.
    pub fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A cycle by its number from 1, if it is one of the last.
    pub fn ended(&self, number: u64) -> Option<Arc<Ended>> {
        self.known().ended.iter().rev().find(|ended| ended.result.number == number).cloned()
    }

    /// Adds the outcome of a cycle.
    pub fn add(&self, ended: Arc<Ended>) {
        let mut known = self.known();
        if known.ended.len() == KEPT_CYCLES {
            known.ended.pop_front();
        }
        known.ended.push_back(ended);
    }

    /// Adds a scan: packs its cloud with the deviations of its cycle.
    pub fn show(&self, scan: Scan) {
        let ended = self.ended(scan.header.cloud_number);
        let packed = cloud::packed(&self.cell, ended.as_deref(), &scan);
        self.known().scan = Some(Arc::new(ShownScan { scan, packed }));
        self.asked.store(false, Ordering::SeqCst);
        self.ask_for_scan();
    }

    /// Sends an event to all viewers.
    pub fn publish(&self, kind: &'static str, json: String) {
        // Without viewers nobody listens.
        let _ = self.events.send(Update { kind, json: json.into() });
    }

    /// A viewer that hears every event from now on; it counts until dropped.
    pub fn viewer(self: &Arc<Self>) -> Viewer {
        self.viewers.fetch_add(1, Ordering::SeqCst);
        self.ask_for_scan();
        Viewer { events: self.events.subscribe(), model: Arc::clone(self) }
    }

    /// Number of viewers that listen.
    pub fn viewers(&self) -> usize {
        self.viewers.load(Ordering::SeqCst)
    }

    /// Asks for the next scan if somebody looks and none is on its way.
    fn ask_for_scan(&self) {
        if self.viewers() > 0 && !self.asked.swap(true, Ordering::SeqCst) {
            // At the end of the run nobody reads it.
            let _ = (&self.supervisor).write_all(b"s");
        }
    }
}

/// A viewer of the page.
pub struct Viewer {
    /// The events that it hears.
    pub events: broadcast::Receiver<Update>,
    model: Arc<Model>,
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.model.viewers.fetch_sub(1, Ordering::SeqCst);
    }
}
