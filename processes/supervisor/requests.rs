//! Handles the requests of people, scripts and gateways.

use super::command_socket::STOPPED;
use super::cycle::Input;
use super::metrics;
use super::monitor::MONITOR;
use super::protocol::{Answer, Request, SpanRow, Spans, StageStatus, Status};
use super::stage_process::ProcessState;
use super::state::{Supervisor, TICK};
use crate::control::{Action, Event, State};
use anyhow::Result;
use cell::schedule::label;
use crossbeam::channel::Sender;
use files::result::CycleResult;
use ipc::os::now_ns;
use std::sync::atomic::Ordering;

/// Longest wait at the end of a run until all clients have their answers, ns.
const LAST_ANSWERS_NS: u64 = 1_000_000_000;

/// Activations in an answer: about ten cycles of a large cell, 1 MB of JSON.
const MAX_SPANS: usize = 5000;

/// Cycles in an answer; more than those of the activations, to include earlier failures.
const MAX_CYCLES: usize = 1000;

impl Supervisor<'_> {
    /// Handles a termination signal and all queued requests.
    pub(super) fn handle_requests(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        if self.interrupted.load(Ordering::SeqCst) || ipc::os::is_terminated() {
            self.stop(each)?;
        }
        self.update_control_state();
        self.start_first_job(each)?;
        while let Ok((request, reply)) = self.requests.try_recv() {
            self.answer(request, reply, each)?;
        }
        Ok(())
    }

    /// Reports to the job controller whether all stages are up.
    fn update_control_state(&mut self) {
        let up = self.cycles.is_ready();
        if std::mem::replace(&mut self.was_ready, up) != up {
            self.jobs.stages_changed(if up { Event::StagesUp } else { Event::StagesDown });
        }
    }

    /// Starts the job that a serving cell begins with, once it is ready.
    fn start_first_job(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        if self.jobs.state() != State::Ready {
            return Ok(());
        }
        let Some(cycles) = self.first_cycles.take() else { return Ok(()) };
        let (action, _started) = self.jobs.start(None, Some(cycles));
        self.apply(action, each)
    }

    /// Reports to the monitor what is new.
    pub(super) fn update_monitor(&mut self) {
        let Some(monitor) = &mut self.monitor else { return };
        monitor.update(now_ns());
        monitor.state(self.jobs.report());
        let number = self.tally.last.as_ref().map_or(0, |last| last.number);
        if let Some(snapshot) = self.snapshot.as_ref().filter(|_| monitor.wants_scan(number)) {
            monitor.scan(snapshot.scan(number));
        }
    }

    /// Tells gateways what is new.
    pub(super) fn update_changes(&mut self) {
        self.changes.state(self.jobs.report());
        for (job, result) in self.results_out.take_settled() {
            self.changes.result(job, result);
        }
        self.changes.update(now_ns());
    }

    /// Ends the monitor, which shows before that the cell has ended.
    pub(super) fn end_monitor(&mut self) {
        if let Some(monitor) = &mut self.monitor {
            monitor.shut_down();
        }
    }

    fn answer(
        &mut self,
        request: Request,
        reply: Sender<Answer>,
        each: &mut dyn FnMut(&CycleResult),
    ) -> Result<()> {
        if let Some(answer) = self.report(&request) {
            // The client may have disconnected.
            let _ = reply.send(answer);
            return Ok(());
        }
        let (action, answer) = match request {
            Request::Inspect { part, recipe } => {
                let action = self.jobs.inspect(part, recipe.as_deref(), &reply);
                return self.apply(action, each);
            }
            Request::Watch { run, after, wait } => {
                self.changes.watch(run.as_deref(), after, wait.then(now_ns), reply);
                return Ok(());
            }
            Request::Begin { part, recipe } => self.jobs.begin(part, recipe.as_deref()),
            Request::Start { recipe, cycles } => self.jobs.start(recipe.as_deref(), cycles),
            Request::Finish {} => {
                self.jobs.change_state(Event::Finish, "the job ends after the current cycle")
            }
            Request::Abort {} => self.jobs.change_state(Event::Abort, "the job is aborted"),
            Request::Halt {} => self.jobs.change_state(Event::Halt, "halted"),
            Request::Reset {} => {
                let done = self.jobs.change_state(Event::Reset, "reset");
                // Also of a cell that was halted while it was in error.
                if matches!(done.1, Answer::Done(_)) {
                    self.revive_stages();
                }
                done
            }
            Request::Prepare { recipe } => (Action::None, self.jobs.select(&recipe, true)),
            Request::Unprepare { recipe } => (Action::None, self.jobs.select(&recipe, false)),
            Request::Restart { stage } => (Action::None, self.restart(&stage)),
            Request::Stop {} => {
                self.stop(each)?;
                (Action::None, Answer::Done("stopping".into()))
            }
            // Reported above.
            Request::State {} | Request::Status {} | Request::Metrics {} | Request::Spans {} => return Ok(()),
        };
        // The client may have disconnected.
        let _ = reply.send(answer);
        self.apply(action, each)
    }

    /// The answer to a request that changes nothing.
    fn report(&self, request: &Request) -> Option<Answer> {
        match request {
            Request::State {} => Some(Answer::State(Box::new(self.jobs.report()))),
            Request::Status {} => Some(Answer::Status(Box::new(self.status()))),
            Request::Metrics {} => Some(Answer::Metrics(metrics::render(&self.status(), &self.profile))),
            Request::Spans {} => Some(Answer::Spans(self.last_spans())),
            _ => None,
        }
    }

    /// Answers the requests that arrived before the end of the run, and waits until their clients have the answers.
    pub(super) fn answer_remaining(&mut self) {
        self.jobs.close();
        self.update_changes();
        self.changes.close();
        let deadline_ns = now_ns().saturating_add(LAST_ANSWERS_NS);
        loop {
            while let Ok((request, reply)) = self.requests.try_recv() {
                let answer = match request {
                    Request::Stop {} => Answer::Done("stopping".into()),
                    other => self.report(&other).unwrap_or_else(|| Answer::Refused(STOPPED.into())),
                };
                let _ = reply.send(answer);
            }
            self.results_out.update();
            if self.clients.unanswered() == 0 || now_ns() > deadline_ns {
                return;
            }
            std::thread::sleep(TICK / 20);
        }
    }

    /// Tells the service manager that the cell is ready and alive.
    pub(super) fn notify_service_manager(&mut self) {
        let (state, done) = (self.jobs.state(), self.tally.done);
        let status = match self.jobs.reason() {
            Some(reason) => format!("{state:?}: {reason}"),
            None => format!("{state:?}, {done} cycles"),
        };
        self.service.update(now_ns(), self.was_ready, &status);
    }

    /// Carries out an action of the job controller.
    pub(super) fn apply(&mut self, action: Action, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        match action {
            Action::None => Ok(()),
            Action::StartCycle { .. } => self.step(Input::Request, each),
            Action::AbortCycle => self.step(Input::Abort { reason: self.abort_reason().into() }, each),
            Action::Revive => {
                self.revive_stages();
                Ok(())
            }
        }
    }

    /// Starts the stages again that failed too often.
    fn revive_stages(&mut self) {
        for child in self.stages.iter_mut().filter(|child| child.state == ProcessState::GaveUp) {
            child.revive();
        }
    }

    /// The reason of an aborted cycle.
    fn abort_reason(&self) -> &'static str {
        match self.jobs.state() {
            State::Halted => "halted by the operator",
            State::Error => "the cell is in error",
            _ => "aborted by the operator",
        }
    }

    /// Handles a stage that failed too often: a batch run ends, a serving cell is in error until it is reset.
    pub(super) fn give_up(&mut self, reason: String, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        let action = self.jobs.fault(&reason);
        if self.jobs.serves() {
            tracing::error!("{reason}");
            return self.apply(action, each);
        }
        self.tally.gave_up = Some(reason.clone());
        self.step(Input::Stop { reason }, each)
    }

    fn stop(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        self.tally.stopped = true;
        self.step(Input::Stop { reason: "stopped by the operator".into() }, each)
    }

    fn restart(&mut self, name: &str) -> Answer {
        if let Some(monitor) = self.monitor.as_mut().filter(|_| name == MONITOR) {
            monitor.restart();
            return Answer::Done(format!("restarting {name}"));
        }
        let known = || self.stages.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
        match self.stages.iter().position(|c| c.name == name) {
            None => Answer::Refused(format!("no stage \"{name}\"; known stages: {}", known())),
            Some(stage) if self.stages[stage].pid().is_none() => {
                Answer::Refused(format!("stage \"{name}\" is not running; it waits for its restart"))
            }
            Some(stage) => {
                self.stages[stage].restart();
                Answer::Done(format!("restarting {name}"))
            }
        }
    }

    fn last_spans(&self) -> Spans {
        let (schedule, history) = (&self.cell.schedule, &self.history);
        let left_out = history.spans.len().saturating_sub(MAX_SPANS);
        let rows = history.spans.iter().skip(left_out).filter_map(|span| {
            let activation = schedule.activations.get(span.activation)?;
            Some(SpanRow {
                stage: schedule.stages[activation.stage].name.clone(),
                name: label(&self.cell.graph, activation.work),
                cycle: span.cycle,
                wait_ns: span.wait_ns,
                start_ns: span.start_ns,
                end_ns: span.end_ns,
                send_ns: span.send_ns,
            })
        });
        let left_out = history.cycles.len().saturating_sub(MAX_CYCLES);
        Spans { activations: rows.collect(), cycles: history.cycles.iter().skip(left_out).cloned().collect() }
    }

    fn status(&self) -> Status {
        let now = now_ns();
        let profile = &self.profile;
        let stages = self.stages.iter().zip(&profile.stages).map(|(child, profile)| StageStatus {
            name: child.name.clone(),
            pid: child.pid(),
            state: child.state.name().to_owned(),
            restarts: child.restarts.total(),
            silent_ms: now.saturating_sub(child.last_message_ns) / 1_000_000,
            cycles: profile.cycles,
            wait: profile.wait.percentiles(),
            compute: profile.compute.percentiles(),
            send: profile.send.percentiles(),
            total: profile.sum.clone(),
        });
        let job = self.jobs.report();
        Status {
            cell: self.cell.name.clone(),
            pid: std::process::id(),
            state: self.jobs.state(),
            reason: self.jobs.reason(),
            cycle: self.cycles.running().next(),
            running: self.cycles.running().collect(),
            cycles_done: self.tally.done,
            cycles_ok: self.tally.ok,
            cycles_requested: self.requested,
            cycles_per_minute: profile.cycles_per_minute(),
            outcomes: profile.outcomes,
            deadline_misses: profile.deadline_misses,
            cycle_time: profile.cycle.percentiles(),
            latency: profile.latency.percentiles(),
            last_failure: self.tally.last_failure.clone(),
            part: job.part,
            recipe: job.recipe,
            last: self.tally.last.clone(),
            stages: stages.collect(),
            cameras: self.cameras.status(),
        }
    }
}
