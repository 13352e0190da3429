//! The supervisor at work: moves messages between its pure modules and the world.

use super::children::{Life, StageProcess};
use super::collect::Collector;
use super::cycle::{Action, Cycles, Input};
use super::desk::Desk;
use super::history::{self, History};
use super::http;
use super::keep::Keeper;
use super::profile::Profile;
use super::socket::{self, Call};
use super::start::{self, Orders};
use super::watch::Watch;
use crate::cycle_number::{unwire, wire};
use crate::graph::Cell;
use crate::judgement::Judgement;
use crate::print;
use crate::schedule::{Half, Interval, Order, SUPERVISOR, label, violation};
use anyhow::Result;
use crossbeam::channel::{Receiver, bounded};
use files::result::CycleResult;
use ipc::IpcError;
use ipc::cell::{CellLock, CellName};
use ipc::error::MessageError;
use ipc::header::{Command, Control, Event, EventKind, Outcome};
use ipc::os::now_ns;
use ipc::payload;
use ipc::port::{Bell, Held, Node, Publisher, Subscriber};
use ipc::turn::Turns;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// How often children, limits and the socket are looked at when nobody rings.
pub(super) const TICK: Duration = Duration::from_millis(20);

/// How long a command may wait for room in front of a stage. Sixteen of them only wait in front of a hung one, which is
/// killed anyway.
const COMMAND_PATIENCE: Duration = Duration::from_millis(50);

/// Requests that may wait for the next look: more than clients can be connected, since each waits for its answer.
const WAITING_CALLS: usize = 64;

/// What a run leaves.
pub struct Summary {
    /// Results that were not ok, and the last one: enough for an exit code.
    pub not_ok: u64,
    /// Cycles whose verdict is not pass although the plan asks for one.
    pub not_pass: u64,
    /// Whether the operator ended it.
    pub stopped: bool,
    /// Why the cell gave up.
    pub held: Option<String>,
    /// When the last cycles ran and what was done in them.
    pub history: History,
    /// What was seen of the last cycle.
    pub watch: Option<Watch>,
    /// Cycles that are missing in the cycle record, and why.
    pub unrecorded: Option<anyhow::Error>,
    // Dropped last, in this order: the ports above before the node, the node before the folder.
    _ports: Ports,
}

/// What keeps the shared memory alive.
pub(super) struct Ports {
    _held: Vec<Held>,
    pub(super) node: Node,
    _lock: CellLock,
}

/// The supervisor at work.
pub(super) struct Supervisor<'a> {
    pub(super) cell: &'a Cell,
    pub(super) control: Publisher<Control>,
    pub(super) events: Subscriber<Event>,
    pub(super) results: Subscriber<Outcome>,
    pub(super) bell: Bell,
    pub(super) watch: Option<Watch>,
    pub(super) keeper: Option<Keeper>,
    pub(super) children: Vec<StageProcess>,
    pub(super) cycles: Cycles,
    /// Number of the last connect command.
    pub(super) epoch: u64,
    pub(super) connecting: bool,
    /// When that command was given, ns.
    pub(super) connect_ns: Option<u64>,
    /// Of the cycles that run, by cycle.
    collectors: BTreeMap<u64, Collector>,
    pub(super) order: Order,
    pub(super) turns: Turns,
    pub(super) requests: Receiver<Call>,
    pub(super) interrupted: Arc<AtomicBool>,
    pub(super) history: History,
    pub(super) requested: Option<u64>,
    pub(super) tally: Tally,
    pub(super) profile: Profile,
    pub(super) desk: Desk,
    /// Whether all stages were ready when it was last asked.
    pub(super) was_ready: bool,
    pub(super) ports: Ports,
}

/// What is counted of a run.
#[derive(Debug, Default)]
pub(super) struct Tally {
    pub(super) done: u64,
    pub(super) ok: u64,
    not_pass: u64,
    pub(super) stopped: bool,
    pub(super) held: Option<String>,
    /// The last cycle that was not ok, and why.
    pub(super) last_failure: Option<(u64, String)>,
}

