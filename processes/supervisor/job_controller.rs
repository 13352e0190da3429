//! The job controller: connects command socket, control states and cycles.

use super::command_socket::STOPPED;
use super::protocol::{Answer, RecipeReport, StateReport};
use crate::control::{Action, Event, Machine, Refusal, State};
use crossbeam::channel::Sender;
use files::result::CycleResult;

/// Longest name of a part, bytes.
const MAX_PART: usize = 256;

/// The current job and the state machine of the cell.
pub(super) struct JobController {
    machine: Machine,
    recipes: Vec<String>,
    serves: bool,
    reason: Option<String>,
    job: Option<Job>,
    /// Jobs that were started.
    started: u64,
    /// Resets that were done.
    resets: u64,
}

/// The job that is running.
struct Job {
    number: u64,
    recipe: usize,
    part: Option<String>,
    reply: Option<Sender<Answer>>,
}

impl JobController {
    /// `serves`: accepts jobs; otherwise the run starts its cycles by itself.
    pub(super) fn new(recipes: Vec<String>, serves: bool) -> Self {
        Self {
            machine: Machine::new(recipes.len()),
            recipes,
            serves,
            reason: None,
            job: None,
            started: 0,
            resets: 0,
        }
    }

    /// Whether jobs are accepted.
    pub(super) fn serves(&self) -> bool {
        self.serves
    }

    /// State of the cell.
    pub(super) fn state(&self) -> State {
        self.machine.state()
    }

    /// Reason of the error state.
    pub(super) fn reason(&self) -> Option<String> {
        self.reason.clone()
    }

    /// Index of the recipe of the current job.
    pub(super) fn recipe(&self) -> usize {
        self.job.as_ref().map_or(0, |job| job.recipe)
    }

    /// Number of the current job; 0 without one.
    pub(super) fn job(&self) -> u64 {
        self.job.as_ref().map_or(0, |job| job.number)
    }

    /// Handles that all stages are up, or that one is down.
    pub(super) fn stages_changed(&mut self, event: Event) {
        // The machine accepts these events in every state and returns no action.
        let _ = self.machine.handle(event);
        if event == Event::StagesUp && !self.serves && self.machine.state() == State::Ready {
            let _ = self.machine.handle(Event::StartContinuous { recipe: 0, cycles: None });
        }
    }

    /// Handles that a stage failed too often.
    pub(super) fn fault(&mut self, reason: &str) -> Action {
        self.reason = Some(reason.to_owned());
        self.machine.handle(Event::Fault).unwrap_or(Action::None)
    }

    /// Starts the inspection of a part. The answer follows with the result, unless the request is refused.
    pub(super) fn inspect(&mut self, part: String, recipe: Option<&str>, reply: &Sender<Answer>) -> Action {
        match self.single(part, recipe, Some(reply.clone())) {
            Ok(action) => action,
            Err(answer) => {
                // The client may have disconnected.
                let _ = reply.send(answer);
                Action::None
            }
        }
    }

    /// Starts a job whose results are told to who watches: of one part, or of part after part.
    pub(super) fn begin(&mut self, part: Option<String>, recipe: Option<&str>) -> (Action, Answer) {
        let started = match part {
            Some(part) => self.single(part, recipe, None),
            None => self.continuous(recipe, None).map(|(action, _recipe)| action),
        };
        match started {
            Ok(action) => (action, Answer::Begun { job: self.started }),
            Err(answer) => (Action::None, answer),
        }
    }

    fn single(
        &mut self,
        part: String,
        recipe: Option<&str>,
        reply: Option<Sender<Answer>>,
    ) -> Result<Action, Answer> {
        self.check(Some(&part))?;
        let recipe = self.number(recipe)?;
        let action = self.handle(Event::StartSingle { recipe })?;
        self.started += 1;
        self.job = Some(Job { number: self.started, recipe, part: Some(part), reply });
        Ok(action)
    }

    fn continuous(&mut self, recipe: Option<&str>, cycles: Option<u64>) -> Result<(Action, usize), Answer> {
        self.check(None)?;
        let recipe = self.number(recipe)?;
        if cycles == Some(0) {
            return Err(Answer::Refused("cycles: 0 is not allowed; the minimum is 1".into()));
        }
        let action = self.handle(Event::StartContinuous { recipe, cycles })?;
        self.started += 1;
        self.job = Some(Job { number: self.started, recipe, part: None, reply: None });
        Ok((action, recipe))
    }

