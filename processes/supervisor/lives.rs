//! The lives of the stages: started, connected, buried, stopped.

use super::children::Life;
use super::cycle::Input;
use super::start;
use super::state::{Supervisor, TICK};
use anyhow::Result;
use files::result::CycleResult;
use ipc::header::Command;
use ipc::os::now_ns;

/// Connecting maps and touches all memory that a stage shares: time for it whatever the budget of a stage is, ns.
const LEAST_CONNECT_NS: u64 = 5_000_000_000;

impl Supervisor<'_> {
    /// Starts the stages whose pause is over.
    pub(super) fn start_waiting(&mut self) -> Result<()> {
        let now = now_ns();
        for child in &mut self.children {
            if matches!(child.life, Life::Waiting { until_ns } if until_ns <= now) {
                child.start(now)?;
            }
        }
        Ok(())
    }

    /// Reaps stages that ended and those that do not start, and decides what follows.
    pub(super) fn bury(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        let limits = &self.cell.config.limits;
        let (now, start_ns) = (now_ns(), start::millis(limits.start_ms));
        let budget_ns = start::millis(limits.stage_budget_ms).max(LEAST_CONNECT_NS);
        for stage in 0..self.children.len() {
            let child = &mut self.children[stage];
            if matches!(child.life, Life::Starting { since_ns } if now.saturating_sub(since_ns) > start_ns) {
                child.kill(&format!("did not report ready within {} ms", start_ns / 1_000_000));
            }
            // Nobody works yet, so no cycle finds it hung; its stage may have stood still while another was started again.
            let waited_ns = self.connect_ns.map_or(0, |since_ns| now.saturating_sub(since_ns));
            let connects = child.life == Life::Up && !self.connecting && !self.cycles.is_stage_ready(stage);
            if connects && child.killed.is_none() && waited_ns > budget_ns {
                child.kill(&format!("hung: did not connect within {} ms", budget_ns / 1_000_000));
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
                self.give_up(reason, each)?;
            }
        }
        Ok(())
    }

    /// When all stages stand and one of them is new, all connect to each other.
    pub(super) fn connect(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        if !self.connecting || self.children.iter().any(|c| c.life != Life::Up) {
            return Ok(());
        }
        self.connecting = false;
        self.connect_ns = Some(now_ns());
        self.epoch += 1;
        for stage in 0..self.children.len() {
            self.feed(Input::Unready { stage }, each)?;
        }
        if let Some(watch) = &self.watch {
            watch.connect()?;
        }
        if let Some(keeper) = &self.keeper {
            keeper.connect()?;
        }
        self.events.connect()?;
        self.results.connect()?;
        self.command(Command::Connect, self.epoch)
    }

    /// Asks all stages to leave, then kills those that do not.
    pub(super) fn shut_down(&mut self) {
        // Those that cannot be told are killed below.
        let _ = self.command(Command::Shutdown, 0);
        let deadline_ns = now_ns().saturating_add(start::millis(self.cell.config.limits.stop_ms));
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
}
