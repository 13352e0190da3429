//! The context of a stage in its cell: ports to the supervisor, position in the schedule, current cycle.

use super::args::StageArgs;
use super::cycle_filter::CycleFilter;
use super::fault::Fault;
use super::text_buffer::shorten;
use anyhow::{Context, Result, anyhow};
use cell::Cell;
use cell::schedule::{FRAME_BUFFER, Half, Kind, Order, SUPERVISOR, Topic, Work};
use devices::LoadedCell;
use ipc::IpcError;
use ipc::cell::CellName;
use ipc::header::{Command, Control, Event, EventKind, Header, MAX_TEXT_BYTES};
use ipc::long_text::parts;
use ipc::os::{Usage, now_ns};
use ipc::output_hash;
use ipc::port::{Listener, Node, Notifier, Publisher, Subscriber, loans};
use ipc::sequence::{SequenceGates, SequencePoint};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// Context of a stage in its cell: its ports, its position in the schedule, the current cycle.
pub struct StageContext {
    /// Configuration, graph and schedule.
    pub cell: LoadedCell,
    /// Index of this stage in the schedule.
    pub stage: usize,
    /// Index of the recipe of the current cycle.
    pub recipe: usize,
    pub(super) cycles: CycleFilter,
    pub(super) listener: Listener,
    pub(super) control: Subscriber<Control>,
    events: Publisher<Event>,
    /// Notified after the stages that may continue with the cycle.
    supervisor: Notifier,
    /// Activations of this stage after which the supervisor is notified.
    supervisor_notifications: BTreeSet<usize>,
    pub(super) node: Node,
    /// Path prefix of the cell's shared memory.
    segments: String,
    /// Whether its buffers were put on large pages.
    on_large_pages: bool,
    order: Order,
    gates: SequenceGates,
    /// Notifiers of the stages that wait for this one: for its core, or for its outputs.
    dependents: BTreeMap<usize, Notifier>,
    idle_since_ns: u64,
    /// Resource use at the last report.
    usage: Usage,
    /// Allocations at the last report.
    allocations: u64,
    /// Loans at the last report.
    messages: u64,
    /// Time for sending since the last report, ns.
    send_ns: u64,
}

/// The supervisor is notified of every n-th report of a stage and of its last one in a cycle; it finds the others at the same
/// time, or within 20 ms. A notification costs the next activation on the same core about 50 µs. The number is half of the
/// frame buffer, so that the buffer of the supervisor never fills.
const REPORTS_PER_NOTIFICATION: usize = FRAME_BUFFER / 2;

/// Room for what fusion and inspection allocate when they see the points, bytes; the heap of the demo's fusion takes 47 MB.
const ROOM: usize = 64 << 20;

/// Longest time for putting buffers on large pages: a computer with other work goes on with what it has by then.
const LARGE_PAGES: Duration = Duration::from_secs(4);

/// Report of an activation, beside its output.
#[derive(Debug, Clone, Copy, Default)]
pub struct Report<'a> {
    /// Valid pixels, points, features.
    pub count: usize,
    /// A report as JSON, or empty.
    pub text: &'a str,
}

/// Number of heap allocations of this process, in builds that count them.
fn allocations() -> u64 {
    #[cfg(feature = "count-allocations")]
    return crate::allocations::count();
    #[cfg(not(feature = "count-allocations"))]
    0
}

impl StageContext {
    /// Joins the cell and opens the ports to the supervisor.
    pub fn join(args: &StageArgs, cell: LoadedCell) -> Result<Self> {
        let stage = cell
            .schedule
            .stages
            .iter()
            .position(|s| s.kind == args.kind && s.name == args.name)
            .ok_or_else(|| anyhow!("the schedule has no stage \"{}\"", args.name))?;
        let name = CellName::new(&cell.name)?;
        let node = Node::join(&name, &args.name)?;
        let listener = node.listener(&args.name)?;
        let control = node.subscriber("control")?;
        let patience = patience(&cell);
        let events = node
            .publisher("event", MAX_TEXT_BYTES, &[SUPERVISOR.to_owned()], patience)?
            .without_notification();
        let supervisor = node.notifier(SUPERVISOR)?;
        let order = Order::new(&cell.schedule);
        Ok(Self {
            gates: SequenceGates::open(&name, order.lanes.len())?,
            dependents: dependents(&cell, &order, stage, &node)?,
            supervisor_notifications: supervisor_notifications(&cell, stage),
            order,
            cell,
            stage,
            recipe: 0,
            cycles: CycleFilter::default(),
            listener,
            control,
            events,
            supervisor,
            node,
            segments: name.segments(),
            on_large_pages: false,
            idle_since_ns: now_ns(),
            usage: Usage::now(),
            allocations: allocations(),
            messages: loans(),
            send_ns: 0,
        })
    }

