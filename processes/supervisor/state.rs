//! State of the supervisor; passes messages and events to the pure modules and carries out their actions.

use super::changes::Changes;
use super::collect::Collector;
use super::command_socket::{self, Call, Clients};
use super::cycle::{Action, Cycles, Input};
use super::cycle_recorder::CycleRecorder;
use super::history::{self, History};
use super::job_controller::JobController;
use super::monitor::Monitor;
use super::ports::Ports;
use super::profile::Profile;
use super::result_delivery::ResultDelivery;
use super::service_manager::ServiceManager;
use super::setup::{self, RunOptions};
use super::snapshot::Snapshot;
use super::stage_process::{ProcessState, StageProcess};
use super::summary::{Summary, Tally};
use super::warm_up::Cameras;
use crate::part_files::{PartOutput, Scan};
use crate::terminal;
use anyhow::{Result, anyhow};
use cell::cycle_number::{unwire, wire};
use cell::schedule::{Half, Interval, Kind, Order, SUPERVISOR, label, violation};
use crossbeam::channel::{Receiver, bounded};
use devices::LoadedCell;
use files::result::CycleResult;
use ipc::IpcError;
use ipc::cell::{CellLock, CellName};
use ipc::error::MessageError;
use ipc::header::{Command, Control, Event, EventKind, Outcome};
use ipc::long_text::TextKey;
use ipc::os::now_ns;
use ipc::payload;
use ipc::port::{Listener, Node, Publisher, Subscriber};
use ipc::sequence::SequenceGates;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// How often stages, time limits and requests are checked without a notification.
pub(super) const TICK: Duration = Duration::from_millis(20);

/// Longest wait for a stage whose command buffer is full. Only a hung stage has one, and it is killed anyway.
const COMMAND_PATIENCE: Duration = Duration::from_millis(50);

/// Requests that may be queued: more than there are clients, since each client waits for its answer.
const QUEUED_CALLS: usize = 64;

/// The supervisor of a running cell.
pub(super) struct Supervisor<'a> {
    pub(super) cell: &'a LoadedCell,
    pub(super) control: Publisher<Control>,
    pub(super) events: Subscriber<Event>,
    pub(super) results: Subscriber<Outcome>,
    pub(super) listener: Listener,
    pub(super) snapshot: Option<Snapshot>,
    pub(super) recorder: Option<CycleRecorder>,
    pub(super) stages: Vec<StageProcess>,
    pub(super) cycles: Cycles,
    /// Number of the last connect command.
    pub(super) epoch: u64,
    pub(super) connecting: bool,
    /// Time of that command, ns.
    pub(super) connect_ns: Option<u64>,
    /// Stages that are connected; all of them are before the first one populates its memory.
    pub(super) connected: BTreeSet<usize>,
    /// Reports of the cycles in progress, by cycle.
    collectors: BTreeMap<u64, Collector>,
    pub(super) order: Order,
    pub(super) gates: SequenceGates,
    pub(super) requests: Receiver<Call>,
    pub(super) clients: Arc<Clients>,
    pub(super) interrupted: Arc<AtomicBool>,
    pub(super) history: History,
    pub(super) requested: Option<u64>,
    pub(super) tally: Tally,
    pub(super) profile: Profile,
    pub(super) jobs: JobController,
    pub(super) results_out: ResultDelivery,
    /// Whether cloud and report of every part are written.
    keeps_parts: bool,
    pub(super) service: ServiceManager,
    /// Whether all stages were ready at the last check.
    pub(super) was_ready: bool,
    pub(super) monitor: Option<Monitor>,
    /// What gateways are told.
    pub(super) changes: Changes,
    /// Cycles that a serving cell begins with, until it has begun.
    pub(super) first_cycles: Option<u64>,
    pub(super) cameras: Cameras,
    /// Why the recording of a cycle is missing: the first one that could not be written.
    unrecorded: Option<anyhow::Error>,
    pub(super) ports: Ports,
}

