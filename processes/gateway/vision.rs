//! The cell as the specification sees it: changes of the cell become positions of the state machines, results and events.

use super::events::{Deliveries, VisionEvent};
use super::machine::{Position, Transition, Transitions, state};
use super::names::{self, Identity, JobNames, external_recipe, internal_recipe, named, structure};
use super::results::Results;
use super::types::JobId;
use crate::supervisor::protocol::{Change, Request, StateReport, What};
use files::result::CycleResult;
use opcua::nodes::BaseEventType;
use opcua::types::{DateTime, LocalizedText, NodeId, Variant};
use std::collections::BTreeMap;

/// Jobs whose clients' names are kept.
const KEPT_JOBS: usize = 2000;

/// Numbers of event types in the nodeset.
mod event {
    pub const JOB_STARTED: u32 = 1013;
    pub const STATE_CHANGED: u32 = 1018;
    pub const ERROR: u32 = 1019;
    pub const ERROR_RESOLVED: u32 = 1020;
    pub const RECIPE_PREPARED: u32 = 1022;
    pub const READY: u32 = 1023;
    pub const RESULT_READY: u32 = 1024;
}

/// State, results and events.
pub struct Vision {
    /// What does not change.
    pub identity: Identity,
    transitions: Transitions,
    /// Run of the cell that the numbers belong to.
    pub run: String,
    /// Number of the last change that was applied.
    pub known: u64,
    /// Number of the last change that the nodes show.
    pub shown: u64,
    /// Changes up to this one make no events: a gateway before this one has delivered them.
    pub mark: u64,
    /// Whether the cell answers.
    pub connected: bool,
    /// State, job and recipes of the cell, as it told them last.
    pub report: Option<StateReport>,
    position: Option<Position>,
    /// Method that was accepted and whose transition has not come yet.
    pub cause: Option<&'static str>,
    /// What clients called their jobs.
    pub jobs: BTreeMap<u64, JobNames>,
    /// The last results, for clients that ask.
    pub results: Results,
    /// Events that wait for clients.
    pub deliveries: Deliveries,
}

impl Vision {
    /// Before the cell was reached.
    pub fn new(identity: Identity, transitions: Transitions, deliveries: Deliveries) -> Self {
        Self {
            identity,
            transitions,
            run: String::new(),
            known: 0,
            shown: 0,
            mark: 0,
            connected: false,
            report: None,
            position: None,
            cause: None,
            jobs: BTreeMap::new(),
            results: Results::default(),
            deliveries,
        }
    }

    /// Begins with another run of the cell.
    pub fn begin(&mut self, run: &str, mark: u64) {
        run.clone_into(&mut self.run);
        (self.known, self.shown, self.mark) = (0, 0, mark);
        self.position = None;
        self.cause = None;
        self.jobs.clear();
        self.results = Results::default();
        self.report = None;
        self.deliveries.begin_run();
    }

    /// Whether the nodes show a change of a run.
    pub fn shows(&self, run: &str, change: u64) -> bool {
        self.run == run && self.shown >= change
    }

    /// The request for what is not yet known.
    pub fn news(&self, wait: bool) -> Request {
        Request::Watch { run: Some(self.run.clone()), after: self.known, wait }
    }

    /// State, job and recipes; `None` while the cell cannot be reached.
    pub fn reached(&self) -> Option<&StateReport> {
        self.report.as_ref().filter(|_| self.connected)
    }

    /// Where the state machines are; `None` while the cell cannot be reached.
    pub fn position(&self) -> Option<Position> {
        self.position.filter(|_| self.connected)
    }

    /// Whether a method may be called now; `None` while the cell cannot be reached.
    pub fn permits(&self, method: &str) -> Option<bool> {
        Some(self.transitions.permit(self.position()?, method))
    }

    /// Takes what a client called its job.
    pub fn name_job(&mut self, job: u64, names: JobNames) {
        self.jobs.insert(job, names);
        while self.jobs.len() > KEPT_JOBS {
            self.jobs.pop_first();
        }
    }

    /// Identification of a job.
    pub fn job_id(&self, job: u64) -> JobId {
        names::job_id(&self.run, job)
    }

    /// Applies a change. Returns whether there is a new result.
    pub fn apply(&mut self, change: Change) -> bool {
        let Change { number, what } = change;
        self.known = number;
        match what {
            What::State(report) => {
                self.change_state(number, report);
                false
            }
            What::Result { job, result } => {
                self.add_result(number, job, &result);
                true
            }
        }
    }

