//! A cycle that is under way: what of it is done, what could be done. Pure.

use crate::schedule::Half;

/// What the machine has to know of an activation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// Its stage.
    pub stage: usize,
    /// The half of the cycle that it belongs to.
    pub half: Half,
    /// What has to be done before.
    pub inputs: Vec<usize>,
    /// In words, for the message when it hangs.
    pub label: String,
}

/// All activations of a cycle.
#[derive(Debug)]
pub(super) struct Steps {
    pub(super) all: Vec<Step>,
    /// What has to be done before each one: its inputs, and the one before it on the same stage.
    needs: Vec<Vec<usize>>,
    /// The activation before each one on the same stage.
    before: Vec<Option<usize>>,
    /// Whom an activation feeds, those after it on the same stage included.
    feeds: Vec<Vec<usize>>,
}

impl Steps {
    /// Of so many stages.
    pub(super) fn new(all: Vec<Step>, stages: usize) -> Self {
        let (mut before, mut needs) = (vec![None; all.len()], vec![Vec::new(); all.len()]);
        let mut feeds = vec![Vec::new(); all.len()];
        let mut last = vec![None; stages];
        for (number, step) in all.iter().enumerate() {
            before[number] = last[step.stage].replace(number);
            needs[number] = step.inputs.iter().copied().chain(before[number]).collect();
            for &input in &needs[number] {
                feeds[input].push(number);
            }
        }
        Self { all, needs, before, feeds }
    }
}

/// A cycle that was started and has no outcome yet.
#[derive(Debug)]
pub(super) struct Flight {
    pub(super) cycle: u64,
    pub(super) start_ns: u64,
    /// Whether the stages of the evaluation were told of it.
    evaluating: bool,
    done: Vec<bool>,
    /// Since when all that has to be done before an activation is done.
    runnable_ns: Vec<Option<u64>>,
    missing: usize,
    /// Of those, in the acquisition.
    to_acquire: usize,
    /// Whether the result is there.
    pub(super) result: bool,
    /// How it ended; the outcome is said when all earlier cycles have theirs.
    pub(super) ended: Option<Result<(), String>>,
}

impl Flight {
    /// The acquisition begins.
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
        flight.wake(steps, 0..steps.all.len(), now_ns);
        flight
    }

    /// The evaluation begins, as soon as it has its inputs. Says whether it had not begun yet.
    pub(super) fn evaluate(&mut self, steps: &Steps, now_ns: u64) -> bool {
        let begins = !std::mem::replace(&mut self.evaluating, true);
        if begins {
            self.wake(steps, 0..steps.all.len(), now_ns);
        }
        begins
    }

    /// Whether the part, the light and the cameras are free for the next cycle.
    pub(super) fn is_acquired(&self) -> bool {
        self.ended.is_some() || self.to_acquire == 0
    }

    /// Whether nothing is missing.
    pub(super) fn is_complete(&self) -> bool {
        self.missing == 0 && self.result
    }

    /// An activation is done, unless that cannot be.
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
        // Reports of different stages travel apart and may overtake each other; those of one stage may not.
        let early = step.half == Half::Evaluation && !self.evaluating;
        if early || steps.before[activation].is_some_and(|before| !self.done[before]) {
            return Err(format!("stage {name} reported \"{}\" out of order", step.label));
        }
        self.done[activation] = true;
        self.missing -= 1;
        self.to_acquire -= usize::from(step.half == Half::Acquisition);
        self.runnable_ns[activation] = None;
        self.wake(steps, steps.feeds[activation].iter().copied(), now_ns);
        Ok(())
    }

    /// The activation that could have been done for longest, and since when, ns.
    pub(super) fn oldest(&self) -> Option<(u64, usize)> {
        self.runnable_ns.iter().enumerate().filter_map(|(i, t)| t.map(|t| (t, i))).min()
    }

    /// Notes which of some activations could be done now.
    fn wake(&mut self, steps: &Steps, some: impl Iterator<Item = usize>, now_ns: u64) {
        for number in some {
            let begun = self.evaluating || steps.all[number].half == Half::Acquisition;
            let free = begun && !self.done[number] && steps.needs[number].iter().all(|&need| self.done[need]);
            if free && self.runnable_ns[number].is_none() {
                self.runnable_ns[number] = Some(now_ns);
            }
        }
    }
}
