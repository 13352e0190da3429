//! The cycles as a state machine: takes the time and what happened, returns what to do. Pure.
//!
//! Every requested cycle gets exactly one outcome, in order, whatever happens in whatever order: done with all its
//! activations and a result, or ended with a reason. A new cycle starts only when all stages are ready, the cycles in
//! flight are fewer than planned, and the last one is acquired. Cycles are evaluated one after another.

use super::flight::{Flight, Steps};
use std::collections::VecDeque;

pub use super::flight::Step;

/// Time limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budgets {
    /// A stage whose next activation could run for this long without being done is hung, ns.
    pub stage_ns: u64,
    /// A cycle may last this long, ns.
    pub cycle_ns: u64,
}

/// What happened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Input {
    /// A stage is connected and waits for work.
    Ready {
        /// Which.
        stage: usize,
    },
    /// A stage is gone.
    Lost {
        /// Which.
        stage: usize,
        /// Why, in words.
        reason: String,
    },
    /// A stage needs the handshake again: a neighbour of it was replaced.
    Unready {
        /// Which.
        stage: usize,
    },
    /// An activation is done.
    Done {
        /// Who says so.
        stage: usize,
        /// In which cycle.
        cycle: u64,
        /// Which.
        activation: usize,
    },
    /// A stage cannot finish the cycle.
    Failed {
        /// Who.
        stage: usize,
        /// Which cycle.
        cycle: u64,
        /// Why.
        reason: String,
    },
    /// The result of a cycle arrived.
    Result {
        /// Which cycle.
        cycle: u64,
    },
    /// Somebody sent what cannot be true.
    Distrust {
        /// What.
        reason: String,
    },
    /// One more cycle is asked for; only of a machine that is [`Cycles::open`].
    Request,
    /// The cycles that run, or else the one that waits for its stages, end now; the machine goes on.
    Abort {
        /// Why.
        reason: String,
    },
    /// Time passed.
    Tick,
    /// No further cycle shall start, the running ones end now.
    Stop {
        /// Why.
        reason: String,
    },
}

/// What to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Tell the stages of the acquisition to start a cycle.
    Start(u64),
    /// Tell those of the evaluation.
    Evaluate(u64),
    /// Tell all stages to forget a cycle.
    Abort(u64),
    /// Kill a hung stage.
    Kill {
        /// Which.
        stage: usize,
        /// Why.
        reason: String,
    },
    /// A cycle has its outcome.
    Outcome {
        /// Which cycle.
        cycle: u64,
        /// Nothing, or why it is not ok.
        result: Result<(), String>,
    },
    /// Every requested cycle has its outcome.
    Finished,
}

/// The machine.
#[derive(Debug)]
pub struct Cycles {
    stages: Vec<String>,
    steps: Steps,
    budgets: Budgets,
    ready: Vec<bool>,
    /// Cycles that may be under way at once, at least 1.
    in_flight: usize,
    /// Those that are, the oldest first.
    flights: VecDeque<Flight>,
    next: u64,
    /// Cycles to run; `None`: until stopped.
    requested: Option<u64>,
    /// Whether more cycles may be requested.
    open: bool,
    finished: bool,
}

impl Cycles {
    /// A machine for `requested` cycles, `in_flight` of them at once, numbered from 0 for the person; messages carry
    /// cycle + 1, see [`crate::cycle_number::wire`].
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

    /// The same without a cycle yet: each one is requested.
    #[must_use]
    pub fn open(self) -> Self {
        Self { requested: Some(0), open: true, ..self }
    }

    /// Whether a stage is connected and waits for work.
    pub fn is_stage_ready(&self, stage: usize) -> bool {
        self.ready[stage]
    }

    /// Whether all stages are ready.
    pub fn is_ready(&self) -> bool {
        self.ready.iter().all(|&ready| ready)
    }

    /// The cycles that run, the oldest first.
    pub fn running(&self) -> impl Iterator<Item = u64> {
        self.flights.iter().filter(|flight| flight.ended.is_none()).map(|flight| flight.cycle)
    }

    /// Whether every requested cycle has its outcome.
    pub fn is_finished(&self) -> bool {
        self.finished
    }

    /// Takes what happened, returns what to do, in order.
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
                // Those of other cycles are the last words of an earlier one.
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
            Input::Distrust { reason } => self.end_all(&reason, &mut actions),
            Input::Request => self.requested = self.requested.map(|n| n + 1),
            Input::Abort { reason } => self.abort(&reason, &mut actions),
            Input::Tick => self.watch(now_ns, &mut actions),
            Input::Stop { reason } => self.stop(&reason, &mut actions),
        }
        if let Some(first) = self.flights.front_mut().filter(|first| first.is_complete()) {
            end(first, Ok(()), &mut actions);
        }
        self.advance(now_ns, &mut actions);
        actions
    }

    /// Says what has its outcome, then starts what may start.
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
            self.flights.push_back(Flight::new(self.next, &self.steps, now_ns));
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
            && self.flights.back().is_none_or(Flight::is_acquired)
    }

    /// Outcomes come in the order of the cycles: one that ended early waits for those before it.
    fn conclude(&mut self, actions: &mut VecDeque<Action>) {
        let ended = self.flights.iter().take_while(|flight| flight.ended.is_some()).count();
        for flight in self.flights.drain(..ended) {
            if let Some(result) = flight.ended {
                actions.push_back(Action::Outcome { cycle: flight.cycle, result });
            }
        }
    }

    /// Ends the cycles in which somebody overran.
    fn watch(&mut self, now_ns: u64, actions: &mut VecDeque<Action>) {
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
                    || "nothing is left to do but no result came".to_owned(),
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

    /// The next cycle ends before it starts.
    fn skip(&mut self, reason: &str, actions: &mut VecDeque<Action>) {
        let result = Err(format!("not started: {reason}"));
        actions.push_back(Action::Outcome { cycle: self.next, result });
        self.next += 1;
    }

    fn stop(&mut self, reason: &str, actions: &mut VecDeque<Action>) {
        self.end_all(reason, actions);
        self.conclude(actions);
        while self.requested.is_some_and(|n| self.next < n) {
            self.skip(reason, actions);
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

/// The cycle with this number, if it runs.
fn running(flights: &mut VecDeque<Flight>, cycle: u64) -> Option<&mut Flight> {
    flights.iter_mut().find(|flight| flight.cycle == cycle && flight.ended.is_none())
}

/// A cycle has ended; those who still work on it are told.
fn end(flight: &mut Flight, result: Result<(), String>, actions: &mut VecDeque<Action>) {
    if result.is_err() {
        actions.push_back(Action::Abort(flight.cycle));
    }
    flight.ended = Some(result);
}

#[cfg(test)]
#[path = "cycle_tests.rs"]
mod tests;
