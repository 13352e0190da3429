//! Lifecycle of the stages: start, connect, reap, stop.

use super::cycle::Input;
use super::setup;
use super::stage_process::ProcessState;
use super::state::{Supervisor, TICK};
use anyhow::Result;
use files::result::CycleResult;
use ipc::header::Command;
use ipc::os::now_ns;

/// Shortest time limit for connecting, ns, and what each byte of the cell's shared memory adds: connecting maps and touches all that a stage
/// sees of it, which takes its time where other work keeps the cores busy.
const MIN_CONNECT_NS: u64 = 5_000_000_000;
const CONNECT_NS_PER_BYTE: u64 = 12;

impl Supervisor<'_> {
    /// Starts the stages whose start is due.
    ///
    /// A start may fail for a moment without memory or processes; it is retried like a failed stage.
    pub(super) fn start_due(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        let now = now_ns();
        for stage in 0..self.stages.len() {
            let child = &mut self.stages[stage];
            if !matches!(child.state, ProcessState::Waiting { until_ns } if until_ns <= now) {
                continue;
            }
            if let Err(error) = child.start(now) {
                tracing::warn!("{error:#}");
                child.ended(now);
                self.give_up_if_failed(stage, &format!("{error:#}"), each)?;
            }
        }
        Ok(())
    }

    /// Gives up if a stage has failed too often.
    fn give_up_if_failed(
        &mut self,
        stage: usize,
        end: &str,
        each: &mut dyn FnMut(&CycleResult),
    ) -> Result<()> {
        let child = &self.stages[stage];
        if child.state != ProcessState::GaveUp {
            return Ok(());
        }
        let (name, failures) = (&child.name, child.restarts.recent());
        let window_s = self.cell.config.limits.restart_window_ms / 1000;
        let reason =
            format!("stage {name} failed {failures} times within {window_s} s, the last time: {end}");
        self.give_up(reason, each)
    }

    /// Kills stages that exceed a time limit, reaps those that ended, and schedules restarts.
    pub(super) fn reap_ended(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        let limits = &self.cell.config.limits;
        let (now, start_ns) = (now_ns(), setup::ns_of_ms(limits.start_ms));
        let touching_ns = self.cell.schedule.memory_bytes().saturating_mul(CONNECT_NS_PER_BYTE);
        let budget_ns =
            setup::ns_of_ms(limits.stage_budget_ms).max(MIN_CONNECT_NS).saturating_add(touching_ns);
        let stages = self.stages.len();
        for stage in 0..stages {
            let child = &mut self.stages[stage];
            if matches!(child.state, ProcessState::Starting { since_ns } if now.saturating_sub(since_ns) > start_ns)
            {
                child.kill(&format!("did not report ready within {} ms", start_ns / 1_000_000));
            }
            // No cycle runs yet that could find the stage hung.
            let waited_ns = self.connect_ns.map_or(0, |since_ns| now.saturating_sub(since_ns));
            let populating = self.connected.len() == stages;
            let answered =
                self.cycles.is_stage_ready(stage) || !populating && self.connected.contains(&stage);
            let connects = child.state == ProcessState::Up && !self.connecting && !answered;
            if connects && child.killed.is_none() && waited_ns > budget_ns {
                let doing = if populating { "touch its buffers" } else { "connect" };
                child.kill(&format!("hung: did not {doing} within {} ms", budget_ns / 1_000_000));
            }
            let Some(end) = child.reap() else { continue };
            tracing::warn!(stage = child.name, end, "stage ended");
            // Its last message may still be queued. iceoryx2 can release its memory only now that it is reaped.
            self.drain(each)?;
            self.ports.clean_up_dead()?;
            let child = &mut self.stages[stage];
            child.ended(now);
            self.step(Input::Lost { stage, reason: end.clone() }, each)?;
            self.give_up_if_failed(stage, &end, each)?;
        }
        Ok(())
    }

    /// Makes all stages connect to each other once all are up and one of them is new.
    pub(super) fn connect(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        if !self.connecting || self.stages.iter().any(|c| c.state != ProcessState::Up) {
            return Ok(());
        }
        self.connecting = false;
        self.connected.clear();
        self.connect_ns = Some(now_ns());
        self.epoch += 1;
        for stage in 0..self.stages.len() {
            self.step(Input::Unready { stage }, each)?;
        }
        if let Some(snapshot) = &mut self.snapshot {
            snapshot.connect()?;
        }
        if let Some(recorder) = &self.recorder {
            recorder.connect()?;
        }
        self.events.connect()?;
        self.results.connect()?;
        self.command(Command::Connect, self.epoch)
    }

    /// Handles the answer to a command that connects or populates. No stage populates the memory of a new one before all have let
    /// go of that of its predecessor: both at once may not fit.
    pub(super) fn answered(&mut self, stage: usize, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        if self.connected.len() == self.stages.len() {
            return self.step(Input::Ready { stage }, each);
        }
        self.connected.insert(stage);
        if self.connected.len() < self.stages.len() {
            return Ok(());
        }
        // As with a stage that finds no room: it is started again, and after some times the cell gives up.
        if let Err(reason) = self.ports.reserve() {
            self.stages[stage].kill(&reason.to_string());
            return Ok(());
        }
        self.connect_ns = Some(now_ns());
        self.epoch += 1;
        self.command(Command::Populate, self.epoch)
    }

    /// Asks all stages to end, then kills those that do not.
    pub(super) fn shut_down(&mut self) {
        // Stages that cannot receive it are killed below.
        let _ = self.command(Command::Shutdown, 0);
        let deadline_ns = now_ns().saturating_add(setup::ns_of_ms(self.cell.config.limits.stop_ms));
        while self.stages.iter().any(|c| c.pid().is_some()) {
            for child in &mut self.stages {
                if child.reap().is_some() {
                    child.state = ProcessState::Ended;
                }
                if now_ns() > deadline_ns {
                    child.kill("did not stop");
                }
            }
            // Messages are no longer needed, but a stage may wait for space in a full buffer.
            while matches!(self.events.receive(), Ok(Some(_))) {}
            if let Some(snapshot) = &mut self.snapshot {
                let _ = snapshot.update();
            }
            std::thread::sleep(TICK / 4);
        }
        // A changed segment was reported by the event loop.
        let _ = self.ports.clean_up_dead();
    }
}
