//! A cycle in progress: which activations are done, which are runnable. Pure.

use cell::schedule::Half;

/// An activation as the state machine needs it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Index of its stage.
    pub stage: usize,
    /// Its half of the cycle.
    pub half: Half,
    /// Activations that must be done before.
    pub inputs: Vec<usize>,
    /// Its label in messages.
    pub label: String,
}

/// All activations of a cycle.
#[derive(Debug)]
pub(super) struct Steps {
    pub(super) all: Vec<Step>,
    /// For each activation: its inputs and the previous one of the same stage.
    needs: Vec<Vec<usize>>,
    /// For each activation: the previous one of the same stage.
    before: Vec<Option<usize>>,
    /// For each activation: those that need it, including the next one of the same stage.
    dependents: Vec<Vec<usize>>,
}

impl Steps {
    /// The activations of a number of stages.
    pub(super) fn new(all: Vec<Step>, stages: usize) -> Self {
        let (mut before, mut needs) = (vec![None; all.len()], vec![Vec::new(); all.len()]);
        let mut dependents = vec![Vec::new(); all.len()];
        let mut last = vec![None; stages];
        for (number, step) in all.iter().enumerate() {
            before[number] = last[step.stage].replace(number);
            needs[number] = step.inputs.iter().copied().chain(before[number]).collect();
            for &input in &needs[number] {
                dependents[input].push(number);
            }
        }
        Self { all, needs, before, dependents }
    }
}

/// A cycle that was started and has no outcome yet.
#[derive(Debug)]
pub(super) struct CycleInFlight {
    pub(super) cycle: u64,
    pub(super) start_ns: u64,
    /// Whether the evaluation was started.
    evaluating: bool,
    done: Vec<bool>,
    /// Since when each activation is runnable, ns.
    runnable_ns: Vec<Option<u64>>,
    /// Activations that are not done.
    missing: usize,
    /// Activations of the acquisition that are not done.
    to_acquire: usize,
    /// Whether the result arrived.
    pub(super) result: bool,
    /// How it ended; the outcome is reported after those of all earlier cycles.
    pub(super) ended: Option<Result<(), String>>,
}

impl CycleInFlight {
    /// Starts the acquisition of a cycle.
    pub(super) fn new(cycle: u64, steps: &Steps, now_ns: u64) -> Self {
        let acquisition = |step: &&Step| step.half == Half::Acquisition;
        let mut flight = Self {
            cycle,
            start_ns: now_ns,
            evaluating: false,
            done: vec![false; steps.all.len()],
            runnable_ns: vec![None; steps.all.len()],
            missing: steps.all.len(),
            to_acquire: steps.all.iter().filter(acquisition).count(),
            result: false,
            ended: None,
        };
        flight.mark_runnable(steps, 0..steps.all.len(), now_ns);
        flight
    }

    /// Starts the evaluation. Returns whether it was not started before.
    pub(super) fn evaluate(&mut self, steps: &Steps, now_ns: u64) -> bool {
        let begins = !std::mem::replace(&mut self.evaluating, true);
        if begins {
            self.mark_runnable(steps, 0..steps.all.len(), now_ns);
        }
        begins
    }

    /// Whether part, projectors and cameras are free for the next cycle.
    pub(super) fn is_acquired(&self) -> bool {
        self.ended.is_some() || self.to_acquire == 0
    }

    /// Whether all activations are done and the result arrived.
    pub(super) fn is_complete(&self) -> bool {
        self.missing == 0 && self.result
    }

    /// Marks an activation as done, or returns why the report is invalid.
    pub(super) fn done(
        &mut self,
        steps: &Steps,
        stages: &[String],
        (stage, activation): (usize, usize),
        now_ns: u64,
    ) -> Result<(), String> {
        let name = &stages[stage];
        let Some(step) = steps.all.get(activation) else {
            return Err(format!(
                "stage {name} reported activation {activation}, which the schedule does not have"
            ));
        };
        if step.stage != stage {
            let owner = &stages[step.stage];
            return Err(format!("stage {name} reported \"{}\", which is the work of {owner}", step.label));
        }
        if self.done[activation] {
            return Err(format!("stage {name} reported \"{}\" twice", step.label));
        }
        // Reports of different stages may overtake each other; those of one stage may not.
        let early = step.half == Half::Evaluation && !self.evaluating;
        if early || steps.before[activation].is_some_and(|before| !self.done[before]) {
            return Err(format!("stage {name} reported \"{}\" out of order", step.label));
        }
        self.done[activation] = true;
        self.missing -= 1;
        self.to_acquire -= usize::from(step.half == Half::Acquisition);
        self.runnable_ns[activation] = None;
        self.mark_runnable(steps, steps.dependents[activation].iter().copied(), now_ns);
        Ok(())
    }

    /// The activation that is runnable for longest, and since when, ns.
    pub(super) fn oldest(&self) -> Option<(u64, usize)> {
        self.runnable_ns.iter().enumerate().filter_map(|(i, t)| t.map(|t| (t, i))).min()
    }

    /// Marks those of some activations that are runnable now.
    fn mark_runnable(&mut self, steps: &Steps, some: impl Iterator<Item = usize>, now_ns: u64) {
        for number in some {
            let begun = self.evaluating || steps.all[number].half == Half::Acquisition;
            let free = begun && !self.done[number] && steps.needs[number].iter().all(|&need| self.done[need]);
            if free && self.runnable_ns[number].is_none() {
                self.runnable_ns[number] = Some(now_ns);
            }
        }
    }
}