    fn change_state(&mut self, number: u64, report: StateReport) {
        let to = Position::of(report.state);
        let was_reset = self.report.as_ref().is_some_and(|last| last.resets != report.resets);
        let cause = if was_reset { Some("Reset") } else { self.cause };
        // A gateway that was started again says how the cell came here from what it knew then.
        let way: Vec<Transition> = match self.position {
            Some(from) if from != to || was_reset => {
                self.transitions.way(from, to, cause).into_iter().cloned().collect()
            }
            _ => Vec::new(),
        };
        if self.position != Some(to) {
            self.cause = None;
        }
        self.position = Some(to);
        let job = report.job.or(self.report.as_ref().and_then(|last| last.job)).unwrap_or(0);
        let prepared = newly_prepared(self.report.as_ref(), &report);
        for transition in &way {
            self.tell(number, transition, job, &report, &prepared);
        }
        self.report = Some(report);
    }

    /// The events of a transition, as the nodeset lists them.
    fn tell(
        &mut self,
        number: u64,
        transition: &Transition,
        job: u64,
        report: &StateReport,
        prepared: &[String],
    ) {
        let mut effects = transition.effects.clone();
        if transition.to == state::ERROR && !effects.contains(&event::ERROR) {
            effects.push(event::ERROR);
        }
        for effect in effects {
            match effect {
                event::STATE_CHANGED | event::ERROR | event::ERROR_RESOLVED => {
                    let severity = if effect == event::ERROR { 900 } else { 300 };
                    let message = match (&report.reason, effect) {
                        (Some(reason), event::ERROR) => reason.clone(),
                        _ => transition.name.clone(),
                    };
                    let fields = self.transition_fields(transition);
                    self.emit(number, effect, severity, &message, fields);
                }
                event::JOB_STARTED | event::READY => {
                    let fields = [("JobId", structure(self.job_id(job)))];
                    let message = if effect == event::READY { "ready" } else { "job started" };
                    self.emit(number, effect, 200, message, named(fields));
                }
                event::RECIPE_PREPARED => {
                    for recipe in prepared {
                        let fields = [
                            ("InternalId", structure(internal_recipe(recipe))),
                            ("ExternalId", structure(external_recipe(recipe))),
                        ];
                        self.emit(
                            number,
                            effect,
                            200,
                            &format!("recipe {recipe} is prepared"),
                            named(fields),
                        );
                    }
                }
                _ => {}
            }
        }
    }

    fn transition_fields(&self, transition: &Transition) -> BTreeMap<String, Variant> {
        let node = |number: u32| Variant::from(NodeId::new(self.identity.standard, number));
        named([
            ("Transition", Variant::from(LocalizedText::new("en", &transition.name))),
            ("Transition/Id", Variant::from(transition.id.clone())),
            ("FromState", Variant::from(LocalizedText::new("en", state_name(transition.from)))),
            ("FromState/Id", node(transition.from)),
            ("ToState", Variant::from(LocalizedText::new("en", state_name(transition.to)))),
            ("ToState/Id", node(transition.to)),
        ])
    }

    fn add_result(&mut self, number: u64, job: u64, result: &CycleResult) {
        let names = self.jobs.get(&job).cloned().unwrap_or_default();
        let data = super::results::data((&self.identity, &self.run), (job, &names), result);
        let part = data.part_id.as_ref().map(|part| part.id.to_string()).unwrap_or_default();
        let message = format!("cycle {} of part {part}: {}", result.number, result.outcome);
        let fields = super::results::fields(&data);
        self.results.add(data);
        self.emit(number, event::RESULT_READY, if result.is_ok() { 200 } else { 500 }, &message, fields);
    }

    fn emit(
        &mut self,
        change: u64,
        kind: u32,
        severity: u16,
        message: &str,
        fields: BTreeMap<String, Variant>,
    ) {
        if change <= self.mark {
            return;
        }
        // The same event has the same identification, also from the next gateway.
        let id = format!("{}-{change}-{kind}-{}", self.run, message.len());
        let base = BaseEventType::new(
            NodeId::new(self.identity.standard, kind),
            id.as_bytes().to_vec().into(),
            LocalizedText::new("en", message),
            DateTime::now(),
        )
        .set_source_node(self.identity.system.clone())
        .set_source_name(self.identity.cell.as_str().into())
        .set_severity(severity);
        self.deliveries.push(VisionEvent { base, standard: self.identity.standard, fields, change });
    }
}

fn newly_prepared(last: Option<&StateReport>, now: &StateReport) -> Vec<String> {
    let was = |name: &str| {
        let known = last.map(|last| last.recipes.iter());
        known.is_some_and(|mut recipes| recipes.any(|recipe| recipe.name == name && recipe.prepared))
    };
    let new = now.recipes.iter().filter(|recipe| recipe.prepared && !was(&recipe.name));
    new.map(|recipe| recipe.name.clone()).collect()
}

/// Name of a state by its number.
pub fn state_name(number: u32) -> &'static str {
    match number {
        state::PREOPERATIONAL => "Preoperational",
        state::HALTED => "Halted",
        state::ERROR => "Error",
        state::OPERATIONAL => "Operational",
        state::INITIALIZED => "Initialized",
        state::READY => "Ready",
        state::SINGLE_EXECUTION => "SingleExecution",
        _ => "ContinuousExecution",
    }
}
