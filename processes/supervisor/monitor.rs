//! The monitor as the supervisor sees it: a process with an address, which is told what happens and may end at any time.
//!
//! No cycle waits for it. What it is to know goes into a queue that a thread empties; a monitor that lets the queue fill up
//! hangs, so it is killed, started again, and told everything once more.

use super::collect::Span;
use super::protocol::StateReport;
use super::restart::Policy;
use super::setup::{self, PageOptions, RunOptions};
use super::stage_process::{ProcessState, StageProcess};
use crate::feed::{self, Ended, Message, Scan};
use crate::terminal;
use anyhow::{Context, Result};
use crossbeam::channel::{Receiver, Sender, bounded};
use devices::LoadedCell;
use files::result::CycleResult;
use std::collections::VecDeque;
use std::io::Read as _;
use std::net::TcpListener;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Name of the process, for `restart` and messages.
pub const MONITOR: &str = "monitor";

/// Outcomes that a monitor knows after it was started again: enough for the charts of the page.
pub const KEPT_CYCLES: usize = 200;

/// Messages that may wait beside those of a start: at 10 cycles per second half a minute.
const QUEUED: usize = 256;

/// Longest wait for the end of the monitor after the last message.
const END_TIMEOUT: Duration = Duration::from_secs(2);

/// What waits for the thread that writes.
enum Item {
    Told(Arc<Message>),
    Scan(Box<Scan>),
}

/// The way to one process: dropped, the process reads the end of the run.
struct Line {
    queue: Sender<Item>,
    /// Whether the process asked for a scan that it has not got yet.
    wants_scan: Arc<AtomicBool>,
    /// Number of the cycle of the last scan sent.
    scanned: Option<u64>,
}

/// The monitor with its address and all that a new one needs to know.
pub(super) struct Monitor {
    process: StageProcess,
    listener: TcpListener,
    line: Option<Line>,
    ended: VecDeque<Arc<Message>>,
    state: Option<StateReport>,
}

impl Monitor {
    /// Listens on the address, which stays the same when the process is started again.
    ///
    /// # Errors
    /// The system refuses the address.
    pub(super) fn new(cell: &LoadedCell, options: &RunOptions, page: &PageOptions) -> Result<Self> {
        let (address, what) = (page.address, if page.metrics_only { "metrics" } else { "page" });
        let listener = TcpListener::bind(address)
            .with_context(|| format!("--{what} {address}: cannot listen on this address"))?;
        let path = if page.metrics_only { "/metrics" } else { "/" };
        terminal::print_line(&format!("{what} at http://{}{path}", listener.local_addr()?));
        let limits = &cell.config.limits;
        let policy = Policy {
            restarts_max: limits.restarts_max,
            window_ns: setup::ns_of_ms(limits.restart_window_ms),
        };
        let arguments = setup::monitor_arguments(cell, options, page);
        Ok(Self {
            process: StageProcess::new(MONITOR, arguments, 1, policy),
            listener,
            line: None,
            ended: VecDeque::new(),
            state: None,
        })
    }

    /// Starts the process when that is due, and finds its end.
    pub(super) fn update(&mut self, now_ns: u64) {
        if let Some(end) = self.process.reap() {
            self.line = None;
            self.process.ended(now_ns);
            tracing::warn!(end, "the monitor ended");
            if self.process.state == ProcessState::GaveUp {
                terminal::print_note(&format!(
                    "warning: the monitor failed too often, the last time: {end}; the cell goes on without page and metrics, until \
                     `fringecell restart {MONITOR}`"
                ));
            }
        }
        if !matches!(self.process.state, ProcessState::Waiting { until_ns } if until_ns <= now_ns) {
            return;
        }
        match self.start(now_ns) {
            Ok(line) => self.line = Some(line),
            Err(error) => {
                tracing::warn!("{error:#}");
                self.process.kill("could not be told what happens");
                if self.process.pid().is_none() {
                    self.process.ended(now_ns);
                }
            }
        }
    }

