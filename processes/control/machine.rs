//! The state machine: takes an event, returns what to do or why not. Pure.
//!
//! After OPC 40100-1, VisionStateMachineType with its automatic mode. Where a cell differs:
//! - It initialises by itself: once all stages stand, Preoperational becomes Initialized, and Ready as soon as a recipe is
//!   prepared; the method SelectModeAutomatic has nothing to select.
//! - A stage that is restarted makes the cell Preoperational until it stands again. A job that runs ends first, since a lost
//!   stage ends its cycle; a continuous job waits for the stage and goes on.
//! - Error is a stage that failed too often. Its reason stays until the reset.

use serde::{Deserialize, Serialize};

/// Where a cell is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum State {
    /// Stages start, or one of them is being restarted.
    Preoperational,
    /// All stages stand, no recipe is prepared.
    Initialized,
    /// Waits for a job.
    Ready,
    /// Inspects one part.
    SingleExecution,
    /// Inspects one part after another.
    ContinuousExecution,
    /// Stopped on purpose until the next reset; may be switched off.
    Halted,
    /// Cannot work until somebody removed the cause and resets.
    Error,
}

/// What happens to a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// All stages stand and are connected.
    StagesUp,
    /// A stage is down and will be started again.
    StagesDown,
    /// A stage was given up.
    Fault,
    /// The cycle of the running job has its outcome.
    CycleDone,
    /// Make a recipe selectable.
    Prepare {
        /// Number of the recipe.
        recipe: usize,
    },
    /// Make a recipe not selectable.
    Unprepare {
        /// Number of the recipe.
        recipe: usize,
    },
    /// Inspect one part.
    StartSingle {
        /// Number of the recipe.
        recipe: usize,
    },
    /// Inspect part after part.
    StartContinuous {
        /// Number of the recipe.
        recipe: usize,
        /// How many; `None`: until asked to finish.
        cycles: Option<u64>,
    },
    /// End the continuous job after the cycle that runs (OPC: Stop).
    Finish,
    /// End the job and its cycle now.
    Abort,
    /// Stop until the next reset.
    Halt,
    /// Begin anew.
    Reset,
}

/// What to do about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Nothing.
    None,
    /// Start a cycle with this recipe.
    StartCycle {
        /// Number of the recipe.
        recipe: usize,
    },
    /// End the cycle that runs.
    AbortCycle,
    /// Start the stages that were given up.
    Revive,
}

/// Why a request is not followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// Stages are being started.
    #[error("the stages are being started")]
    Starting,
    /// A job runs.
    #[error("a job runs")]
    Busy,
    /// No job runs.
    #[error("no job runs")]
    Idle,
    /// A halted cell has to be reset first.
    #[error("the cell was halted; reset it")]
    Halted,
    /// A cell in error has to be reset first.
    #[error("the cell is in error; remove the cause and reset it")]
    Error,
    /// The recipe is not prepared.
    #[error("the recipe is not prepared")]
    NotPrepared,
    /// The job needs the recipe.
    #[error("the running job uses the recipe")]
    InUse,
}

impl Refusal {
    /// Whether the same request may be followed later without anybody doing anything.
    pub fn is_passing(self) -> bool {
        matches!(self, Self::Starting | Self::Busy)
    }
}

/// A job that runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Job {
    recipe: usize,
    /// Cycles still to start; `None`: until asked to finish.
    left: Option<u64>,
}

/// The machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Machine {
    state: State,
    up: bool,
    prepared: Vec<bool>,
    job: Option<Job>,
}

impl Machine {
    /// Stages are down, all recipes prepared.
    pub fn new(recipes: usize) -> Self {
        Self { state: State::Preoperational, up: false, prepared: vec![true; recipes], job: None }
    }

    /// Where it is.
    pub fn state(&self) -> State {
        self.state
    }

    /// Whether a recipe can be selected.
    pub fn is_prepared(&self, recipe: usize) -> bool {
        self.prepared.get(recipe).copied().unwrap_or(false)
    }

