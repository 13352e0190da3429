//! What a person asks of a running cell: the interrupt key, `status`, `restart`, `stop`.

use super::cycle::Input;
use super::metrics;
use super::socket::{Answer, Request, StageStatus, Status};
use super::state::Supervisor;
use anyhow::Result;
use ipc::os::now_ns;
use rig::result::CycleResult;
use std::sync::atomic::Ordering;

impl Supervisor<'_> {
    /// Does what the operator asks.
    pub(super) fn obey(&mut self, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
        if self.interrupted.load(Ordering::SeqCst) {
            self.stop(each)?;
        }
        while let Ok((request, reply)) = self.requests.try_recv() {
            let answer = match request {
                Request::Status {} => Answer::Status(Box::new(self.status())),
                Request::Metrics {} => Answer::Metrics(metrics::render(&self.status(), &self.profile)),
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
            cycle: self.cycles.running(),
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
