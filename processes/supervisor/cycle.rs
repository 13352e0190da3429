//! State machine of the cycles: takes the time and an input, returns actions. Pure.
//!
//! Every cycle that starts gets exactly one outcome, in order, for any order of inputs: complete with all activations and a
//! result, or ended with a reason. Requested cycles that a stop prevents are counted once. A new cycle starts only when all stages are ready, fewer cycles than planned are in
//! flight, and the last one is acquired. Cycles are evaluated one after another.

use super::in_flight::{CycleInFlight, Steps};
use std::collections::VecDeque;

pub use super::in_flight::Step;

/// Time limits of a cycle and its stages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budgets {
    /// A stage whose next activation is runnable for longer than this is hung, ns.
    pub stage_ns: u64,
    /// Deadline of a cycle, ns.
    pub cycle_ns: u64,
}

/// Inputs of the state machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Input {
    /// A stage is connected and ready.
    Ready {
        /// Index of the stage.
        stage: usize,
    },
    /// The process of a stage ended.
    Lost {
        /// Index of the stage.
        stage: usize,
        /// The reason, after the name of the stage.
        reason: String,
    },
    /// A stage has to connect again: another stage was replaced.
    Unready {
        /// Index of the stage.
        stage: usize,
    },
    /// An activation is done.
    Done {
        /// Index of the stage that reports it.
        stage: usize,
        /// Cycle, counted from 0.
        cycle: u64,
        /// Index of the activation.
        activation: usize,
    },
    /// A stage cannot complete the cycle.
    Failed {
        /// Index of the stage.
        stage: usize,
        /// Cycle, counted from 0.
        cycle: u64,
        /// The reason, for the outcome of the cycle.
        reason: String,
    },
    /// The result of a cycle arrived.
    Result {
        /// Cycle, counted from 0.
        cycle: u64,
    },
    /// A stage sent an invalid message.
    InvalidMessage {
        /// What is invalid about the message.
        reason: String,
    },
    /// One more cycle is requested; only for a machine that is [`Cycles::open`].
    Request,
    /// A cycle with this number is requested, which is no lower than that of the next one; those between are left out.
    RequestNumber {
        /// Cycle, counted from 0.
        cycle: u64,
    },
    /// Ends the cycles in progress, or else the one that waits for its stages; the machine continues.
    Abort {
        /// The reason, for the outcomes of the cycles.
        reason: String,
    },
    /// Time has passed; nothing else happened.
    Tick,
    /// Ends the cycles in progress and starts no more.
    Stop {
        /// The reason, for the outcomes of the cycles.
        reason: String,
    },
}

/// Actions for the supervisor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Tell the acquisition stages to start a cycle.
    Start(u64),
    /// Tell the evaluation stages to start a cycle.
    Evaluate(u64),
    /// Tell all stages to drop a cycle.
    Abort(u64),
    /// Kill a hung stage.
    Kill {
        /// Index of the stage.
        stage: usize,
        /// The reason, for the outcome of the cycle.
        reason: String,
    },
    /// A cycle has its outcome.
    Outcome {
        /// Cycle, counted from 0.
        cycle: u64,
        /// Ok, or the reason why not.
        result: Result<(), String>,
    },
    /// Requested cycles that are never started.
    NotRun {
        /// Number of cycles that are not run.
        count: u64,
        /// The reason that is reported for them.
        reason: String,
    },
    /// Every requested cycle has its outcome or is not run.
    Finished,
}

/// The state machine of the cycles.
#[derive(Debug)]
pub struct Cycles {
    stages: Vec<String>,
    steps: Steps,
    budgets: Budgets,
    ready: Vec<bool>,
    /// Cycles that may be in progress at once, at least 1.
    in_flight: usize,
    /// Cycles in progress, the oldest first.
    flights: VecDeque<CycleInFlight>,
    next: u64,
    /// Cycles to run; `None`: until stopped.
    requested: Option<u64>,
    /// Whether more cycles may be requested.
    open: bool,
    finished: bool,
}