impl<'a> Supervisor<'a> {
    /// Makes the shared memory and the ports; no stage runs yet.
    pub(super) fn new(cell: &'a Cell, orders: &Orders, interrupted: Arc<AtomicBool>) -> Result<Self> {
        let name = CellName::new(&cell.name)?;
        let lock = CellLock::take(&name)?;
        lock.check_space(cell.schedule.memory_bytes())?;
        let node = Node::join(&name, SUPERVISOR)?;
        let mut held =
            cell.schedule.topics.iter().map(|t| start::create(&node, t)).collect::<Result<Vec<_>, _>>()?;
        for owner in cell.schedule.stages.iter().map(|s| s.name.as_str()).chain([SUPERVISOR]) {
            held.push(node.create_bell(owner)?);
        }
        let (calls, requests) = bounded(WAITING_CALLS);
        socket::listen(&name.socket(), calls.clone())?;
        if let Some(address) = orders.metrics {
            let address = http::listen(address, calls)?;
            print::say(&format!("metrics at http://{address}/metrics"));
        }
        let order = Order::new(&cell.schedule);
        let stages: Vec<String> = cell.schedule.stages.iter().map(|s| s.name.clone()).collect();
        let watch = cell.graph.watch.then(|| Watch::new(&node, cell)).transpose()?;
        let keeper = orders.cycle_record.as_ref().map(|path| Keeper::new(path, cell, &node)).transpose()?;
        Ok(Self {
            control: node.publisher("control", 1, &stages, COMMAND_PATIENCE)?,
            events: node.subscriber("event")?,
            results: node.subscriber("result")?,
            bell: node.bell(SUPERVISOR)?,
            watch,
            keeper,
            children: start::children(cell, orders),
            cycles: start::machine(cell, orders),
            epoch: 0,
            connecting: false,
            connect_ns: None,
            collectors: BTreeMap::new(),
            turns: Turns::create(&name, order.lanes.len())?,
            order,
            requests,
            interrupted,
            history: History::default(),
            requested: orders.cycles,
            tally: Tally::default(),
            was_ready: false,
            desk: Desk::new(cell.recipes.iter().map(|r| r.name.clone()).collect(), orders.serve),
            profile: Profile::new(&stages, start::millis(cell.config.limits.cycle_deadline_ms))?,
            ports: Ports { _held: held, node, _lock: lock },
            cell,
        })
    }

    /// Gives an input to the cycles and does what they want.
    pub(super) fn feed(&mut self, input: Input, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        for action in self.cycles.handle(now_ns(), input) {
            match action {
                Action::Start(cycle) => {
                    self.collectors.insert(cycle, Collector::default());
                    if let Some(keeper) = &mut self.keeper {
                        keeper.begin(cycle);
                    }
                    self.turns.begin(self.lanes(|half| half != Some(Half::Evaluation)), wire(cycle));
                    self.profile.begin(cycle, now_ns());
                    self.command(Command::Start, wire(cycle))?;
                }
                Action::Evaluate(cycle) => {
                    self.turns.begin(self.lanes(|half| half == Some(Half::Evaluation)), wire(cycle));
                    self.command(Command::Evaluate, wire(cycle))?;
                }
                Action::Abort(cycle) => self.command(Command::Abort, wire(cycle))?,
                Action::Kill { stage, reason } => self.children[stage].kill(&reason),
                Action::Outcome { cycle, result } => self.conclude(cycle, &result, each)?,
                Action::Finished => {}
            }
        }
        Ok(())
    }

    /// The lanes whose half of the cycle it is.
    fn lanes(&self, which: fn(Option<Half>) -> bool) -> impl Iterator<Item = usize> {
        self.order
            .lanes
            .iter()
            .enumerate()
            .filter(move |(_, lane)| which(lane.half))
            .map(|(number, _)| number)
    }

    fn conclude(
        &mut self,
        cycle: u64,
        outcome: &Result<(), String>,
        each: &mut dyn FnMut(&CycleResult),
    ) -> Result<()> {
        let collector = self.collectors.remove(&cycle).unwrap_or_default();
        let trusted = || self.in_order(&collector).and_then(|()| collector.check_result(&self.cell.schedule));
        let outcome = &outcome.clone().and_then(|()| trusted());
        if let Some(watch) = &mut self.watch {
            watch.look()?;
            watch.ended(wire(cycle), outcome.is_ok());
        }
        let mut result = collector.result(self.cell, cycle, outcome);
        if let Some(keeper) = &mut self.keeper {
            keeper.end(self.cell, &result, self.desk.recipe(), collector.events())?;
        }
        let end_ns = now_ns();
        let duration_ns = self.profile.end(&result, end_ns);
        tracing::info!(cycle, outcome = result.outcome, verdict = ?result.verdict, duration_ns, "cycle ended");
        if let Some(duration_ns) = duration_ns {
            result.more.insert("duration_ns".into(), duration_ns.into());
        }
        let plan = self.cell.recipes.get(self.desk.recipe()).and_then(|recipe| recipe.plan.as_ref());
        self.desk.mark(&mut result);
        if let Some(duration_ns) = duration_ns {
            self.history.add(history::ended(&result, end_ns, duration_ns), collector.spans(cycle));
        }
        self.tally.done += 1;
        self.tally.ok += u64::from(outcome.is_ok());
        if let Err(reason) = outcome {
            self.tally.last_failure = Some((cycle, reason.clone()));
        }
        let pass = result.verdict == Some(files::result::ResultVerdict::Pass);
        self.tally.not_pass += u64::from(outcome.is_ok() && plan.is_some() && !pass);
        each(&result);
        let next = self.desk.concluded(&result);
        self.act(next, each)
    }

