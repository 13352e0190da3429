//! What every stage shares: its ports to the supervisor, its place in the schedule, its cycle.

use super::args::StageArgs;
use super::fault::Fault;
use super::gate::{Gate, Verdict};
use super::text::shorten;
use crate::graph::Cell;
use crate::schedule::{Carries, FRAME_BUFFER, Half, Order, SUPERVISOR, Topic, Work};
use anyhow::{Context, Result, anyhow};
use ipc::IpcError;
use ipc::cell::CellName;
use ipc::error::MessageError;
use ipc::header::{Command, Control, Event, EventKind, Header, MAX_TEXT_BYTES};
use ipc::os::{Usage, now_ns};
use ipc::port::{Bell, Node, Publisher, Received, Ringer, Subscriber, loans};
use ipc::turn::{Turn, Turns};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;
use xxhash_rust::xxh3::xxh3_128;

/// A stage's view of the cell.
pub struct Link {
    /// Config, graph, schedule.
    pub cell: Cell,
    /// Number of this stage in the schedule.
    pub stage: usize,
    /// Recipe of the cycle that runs.
    pub recipe: usize,
    pub(super) gate: Gate,
    pub(super) bell: Bell,
    pub(super) control: Subscriber<Control>,
    events: Publisher<Event>,
    /// Rung after whoever may go on with the cycle.
    supervisor: Ringer,
    /// Of the activations of this stage, those after which it is rung.
    ringing: BTreeSet<usize>,
    node: Node,
    /// What the paths of the cell's shared memory begin with.
    segments: String,
    order: Order,
    turns: Turns,
    /// Bells of the stages that wait for this one: for its core, or for what it gives.
    waiting: BTreeMap<usize, Ringer>,
    idle_since_ns: u64,
    /// As of the last report.
    usage: Usage,
    allocations: u64,
    /// Likewise.
    messages: u64,
    /// Spent on sending since the last report, ns.
    send_ns: u64,
}

/// The supervisor is rung for every so many reports of a stage, and for its last one of a cycle; it takes the others along,
/// or finds them within 20 ms by itself. Ringing costs whoever goes on with the cycle on the same core some 50 µs. Half of the
/// frames that may wait in front of it, where it watches them.
const REPORTS_PER_RING: usize = FRAME_BUFFER / 2;

/// What an activation did, beside its bytes.
#[derive(Debug, Clone, Copy, Default)]
pub struct Report<'a> {
    /// Valid pixels, points, features.
    pub count: usize,
    /// A report as JSON, or empty.
    pub text: &'a str,
}

/// Heap allocations of this process, where the build counts them.
fn allocations() -> u64 {
    #[cfg(feature = "count-allocations")]
    return crate::allocations::count();
    #[cfg(not(feature = "count-allocations"))]
    0
}

impl Link {
    /// Joins the cell and opens the ports to the supervisor.
    pub fn join(args: &StageArgs, cell: Cell) -> Result<Self> {
        let stage = cell
            .schedule
            .stages
            .iter()
            .position(|s| s.kind == args.kind && s.name == args.name)
            .ok_or_else(|| anyhow!("the schedule has no stage \"{}\"", args.name))?;
        let name = CellName::new(&args.cell)?;
        let node = Node::join(&name, &args.name)?;
        let bell = node.bell(&args.name)?;
        let control = node.subscriber("control")?;
        let patience = patience(&cell);
        let events = node.publisher("event", MAX_TEXT_BYTES, &[SUPERVISOR.to_owned()], patience)?.silent();
        let supervisor = node.ringer(SUPERVISOR)?;
        let order = Order::new(&cell.schedule);
        Ok(Self {
            turns: Turns::open(&name, order.lanes.len())?,
            waiting: waiting(&cell, &order, stage, &node)?,
            ringing: ringing(&cell, stage),
            order,
            cell,
            stage,
            recipe: 0,
            gate: Gate::default(),
            bell,
            control,
            events,
            supervisor,
            node,
            segments: name.segments(),
            idle_since_ns: now_ns(),
            usage: Usage::now(),
            allocations: allocations(),
            messages: loans(),
            send_ns: 0,
        })
    }

    /// Makes all memory that this stage shares ready to be touched without page faults. After connecting: only then all of
    /// it is mapped.
    ///
    /// # Errors
    /// Pages that cannot be had: touching them later would end the stage in the middle of a cycle.
    pub fn populate(&self) -> Result<()> {
        let begin = now_ns();
        match ipc::os::populate(&self.segments) {
            Ok(bytes) => {
                let ms = (now_ns() - begin) / 1_000_000;
                tracing::debug!(bytes, ms, "shared memory populated");
            }
            // Bad address: what a bus error would be on touching it.
            Err(error) if error.raw_os_error() == Some(libc::EFAULT) => {
                anyhow::bail!(
                    "no room for this stage's buffers: is /dev/shm full? Free some of it or make it larger"
                );
            }
            // Page faults in the first cycles are no reason not to measure.
            Err(error) => {
                tracing::warn!("shared memory cannot be populated ahead: {error}; first cycles take longer");
            }
        }
        Ok(())
    }