impl Cycles {
    /// A machine for `requested` cycles, at most `in_flight` at once. Cycles are numbered from 0 here; people see cycle + 1,
    /// and so do messages, see [`cell::cycle_number::wire`].
    pub fn new(
        stages: Vec<String>,
        steps: Vec<Step>,
        budgets: Budgets,
        in_flight: usize,
        requested: Option<u64>,
    ) -> Self {
        Self {
            steps: Steps::new(steps, stages.len()),
            budgets,
            ready: vec![false; stages.len()],
            stages,
            in_flight,
            flights: VecDeque::with_capacity(in_flight),
            next: 0,
            requested,
            open: false,
            finished: false,
        }
    }

    /// The same machine, but each cycle has to be requested.
    #[must_use]
    pub fn open(self) -> Self {
        Self { requested: Some(0), open: true, ..self }
    }

    /// Whether a stage is connected and ready.
    pub fn is_stage_ready(&self, stage: usize) -> bool {
        self.ready[stage]
    }

    /// Whether all stages are ready.
    pub fn is_ready(&self) -> bool {
        self.ready.iter().all(|&ready| ready)
    }

    /// The cycles in progress, the oldest first.
    pub fn running(&self) -> impl Iterator<Item = u64> {
        self.flights.iter().filter(|flight| flight.ended.is_none()).map(|flight| flight.cycle)
    }

    /// Whether every requested cycle has its outcome.
    pub fn is_finished(&self) -> bool {
        self.finished
    }

    /// Handles an input; returns the actions in order.
    pub fn handle(&mut self, now_ns: u64, input: Input) -> VecDeque<Action> {
        let mut actions = VecDeque::new();
        if self.finished {
            return actions;
        }
        match input {
            Input::Ready { stage } => self.ready[stage] = true,
            Input::Unready { stage } => self.ready[stage] = false,
            Input::Lost { stage, reason } => {
                self.ready[stage] = false;
                self.end_all(&format!("stage {} {reason}", self.stages[stage]), &mut actions);
            }
            Input::Done { stage, cycle, activation } => {
                let (steps, stages) = (&self.steps, &self.stages);
                // Reports of other cycles are late ones.
                if let Some(flight) = running(&mut self.flights, cycle)
                    && let Err(reason) = flight.done(steps, stages, (stage, activation), now_ns)
                {
                    end(flight, Err(reason), &mut actions);
                }
            }
            Input::Failed { stage, cycle, reason } => {
                if let Some(flight) = running(&mut self.flights, cycle) {
                    end(flight, Err(format!("stage {}: {reason}", self.stages[stage])), &mut actions);
                }
            }
            Input::Result { cycle } => {
                if let Some(flight) = running(&mut self.flights, cycle) {
                    flight.result = true;
                }
            }
            Input::InvalidMessage { reason } => self.end_all(&reason, &mut actions),
            Input::Request => self.requested = self.requested.map(|n| n + 1),
            Input::RequestNumber { cycle } => {
                // One that has its outcome already is not run again.
                if cycle >= self.next {
                    self.next = cycle;
                    self.requested = Some(cycle + 1);
                }
            }
            Input::Abort { reason } => self.abort(&reason, &mut actions),
            Input::Tick => self.check_limits(now_ns, &mut actions),
            Input::Stop { reason } => self.stop(&reason, &mut actions),
        }
        if let Some(first) = self.flights.front_mut().filter(|first| first.is_complete()) {
            end(first, Ok(()), &mut actions);
        }
        self.advance(now_ns, &mut actions);
        actions
    }

    /// Reports outcomes, then starts the cycle that may start.
    fn advance(&mut self, now_ns: u64, actions: &mut VecDeque<Action>) {
        self.conclude(actions);
        if self.finished {
            return;
        }
        if self.requested.is_some_and(|n| self.next >= n) {
            if self.flights.is_empty() && !self.open {
                self.finished = true;
                actions.push_back(Action::Finished);
            }
        } else if self.may_start() {
            self.flights.push_back(CycleInFlight::new(self.next, &self.steps, now_ns));
            actions.push_back(Action::Start(self.next));
            self.next += 1;
        }
        if let Some(first) = self.flights.front_mut()
            && first.evaluate(&self.steps, now_ns)
        {
            actions.push_back(Action::Evaluate(first.cycle));
        }
    }

