//! The supervisor: plans, starts, watches, restarts and stops the stages, and gathers what they measure.
//!
//! Its decisions are made in pure modules ([`schedule`], [`cycle`], [`restart`]); this file moves messages between them
//! and the world. It never blocks on a child: every 20 ms it looks at all of them.

mod children;
pub mod collect;
pub mod cycle;
pub mod restart;
pub mod schedule;
pub mod socket;
pub mod watch;

use crate::graph::Cell;
use crate::inspection::Judgement;
use anyhow::{Context, Result};
use children::{Life, StageProcess};
use collect::{Collector, Span, label};
use cycle::{Action, Budgets, Cycles, Input, Step, unwire, wire};
use ipc::IpcError;
use ipc::cell::{CellLock, CellName};
use ipc::header::{Command, Control, Event, EventKind, Outcome};
use ipc::os::now_ns;
use ipc::payload;
use ipc::port::{Bell, Held, Node, Publisher, Subscriber};
use restart::Policy;
use rig::result::CycleResult;
use schedule::{Carries, Kind, SUPERVISOR, Topic};
use socket::{Answer, Call, Request, StageStatus, Status};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;
use watch::Watch;

/// How often children, limits and the socket are looked at when nobody rings.
const TICK: Duration = Duration::from_millis(20);

/// How long a command may wait for room in front of a stage. Sixteen of them only wait in front of a hung one, which is
/// killed anyway.
const COMMAND_PATIENCE: Duration = Duration::from_millis(50);

/// Spans are kept of the last cycles only: a run until stopped must not grow.
const KEPT_SPANS: usize = 100_000;

/// What a run is asked to do.
#[derive(Debug, Clone)]
pub struct Orders {
    /// Configuration, for the stages.
    pub config: PathBuf,
    /// Cycles; `None`: until stopped.
    pub cycles: Option<u64>,
    /// Where a recording is written.
    pub record: Option<PathBuf>,
}

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
    /// Spans of the last cycles.
    pub spans: Vec<Span>,
    /// What was seen of the last cycle.
    pub watch: Option<Watch>,
    // Dropped last, in this order: the ports above before the node, the node before the folder.
    _ports: Ports,
}

/// What keeps the shared memory alive.
struct Ports {
    _held: Vec<Held>,
    node: Node,
    _lock: CellLock,
}

struct Supervisor<'a> {
    cell: &'a Cell,
    control: Publisher<Control>,
    events: Subscriber<Event>,
    results: Subscriber<Outcome>,
    bell: Bell,
    watch: Option<Watch>,
    children: Vec<StageProcess>,
    cycles: Cycles,
    /// Number of the last connect command.
    epoch: u64,
    connecting: bool,
    collector: Collector,
    requests: Receiver<Call>,
    interrupted: Arc<AtomicBool>,
    spans: Vec<Span>,
    requested: Option<u64>,
    tally: Tally,
    ports: Ports,
}

#[derive(Debug, Default)]
struct Tally {
    done: u64,
    ok: u64,
    not_pass: u64,
    stopped: bool,
    held: Option<String>,
}

/// Runs a cell; `each` gets every cycle's result as soon as it stands.
///
/// # Errors
/// What keeps the cell from starting, or makes the supervisor itself unable to go on.
pub fn run(cell: &Cell, orders: &Orders, each: &mut dyn FnMut(&CycleResult)) -> Result<Summary> {
    let interrupted = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&interrupted);
    ctrlc::set_handler(move || flag.store(true, Ordering::SeqCst))
        .context("taking over the interrupt signal")?;
    let mut supervisor = Supervisor::new(cell, orders, interrupted)?;
    let ended = supervisor.work(each);
    supervisor.shut_down();
    ended?;
    Ok(supervisor.summary())
}