    /// Whether its lane has come to this work and all that it takes was sent. The bell rings when it is so.
    ///
    /// To be asked before the inboxes are emptied: then the true messages are among what is found there, and one that came
    /// twice is seen before it is used.
    pub fn may(&self, work: Work) -> bool {
        let Some(number) = self.cell.schedule.find(work) else { return false };
        let inputs = &self.cell.schedule.activations[number].inputs;
        self.turns.is(self.order.lane[number], self.turn(number))
            && inputs.iter().all(|&input| self.is_given(number, input))
    }

    /// Whether the input of an activation was sent. The acquisition may be cycles ahead of the evaluation.
    fn is_given(&self, number: usize, input: usize) -> bool {
        let (lane, turn) = (self.order.lane[input], self.turn(input));
        if self.order.lanes[lane].half == self.order.lanes[self.order.lane[number]].half {
            self.turns.is_past(lane, turn)
        } else {
            self.turns.was_past(lane, turn)
        }
    }

    /// The command that begins a cycle here.
    pub(super) fn begins(&self) -> Command {
        match self.cell.schedule.stages[self.stage].kind.half() {
            Half::Acquisition => Command::Start,
            Half::Evaluation => Command::Evaluate,
        }
    }

    fn turn(&self, activation: usize) -> Turn {
        Turn { cycle: self.cycle(), place: self.order.place[activation] }
    }

    /// Lets the lane go on to what comes after an activation, and the others begin what they needed it for.
    fn pass(&self, activation: usize) {
        self.turns.pass(self.order.lane[activation], self.turn(activation));
        self.order.wakes[activation]
            .iter()
            .filter_map(|stage| self.waiting.get(stage))
            .for_each(Ringer::ring);
    }

    /// The subject of this stage: camera or pair.
    pub fn subject(&self) -> usize {
        self.cell.schedule.stages[self.stage].subject
    }

    /// A sender on a topic of the schedule. Whoever takes from it is rung when the activation is done ([`Self::done`]).
    pub fn publisher<H: Header>(&self, topic: &str) -> Result<Publisher<H>> {
        let plan = self.plan(topic)?;
        let sender =
            self.node.publisher(topic, plan.bytes as usize, &plan.consumers, patience(&self.cell))?;
        Ok(sender.silent())
    }

    /// A receiver of a topic of the schedule.
    pub fn inbox<H: Header>(&self, topic: &str) -> Result<Inbox<H>> {
        let ahead = match self.plan(topic)?.carries {
            // What the acquisition hands to the evaluation.
            Carries::Phase => self.cell.schedule.in_flight as u64 - 1,
            _ => 0,
        };
        Ok(Inbox { subscriber: self.node.subscriber(topic)?, early: None, ahead })
    }

    fn plan(&self, topic: &str) -> Result<&Topic> {
        self.cell.schedule.topic(topic).with_context(|| format!("the schedule has no topic \"{topic}\""))
    }

    /// The cycle that runs, as on the wire.
    pub fn cycle(&self) -> u64 {
        self.gate.current().unwrap_or_default()
    }

    /// Begins to measure waiting and use from now, for instance after the part was moved.
    pub fn idle_from_now(&mut self) {
        self.idle_since_ns = now_ns();
        self.usage = Usage::now();
        (self.allocations, self.messages) = (allocations(), loans());
        self.send_ns = 0;
    }

    /// Hands a message over and counts the time that it takes.
    pub fn sending(&mut self, send: impl FnOnce() -> Result<(), IpcError>) -> Result<(), IpcError> {
        let start_ns = now_ns();
        let sent = send();
        self.send_ns += now_ns().saturating_sub(start_ns);
        sent
    }

    /// Reports an activation that began at `start_ns` and gave `bytes`.
    pub fn done(&mut self, work: Work, start_ns: u64, bytes: &[u8], report: Report<'_>) -> Result<(), Fault> {
        let hash = if bytes.is_empty() { 0 } else { xxh3_128(bytes) };
        self.done_hashed(work, start_ns, (bytes.len(), hash), report)
    }