    fn start(&mut self, now_ns: u64) -> Result<Line> {
        let (ours, theirs) = UnixStream::pair().context("a socket pair for the monitor")?;
        let address = OwnedFd::from(self.listener.try_clone().context("the address of the monitor")?);
        self.process.start_with(now_ns, Stdio::from(address), Stdio::from(OwnedFd::from(theirs)))?;
        self.process.state = ProcessState::Up;
        let (queue, items) = bounded(QUEUED + KEPT_CYCLES);
        let known = self.state.clone().map(|state| Arc::new(Message::State(state)));
        for message in known.into_iter().chain(self.ended.iter().cloned()) {
            // There is room for all of them.
            let _ = queue.try_send(Item::Told(message));
        }
        let wants_scan = Arc::new(AtomicBool::new(false));
        spawn_threads(ours, items, Arc::clone(&wants_scan))?;
        Ok(Line { queue, wants_scan, scanned: None })
    }

    /// Reports the state of the cell, if it has changed.
    pub(super) fn state(&mut self, state: StateReport) {
        if self.state.as_ref() != Some(&state) {
            self.tell(Arc::new(Message::State(state.clone())));
            self.state = Some(state);
        }
    }

    /// Reports the outcome of a cycle.
    pub(super) fn ended(&mut self, result: &CycleResult, spans: Vec<Span>) {
        let message = Arc::new(Message::Ended(Box::new(Ended { result: result.clone(), spans })));
        if self.ended.len() == KEPT_CYCLES {
            self.ended.pop_front();
        }
        self.ended.push_back(Arc::clone(&message));
        self.tell(message);
    }

    /// Whether a viewer waits for a scan of this cycle.
    pub(super) fn wants_scan(&self, number: u64) -> bool {
        let line = self.line.as_ref();
        line.is_some_and(|line| line.scanned != Some(number) && line.wants_scan.load(Ordering::Acquire))
    }

    /// Sends the scan that was asked for.
    pub(super) fn scan(&mut self, scan: Scan) {
        if let Some(line) = &mut self.line {
            line.scanned = Some(scan.header.number);
            line.wants_scan.store(false, Ordering::Release);
        }
        self.queue(Item::Scan(Box::new(scan)));
    }

    fn tell(&mut self, message: Arc<Message>) {
        self.queue(Item::Told(message));
    }

    fn queue(&mut self, item: Item) {
        if let Some(line) = &self.line
            && line.queue.try_send(item).is_err()
        {
            self.process.kill("did not take its messages");
            self.line = None;
        }
    }

    /// Kills the process, so that it is started again; also one that failed too often.
    pub(super) fn restart(&mut self) {
        if self.process.pid().is_some() {
            self.process.restart();
        } else {
            self.process.revive();
        }
    }

    /// Lets the process read the end of the run, then ends it.
    pub(super) fn shut_down(&mut self) {
        self.line = None;
        let begin = Instant::now();
        while self.process.pid().is_some() && self.process.reap().is_none() {
            if begin.elapsed() > END_TIMEOUT {
                self.process.kill("did not stop");
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// One thread writes what is queued, another reads what the process asks for; both end with the process.
fn spawn_threads(stream: UnixStream, items: Receiver<Item>, wants_scan: Arc<AtomicBool>) -> Result<()> {
    let mut asked = stream.try_clone().context("the socket of the monitor")?;
    let read = move || {
        let mut byte = [0];
        while matches!(asked.read(&mut byte), Ok(1)) {
            wants_scan.store(true, Ordering::Release);
        }
    };
    let write = move || {
        let mut stream = stream;
        for item in items {
            let sent = match item {
                Item::Told(message) => feed::send(&mut stream, &message),
                Item::Scan(scan) => feed::send_scan(&mut stream, &scan),
            };
            if sent.is_err() {
                return;
            }
        }
        // The other thread holds the socket too.
        let _ = stream.shutdown(std::net::Shutdown::Both);
    };
    let thread = |name: &str| std::thread::Builder::new().name(name.into());
    thread("monitor in").spawn(read).context("starting a thread")?;
    thread("monitor out").spawn(write).context("starting a thread")?;
    Ok(())
}