impl<'a> Supervisor<'a> {
    fn new(cell: &'a Cell, orders: &Orders, interrupted: Arc<AtomicBool>) -> Result<Self> {
        let name = CellName::new(&cell.name)?;
        let lock = CellLock::take(&name)?;
        lock.check_space(cell.schedule.memory_bytes())?;
        let node = Node::join(&name, SUPERVISOR)?;
        let mut held =
            cell.schedule.topics.iter().map(|t| create(&node, t)).collect::<Result<Vec<_>, _>>()?;
        for owner in cell.schedule.stages.iter().map(|s| s.name.as_str()).chain([SUPERVISOR]) {
            held.push(node.create_bell(owner)?);
        }
        let stages: Vec<String> = cell.schedule.stages.iter().map(|s| s.name.clone()).collect();
        let watch = watch::is_watched(&cell.schedule).then(|| Watch::new(&node, cell)).transpose()?;
        Ok(Self {
            control: node.publisher("control", 1, &stages, COMMAND_PATIENCE)?,
            events: node.subscriber("event")?,
            results: node.subscriber("result")?,
            bell: node.bell(SUPERVISOR)?,
            watch,
            children: children(cell, orders),
            cycles: machine(cell, orders.cycles),
            epoch: 0,
            connecting: false,
            collector: Collector::default(),
            requests: socket::listen(&name.socket())?,
            interrupted,
            spans: Vec::new(),
            requested: orders.cycles,
            tally: Tally::default(),
            ports: Ports { _held: held, node, _lock: lock },
            cell,
        })
    }

    fn work(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        while !self.cycles.is_finished() {
            self.start_waiting()?;
            self.hear(each)?;
            self.bury(each)?;
            self.connect(each)?;
            self.obey(each)?;
            self.feed(Input::Tick, each)?;
            if !self.cycles.is_finished() {
                self.bell.wait(TICK)?;
            }
        }
        Ok(())
    }

    /// Gives an input to the cycles and does what they want.
    fn feed(&mut self, input: Input, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        for action in self.cycles.handle(now_ns(), input) {
            match action {
                Action::Start(cycle) => {
                    self.collector.begin();
                    self.command(Command::Start, wire(cycle))?;
                }
                Action::Abort(cycle) => self.command(Command::Abort, wire(cycle))?,
                Action::Kill { stage, reason } => self.children[stage].kill(&reason),
                Action::Outcome { cycle, result } => self.conclude(cycle, &result, each)?,
                Action::Finished => {}
            }
        }
        Ok(())
    }

    fn conclude(
        &mut self,
        cycle: u64,
        outcome: &Result<(), String>,
        each: &mut dyn FnMut(&CycleResult),
    ) -> Result<()> {
        if let Some(watch) = &mut self.watch {
            watch.look()?;
            watch.ended(wire(cycle), outcome.is_ok());
        }
        let result = self.collector.result(self.cell, cycle, outcome);
        self.spans.extend(self.collector.spans(cycle));
        let excess = self.spans.len().saturating_sub(KEPT_SPANS);
        self.spans.drain(..excess);
        self.collector.begin();
        self.tally.done += 1;
        self.tally.ok += u64::from(outcome.is_ok());
        let pass = result.verdict == Some(rig::result::ResultVerdict::Pass);
        self.tally.not_pass += u64::from(outcome.is_ok() && self.cell.plan.is_some() && !pass);
        each(&result);
        Ok(())
    }

    fn command(&self, command: Command, number: u64) -> Result<()> {
        match self.control.send(Control::new(command, number), &[]) {
            // A stage that is down or hung misses it; its end is noticed apart.
            Err(IpcError::NotReached { .. } | IpcError::Full { .. }) => Ok(()),
            other => Ok(other?),
        }
    }

    /// Starts the stages whose pause is over.
    fn start_waiting(&mut self) -> Result<()> {
        let now = now_ns();
        for child in &mut self.children {
            if matches!(child.life, Life::Waiting { until_ns } if until_ns <= now) {
                child.start(now)?;
            }
        }
        Ok(())
    }