    /// Puts the buffers of this stage on large pages, where there are some; without them it only is slower. Call it after connecting: all buffers are
    /// there, and nobody populates them yet; while others do, most cannot be put together. Full ones would be copied, so that nothing happens when
    /// another stage connects again.
    pub fn use_large_pages(&mut self) {
        if std::mem::replace(&mut self.on_large_pages, true) {
            return;
        }
        let begin = now_ns();
        // These two need memory by the number of points, when they see them.
        let by_points = matches!(self.cell.schedule.stages[self.stage].kind, Kind::Fusion | Kind::Inspection);
        let room = if by_points { ROOM } else { 0 };
        let bytes = ipc::large_pages::use_large_pages(&self.segments, room, LARGE_PAGES).unwrap_or(0);
        let ms = (now_ns() - begin) / 1_000_000;
        tracing::debug!(bytes, ms, "buffers on large pages");
    }

    /// Populates all shared memory of this stage, to avoid page faults later. Call it after connecting: only then all of it
    /// is mapped.
    ///
    /// # Errors
    /// There is not enough memory: touching it later would kill the stage in the middle of a cycle.
    pub fn populate(&self) -> Result<()> {
        let begin = now_ns();
        if let Some(bytes) = populated(ipc::os::populate(&self.segments), "this stage")? {
            let ms = (now_ns() - begin) / 1_000_000;
            tracing::debug!(bytes, ms, "shared memory populated");
        }
        Ok(())
    }

    /// Whether the lane is at this activation and all its inputs were sent. A notification arrives when both are true.
    ///
    /// Call it before reading the inboxes: then they contain all valid inputs, and a duplicate is found before it is used.
    pub fn may_start(&self, work: Work) -> bool {
        let Some(number) = self.cell.schedule.find(work) else { return false };
        let inputs = &self.cell.schedule.activations[number].inputs;
        self.gates.is_open(self.order.lane[number], self.point(number))
            && inputs.iter().all(|&input| self.is_available(number, input))
    }

    /// Whether an input of an activation was sent. The acquisition may be several cycles ahead of the evaluation.
    fn is_available(&self, number: usize, input: usize) -> bool {
        let (lane, point) = (self.order.lane[input], self.point(input));
        if self.order.lanes[lane].half == self.order.lanes[self.order.lane[number]].half {
            self.gates.is_done_in_cycle(lane, point)
        } else {
            self.gates.is_done(lane, point)
        }
    }

    /// The command that starts a cycle for this stage.
    pub(super) fn start_command(&self) -> Command {
        match self.cell.schedule.stages[self.stage].kind.half() {
            Half::Acquisition => Command::Start,
            Half::Evaluation => Command::Evaluate,
        }
    }

    fn point(&self, activation: usize) -> SequencePoint {
        SequencePoint { cycle: self.cycle(), position: self.order.place[activation] }
    }

    /// Opens the next position of the lane and notifies the stages that wait for this activation.
    fn advance(&self, activation: usize) {
        self.gates.advance(self.order.lane[activation], self.point(activation));
        self.order.wakes[activation]
            .iter()
            .filter_map(|stage| self.dependents.get(stage))
            .for_each(Notifier::notify);
    }

    /// Name of this stage.
    pub fn name(&self) -> &str {
        &self.cell.schedule.stages[self.stage].name
    }

    /// Index of the camera or pair of this stage.
    pub fn subject(&self) -> usize {
        self.cell.schedule.stages[self.stage].subject
    }

