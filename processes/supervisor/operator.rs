//! What people, scripts and gateways ask of a running cell.

use super::children::Life;
use super::cycle::Input;
use super::metrics;
use super::protocol::{Answer, Request, SpanRow, Spans, StageStatus, Status};
use super::state::Supervisor;
use crate::control::{Action, Event, State};
use crate::schedule::label;
use anyhow::Result;
use crossbeam::channel::Sender;
use files::result::CycleResult;
use ipc::os::now_ns;
use std::sync::atomic::Ordering;

/// Spans that an answer may hold: some ten cycles of a large cell, a megabyte of JSON.
const MAX_SPANS: usize = 5000;

/// Cycles that an answer may hold: beyond those of the spans they say when others failed.
const MAX_CYCLES: usize = 1000;

impl Supervisor<'_> {
    /// Does what is asked.
    pub(super) fn obey(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        if self.interrupted.load(Ordering::SeqCst) {
            self.stop(each)?;
        }
        self.follow();
        while let Ok((request, reply)) = self.requests.try_recv() {
            self.answer(request, reply, each)?;
        }
        Ok(())
    }

    /// Tells the control states whether all stages stand.
    fn follow(&mut self) {
        let up = self.cycles.is_ready();
        if std::mem::replace(&mut self.was_ready, up) != up {
            self.desk.stages(if up { Event::StagesUp } else { Event::StagesDown });
        }
    }

    fn answer(
        &mut self,
        request: Request,
        reply: Sender<Answer>,
        each: &mut dyn FnMut(&CycleResult),
    ) -> Result<()> {
        let (action, answer) = match request {
            Request::Inspect { part, recipe } => {
                let action = self.desk.inspect(part, recipe.as_deref(), reply);
                return self.act(action, each);
            }
            Request::Start { recipe, cycles } => self.desk.start(recipe.as_deref(), cycles),
            Request::Finish {} => self.desk.simply(Event::Finish, "the job ends after its cycle"),
            Request::Abort {} => self.desk.simply(Event::Abort, "the job was ended"),
            Request::Halt {} => self.desk.simply(Event::Halt, "halted"),
            Request::Reset {} => self.desk.simply(Event::Reset, "reset"),
            Request::Prepare { recipe } => (Action::None, self.desk.select(&recipe, true)),
            Request::Unprepare { recipe } => (Action::None, self.desk.select(&recipe, false)),
            Request::State {} => (Action::None, Answer::State(self.desk.report())),
            Request::Status {} => (Action::None, Answer::Status(Box::new(self.status()))),
            Request::Metrics {} => {
                (Action::None, Answer::Metrics(metrics::render(&self.status(), &self.profile)))
            }
            Request::Spans {} => (Action::None, Answer::Spans(self.last_spans())),
            Request::Restart { stage } => (Action::None, self.restart(&stage)),
            Request::Stop {} => {
                self.stop(each)?;
                (Action::None, Answer::Done("stopping".into()))
            }
        };
        // A client that went away needs no answer.
        let _ = reply.send(answer);
        self.act(action, each)
    }

    /// Does what the control states want.
    pub(super) fn act(&mut self, action: Action, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        match action {
            Action::None => Ok(()),
            Action::StartCycle { .. } => self.feed(Input::Request, each),
            Action::AbortCycle => self.feed(Input::Abort { reason: self.ending().into() }, each),
            Action::Revive => {
                for child in self.children.iter_mut().filter(|child| child.life == Life::Held) {
                    child.revive();
                }
                Ok(())
            }
        }
    }

    /// Why a cycle was ended from outside.
    fn ending(&self) -> &'static str {
        match self.desk.state() {
            State::Halted => "halted by the operator",
            State::Error => "the cell is in error",
            _ => "aborted by the operator",
        }
    }

    /// A stage failed too often. A run that goes on by itself ends; a cell that serves says so until it is reset.
    pub(super) fn give_up(&mut self, reason: String, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        let action = self.desk.fault(&reason);
        if self.desk.serves() {
            tracing::error!("{reason}");
            return self.act(action, each);
        }
        self.tally.held = Some(reason.clone());
        self.feed(Input::Stop { reason }, each)
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
        let stages = self.children.iter().zip(&profile.stages).map(|(child, profile)| StageStatus {
            name: child.name.clone(),
            pid: child.pid(),
            state: child.life.word().to_owned(),
            restarts: child.restarts.total(),
            silent_ms: now.saturating_sub(child.heard_ns) / 1_000_000,
            cycles: profile.cycles,
            wait: profile.wait.percentiles(),
            compute: profile.compute.percentiles(),
            send: profile.send.percentiles(),
            total: profile.sum.clone(),
        });
        Status {
            cell: self.cell.name.clone(),
            pid: std::process::id(),
            state: self.desk.state(),
            reason: self.desk.reason(),
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
            stages: stages.collect(),
        }
    }
}