    /// The same for an output that is already sent.
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
            ..self.event(EventKind::Done, report.text.len())
        };
        tracing::debug!(?work, bytes, wait_ns = header.wait_ns, ns = end_ns.saturating_sub(start_ns), "done");
        (self.idle_since_ns, self.usage, self.send_ns) = (end_ns, usage, 0);
        (self.allocations, self.messages) = (allocated, messages);
        self.events.send(header, report.text.as_bytes())?;
        self.pass(activation);
        if self.ringing.contains(&activation) {
            self.supervisor.ring();
        }
        Ok(())
    }

    /// Reports that the ports stand, as an answer to the number of a connect command.
    pub fn ready(&self, answer: u64) -> Result<(), IpcError> {
        self.events.send(Event { cycle: answer, ..self.event(EventKind::Ready, 0) }, &[])?;
        self.supervisor.ring();
        Ok(())
    }

    /// Reports that the cycle cannot be finished, and forgets it. Cycle 0: the stage itself cannot go on.
    pub fn failed(&mut self, cycle: u64, reason: &str) -> Result<(), IpcError> {
        let text = shorten(reason, MAX_TEXT_BYTES);
        let header = Event { cycle, count: self.gate.stale(), ..self.event(EventKind::Failed, text.len()) };
        self.gate.end(cycle);
        self.events.send(header, text.as_bytes())?;
        self.supervisor.ring();
        Ok(())
    }

    /// Sleeps until somebody rings or the time is over.
    pub fn sleep(&self, timeout: Duration) -> Result<(), IpcError> {
        self.bell.wait(timeout).map(|_| ())
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

/// The activations of a stage after which the supervisor is rung.
fn ringing(cell: &Cell, stage: usize) -> BTreeSet<usize> {
    let activations = cell.schedule.activations.iter().enumerate();
    let mine: Vec<usize> = activations.filter(|(_, a)| a.stage == stage).map(|(number, _)| number).collect();
    let every = mine.iter().copied().skip(REPORTS_PER_RING - 1).step_by(REPORTS_PER_RING);
    every.chain(mine.last().copied()).collect()
}

/// The bells of the other stages that may begin something when this one has done something.
fn waiting(cell: &Cell, order: &Order, stage: usize, node: &Node) -> Result<BTreeMap<usize, Ringer>> {
    let activations = cell.schedule.activations.iter().zip(&order.wakes);
    let woken = activations.filter(|(activation, _)| activation.stage == stage).flat_map(|(_, wakes)| wakes);
    let others: BTreeSet<usize> = woken.copied().collect();
    others.into_iter().map(|other| Ok((other, node.ringer(&cell.schedule.stages[other].name)?))).collect()
}

/// A sender waits longer for room than the supervisor waits for progress: then the receiver that hangs is found and
/// killed, and not the sender that waits for it.
fn patience(cell: &Cell) -> Duration {
    Duration::from_millis(cell.config.limits.stage_budget_ms.saturating_mul(2))
}

/// A receiver that hands out only messages of the running cycle.
pub struct Inbox<H: Header> {
    subscriber: Subscriber<H>,
    early: Option<Received<H>>,
    /// By so many cycles an honest sender may be ahead.
    ahead: u64,
}

impl<H: Header> Inbox<H> {
    /// The next message of the running cycle.
    pub fn take(&mut self, link: &mut Link) -> Result<Option<Received<H>>, IpcError> {
        loop {
            let next = match self.early.take() {
                Some(early) => Some(early),
                None => self.subscriber.receive()?,
            };
            let Some(message) = next else { return Ok(None) };
            match link.gate.judge(message.header().cycle()) {
                Verdict::Now => return Ok(Some(message)),
                Verdict::Stale => {}
                Verdict::Absurd => {
                    let value = message.header().cycle();
                    let allowed = "the cycle that runs and the sixteen after it";
                    let source = MessageError::Value { key: "cycle", value, allowed };
                    return Err(IpcError::Message { topic: self.subscriber.topic().to_owned(), source });
                }
                Verdict::Early => {
                    self.early = Some(message);
                    return Ok(None);
                }
            }
        }
    }

    /// Fails when a message of a later cycle stands before what may still come of this one.
    ///
    /// No honest stage sends it while this cycle runs: it lies, or the cycle is over and the command that says so on its way.
    pub fn check_not_overtaken(&self, link: &Link) -> Result<(), Fault> {
        let allowed = link.cycle().saturating_add(self.ahead);
        match self.early.as_ref().filter(|early| early.header().cycle() > allowed) {
            Some(early) => Err(Fault::Cycle(format!(
                "a message of cycle {} came on {} before this one was done",
                early.header().cycle(),
                self.subscriber.topic()
            ))),
            None => Ok(()),
        }
    }

    /// Connects to senders that have come since.
    pub fn connect(&self) -> Result<(), IpcError> {
        self.subscriber.connect()
    }
}
