//! Control state machine of a cell: takes an event, returns an action or a refusal. Pure.
//!
//! It follows OPC 40100-1, VisionStateMachineType with its automatic mode. Differences:
//! - A cell initialises itself: once all stages are up, Preoperational becomes Initialized, and Ready as soon as a recipe is
//!   prepared. The method SelectModeAutomatic does not exist.
//! - While a stage is restarted the cell is Preoperational. A single job ends first, since the loss of a stage ends its cycle;
//!   a continuous job waits for the stage and continues.
//! - Error means that a stage failed too often. The reason is kept until the reset.

use serde::{Deserialize, Serialize};

/// State of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum State {
    /// Stages are starting or restarting.
    Preoperational,
    /// All stages are up, no recipe is prepared.
    Initialized,
    /// Ready for a job.
    Ready,
    /// A job of one cycle is running.
    SingleExecution,
    /// Inspects one part after another.
    ContinuousExecution,
    /// Halted by an operator until the next reset.
    Halted,
    /// A stage failed too often; waits for a reset.
    Error,
}

/// Events of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// All stages are up and connected.
    StagesUp,
    /// A stage is down and will be restarted.
    StagesDown,
    /// A stage failed too often.
    Fault,
    /// The cycle of the current job has its outcome.
    CycleDone,
    /// Make a recipe selectable.
    Prepare {
        /// Index of the recipe.
        recipe: usize,
    },
    /// Make a recipe not selectable.
    Unprepare {
        /// Index of the recipe.
        recipe: usize,
    },
    /// Start a job of one cycle.
    StartSingle {
        /// Index of the recipe.
        recipe: usize,
    },
    /// Inspect part after part.
    StartContinuous {
        /// Index of the recipe.
        recipe: usize,
        /// Number of cycles; `None`: until `Finish`.
        cycles: Option<u64>,
    },
    /// End the continuous job after the current cycle (OPC: Stop).
    Finish,
    /// End the job and its cycle now.
    Abort,
    /// Stop until the next reset.
    Halt,
    /// Leave halted and error, end any job.
    Reset,
}

/// Action for the supervisor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Nothing has to be done.
    None,
    /// Start a cycle with this recipe.
    StartCycle {
        /// Index of the recipe.
        recipe: usize,
    },
    /// End the current cycle.
    AbortCycle,
    /// Start the stages that failed too often.
    Revive,
}

/// Why a request is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// Stages are still starting.
    #[error("the stages are starting")]
    Starting,
    /// A job is running.
    #[error("a job is running")]
    Busy,
    /// No job is running.
    #[error("no job is running")]
    Idle,
    /// The cell is halted.
    #[error("the cell is halted; reset it first")]
    Halted,
    /// The cell is in error.
    #[error("the cell is in error; remove the cause, then reset it")]
    Error,
    /// The recipe is not prepared.
    #[error("the recipe is not prepared")]
    NotPrepared,
    /// The running job uses the recipe.
    #[error("the running job uses the recipe")]
    InUse,
}

impl Refusal {
    /// Whether the same request may succeed later.
    pub fn is_temporary(self) -> bool {
        matches!(self, Self::Starting | Self::Busy)
    }
}

/// The job that is running.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Job {
    recipe: usize,
    /// Number of cycles still to start; `None`: until `Finish`.
    left: Option<u64>,
}

/// The control state machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Machine {
    state: State,
    up: bool,
    prepared: Vec<bool>,
    job: Option<Job>,
}

impl Machine {
    /// A machine whose stages are down and whose recipes are all prepared.
    pub fn new(recipes: usize) -> Self {
        Self { state: State::Preoperational, up: false, prepared: vec![true; recipes], job: None }
    }

    /// The current state of the cell.
    pub fn state(&self) -> State {
        self.state
    }

    /// Whether a recipe can be selected.
    pub fn is_prepared(&self, recipe: usize) -> bool {
        self.prepared.get(recipe).copied().unwrap_or(false)
    }

    /// Handles an event.
    ///
    /// # Errors
    /// The event is refused; the state is unchanged.
    pub fn handle(&mut self, event: Event) -> Result<Action, Refusal> {
        match event {
            Event::StagesUp => Ok(self.stages(true)),
            Event::StagesDown => Ok(self.stages(false)),
            Event::Fault => {
                self.up = false;
                Ok(self.end_job(State::Error))
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
            Event::Halt => Ok(self.end_job(State::Halted)),
            Event::Reset => Ok(self.reset()),
        }
    }

    fn stages(&mut self, up: bool) -> Action {
        self.up = up;
        self.update_idle_state();
        Action::None
    }

    /// Ends a single job; continues a continuous one until all its cycles are done.
    fn cycle_done(&mut self) -> Action {
        let Some(job) = &mut self.job else { return Action::None };
        if job.left != Some(0) {
            job.left = job.left.map(|left| left - 1);
            return Action::StartCycle { recipe: job.recipe };
        }
        self.job = None;
        self.update_idle_state();
        Action::None
    }

    fn prepare(&mut self, recipe: usize) -> Result<Action, Refusal> {
        self.operational()?;
        *self.prepared.get_mut(recipe).ok_or(Refusal::NotPrepared)? = true;
        self.update_idle_state();
        Ok(Action::None)
    }

    fn unprepare(&mut self, recipe: usize) -> Result<Action, Refusal> {
        self.operational()?;
        if self.job.is_some_and(|job| job.recipe == recipe) {
            return Err(Refusal::InUse);
        }
        *self.prepared.get_mut(recipe).ok_or(Refusal::NotPrepared)? = false;
        self.update_idle_state();
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

    /// Changes to a state without a job.
    fn end_job(&mut self, state: State) -> Action {
        self.state = state;
        if self.job.take().is_some() { Action::AbortCycle } else { Action::None }
    }

    fn reset(&mut self) -> Action {
        let was = self.state;
        let action = self.end_job(State::Preoperational);
        self.prepared.fill(true);
        self.update_idle_state();
        if was == State::Error { Action::Revive } else { action }
    }

    /// Updates the state without a job to stages and recipes.
    fn update_idle_state(&mut self) {
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