    /// A publisher on a topic of the schedule. Its receivers are notified when the activation is done ([`Self::done`]).
    pub fn publisher<H: Header>(&self, topic: &str) -> Result<Publisher<H>> {
        let plan = self.plan(topic)?;
        let sender =
            self.node.publisher(topic, plan.bytes as usize, &plan.consumers, patience(&self.cell))?;
        Ok(sender.without_notification())
    }

    /// A topic of the schedule by its name.
    pub(super) fn plan(&self, topic: &str) -> Result<&Topic> {
        self.cell.schedule.topic(topic).with_context(|| format!("the schedule has no topic \"{topic}\""))
    }

    /// The current cycle, as in messages.
    pub fn cycle(&self) -> u64 {
        self.cycles.current().unwrap_or_default()
    }

    /// Resets the counters of waiting time and resource use, for instance after the part was moved.
    pub fn reset_counters(&mut self) {
        self.idle_since_ns = now_ns();
        self.usage = Usage::now();
        (self.allocations, self.messages) = (allocations(), loans());
        self.send_ns = 0;
    }

    /// Sends a message and adds the time to that of the report.
    pub fn sending(&mut self, send: impl FnOnce() -> Result<(), IpcError>) -> Result<(), IpcError> {
        let start_ns = now_ns();
        let sent = send();
        self.send_ns += now_ns().saturating_sub(start_ns);
        sent
    }

    /// Reports an activation that started at `start_ns` and has the output `bytes`.
    pub fn done(&mut self, work: Work, start_ns: u64, bytes: &[u8], report: Report<'_>) -> Result<(), Fault> {
        let hash = if bytes.is_empty() { 0 } else { output_hash(bytes) };
        self.done_hashed(work, start_ns, (bytes.len(), hash), report)
    }

    /// Reports an activation by length and hash of its output.
    pub fn done_hashed(
        &mut self,
        work: Work,
        start_ns: u64,
        (bytes, hash): (usize, u128),
        report: Report<'_>,
    ) -> Result<(), Fault> {
        let activation = self
            .cell
            .schedule
            .find(work)
            .ok_or_else(|| Fault::Cycle(format!("{work:?} is not in the schedule")))?;
        let (end_ns, usage, allocated, messages) = (now_ns(), Usage::now(), allocations(), loans());
        let used = usage.since(self.usage);
        let header = Event {
            cycle: self.cycle(),
            hash_high: (hash >> 64) as u64,
            hash_low: hash as u64,
            start_ns,
            end_ns,
            wait_ns: start_ns.saturating_sub(self.idle_since_ns),
            bytes: bytes as u64,
            send_ns: self.send_ns,
            cpu_ns: used.cpu_ns,
            minor_faults: used.minor_faults as u32,
            major_faults: used.major_faults as u32,
            voluntary_switches: used.voluntary_switches as u32,
            involuntary_switches: used.involuntary_switches as u32,
            allocations: (allocated - self.allocations) as u32,
            messages: (messages - self.messages) as u32,
            activation: activation as u32,
            count: report.count as u32,
            ..self.event(EventKind::Done, 0)
        };
        tracing::debug!(?work, bytes, wait_ns = header.wait_ns, ns = end_ns.saturating_sub(start_ns), "done");
        (self.idle_since_ns, self.usage, self.send_ns) = (end_ns, usage, 0);
        (self.allocations, self.messages) = (allocated, messages);
        self.send_report(header, report.text)?;
        self.advance(activation);
        if self.supervisor_notifications.contains(&activation) {
            self.supervisor.notify();
        }
        Ok(())
    }

    /// Sends a report; a text that is longer than an event in parts, the last of which comes with `done`.
    fn send_report(&self, done: Event, text: &str) -> Result<(), IpcError> {
        let mut parts = parts(text, MAX_TEXT_BYTES).peekable();
        while let Some(part) = parts.next() {
            let text_bytes = part.len() as u32;
            if parts.peek().is_none() {
                return self.events.send(Event { text_bytes, ..done }, part.as_bytes());
            }
            let event = Event { text_bytes, kind: EventKind::Part as u32, ..done };
            self.events.send(event, part.as_bytes())?;
            // So many parts may come that they fill the buffer: the supervisor empties it meanwhile.
            self.supervisor.notify();
        }
        Ok(())
    }

