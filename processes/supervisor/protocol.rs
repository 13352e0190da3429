//! Requests and answers of the command socket; documented in `docs/control.md`.

use super::profile::{Outcomes, Percentiles};
use crate::control::State;
use devices::CameraState;
use files::result::{CycleResult, StageResult};
use files::trace::TraceCycle;
use metrology::inspection::FeatureResult;
use metrology::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// A request to a cell.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "command", rename_all = "lowercase", deny_unknown_fields)]
pub enum Request {
    /// Stages, rate, percentiles and outcomes.
    Status {},
    /// Metrics in the Prometheus text format.
    Metrics {},
    /// Times of the activations of the last cycles.
    Spans {},
    /// Kill a stage and start it again.
    Restart {
        /// Name of the stage.
        stage: String,
    },
    /// End the run of the cell.
    Stop {},
    /// State, current job and recipes.
    State {},
    /// Inspect one part; the answer is the result of the cycle.
    Inspect {
        /// Identification of the part.
        part: String,
        /// Name of the recipe; absent: the first one.
        recipe: Option<String>,
    },
    /// Inspect part after part.
    Start {
        /// Name of the recipe; absent: the first one.
        recipe: Option<String>,
        /// Number of cycles; absent: until `finish`.
        cycles: Option<u64>,
    },
    /// Start a job and answer at once with its number; the results are told to who watches.
    Begin {
        /// Identification of the one part to inspect; absent: part after part until `finish`.
        part: Option<String>,
        /// Name of the recipe; absent: the first one.
        recipe: Option<String>,
    },
    /// What has happened since a change, at once or as soon as there is something.
    Watch {
        /// The run that the change belongs to; another one, or none: from the oldest change that is kept.
        run: Option<String>,
        /// Number of the last change that is known.
        #[serde(default)]
        after: u64,
        /// Whether to wait for something to happen; `false`: the answer comes at once and may have no changes.
        #[serde(default = "waits")]
        wait: bool,
    },
    /// End the continuous job after the current cycle.
    Finish {},
    /// End the job and its cycle now.
    Abort {},
    /// Stop until the next reset.
    Halt {},
    /// Leave the states halted and error.
    Reset {},
    /// Make a recipe selectable.
    Prepare {
        /// Name of the recipe.
        recipe: String,
    },
    /// Make a recipe not selectable.
    Unprepare {
        /// Name of the recipe.
        recipe: String,
    },
}

/// Who watches waits, unless the request says otherwise.
const fn waits() -> bool {
    true
}

/// An answer of a cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// Stages, rate, percentiles and outcomes.
    Status(Box<Status>),
    /// Metrics in the Prometheus text format.
    Metrics(String),
    /// Times of the activations of the last cycles.
    Spans(Spans),
    /// State, current job and recipes.
    State(Box<StateReport>),
    /// The result of the cycle of an inspection.
    Inspected(Box<CycleResult>),
    /// A job has started.
    Begun {
        /// Number of the job in this run, from 1.
        job: u64,
    },
    /// What has happened, in its order.
    Watched(Box<Watched>),
    /// The request was carried out.
    Done(String),
    /// The request is refused, with the reason; a retry does not help.
    Refused(String),
    /// The request is not possible now; retry later.
    NotReady {
        /// State of the cell.
        state: State,
        /// The reason, for the user.
        reason: String,
    },
}

/// What has happened in a cell, in its order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Watched {
    /// Identification of the run: numbers of changes, jobs and cycles begin anew with each run.
    pub run: String,
    /// Number of the oldest change that is kept.
    pub oldest: u64,
    /// Number of the newest change; 0 before the first one.
    pub newest: u64,
    /// Changes after the one that was named, without a gap unless `oldest` tells one.
    pub changes: Vec<Change>,
}

/// One thing that has happened.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// From 1 in each run.
    pub number: u64,
    /// A state or a result.
    #[serde(flatten)]
    pub what: What,
}

/// A new state, or the result of a cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// State, job or recipes are others.
    State(StateReport),
    /// A cycle has its outcome, and its files are written.
    Result {
        /// Number of the job; 0 in a cell that takes no jobs.
        job: u64,
        /// As `result.json`, without times of the stages.
        result: Box<CycleResult>,
    },
}

/// State, current job and recipes of a cell.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StateReport {
    /// State, as in OPC 40100-1.
    pub state: State,
    /// Reason of the state `Error`.
    pub reason: Option<String>,
    /// Whether the cell accepts jobs (`run --serve`).
    pub serves: bool,
    /// Number of the current job, from 1 in each run.
    #[serde(default)]
    pub job: Option<u64>,
    /// How often the cell was reset in this run.
    #[serde(default)]
    pub resets: u64,
    /// The part of the current job.
    pub part: Option<String>,
    /// The recipe of the current job.
    pub recipe: Option<String>,
    /// All recipes; the first one is the default.
    pub recipes: Vec<RecipeReport>,
}

