//! The cycles as a state machine: takes the time and what happened, returns what to do. Pure.
//!
//! Every requested cycle gets exactly one outcome, in order, whatever happens in whatever order: done with all its
//! activations and a result, or ended with a reason. A new cycle starts only when all stages are ready.

use std::collections::VecDeque;

/// What the machine has to know of an activation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Its stage.
    pub stage: usize,
    /// What has to be done before.
    pub inputs: Vec<usize>,
    /// In words, for the message when it hangs.
    pub label: String,
}

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
    /// The cycle that runs, or waits for its stages, ends now; the machine goes on.
    Abort {
        /// Why.
        reason: String,
    },
    /// Time passed.
    Tick,
    /// No further cycle shall start, the running one ends now.
    Stop {
        /// Why.
        reason: String,
    },
}

/// What to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Tell all stages to start a cycle.
    Start(u64),
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

#[derive(Debug)]
struct Running {
    cycle: u64,
    start_ns: u64,
    done: Vec<bool>,
    /// Since when all inputs are done and the stage has nothing before it.
    runnable_ns: Vec<Option<u64>>,
    missing: usize,
    result: bool,
}

/// The machine.
#[derive(Debug)]
pub struct Cycles {
    stages: Vec<String>,
    steps: Vec<Step>,
    /// The activation before and after each one on the same stage.
    before: Vec<Option<usize>>,
    /// Whom an activation feeds, those after it on the same stage included.
    feeds: Vec<Vec<usize>>,
    budgets: Budgets,
    ready: Vec<bool>,
    running: Option<Running>,
    next: u64,
    /// Cycles to run; `None`: until stopped.
    requested: Option<u64>,
    /// Whether more cycles may be requested.
    open: bool,
    finished: bool,
}

impl Cycles {
    /// A machine for `requested` cycles, numbered from 0 for the person; messages carry cycle + 1, see
    /// [`crate::cycle_number::wire`].
    pub fn new(stages: Vec<String>, steps: Vec<Step>, budgets: Budgets, requested: Option<u64>) -> Self {
        let mut before = vec![None; steps.len()];
        let mut feeds = vec![Vec::new(); steps.len()];
        let mut last = vec![None; stages.len()];
        for (number, step) in steps.iter().enumerate() {
            before[number] = last[step.stage].replace(number);
            for &input in step.inputs.iter().chain(&before[number]) {
                feeds[input].push(number);
            }
        }
        let ready = vec![false; stages.len()];
        Self {
            stages,
            steps,
            before,
            feeds,
            budgets,
            ready,
            running: None,
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

    /// Whether all stages are ready.
    pub fn is_ready(&self) -> bool {
        self.ready.iter().all(|&ready| ready)
    }

    /// The cycle that runs.
    pub fn running(&self) -> Option<u64> {
        self.running.as_ref().map(|r| r.cycle)
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
                self.end(Err(format!("stage {} {reason}", self.stages[stage])), &mut actions);
            }
            Input::Done { stage, cycle, activation } => {
                if let Err(reason) = self.done(now_ns, stage, cycle, activation) {
                    self.end(Err(reason), &mut actions);
                }
            }
            Input::Failed { stage, cycle, reason } => {
                if self.running() == Some(cycle) {
                    self.end(Err(format!("stage {}: {reason}", self.stages[stage])), &mut actions);
                }
            }
            Input::Result { cycle } => {
                if let Some(running) = self.running.as_mut().filter(|r| r.cycle == cycle) {
                    running.result = true;
                }
            }
            Input::Distrust { reason } => self.end(Err(reason), &mut actions),
            Input::Request => self.requested = self.requested.map(|n| n + 1),
            Input::Abort { reason } => self.abort(&reason, &mut actions),
            Input::Tick => self.watch(now_ns, &mut actions),
            Input::Stop { reason } => self.stop(&reason, &mut actions),
        }
        if self.running.as_ref().is_some_and(|r| r.missing == 0 && r.result) {
            self.end(Ok(()), &mut actions);
        }
        self.advance(now_ns, &mut actions);
        actions
    }