    fn may_start(&self) -> bool {
        self.is_ready()
            && self.flights.len() < self.in_flight
            && self.flights.back().is_none_or(CycleInFlight::is_acquired)
    }

    /// Reports outcomes in the order of the cycles: a cycle that ended early waits for earlier ones.
    fn conclude(&mut self, actions: &mut VecDeque<Action>) {
        let ended = self.flights.iter().take_while(|flight| flight.ended.is_some()).count();
        for flight in self.flights.drain(..ended) {
            if let Some(result) = flight.ended {
                actions.push_back(Action::Outcome { cycle: flight.cycle, result });
            }
        }
    }

    /// Ends the cycles that exceed a time limit.
    fn check_limits(&mut self, now_ns: u64, actions: &mut VecDeque<Action>) {
        for flight in self.flights.iter_mut().filter(|flight| flight.ended.is_none()) {
            let oldest = flight.oldest();
            if let Some((since_ns, number)) = oldest
                && now_ns.saturating_sub(since_ns) > self.budgets.stage_ns
            {
                let step = &self.steps.all[number];
                let reason = format!(
                    "hung: no progress for {} ms at \"{}\", the limit is {} ms",
                    now_ns.saturating_sub(since_ns) / 1_000_000,
                    step.label,
                    self.budgets.stage_ns / 1_000_000
                );
                let stage = step.stage;
                self.ready[stage] = false;
                actions.push_back(Action::Kill { stage, reason: reason.clone() });
                end(flight, Err(format!("stage {} {reason}", self.stages[stage])), actions);
            } else if now_ns.saturating_sub(flight.start_ns) > self.budgets.cycle_ns {
                let at = oldest.map_or_else(
                    || "all activations are done but the result is missing".to_owned(),
                    |(_, number)| {
                        let step = &self.steps.all[number];
                        format!("stage {} was at \"{}\"", self.stages[step.stage], step.label)
                    },
                );
                let limit_ms = self.budgets.cycle_ns / 1_000_000;
                end(flight, Err(format!("not finished within the deadline of {limit_ms} ms; {at}")), actions);
            }
        }
    }

    fn abort(&mut self, reason: &str, actions: &mut VecDeque<Action>) {
        if !self.flights.is_empty() {
            self.end_all(reason, actions);
        } else if self.requested.is_some_and(|n| self.next < n) {
            self.skip(reason, actions);
        }
    }

    /// Ends the next cycle before its start.
    fn skip(&mut self, reason: &str, actions: &mut VecDeque<Action>) {
        let result = Err(format!("not started: {reason}"));
        actions.push_back(Action::Outcome { cycle: self.next, result });
        self.next += 1;
    }

    fn stop(&mut self, reason: &str, actions: &mut VecDeque<Action>) {
        self.end_all(reason, actions);
        self.conclude(actions);
        let count = self.requested.map_or(0, |n| n.saturating_sub(self.next));
        if self.open {
            // A client waits for the outcome of each of them.
            (0..count).for_each(|_| self.skip(reason, actions));
        } else if count > 0 {
            self.next += count;
            actions.push_back(Action::NotRun { count, reason: reason.to_owned() });
        }
        self.finished = true;
        actions.push_back(Action::Finished);
    }

    fn end_all(&mut self, reason: &str, actions: &mut VecDeque<Action>) {
        for flight in self.flights.iter_mut().filter(|flight| flight.ended.is_none()) {
            end(flight, Err(reason.to_owned()), actions);
        }
    }
}

/// The cycle with this number, if in progress.
fn running(flights: &mut VecDeque<CycleInFlight>, cycle: u64) -> Option<&mut CycleInFlight> {
    flights.iter_mut().find(|flight| flight.cycle == cycle && flight.ended.is_none())
}

/// Ends a cycle; without a result the stages drop it.
fn end(flight: &mut CycleInFlight, result: Result<(), String>, actions: &mut VecDeque<Action>) {
    if result.is_err() {
        actions.push_back(Action::Abort(flight.cycle));
    }
    flight.ended = Some(result);
}

#[cfg(test)]
#[path = "cycle_tests.rs"]
mod tests;