impl<'a> Supervisor<'a> {
    /// Creates the shared memory and the ports; no stage runs yet.
    pub(super) fn new(
        cell: &'a LoadedCell,
        options: &RunOptions,
        interrupted: Arc<AtomicBool>,
    ) -> Result<Self> {
        let name = CellName::new(&cell.name)?;
        let mut lock = CellLock::take(&name)?;
        lock.check_space(cell.schedule.memory_bytes())?;
        let node = Node::join(&name, SUPERVISOR)?;
        lock.protect_segments()?;
        let mut services =
            cell.schedule.topics.iter().map(|t| setup::create(&node, t)).collect::<Result<Vec<_>, _>>()?;
        for owner in cell.schedule.stages.iter().map(|s| s.name.as_str()).chain([SUPERVISOR]) {
            services.push(node.create_notification(owner)?);
        }
        let (calls, requests) = bounded(QUEUED_CALLS);
        let clients = command_socket::listen(&name.socket(), calls)?;
        let monitor = options.page.as_ref().map(|page| Monitor::new(cell, options, page)).transpose()?;
        let order = Order::new(&cell.schedule);
        let names: Vec<String> = cell.schedule.stages.iter().map(|s| s.name.clone()).collect();
        let snapshot = cell.graph.watch.then(|| Snapshot::new(&node, cell)).transpose()?;
        let recorder =
            options.cycle_record.as_ref().map(|path| CycleRecorder::new(path, cell, &node)).transpose()?;
        Ok(Self {
            control: node.publisher("control", 1, &names, COMMAND_PATIENCE)?,
            events: node.subscriber("event")?,
            results: node.subscriber("result")?,
            listener: node.listener(SUPERVISOR)?,
            snapshot,
            recorder,
            stages: setup::stages(cell, options),
            cycles: setup::machine(cell, options),
            epoch: 0,
            connecting: false,
            connect_ns: None,
            connected: BTreeSet::new(),
            collectors: BTreeMap::new(),
            gates: SequenceGates::create(&name, order.lanes.len())?,
            order,
            requests,
            clients,
            interrupted,
            history: History::default(),
            requested: options.cycles,
            tally: Tally::default(),
            results_out: ResultDelivery::new(setup::result_writer(cell, options)?),
            service: ServiceManager::new(),
            was_ready: false,
            monitor,
            changes: Changes::new(),
            first_cycles: options.first_cycles,
            keeps_parts: options.serve && options.out.is_some() && cell.file.results.parts > 0,
            jobs: JobController::new(
                cell.config.recipes.iter().map(|r| r.name.clone()).collect(),
                options.serve,
            ),
            profile: Profile::new(&names, setup::ns_of_ms(cell.config.limits.cycle_deadline_ms))?,
            cameras: Cameras::new(Self::cameras_here(cell), cell.config.warm_up),
            unrecorded: None,
            ports: Ports::new(services, node, lock),
            cell,
        })
    }

    /// Passes an input to the state machine of the cycles and carries out its actions.
    pub(super) fn step(&mut self, input: Input, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        for action in self.cycles.handle(now_ns(), input) {
            match action {
                Action::Start(cycle) => {
                    self.collectors.insert(cycle, Collector::default());
                    if let Some(recorder) = &mut self.recorder {
                        recorder.begin(cycle);
                    }
                    self.gates.reset(self.lanes(Half::Acquisition), wire(cycle));
                    self.profile.begin(cycle, now_ns());
                    self.command(Command::Start, wire(cycle))?;
                }
                Action::Evaluate(cycle) => {
                    self.gates.reset(self.lanes(Half::Evaluation), wire(cycle));
                    self.command(Command::Evaluate, wire(cycle))?;
                }
                Action::Abort(cycle) => self.command(Command::Abort, wire(cycle))?,
                Action::Kill { stage, reason } => self.stages[stage].kill(&reason),
                Action::Outcome { cycle, result } => self.conclude(cycle, &result, each)?,
                Action::NotRun { count, reason } => {
                    self.tally.not_run += count;
                    let cycles = if count == 1 { "cycle" } else { "cycles" };
                    terminal::print_line(&format!("{count} {cycles} not run: {reason}"));
                }
                Action::Finished => {}
            }
        }
        Ok(())
    }

    /// Indices of the lanes of one half of the cycle.
    fn lanes(&self, half: Half) -> impl Iterator<Item = usize> {
        let lanes = self.order.lanes.iter().enumerate();
        lanes.filter(move |(_, lane)| lane.half == half).map(|(number, _)| number)
    }

    fn conclude(
        &mut self,
        cycle: u64,
        outcome: &Result<(), String>,
        each: &mut dyn FnMut(&CycleResult),
    ) -> Result<()> {
        let collector = self.collectors.remove(&cycle).unwrap_or_default();
        for (camera, state) in collector.camera_states(self.cell) {
            self.cameras.told(&camera, state, now_ns());
        }
        let checked = || self.in_order(&collector).and_then(|()| collector.check_result(&self.cell.schedule));
        let settled = || self.cameras.settled(now_ns());
        let outcome = &outcome.clone().and_then(|()| checked()).and_then(|()| settled());
        if let Some(snapshot) = &mut self.snapshot {
            snapshot.update()?;
            snapshot.end_cycle(wire(cycle), outcome.is_ok());
        }
        let mut result = collector.result(self.cell, cycle, outcome);
        if let Some(recorder) = &mut self.recorder {
            recorder.end(self.cell, &result, self.jobs.recipe(), collector.events())?;
        }
        let end_ns = now_ns();
        let duration_ns = self.profile.end(&result, end_ns);
        tracing::info!(cycle, outcome = result.outcome, verdict = ?result.verdict, duration_ns, "cycle ended");
        result.duration_ns = duration_ns;
        let recipe = self.cell.config.recipes.get(self.jobs.recipe());
        // A host that is led inspects nothing.
        let plan = recipe.and_then(|recipe| recipe.plan.as_ref()).filter(|_| self.cell.graph.leads());
        result.plan_sha256 = recipe.and_then(|recipe| recipe.plan_sha256.clone());
        result.calibration_shares_sha256 = recipe.and_then(|recipe| recipe.calibration_shares_sha256.clone());
        self.jobs.annotate(&mut result);
        if let Some(duration_ns) = duration_ns {
            self.history.add(history::ended(&result, end_ns, duration_ns), collector.spans(cycle));
        }
        self.tally.count(cycle, outcome, &result, plan.is_some());
        if let Some(monitor) = &mut self.monitor {
            monitor.ended(&result, collector.spans(cycle).collect());
        }
        each(&result);
        let output = self.output_of(&result);
        let reply = self.jobs.take_reply();
        self.results_out.deliver(self.jobs.job(), &result, output, reply);
        let next = self.jobs.cycle_ended();
        self.apply(next, each)
    }