    /// Starts the next cycle when it may.
    fn advance(&mut self, now_ns: u64, actions: &mut VecDeque<Action>) {
        if self.finished || self.running.is_some() {
            return;
        }
        if self.requested.is_some_and(|n| self.next >= n) {
            if !self.open {
                self.finished = true;
                actions.push_back(Action::Finished);
            }
            return;
        }
        if self.is_ready() {
            let cycle = self.next;
            self.next += 1;
            let runnable = |number: usize| {
                let step = &self.steps[number];
                (step.inputs.is_empty() && self.before[number].is_none()).then_some(now_ns)
            };
            self.running = Some(Running {
                cycle,
                start_ns: now_ns,
                done: vec![false; self.steps.len()],
                runnable_ns: (0..self.steps.len()).map(runnable).collect(),
                missing: self.steps.len(),
                result: false,
            });
            actions.push_back(Action::Start(cycle));
        }
    }

    fn done(&mut self, now_ns: u64, stage: usize, cycle: u64, activation: usize) -> Result<(), String> {
        let Some(running) = self.running.as_mut().filter(|r| r.cycle == cycle) else {
            return Ok(()); // the last words of an earlier cycle
        };
        let name = &self.stages[stage];
        let Some(step) = self.steps.get(activation) else {
            return Err(format!(
                "stage {name} reported activation {activation}, which the schedule does not have"
            ));
        };
        if step.stage != stage {
            let owner = &self.stages[step.stage];
            return Err(format!("stage {name} reported \"{}\", which is the work of {owner}", step.label));
        }
        if running.done[activation] {
            return Err(format!("stage {name} reported \"{}\" twice", step.label));
        }
        // Reports of different stages travel apart and may overtake each other; those of one stage may not.
        if self.before[activation].is_some_and(|before| !running.done[before]) {
            return Err(format!("stage {name} reported \"{}\" out of order", step.label));
        }
        running.done[activation] = true;
        running.missing -= 1;
        running.runnable_ns[activation] = None;
        for &fed in &self.feeds[activation] {
            let inputs = self.steps[fed].inputs.iter().chain(&self.before[fed]);
            if !running.done[fed] && inputs.clone().all(|&i| running.done[i]) {
                running.runnable_ns[fed] = Some(now_ns);
            }
        }
        Ok(())
    }

    /// Ends the cycle when somebody overran.
    fn watch(&mut self, now_ns: u64, actions: &mut VecDeque<Action>) {
        let Some(running) = &self.running else { return };
        let waiting = running.runnable_ns.iter().enumerate().filter_map(|(i, t)| t.map(|t| (t, i)));
        let oldest = waiting.min();
        if let Some((since_ns, number)) = oldest
            && now_ns.saturating_sub(since_ns) > self.budgets.stage_ns
        {
            let step = &self.steps[number];
            let reason = format!(
                "hung: no progress for {} ms at \"{}\", the limit is {} ms",
                now_ns.saturating_sub(since_ns) / 1_000_000,
                step.label,
                self.budgets.stage_ns / 1_000_000
            );
            let stage = step.stage;
            self.ready[stage] = false;
            actions.push_back(Action::Kill { stage, reason: reason.clone() });
            self.end(Err(format!("stage {} {reason}", self.stages[stage])), actions);
            return;
        }
        if now_ns.saturating_sub(running.start_ns) > self.budgets.cycle_ns {
            let at = oldest.map_or_else(
                || "nothing is left to do but no result came".to_owned(),
                |(_, number)| {
                    let step = &self.steps[number];
                    format!("stage {} was at \"{}\"", self.stages[step.stage], step.label)
                },
            );
            let limit_ms = self.budgets.cycle_ns / 1_000_000;
            self.end(Err(format!("not finished within the deadline of {limit_ms} ms; {at}")), actions);
        }
    }

    fn abort(&mut self, reason: &str, actions: &mut VecDeque<Action>) {
        if self.running.is_some() {
            self.end(Err(reason.to_owned()), actions);
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
        self.end(Err(reason.to_owned()), actions);
        while self.requested.is_some_and(|n| self.next < n) {
            self.skip(reason, actions);
        }
        self.finished = true;
        actions.push_back(Action::Finished);
    }

    fn end(&mut self, result: Result<(), String>, actions: &mut VecDeque<Action>) {
        let Some(running) = self.running.take() else { return };
        if result.is_err() {
            actions.push_back(Action::Abort(running.cycle));
        }
        actions.push_back(Action::Outcome { cycle: running.cycle, result });
    }
}

#[cfg(test)]
#[path = "cycle_tests.rs"]
mod tests;
