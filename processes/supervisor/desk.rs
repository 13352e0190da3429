//! The desk at which jobs are taken: between the socket, the control states and the cycles.

use super::protocol::{Answer, RecipeReport, StateReport};
use crate::control::{Action, Event, Machine, Refusal, State};
use crossbeam::channel::Sender;
use files::result::CycleResult;
use serde_json::json;

/// Longest name of a part, bytes: it stands in a request of at most 4 kB and in every result.
const MAX_PART: usize = 256;

/// Jobs and who waits for them.
pub(super) struct Desk {
    machine: Machine,
    recipes: Vec<String>,
    serves: bool,
    reason: Option<String>,
    job: Option<Job>,
}

/// What the cell works on.
struct Job {
    recipe: usize,
    part: Option<String>,
    waits: Option<Sender<Answer>>,
}

impl Desk {
    /// `serves`: takes jobs; otherwise it only follows a run that goes on by itself.
    pub(super) fn new(recipes: Vec<String>, serves: bool) -> Self {
        Self { machine: Machine::new(recipes.len()), recipes, serves, reason: None, job: None }
    }

    /// Whether jobs are taken.
    pub(super) fn serves(&self) -> bool {
        self.serves
    }

    /// Where the cell is.
    pub(super) fn state(&self) -> State {
        self.machine.state()
    }

    /// Why it is in error.
    pub(super) fn reason(&self) -> Option<String> {
        self.reason.clone()
    }

    /// The recipe of the cycle that starts.
    pub(super) fn recipe(&self) -> usize {
        self.job.as_ref().map_or(0, |job| job.recipe)
    }

    /// Something happened to the stages.
    pub(super) fn stages(&mut self, event: Event) {
        // The machine accepts these in every state and asks for nothing.
        let _ = self.machine.handle(event);
        if event == Event::StagesUp && !self.serves && self.machine.state() == State::Ready {
            let _ = self.machine.handle(Event::StartContinuous { recipe: 0, cycles: None });
        }
    }

    /// A stage was given up.
    pub(super) fn fault(&mut self, reason: &str) -> Action {
        self.reason = Some(reason.to_owned());
        self.machine.handle(Event::Fault).unwrap_or(Action::None)
    }

    /// Inspects a part; the answer comes with the result, unless it is refused here.
    pub(super) fn inspect(&mut self, part: String, recipe: Option<&str>, reply: Sender<Answer>) -> Action {
        let started = self.check(Some(&part)).and_then(|()| self.number(recipe)).and_then(|recipe| {
            let action = self.handle(Event::StartSingle { recipe })?;
            Ok((recipe, action))
        });
        match started {
            Ok((recipe, action)) => {
                self.job = Some(Job { recipe, part: Some(part), waits: Some(reply) });
                action
            }
            Err(answer) => {
                // A client that went away needs no answer.
                let _ = reply.send(answer);
                Action::None
            }
        }
    }

    /// Inspects part after part.
    pub(super) fn start(&mut self, recipe: Option<&str>, cycles: Option<u64>) -> (Action, Answer) {
        let started = self.check(None).and_then(|()| self.number(recipe)).and_then(|recipe| {
            if cycles == Some(0) {
                return Err(Answer::Refused("cycles: 0 is nothing to do; 1 at least".into()));
            }
            let action = self.handle(Event::StartContinuous { recipe, cycles })?;
            self.job = Some(Job { recipe, part: None, waits: None });
            Ok((action, Answer::Done(format!("started with recipe \"{}\"", self.recipes[recipe]))))
        });
        started.unwrap_or_else(|answer| (Action::None, answer))
    }

    /// Does what needs no more than the machine.
    pub(super) fn simply(&mut self, event: Event, done: &str) -> (Action, Answer) {
        let handled = self.check(None).and_then(|()| self.handle(event));
        match handled {
            Ok(action) => {
                if event == Event::Reset {
                    self.reason = None;
                }
                (action, Answer::Done(done.to_owned()))
            }
            Err(answer) => (Action::None, answer),
        }
    }

    /// Makes a recipe selectable, or not.
    pub(super) fn select(&mut self, recipe: &str, prepare: bool) -> Answer {
        let changed = self.check(None).and_then(|()| self.number(Some(recipe))).and_then(|recipe| {
            self.handle(if prepare { Event::Prepare { recipe } } else { Event::Unprepare { recipe } })
        });
        let word = if prepare { "prepared" } else { "no longer prepared" };
        changed.map_or_else(|answer| answer, |_| Answer::Done(format!("recipe \"{recipe}\" is {word}")))
    }

    /// Marks a result with the recipe and the part of its job.
    pub(super) fn mark(&self, result: &mut CycleResult) {
        result.more.insert("recipe".into(), json!(self.recipes[self.recipe()]));
        if let Some(part) = self.job.as_ref().and_then(|job| job.part.as_ref()) {
            result.more.insert("part".into(), json!(part));
        }
    }

    /// A cycle has its outcome, and its files are written: who waits gets it, and the next one may start.
    pub(super) fn concluded(&mut self, result: &CycleResult) -> Action {
        if let Some(reply) = self.job.as_mut().and_then(|job| job.waits.take()) {
            // A client that went away needs no answer; the result is written all the same.
            let _ = reply.send(Answer::Inspected(Box::new(result.clone())));
        }
        if !self.serves {
            return Action::None;
        }
        let action = self.machine.handle(Event::CycleDone).unwrap_or(Action::None);
        if action == Action::None {
            self.job = None;
        }
        action
    }

    /// In which state the cell is.
    pub(super) fn report(&self) -> StateReport {
        let recipes = self.recipes.iter().enumerate();
        StateReport {
            state: self.machine.state(),
            reason: self.reason(),
            serves: self.serves,
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
            let reason =
                "the cell runs its cycles by itself; start it with `fringecell run --serve` to give it jobs";
            return Err(Answer::Refused(reason.into()));
        }
        match part {
            Some(part) if part.is_empty() || part.len() > MAX_PART || part.chars().any(char::is_control) => {
                let reason = format!("part {part:?}: 1 to {MAX_PART} bytes of printable text are allowed");
                Err(Answer::Refused(reason))
            }
            _ => Ok(()),
        }
    }

    fn number(&self, recipe: Option<&str>) -> Result<usize, Answer> {
        let Some(name) = recipe else { return Ok(0) };
        self.recipes.iter().position(|known| known == name).ok_or_else(|| {
            Answer::Refused(format!("no recipe \"{name}\"; there are {}", self.recipes.join(", ")))
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
                format!("{refusal}: part {part:?} is being inspected")
            }
            _ => refusal.to_string(),
        };
        if refusal.is_passing() {
            Answer::NotReady { state, reason }
        } else {
            Answer::Refused(format!("{state:?}: {reason}"))
        }
    }
}