    /// Starts the inspection of part after part.
    pub(super) fn start(&mut self, recipe: Option<&str>, cycles: Option<u64>) -> (Action, Answer) {
        match self.continuous(recipe, cycles) {
            Ok((action, recipe)) => {
                (action, Answer::Done(format!("started with recipe \"{}\"", self.recipes[recipe])))
            }
            Err(answer) => (Action::None, answer),
        }
    }

    /// Handles a request that only changes the state.
    pub(super) fn change_state(&mut self, event: Event, done: &str) -> (Action, Answer) {
        let handled = self.check(None).and_then(|()| self.handle(event));
        match handled {
            Ok(action) => {
                if event == Event::Reset {
                    self.reason = None;
                    self.resets += 1;
                }
                (action, Answer::Done(done.to_owned()))
            }
            Err(answer) => (Action::None, answer),
        }
    }

    /// Prepares or unprepares a recipe.
    pub(super) fn select(&mut self, recipe: &str, prepare: bool) -> Answer {
        let changed = self.check(None).and_then(|()| self.number(Some(recipe))).and_then(|recipe| {
            self.handle(if prepare { Event::Prepare { recipe } } else { Event::Unprepare { recipe } })
        });
        let word = if prepare { "prepared" } else { "no longer prepared" };
        changed.map_or_else(|answer| answer, |_| Answer::Done(format!("recipe \"{recipe}\" is {word}")))
    }

    /// Adds recipe and part of the job to a result.
    pub(super) fn annotate(&self, result: &mut CycleResult) {
        result.recipe = Some(self.recipes[self.recipe()].clone());
        result.part = self.job.as_ref().and_then(|job| job.part.clone());
    }

    /// The client that waits for the result of the current job.
    pub(super) fn take_reply(&mut self) -> Option<Sender<Answer>> {
        self.job.as_mut().and_then(|job| job.reply.take())
    }

    /// Handles the end of a cycle; may start the next one.
    pub(super) fn cycle_ended(&mut self) -> Action {
        if !self.serves {
            return Action::None;
        }
        let action = self.machine.handle(Event::CycleDone).unwrap_or(Action::None);
        if action == Action::None {
            self.job = None;
        }
        action
    }

    /// Answers the client that waits for a job that will not end any more.
    pub(super) fn close(&mut self) {
        if let Some(reply) = self.take_reply() {
            let _ = reply.send(Answer::Refused(STOPPED.into()));
        }
    }

    /// State, job and recipes of the cell.
    pub(super) fn report(&self) -> StateReport {
        let recipes = self.recipes.iter().enumerate();
        StateReport {
            state: self.machine.state(),
            reason: self.reason(),
            serves: self.serves,
            job: self.job.as_ref().map(|job| job.number),
            resets: self.resets,
            part: self.job.as_ref().and_then(|job| job.part.clone()),
            recipe: self.job.as_ref().map(|job| self.recipes[job.recipe].clone()),
            recipes: recipes
                .map(|(number, name)| RecipeReport {
                    name: name.clone(),
                    prepared: self.machine.is_prepared(number),
                })
                .collect(),
        }
    }

    fn check(&self, part: Option<&str>) -> Result<(), Answer> {
        if !self.serves {
            let reason = "this cell accepts no jobs; start it with `fringecell run --serve`";
            return Err(Answer::Refused(reason.into()));
        }
        match part {
            Some(part) if part.is_empty() || part.len() > MAX_PART || !fringe::text::is_printable(part) => {
                let reason = format!("part {part:?}: must be 1 to {MAX_PART} bytes of printable text");
                Err(Answer::Refused(reason))
            }
            _ => Ok(()),
        }
    }

    fn number(&self, recipe: Option<&str>) -> Result<usize, Answer> {
        let Some(name) = recipe else { return Ok(0) };
        self.recipes.iter().position(|known| known == name).ok_or_else(|| {
            Answer::Refused(format!("no recipe \"{name}\"; known recipes: {}", self.recipes.join(", ")))
        })
    }

    fn handle(&mut self, event: Event) -> Result<Action, Answer> {
        self.machine.handle(event).map_err(|refusal| self.refuse(refusal))
    }

    fn refuse(&self, refusal: Refusal) -> Answer {
        let state = self.machine.state();
        let reason = match (&self.reason, &self.job) {
            (Some(reason), _) if state == State::Error => format!("{refusal}: {reason}"),
            (_, Some(Job { part: Some(part), .. })) if refusal == Refusal::Busy => {
                format!("{refusal}: part {part:?}")
            }
            _ => refusal.to_string(),
        };
        if refusal.is_temporary() {
            Answer::NotReady { state, reason }
        } else {
            Answer::Refused(format!("{state:?}: {reason}"))
        }
    }
}
