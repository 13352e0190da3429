//! What is said over the socket of a cell; `docs/control.md` is its documentation.

use super::profile::{Outcomes, Percentiles};
use crate::control::State;
use files::result::{CycleResult, StageResult};
use files::trace::TraceCycle;
use serde::{Deserialize, Serialize};

/// What a cell is asked.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "command", rename_all = "lowercase", deny_unknown_fields)]
pub enum Request {
    /// How it is.
    Status {},
    /// The same in the Prometheus text format.
    Metrics {},
    /// When the activations of the last cycles were done.
    Spans {},
    /// Kill a stage and start it again.
    Restart {
        /// Name in the schedule.
        stage: String,
    },
    /// End the run.
    Stop {},
    /// In which state it is, and which recipes it has.
    State {},
    /// Inspect one part and answer with the result of its cycle.
    Inspect {
        /// Which part.
        part: String,
        /// How it is inspected; absent: the first recipe.
        recipe: Option<String>,
    },
    /// Inspect part after part.
    Start {
        /// How; absent: the first recipe.
        recipe: Option<String>,
        /// How many; absent: until asked to finish.
        cycles: Option<u64>,
    },
    /// End the continuous job after the cycle that runs.
    Finish {},
    /// End the job and its cycle now.
    Abort {},
    /// Stop until the next reset.
    Halt {},
    /// Begin anew after halt or error.
    Reset {},
    /// Make a recipe selectable.
    Prepare {
        /// Which.
        recipe: String,
    },
    /// Make a recipe not selectable.
    Unprepare {
        /// Which.
        recipe: String,
    },
}

/// What a cell answers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// How it is.
    Status(Box<Status>),
    /// In the Prometheus text format.
    Metrics(String),
    /// What was done when.
    Spans(Spans),
    /// In which state it is.
    State(StateReport),
    /// The result of the cycle.
    Inspected(Box<CycleResult>),
    /// Done.
    Done(String),
    /// Not done, and why. Asking again does not help.
    Refused(String),
    /// Not done now; it may be later without anybody doing anything.
    NotReady {
        /// Where the cell is.
        state: State,
        /// Why not.
        reason: String,
    },
}

/// In which state a cell is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StateReport {
    /// As in OPC 40100-1.
    pub state: State,
    /// Why it is in error.
    pub reason: Option<String>,
    /// Whether it takes jobs: `run --serve`.
    pub serves: bool,
    /// The part that is being inspected.
    pub part: Option<String>,
    /// The recipe of the job that runs.
    pub recipe: Option<String>,
    /// All recipes, the first one being used where none is named.
    pub recipes: Vec<RecipeReport>,
}

/// A recipe of a cell.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecipeReport {
    /// Name.
    pub name: String,
    /// Whether it can be selected.
    pub prepared: bool,
}

/// What was done in the last cycles.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Spans {
    /// Every piece of work.
    pub activations: Vec<SpanRow>,
    /// The cycles from start to outcome.
    pub cycles: Vec<TraceCycle>,
}

/// One activation as it was done.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SpanRow {
    /// Stage.
    pub stage: String,
    /// What was done.
    pub name: String,
    /// Cycle.
    pub cycle: u64,
    /// Waiting before, ns.
    pub wait_ns: u64,
    /// Start on the machine's monotonic clock, ns.
    pub start_ns: u64,
    /// End, ns.
    pub end_ns: u64,
    /// Handing over, part of the time between start and end, ns.
    pub send_ns: u64,
}

/// How a cell is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Name.
    pub cell: String,
    /// Process of the supervisor.
    pub pid: u32,
    /// As in OPC 40100-1.
    pub state: State,
    /// Why it is in error.
    pub reason: Option<String>,
    /// The cycle that runs; of several in flight the oldest.
    pub cycle: Option<u64>,
    /// All cycles in flight, the oldest first.
    pub running: Vec<u64>,
    /// Cycles with an outcome.
    pub cycles_done: u64,
    /// Of these, ok.
    pub cycles_ok: u64,
    /// Cycles asked for; absent: until stopped.
    pub cycles_requested: Option<u64>,
    /// Of the last cycles; absent before the second one.
    pub cycles_per_minute: Option<f64>,
    /// Cycles by what became of them.
    pub outcomes: Outcomes,
    /// Cycles that were not done within their deadline.
    pub deadline_misses: u64,
    /// From start to outcome, of the last cycles that were ok.
    pub cycle_time: Percentiles,
    /// From the last frame to the verdict, of the same.
    pub latency: Percentiles,
    /// The last cycle that was not ok, and why.
    pub last_failure: Option<(u64, String)>,
    /// In the order of the schedule.
    pub stages: Vec<StageStatus>,
}

/// How a stage is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageStatus {
    /// Name.
    pub name: String,
    /// Process, while there is one.
    pub pid: Option<u32>,
    /// `up`, `starting`, …
    pub state: String,
    /// Failures since the start of the cell.
    pub restarts: u32,
    /// Since it last said anything, ms.
    pub silent_ms: u64,
    /// Cycles that `total` is the sum of.
    pub cycles: u64,
    /// Waiting for input, per cycle.
    pub wait: Percentiles,
    /// Computing, per cycle.
    pub compute: Percentiles,
    /// Handing outputs over, per cycle.
    pub send: Percentiles,
    /// What it did and used since the start of the cell.
    pub total: StageResult,
}