    /// Takes results, events and what is watched.
    fn hear(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        while let Some(message) = self.results.receive()? {
            let header = *message.header();
            let Some(cycle) = unwire(header.cycle).filter(|c| self.cycles.running() == Some(*c)) else {
                continue;
            };
            let judgement: Judgement =
                serde_json::from_str(payload::text(header.text_bytes, message.payload())?)?;
            self.collector.judged(judgement, header.t_ns.saturating_sub(header.t_last_frame_ns));
            self.feed(Input::Result { cycle }, each)?;
        }
        if let Some(watch) = &mut self.watch {
            watch.look()?;
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
                if self.cycles.running() == Some(cycle) {
                    self.collector.done(event, text);
                }
                self.feed(Input::Done { stage, cycle, activation: event.activation as usize }, each)
            }
        }
    }

    /// Reaps stages that ended and those that do not start, and decides what follows.
    fn bury(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        let (now, start_ns) = (now_ns(), millis(self.cell.config.limits.start_ms));
        for stage in 0..self.children.len() {
            let child = &mut self.children[stage];
            if matches!(child.life, Life::Starting { since_ns } if now.saturating_sub(since_ns) > start_ns) {
                child.kill(&format!("did not report ready within {} ms", start_ns / 1_000_000));
            }
            let Some(end) = child.reap() else { continue };
            tracing::warn!(stage = child.name, end, "stage ended");
            // Its last words may still lie in our buffer; iceoryx2 frees what it held only now that it is reaped.
            self.hear(each)?;
            self.ports.node.clean_up_dead();
            let child = &mut self.children[stage];
            child.failed(now);
            let held = child.life == Life::Held;
            let (name, failures) = (child.name.clone(), child.restarts.recent());
            self.feed(Input::Lost { stage, reason: end.clone() }, each)?;
            if held {
                let window_s = self.cell.config.limits.restart_window_ms / 1000;
                let reason =
                    format!("stage {name} failed {failures} times within {window_s} s, the last time: {end}");
                self.tally.held = Some(reason.clone());
                self.feed(Input::Stop { reason }, each)?;
            }
        }
        Ok(())
    }

    /// When all stages stand and one of them is new, all connect to each other.
    fn connect(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        if !self.connecting || self.children.iter().any(|c| c.life != Life::Up) {
            return Ok(());
        }
        self.connecting = false;
        self.epoch += 1;
        for stage in 0..self.children.len() {
            self.feed(Input::Unready { stage }, each)?;
        }
        if let Some(watch) = &self.watch {
            watch.connect()?;
        }
        self.events.connect()?;
        self.results.connect()?;
        self.command(Command::Connect, self.epoch)
    }

    /// Does what the operator asks.
    fn obey(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        if self.interrupted.load(Ordering::SeqCst) {
            self.stop(each)?;
        }
        while let Ok((request, reply)) = self.requests.try_recv() {
            let answer = match request {
                Request::Status {} => Answer::Status(self.status()),
                Request::Restart { stage } => self.restart(&stage),
                Request::Stop {} => {
                    self.stop(each)?;
                    Answer::Done("stopping".into())
                }
            };
            // A person who went away needs no answer.
            let _ = reply.send(answer);
        }
        Ok(())
    }

    fn stop(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        self.tally.stopped = true;
        self.feed(Input::Stop { reason: "stopped by the operator".into() }, each)
    }

    fn restart(&mut self, name: &str) -> Answer {
        let known = || self.children.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
        match self.children.iter().position(|c| c.name == name) {
            None => Answer::Refused(format!("no stage \"{name}\"; there are {}", known())),
            Some(stage) if self.children[stage].pid().is_none() => {
                Answer::Refused(format!("stage \"{name}\" has no process now; it will be started again"))
            }
            Some(stage) => {
                self.children[stage].kill("was restarted by the operator");
                Answer::Done(format!("restarting {name}"))
            }
        }
    }

    fn status(&self) -> Status {
        let now = now_ns();
        let stages = self.children.iter().map(|child| StageStatus {
            name: child.name.clone(),
            pid: child.pid(),
            state: child.life.word().to_owned(),
            restarts: child.restarts.total(),
            silent_ms: now.saturating_sub(child.heard_ns) / 1_000_000,
        });
        Status {
            cell: self.cell.name.clone(),
            pid: std::process::id(),
            cycle: self.cycles.running(),
            cycles_done: self.tally.done,
            cycles_ok: self.tally.ok,
            cycles_requested: self.requested,
            stages: stages.collect(),
        }
    }

    /// Asks all stages to leave, then kills those that do not.
    fn shut_down(&mut self) {
        // Those that cannot be told are killed below.
        let _ = self.command(Command::Shutdown, 0);
        let deadline_ns = now_ns().saturating_add(millis(self.cell.config.limits.stop_ms));
        while self.children.iter().any(|c| c.pid().is_some()) {
            for child in &mut self.children {
                if child.reap().is_some() {
                    child.life = Life::Ended;
                }
                if now_ns() > deadline_ns {
                    child.kill("did not stop");
                }
            }
            // Nobody listens any more, but a stage that waits for room in our buffers must get it.
            while matches!(self.events.receive(), Ok(Some(_))) {}
            if let Some(watch) = &mut self.watch {
                let _ = watch.look();
            }
            std::thread::sleep(TICK / 4);
        }
        self.ports.node.clean_up_dead();
    }

    fn summary(self) -> Summary {
        Summary {
            not_ok: self.tally.done - self.tally.ok,
            not_pass: self.tally.not_pass,
            stopped: self.tally.stopped,
            held: self.tally.held,
            spans: self.spans,
            watch: self.watch,
            _ports: self.ports,
        }
    }
}