/// State of a recipe.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecipeReport {
    /// Name of the recipe.
    pub name: String,
    /// Whether it can be selected.
    pub prepared: bool,
}

/// Times of the last cycles and their activations.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Spans {
    /// Activations, in the order of the outcomes.
    pub activations: Vec<SpanRow>,
    /// Cycles, from start to outcome.
    pub cycles: Vec<TraceCycle>,
}

/// Times of one activation.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SpanRow {
    /// Name of the stage.
    pub stage: String,
    /// Label of the activation.
    pub name: String,
    /// Cycle, counted from 0.
    pub cycle: u64,
    /// Waiting before the start, ns.
    pub wait_ns: u64,
    /// Start on the machine's monotonic clock, ns.
    pub start_ns: u64,
    /// End on the machine's monotonic clock, ns.
    pub end_ns: u64,
    /// Sending, part of the time between start and end, ns.
    pub send_ns: u64,
}

/// Status of a cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Name of the cell.
    pub cell: String,
    /// Process id of the supervisor.
    pub pid: u32,
    /// State, as in OPC 40100-1.
    pub state: State,
    /// Reason of the state `Error`.
    pub reason: Option<String>,
    /// The oldest cycle in progress, counted from 0.
    pub cycle: Option<u64>,
    /// All cycles in progress, the oldest first.
    pub running: Vec<u64>,
    /// Number of cycles with an outcome.
    pub cycles_done: u64,
    /// Number of cycles that are ok.
    pub cycles_ok: u64,
    /// Number of cycles requested; absent: until stopped.
    pub cycles_requested: Option<u64>,
    /// Rate of the last cycles; absent before the second one.
    pub cycles_per_minute: Option<f64>,
    /// Number of cycles by outcome.
    pub outcomes: Outcomes,
    /// Number of cycles that exceeded their deadline.
    pub deadline_misses: u64,
    /// Duration from start to outcome, of the last cycles that are ok.
    pub cycle_time: Percentiles,
    /// Duration from the last frame to the verdict, of the same cycles.
    pub latency: Percentiles,
    /// The last cycle that is not ok, counted from 0, and the reason.
    pub last_failure: Option<(u64, String)>,
    /// Identification of the part in progress, as the job names it.
    #[serde(default)]
    pub part: Option<String>,
    /// Recipe of the job in progress.
    #[serde(default)]
    pub recipe: Option<String>,
    /// The last cycle with an outcome.
    #[serde(default)]
    pub last: Option<LastPart>,
    /// Status of the stages, in the order of the schedule.
    pub stages: Vec<StageStatus>,
    /// What cameras told of themselves at the end of the last cycle that they completed, by name; those that tell nothing are absent.
    #[serde(default)]
    pub cameras: Vec<CameraStatus>,
}

/// What a camera told of itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraStatus {
    /// Name of the camera.
    pub name: String,
    /// Its temperature and its link.
    #[serde(flatten)]
    pub state: CameraState,
}

/// What the last cycle found.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LastPart {
    /// Number of the cycle, from 1.
    pub number: u64,
    /// Identification of the part, as the job named it.
    pub part: Option<String>,
    /// Recipe of the inspection.
    pub recipe: Option<String>,
    /// `ok` or the reason.
    pub outcome: String,
    /// Over all features; absent when nothing was evaluated.
    pub verdict: Option<Verdict>,
    /// In the order of the inspection plan.
    pub features: Vec<FeatureResult>,
}

impl LastPart {
    /// What status and metrics show of a result.
    pub fn of(result: &CycleResult) -> Self {
        Self {
            number: result.number,
            part: result.part.clone(),
            recipe: result.recipe.clone(),
            outcome: result.outcome.clone(),
            verdict: result.verdict,
            features: result.features.clone(),
        }
    }
}

/// Status of a stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageStatus {
    /// Name of the stage.
    pub name: String,
    /// Process id, while the process exists.
    pub pid: Option<u32>,
    /// State of the process: `starting`, `up`, `waiting to restart`, `held` (failed too often) or `ended`.
    pub state: String,
    /// Number of restarts since the start of the cell, requested ones included.
    pub restarts: u32,
    /// Time since its last message, ms.
    pub silent_ms: u64,
    /// Number of cycles in `total`.
    pub cycles: u64,
    /// Waiting for input, per cycle.
    pub wait: Percentiles,
    /// Computing time, one duration per cycle.
    pub compute: Percentiles,
    /// Sending outputs, per cycle.
    pub send: Percentiles,
    /// Work and resource use since the start of the cell.
    pub total: StageResult,
}