    /// A result whose making stood against the schedule is none.
    fn in_order(&self, collector: &Collector) -> Result<(), String> {
        let trace: Vec<Interval> = collector.intervals().collect();
        let Some((before, after)) = violation(&self.cell.schedule, &self.order, &trace) else {
            return Ok(());
        };
        let name = |number: usize| {
            let activation = &self.cell.schedule.activations[number];
            let stage = &self.cell.schedule.stages[activation.stage].name;
            format!("\"{}\" of {stage}", label(&self.cell.graph, activation.work))
        };
        Err(format!("out of schedule: {} began before {}", name(after), name(before)))
    }

    pub(super) fn command(&self, command: Command, number: u64) -> Result<()> {
        let recipe = self.desk.recipe() as u32;
        match self.control.send(Control { recipe, ..Control::new(command, number) }, &[]) {
            // A stage that is down or hung misses it; its end is noticed apart.
            Err(IpcError::NotReached { .. } | IpcError::Full { .. }) => Ok(()),
            other => Ok(other?),
        }
    }

    /// Takes messages. One that contradicts itself ends the cycle: nobody knows what else its sender got wrong.
    pub(super) fn hear(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        match self.take_messages(each) {
            Err(error) if is_lie(&error) => {
                tracing::error!("{error:#}");
                self.feed(Input::Distrust { reason: format!("{error:#}") }, each)
            }
            other => other,
        }
    }

    fn take_messages(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        while let Some(message) = self.results.receive()? {
            let header = *message.header();
            let Some(cycle) = unwire(header.cycle) else { continue };
            let Some(collector) = self.collectors.get_mut(&cycle) else { continue };
            let text = payload::text(header.text_bytes, message.payload())?;
            let judgement: Judgement = serde_json::from_str(text)?;
            if let Some(keeper) = &self.keeper {
                keeper.result(self.cell, header.cycle, text);
            }
            collector.judged(judgement, text, header.t_ns.saturating_sub(header.t_last_frame_ns));
            self.feed(Input::Result { cycle }, each)?;
        }
        if let Some(watch) = &mut self.watch {
            watch.look()?;
        }
        if let Some(keeper) = &mut self.keeper {
            keeper.look(self.cell)?;
        }
        while let Some(message) = self.events.receive()? {
            let header = *message.header();
            let text = payload::text(header.text_bytes, message.payload())?.to_owned();
            drop(message);
            self.event(header, &text, each)?;
        }
        Ok(())
    }

    fn event(&mut self, event: Event, text: &str, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        let stage = event.stage as usize;
        let Some(child) = self.children.get_mut(stage).filter(|c| c.pid() == Some(event.pid)) else {
            return Ok(()); // the last words of a process that was replaced
        };
        child.heard_ns = now_ns();
        match event.kind()? {
            EventKind::Ready if event.cycle == 0 => {
                child.life = Life::Up;
                self.connecting = true;
                Ok(())
            }
            EventKind::Ready if event.cycle == self.epoch => self.feed(Input::Ready { stage }, each),
            EventKind::Ready => Ok(()),
            EventKind::Failed => {
                if let Some(cycle) = unwire(event.cycle) {
                    return self.feed(Input::Failed { stage, cycle, reason: text.to_owned() }, each);
                }
                child.last_words = Some(text.to_owned());
                Ok(())
            }
            EventKind::Done => {
                let Some(cycle) = unwire(event.cycle) else { return Ok(()) };
                if let Some(collector) = self.collectors.get_mut(&cycle) {
                    collector.done(event, text);
                }
                self.feed(Input::Done { stage, cycle, activation: event.activation as usize }, each)
            }
        }
    }

    /// What the run leaves.
    pub(super) fn summary(mut self) -> Summary {
        let unrecorded = self.keeper.as_mut().and_then(|keeper| keeper.finish().err());
        Summary {
            unrecorded,
            not_ok: self.tally.done - self.tally.ok,
            not_pass: self.tally.not_pass,
            stopped: self.tally.stopped,
            held: self.tally.held,
            history: self.history,
            watch: self.watch,
            _ports: self.ports,
        }
    }
}

/// Whether the sender of a message is to blame, and not the machine.
fn is_lie(error: &anyhow::Error) -> bool {
    error.is::<MessageError>()
        || error.is::<serde_json::Error>()
        || matches!(error.downcast_ref(), Some(IpcError::Message { .. }))
}