    /// Reports that this stage is ready; `answer` is the number of the connect command, 0 after the start.
    pub fn ready(&self, answer: u64) -> Result<(), IpcError> {
        self.events.send(Event { cycle: answer, ..self.event(EventKind::Ready, 0) }, &[])?;
        self.supervisor.notify();
        Ok(())
    }

    /// Tells the supervisor what the host that leads wants.
    pub fn announce(&self, kind: EventKind, cycle: u64, text: &str) -> Result<(), IpcError> {
        let text = shorten(text, MAX_TEXT_BYTES);
        self.events.send(Event { cycle, ..self.event(kind, text.len()) }, text.as_bytes())?;
        self.supervisor.notify();
        Ok(())
    }

    /// Reports that a cycle failed, and ends it. Cycle 0: the stage itself fails.
    pub fn failed(&mut self, cycle: u64, reason: &str) -> Result<(), IpcError> {
        let text = shorten(reason, MAX_TEXT_BYTES);
        let header = Event { cycle, count: self.cycles.stale(), ..self.event(EventKind::Failed, text.len()) };
        self.cycles.end(cycle);
        self.events.send(header, text.as_bytes())?;
        self.supervisor.notify();
        Ok(())
    }

    /// Sleeps until a notification arrives or the timeout is over.
    pub fn sleep(&self, timeout: Duration) -> Result<(), IpcError> {
        self.listener.wait(timeout).map(|_| ())
    }

    fn event(&self, kind: EventKind, text_bytes: usize) -> Event {
        Event {
            stage: self.stage as u32,
            kind: kind as u32,
            pid: std::process::id(),
            text_bytes: text_bytes as u32,
            ..Event::default()
        }
    }
}

/// The activations of a stage after which the supervisor is notified.
fn supervisor_notifications(cell: &Cell, stage: usize) -> BTreeSet<usize> {
    let activations = cell.schedule.activations.iter().enumerate();
    let mine: Vec<usize> = activations.filter(|(_, a)| a.stage == stage).map(|(number, _)| number).collect();
    let every = mine.iter().copied().skip(REPORTS_PER_NOTIFICATION - 1).step_by(REPORTS_PER_NOTIFICATION);
    every.chain(mine.last().copied()).collect()
}

/// Notifiers of the other stages whose activations depend on those of this stage.
fn dependents(cell: &Cell, order: &Order, stage: usize, node: &Node) -> Result<BTreeMap<usize, Notifier>> {
    let activations = cell.schedule.activations.iter().zip(&order.wakes);
    let woken = activations.filter(|(activation, _)| activation.stage == stage).flat_map(|(_, wakes)| wakes);
    let others: BTreeSet<usize> = woken.copied().collect();
    others.into_iter().map(|other| Ok((other, node.notifier(&cell.schedule.stages[other].name)?))).collect()
}

/// A sender waits longer for a full buffer than the supervisor waits for progress: so the supervisor finds and kills the hung
/// receiver, not the waiting sender.
fn patience(cell: &Cell) -> Duration {
    Duration::from_millis(cell.config.limits.stage_budget_ms.saturating_mul(2))
}

/// How many bytes of shared memory were populated; `None`, with a warning, where they were not and page faults slow the first cycles down.
/// `whose`: buffers, in words.
///
/// # Errors
/// There is not enough memory.
pub fn populated(bytes: std::io::Result<u64>, whose: &str) -> Result<Option<u64>> {
    match bytes {
        Ok(bytes) => Ok(Some(bytes)),
        // "Bad address": touching the memory would be a bus error.
        Err(error) if error.raw_os_error() == Some(libc::EFAULT) => {
            anyhow::bail!(
                "no space for the buffers of {whose}: /dev/shm is full; free space there or enlarge it"
            )
        }
        Err(error) => {
            tracing::warn!("cannot populate shared memory: {error}; the first cycles take longer");
            Ok(None)
        }
    }
}