    /// What is written of a cycle: a serving cell keeps cloud and report of every part.
    fn output_of(&self, result: &CycleResult) -> PartOutput {
        let Some(snapshot) = self.snapshot.as_ref().filter(|_| self.keeps_parts) else {
            return PartOutput::ResultOnly;
        };
        if !self.results_out.has_room() {
            return PartOutput::Lost;
        }
        let spans = self.history.spans.iter().filter(|span| span.cycle == result.cycle).cloned().collect();
        PartOutput::Scan(Box::new(Scan {
            points: snapshot.points_of(wire(result.cycle)),
            images: snapshot.images.clone(),
            spans,
        }))
    }

    /// Refuses a result whose activations did not run in the order of the schedule.
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
        Err(format!("schedule violated: {} started before {} ended", name(after), name(before)))
    }

    pub(super) fn command(&self, command: Command, number: u64) -> Result<()> {
        let recipe = self.jobs.recipe() as u32;
        match self.control.send(Control { recipe, ..Control::new(command, number) }, &[]) {
            // A stage that is down or hung misses the command; its end is detected elsewhere.
            Err(IpcError::NotReached { .. } | IpcError::Full { .. }) => Ok(()),
            other => Ok(other?),
        }
    }

    /// Handles all queued messages. An invalid message ends the cycle: its sender cannot be trusted.
    pub(super) fn drain(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        match self.take_messages(each) {
            Err(error) if is_invalid_message(&error) => {
                tracing::error!("{error:#}");
                self.step(Input::InvalidMessage { reason: format!("{error:#}") }, each)
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
            let inspection = serde_json::from_str(text)?;
            if let Some(recorder) = &self.recorder {
                recorder.result(self.cell, header.cycle, text);
            }
            collector.inspected(inspection, text, header.t_ns.saturating_sub(header.t_last_frame_ns));
            self.step(Input::Result { cycle }, each)?;
        }
        if let Some(snapshot) = &mut self.snapshot {
            snapshot.update()?;
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.update(self.cell)?;
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
        let Some(child) = self.stages.get_mut(stage).filter(|c| c.pid() == Some(event.pid)) else {
            return Ok(()); // a message of a process that was replaced
        };
        child.last_message_ns = now_ns();
        match event.kind()? {
            EventKind::Ready if event.cycle == 0 => {
                child.state = ProcessState::Up;
                self.connecting = true;
                Ok(())
            }
            EventKind::Ready if event.cycle == self.epoch => self.answered(stage, each),
            EventKind::Ready => Ok(()),
            kind @ (EventKind::Request | EventKind::Withdraw | EventKind::Renew) => {
                self.led(kind, event, text, each)
            }
            EventKind::Part => Ok(child.report.push(TextKey::of(&event), text)?),
            EventKind::Failed => {
                if let Some(cycle) = unwire(event.cycle) {
                    if self.cell.schedule.stages[stage].kind == Kind::Record {
                        self.unrecorded
                            .get_or_insert_with(|| anyhow!("cycle {} is not recorded: {text}", cycle + 1));
                    }
                    return self.step(Input::Failed { stage, cycle, reason: text.to_owned() }, each);
                }
                child.final_message = Some(text.to_owned());
                Ok(())
            }
            EventKind::Done => {
                let text = child.report.take(TextKey::of(&event), text);
                let Some(cycle) = unwire(event.cycle) else { return Ok(()) };
                if let Some(collector) = self.collectors.get_mut(&cycle) {
                    collector.done(event, text);
                }
                self.step(Input::Done { stage, cycle, activation: event.activation as usize }, each)
            }
        }
    }

    /// The summary of the run.
    pub(super) fn summary(mut self) -> Summary {
        let unwritten = self.results_out.finish();
        // Who waited for the disk has an answer only now.
        self.answer_remaining();
        let unrecorded =
            self.recorder.as_mut().and_then(|recorder| recorder.finish().err()).or(self.unrecorded);
        Summary {
            tally: self.tally,
            history: self.history,
            snapshot: self.snapshot,
            unwritten,
            unrecorded,
            _ports: self.ports,
        }
    }
}

/// Whether the error is an invalid message rather than a problem of the machine.
fn is_invalid_message(error: &anyhow::Error) -> bool {
    error.is::<MessageError>()
        || error.is::<serde_json::Error>()
        || matches!(error.downcast_ref(), Some(IpcError::Message { .. }))
}