    /// Takes an event.
    ///
    /// # Errors
    /// Why it is not followed; nothing has changed then.
    pub fn handle(&mut self, event: Event) -> Result<Action, Refusal> {
        match event {
            Event::StagesUp => Ok(self.stages(true)),
            Event::StagesDown => Ok(self.stages(false)),
            Event::Fault => {
                self.up = false;
                Ok(self.leave(State::Error))
            }
            Event::CycleDone => Ok(self.cycle_done()),
            Event::Prepare { recipe } => self.prepare(recipe),
            Event::Unprepare { recipe } => self.unprepare(recipe),
            Event::StartSingle { recipe } => self.start(recipe, State::SingleExecution, Some(0)),
            Event::StartContinuous { recipe, cycles } => {
                let left = cycles.map(|n| n.saturating_sub(1));
                self.start(recipe, State::ContinuousExecution, left)
            }
            Event::Finish => {
                self.job.as_mut().ok_or(Refusal::Idle)?.left = Some(0);
                Ok(Action::None)
            }
            Event::Abort => {
                self.job.as_mut().ok_or(Refusal::Idle)?.left = Some(0);
                Ok(Action::AbortCycle)
            }
            Event::Halt => Ok(self.leave(State::Halted)),
            Event::Reset => Ok(self.reset()),
        }
    }

    fn stages(&mut self, up: bool) -> Action {
        self.up = up;
        self.settle();
        Action::None
    }

    /// A single job is over; a continuous one goes on until its count is used up.
    fn cycle_done(&mut self) -> Action {
        let Some(job) = &mut self.job else { return Action::None };
        if job.left != Some(0) {
            job.left = job.left.map(|left| left - 1);
            return Action::StartCycle { recipe: job.recipe };
        }
        self.job = None;
        self.settle();
        Action::None
    }

    fn prepare(&mut self, recipe: usize) -> Result<Action, Refusal> {
        self.operational()?;
        *self.prepared.get_mut(recipe).ok_or(Refusal::NotPrepared)? = true;
        self.settle();
        Ok(Action::None)
    }

    fn unprepare(&mut self, recipe: usize) -> Result<Action, Refusal> {
        self.operational()?;
        if self.job.is_some_and(|job| job.recipe == recipe) {
            return Err(Refusal::InUse);
        }
        *self.prepared.get_mut(recipe).ok_or(Refusal::NotPrepared)? = false;
        self.settle();
        Ok(Action::None)
    }

    fn start(&mut self, recipe: usize, state: State, left: Option<u64>) -> Result<Action, Refusal> {
        self.operational()?;
        if self.job.is_some() {
            return Err(Refusal::Busy);
        }
        if !self.is_prepared(recipe) {
            return Err(Refusal::NotPrepared);
        }
        self.job = Some(Job { recipe, left });
        self.state = state;
        Ok(Action::StartCycle { recipe })
    }

    fn operational(&self) -> Result<(), Refusal> {
        match self.state {
            State::Preoperational => Err(Refusal::Starting),
            State::Halted => Err(Refusal::Halted),
            State::Error => Err(Refusal::Error),
            State::Initialized | State::Ready | State::SingleExecution | State::ContinuousExecution => Ok(()),
        }
    }

    /// To a state without job.
    fn leave(&mut self, state: State) -> Action {
        self.state = state;
        if self.job.take().is_some() { Action::AbortCycle } else { Action::None }
    }

    fn reset(&mut self) -> Action {
        let was = self.state;
        let action = self.leave(State::Preoperational);
        self.prepared.fill(true);
        self.settle();
        if was == State::Error { Action::Revive } else { action }
    }

    /// The state without job that belongs to stages and recipes.
    fn settle(&mut self) {
        if self.job.is_none() && !matches!(self.state, State::Halted | State::Error) {
            self.state = match (self.up, self.prepared.contains(&true)) {
                (false, _) => State::Preoperational,
                (true, false) => State::Initialized,
                (true, true) => State::Ready,
            };
        }
    }
}

#[cfg(test)]
#[path = "machine_tests.rs"]
mod tests;
