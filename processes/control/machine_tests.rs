//! Every state against every event, and what must hold after any sequence of events.

use super::*;
use Action::{AbortCycle, None as Nothing, Revive};
use State::{ContinuousExecution, Error, Halted, Initialized, Preoperational, Ready, SingleExecution};
use proptest::prelude::*;

const STATES: [State; 7] =
    [Preoperational, Initialized, Ready, SingleExecution, ContinuousExecution, Halted, Error];

const START: Action = Action::StartCycle { recipe: 0 };

fn after(events: &[Event]) -> Machine {
    let mut machine = Machine::new(2);
    for &event in events {
        machine.handle(event).unwrap();
    }
    machine
}

/// A machine in a state, reached by events alone; stages are up where the state allows it.
fn machine_in(state: State) -> Machine {
    let up = Event::StagesUp;
    let machine = match state {
        Preoperational => after(&[]),
        Initialized => after(&[up, Event::Unprepare { recipe: 0 }, Event::Unprepare { recipe: 1 }]),
        Ready => after(&[up]),
        SingleExecution => after(&[up, Event::StartSingle { recipe: 0 }]),
        ContinuousExecution => after(&[up, Event::StartContinuous { recipe: 0, cycles: None }]),
        Halted => after(&[up, Event::Halt]),
        Error => after(&[up, Event::Fault]),
    };
    assert_eq!(machine.state(), state);
    machine
}

/// What each state makes of an event: the next state and the action, or the refusal.
type Row = [Result<(State, Action), Refusal>; 7];

/// A cell of the table: this state, nothing to do.
#[allow(clippy::unnecessary_wraps)] // the other cells are refusals
fn to(state: State) -> Result<(State, Action), Refusal> {
    Ok((state, Nothing))
}

/// The columns: Preoperational, Initialized, Ready, SingleExecution, ContinuousExecution, Halted, Error.
fn table() -> Vec<(Event, Row)> {
    [table_of_the_cell(), table_of_recipes_and_jobs(), table_of_ends()].concat()
}

fn table_of_the_cell() -> Vec<(Event, Row)> {
    let (single, continuous) = (to(SingleExecution), to(ContinuousExecution));
    let (down, again) = (to(Preoperational), Ok((ContinuousExecution, START)));
    vec![
        (Event::StagesUp, [to(Ready), to(Initialized), to(Ready), single, continuous, to(Halted), to(Error)]),
        (Event::StagesDown, [down, down, down, single, continuous, to(Halted), to(Error)]),
        (Event::CycleDone, [down, to(Initialized), to(Ready), to(Ready), again, to(Halted), to(Error)]),
    ]
}

fn table_of_recipes_and_jobs() -> Vec<(Event, Row)> {
    let (starting, halted, error) = (Err(Refusal::Starting), Err(Refusal::Halted), Err(Refusal::Error));
    let (busy, absent, used) = (Err(Refusal::Busy), Err(Refusal::NotPrepared), Err(Refusal::InUse));
    let (single, continuous) = (to(SingleExecution), to(ContinuousExecution));
    let one = Ok((SingleExecution, START));
    let many = Ok((ContinuousExecution, START));
    let start_many = Event::StartContinuous { recipe: 0, cycles: Some(2) };
    vec![
        (Event::Prepare { recipe: 1 }, [starting, to(Ready), to(Ready), single, continuous, halted, error]),
        (Event::Prepare { recipe: 9 }, [starting, absent, absent, absent, absent, halted, error]),
        (
            Event::Unprepare { recipe: 1 },
            [starting, to(Initialized), to(Ready), single, continuous, halted, error],
        ),
        (Event::Unprepare { recipe: 0 }, [starting, to(Initialized), to(Ready), used, used, halted, error]),
        (Event::StartSingle { recipe: 0 }, [starting, absent, one, busy, busy, halted, error]),
        (Event::StartSingle { recipe: 9 }, [starting, absent, absent, busy, busy, halted, error]),
        (start_many, [starting, absent, many, busy, busy, halted, error]),
    ]
}