fn create(node: &Node, topic: &Topic) -> Result<Held, IpcError> {
    use ipc::header;
    match topic.carries {
        Carries::Control => node.create_topic::<header::Control>(&topic.name, topic.size),
        Carries::Event => node.create_topic::<header::Event>(&topic.name, topic.size),
        Carries::Trigger => node.create_topic::<header::Trigger>(&topic.name, topic.size),
        Carries::Frame => node.create_topic::<header::Frame>(&topic.name, topic.size),
        Carries::Phase => node.create_topic::<header::Phase>(&topic.name, topic.size),
        Carries::Cloud => node.create_topic::<header::Cloud>(&topic.name, topic.size),
        Carries::Outcome => node.create_topic::<header::Outcome>(&topic.name, topic.size),
    }
}

fn machine(cell: &Cell, cycles: Option<u64>) -> Cycles {
    let steps = cell.schedule.activations.iter().map(|a| Step {
        stage: a.stage,
        inputs: a.inputs.clone(),
        label: label(&cell.graph, a.work),
    });
    let limits = &cell.config.limits;
    let budgets =
        Budgets { stage_ns: millis(limits.stage_budget_ms), cycle_ns: millis(limits.cycle_deadline_ms) };
    let names = cell.schedule.stages.iter().map(|s| s.name.clone()).collect();
    Cycles::new(names, steps.collect(), budgets, cycles)
}

fn children(cell: &Cell, orders: &Orders) -> Vec<StageProcess> {
    let limits = &cell.config.limits;
    let policy = Policy { restarts_max: limits.restarts_max, window_ns: millis(limits.restart_window_ms) };
    let stages = cell.schedule.stages.iter().map(|stage| {
        // Stages that run once per cycle get all cores, those that run side by side one each.
        let threads = match stage.kind {
            Kind::Matching | Kind::Fusion | Kind::Inspection => cell.schedule.cores,
            Kind::Projection | Kind::Capture | Kind::Decode | Kind::Record => 1,
        };
        StageProcess::new(&stage.name, arguments(cell, orders, stage), threads, policy)
    });
    stages.collect()
}

fn arguments(cell: &Cell, orders: &Orders, stage: &schedule::Stage) -> Vec<String> {
    let mut arguments: Vec<String> = ["stage", stage.kind.word(), &stage.name].map(str::to_owned).to_vec();
    let mut option = |name: &str, value: String| arguments.extend([name.to_owned(), value]);
    option("--cell", cell.name.clone());
    option("--config", orders.config.display().to_string());
    option("--config-sha256", cell.config.sha256.clone());
    option("--rig-sha256", cell.config.rig_sha256.clone());
    option("--parent", std::process::id().to_string());
    if let Some(folder) = &orders.record {
        option("--record", folder.display().to_string());
        if orders.cycles != Some(1) {
            arguments.push("--record-many".into());
        }
    }
    if cell.graph.watch {
        arguments.push("--watch".into());
    }
    arguments
}

fn millis(ms: u64) -> u64 {
    ms.saturating_mul(1_000_000)
}