fn table_of_ends() -> Vec<(Event, Row)> {
    let idle = Err(Refusal::Idle);
    let all = |state| {
        let running = Ok((state, AbortCycle));
        [to(state), to(state), to(state), running, running, to(state), to(state)]
    };
    let (single, continuous) = (to(SingleExecution), to(ContinuousExecution));
    let (end_one, end_many) = (Ok((SingleExecution, AbortCycle)), Ok((ContinuousExecution, AbortCycle)));
    let (anew, revived) = (Ok((Ready, AbortCycle)), Ok((Preoperational, Revive)));
    vec![
        (Event::Fault, all(Error)),
        (Event::Halt, all(Halted)),
        (Event::Finish, [idle, idle, idle, single, continuous, idle, idle]),
        (Event::Abort, [idle, idle, idle, end_one, end_many, idle, idle]),
        (Event::Reset, [to(Preoperational), to(Ready), to(Ready), anew, anew, to(Ready), revived]),
    ]
}

#[test]
fn every_state_answers_every_event_as_the_table_says() {
    for (event, row) in table() {
        for (state, expected) in STATES.into_iter().zip(row) {
            let mut machine = machine_in(state);
            let before = machine.clone();
            let answer = machine.handle(event);
            assert_eq!(answer.map(|action| (machine.state(), action)), expected, "{state:?} × {event:?}");
            if answer.is_err() {
                assert_eq!(machine, before, "a refusal changes nothing: {state:?} × {event:?}");
            }
        }
    }
}

#[test]
fn a_continuous_job_starts_as_many_cycles_as_it_was_asked_for() {
    let mut machine = machine_in(Ready);
    let mut started = 0;
    let mut action = machine.handle(Event::StartContinuous { recipe: 1, cycles: Some(3) }).unwrap();
    while action == (Action::StartCycle { recipe: 1 }) {
        started += 1;
        action = machine.handle(Event::CycleDone).unwrap();
    }
    assert_eq!((started, machine.state()), (3, Ready));
}

#[test]
fn a_job_that_lost_a_stage_ends_preoperational_and_becomes_ready_by_itself() {
    let mut machine = machine_in(SingleExecution);
    machine.handle(Event::StagesDown).unwrap();
    assert_eq!(machine.state(), SingleExecution);
    machine.handle(Event::CycleDone).unwrap();
    assert_eq!(machine.state(), Preoperational);
    machine.handle(Event::StagesUp).unwrap();
    assert_eq!(machine.state(), Ready);
}

fn any_event() -> impl Strategy<Value = Event> {
    let events: Vec<Event> = table().into_iter().map(|(event, _)| event).collect();
    proptest::sample::select(events)
}

proptest! {
    /// Proves: after any sequence, a cycle is started only while none runs, an aborted one was running, and a job runs
    /// exactly in the two execution states.
    #[test]
    fn cycles_never_overlap(events in proptest::collection::vec(any_event(), 1..80)) {
        let mut machine = Machine::new(2);
        let mut running = false;
        for event in events {
            // The supervisor reports an outcome only of a cycle that runs.
            if event == Event::CycleDone {
                if !running { continue; }
                running = false;
            }
            match machine.handle(event) {
                Ok(Action::StartCycle { .. }) => {
                    prop_assert!(!running);
                    running = true;
                }
                Ok(Action::AbortCycle) => {
                    prop_assert!(running);
                    // The supervisor reports the outcome at once, as it does for any cycle.
                    running = false;
                    machine.handle(Event::CycleDone).unwrap();
                }
                Ok(Action::Revive) => prop_assert!(!running),
                Ok(Action::None) | Err(_) => {}
            }
            let executes = matches!(machine.state(), SingleExecution | ContinuousExecution);
            prop_assert_eq!(executes, machine.job.is_some());
            prop_assert_eq!(executes, running);
        }
    }
}
