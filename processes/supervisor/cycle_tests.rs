//! Exactly one outcome per requested cycle, whatever happens; and the right one where the reason is plain.

use super::*;
use cell::schedule::Half;
use proptest::prelude::*;

const MS: u64 = 1_000_000;

/// Two stages feed a third: 0 and 1 are sources of the acquisition, 2 and 3 belong to stage 2, the evaluation.
fn machine(requested: Option<u64>) -> Cycles {
    overlapping(1, requested)
}

/// The same with so many cycles in flight.
fn overlapping(in_flight: usize, requested: Option<u64>) -> Cycles {
    let step = |stage: usize, inputs: &[usize]| Step {
        stage,
        half: if stage < 2 { Half::Acquisition } else { Half::Evaluation },
        inputs: inputs.to_vec(),
        label: format!("work of {stage}"),
    };
    let steps = vec![step(0, &[]), step(1, &[]), step(2, &[0, 1]), step(2, &[2])];
    let stages = ["a", "b", "c"].map(str::to_owned).to_vec();
    let budgets = Budgets { stage_ns: 100 * MS, cycle_ns: 1000 * MS };
    Cycles::new(stages, steps, budgets, in_flight, requested)
}

fn ready(machine: &mut Cycles, now_ns: u64) -> Vec<Action> {
    (0..3).flat_map(|stage| machine.handle(now_ns, Input::Ready { stage })).collect()
}

fn done(machine: &mut Cycles, now_ns: u64, cycle: u64, activation: usize) -> Vec<Action> {
    let stage = machine.steps.all[activation].stage;
    machine.handle(now_ns, Input::Done { stage, cycle, activation }).into()
}

fn outcome(actions: &[Action]) -> Option<Result<(), String>> {
    actions.iter().find_map(|a| match a {
        Action::Outcome { result, .. } => Some(result.clone()),
        _ => None,
    })
}

#[test]
fn a_cycle_is_ok_when_all_is_done_and_the_result_is_there_and_the_next_one_follows() {
    let mut machine = machine(Some(2));
    assert_eq!(ready(&mut machine, 0), [Action::Start(0), Action::Evaluate(0)]);
    for activation in [1, 0, 2, 3] {
        assert_eq!(done(&mut machine, 1, 0, activation), []);
    }
    let actions: Vec<_> = machine.handle(2, Input::Result { cycle: 0 }).into();
    assert_eq!(
        actions,
        [Action::Outcome { cycle: 0, result: Ok(()) }, Action::Start(1), Action::Evaluate(1)]
    );
    machine.handle(3, Input::Result { cycle: 1 });
    for activation in [0, 1, 2] {
        assert_eq!(done(&mut machine, 4, 1, activation), []);
    }
    let actions = done(&mut machine, 5, 1, 3);
    assert_eq!(actions, [Action::Outcome { cycle: 1, result: Ok(()) }, Action::Finished]);
}

#[test]
fn a_lost_stage_ends_the_cycle_with_its_reason_and_the_next_waits_for_its_return() {
    let mut machine = machine(Some(2));
    ready(&mut machine, 0);
    let actions: Vec<_> =
        machine.handle(1, Input::Lost { stage: 1, reason: "died (signal 9)".into() }).into();
    let reason = "stage b died (signal 9)".to_owned();
    assert_eq!(actions, [Action::Abort(0), Action::Outcome { cycle: 0, result: Err(reason) }]);
    assert!(machine.handle(2, Input::Tick).is_empty());
    assert_eq!(machine.handle(3, Input::Ready { stage: 1 }), [Action::Start(1), Action::Evaluate(1)]);
}

#[test]
fn the_stage_that_could_work_and_does_not_is_the_hung_one() {
    let mut machine = machine(Some(1));
    ready(&mut machine, 0);
    done(&mut machine, 50 * MS, 0, 0);
    assert!(machine.handle(100 * MS, Input::Tick).is_empty());
    let actions: Vec<_> = machine.handle(101 * MS, Input::Tick).into();
    assert!(matches!(&actions[0], Action::Kill { stage: 1, .. }), "{actions:?}");
    let message = outcome(&actions).unwrap().unwrap_err();
    assert!(message.contains("stage b hung: no progress for 101 ms at \"work of 1\", the limit is 100 ms"));
}

#[test]
fn a_stage_with_much_work_is_not_hung_while_it_moves_but_the_cycle_has_a_deadline() {
    let steps: Vec<Step> = (0..100)
        .map(|i| Step { stage: 0, half: Half::Evaluation, inputs: vec![], label: format!("step {i}") })
        .collect();
    let budgets = Budgets { stage_ns: 100 * MS, cycle_ns: 1000 * MS };
    let mut machine = Cycles::new(vec!["a".into()], steps, budgets, 1, Some(1));
    machine.handle(0, Input::Ready { stage: 0 });
    for i in 0..12 {
        let now = (i + 1) * 90 * MS;
        machine.handle(now, Input::Done { stage: 0, cycle: 0, activation: i as usize });
        let actions: Vec<_> = machine.handle(now, Input::Tick).into();
        let expected = now > 1000 * MS;
        assert_eq!(outcome(&actions).is_some(), expected, "{i}");
        if let Some(result) = outcome(&actions) {
            let message = result.unwrap_err();
            assert!(message.contains("deadline of 1000 ms; stage a was at \"step 12\""), "{message}");
        }
    }
}

#[test]
fn reports_that_contradict_the_schedule_end_the_cycle() {
    let cases = [
        (Input::Done { stage: 0, cycle: 0, activation: 0 }, "twice"),
        (Input::Done { stage: 1, cycle: 0, activation: 2 }, "which is the work of c"),
        (
            Input::Done { stage: 1, cycle: 0, activation: 77 },
            "activation 77, which the schedule does not have",
        ),
        (Input::Done { stage: 2, cycle: 0, activation: 3 }, "out of order"),
    ];
    for (input, message) in cases {
        let mut machine = machine(Some(1));
        ready(&mut machine, 0);
        done(&mut machine, 1, 0, 0);
        let actions: Vec<_> = machine.handle(2, input).into();
        let reason = outcome(&actions).unwrap().unwrap_err();
        assert!(reason.contains(message), "{reason} lacks {message}");
    }
}

#[test]
fn cycles_that_a_stop_prevents_are_counted_apart_from_the_one_that_it_ends() {
    let mut machine = machine(Some(3));
    ready(&mut machine, 0);
    let actions: Vec<_> = machine.handle(1, Input::Stop { reason: "stopped by the operator".into() }).into();
    let outcomes: Vec<_> = actions
        .iter()
        .filter_map(|a| match a {
            Action::Outcome { cycle, result } => Some((*cycle, result.clone().unwrap_err())),
            _ => None,
        })
        .collect();
    assert_eq!(outcomes[0], (0, "stopped by the operator".to_owned()));
    assert_eq!(outcomes.len(), 1);
    assert!(actions.contains(&Action::NotRun { count: 2, reason: "stopped by the operator".into() }));
    assert_eq!(actions.last(), Some(&Action::Finished));
    assert!(machine.handle(2, Input::Result { cycle: 0 }).is_empty());
}

#[test]
fn the_next_cycle_is_acquired_while_the_last_one_is_evaluated_and_no_more_than_planned() {
    let mut machine = overlapping(2, Some(4));
    assert_eq!(ready(&mut machine, 0), [Action::Start(0), Action::Evaluate(0)]);
    assert_eq!(done(&mut machine, 1, 0, 0), []);
    assert_eq!(done(&mut machine, 2, 0, 1), [Action::Start(1)], "acquired: the part is free");
    for activation in [0, 1] {
        assert_eq!(done(&mut machine, 3, 1, activation), [], "two are in flight");
    }
    assert_eq!(machine.running().collect::<Vec<_>>(), [0, 1]);
    // Nothing of the second cycle is evaluated while the first one is, and no stage is blamed for its wait.
    assert_eq!(done(&mut machine, 90 * MS, 0, 2), []);
    assert_eq!(machine.handle(150 * MS, Input::Tick), []);
    assert_eq!(done(&mut machine, 151 * MS, 0, 3), []);
    let actions: Vec<_> = machine.handle(152 * MS, Input::Result { cycle: 0 }).into();
    let first = Action::Outcome { cycle: 0, result: Ok(()) };
    assert_eq!(actions, [first, Action::Start(2), Action::Evaluate(1)]);
    assert_eq!(machine.handle(251 * MS, Input::Tick), [], "its evaluation began just now");
    let actions: Vec<_> = machine.handle(253 * MS, Input::Tick).into();
    let hung =
        |stage: usize| actions.iter().any(|a| matches!(a, Action::Kill { stage: s, .. } if *s == stage));
    assert!(hung(0) && hung(2), "{actions:?}");
}

#[test]
fn a_cycle_that_ends_before_an_earlier_one_waits_with_its_outcome_and_blocks_nothing() {
    let mut machine = overlapping(3, Some(3));
    ready(&mut machine, 0);
    done(&mut machine, 1, 0, 0);
    done(&mut machine, 1, 0, 1);
    let failed = Input::Failed { stage: 1, cycle: 1, reason: "no light".into() };
    let actions: Vec<_> = machine.handle(2, failed).into();
    assert_eq!(actions, [Action::Abort(1), Action::Start(2)]);
    done(&mut machine, 3, 0, 2);
    done(&mut machine, 3, 0, 3);
    let actions: Vec<_> = machine.handle(4, Input::Result { cycle: 0 }).into();
    let outcomes = [
        Action::Outcome { cycle: 0, result: Ok(()) },
        Action::Outcome { cycle: 1, result: Err("stage b: no light".into()) },
        Action::Evaluate(2),
    ];
    assert_eq!(actions, outcomes);
}

#[test]
fn a_lost_stage_ends_all_cycles_in_flight_and_an_early_report_its_own() {
    let mut machine = overlapping(2, Some(3));
    ready(&mut machine, 0);
    done(&mut machine, 1, 0, 0);
    done(&mut machine, 1, 0, 1);
    done(&mut machine, 1, 1, 0);
    done(&mut machine, 1, 1, 1);
    let actions = done(&mut machine, 2, 1, 2);
    assert_eq!(actions, [Action::Abort(1)], "the evaluation of the second cycle was not started");
    let actions: Vec<_> = machine.handle(3, Input::Lost { stage: 2, reason: "died".into() }).into();
    let reason = Err("stage c died".to_owned());
    assert_eq!(actions[..2], [Action::Abort(0), Action::Outcome { cycle: 0, result: reason }]);
    assert!(outcome(&actions[2..]).unwrap().unwrap_err().contains("out of order"));
    assert_eq!(actions.len(), 3);
    assert_eq!(machine.handle(4, Input::Ready { stage: 2 }), [Action::Start(2), Action::Evaluate(2)]);
}

fn any_input() -> impl Strategy<Value = Input> {
    let cycle = 0_u64..4;
    prop_oneof![
        4 => (0_usize..3).prop_map(|stage| Input::Ready { stage }),
        1 => (0_usize..3).prop_map(|stage| Input::Lost { stage, reason: "died".into() }),
        1 => (0_usize..3).prop_map(|stage| Input::Unready { stage }),
        12 => (0_usize..3, cycle.clone(), 0_usize..5)
            .prop_map(|(stage, cycle, activation)| Input::Done { stage, cycle, activation }),
        1 => (0_usize..3, cycle.clone())
            .prop_map(|(stage, cycle)| Input::Failed { stage, cycle, reason: "no".into() }),
        4 => cycle.prop_map(|cycle| Input::Result { cycle }),
        1 => Just(Input::InvalidMessage { reason: "invalid".into() }),
        2 => Just(Input::Tick),
        1 => Just(Input::Stop { reason: "stop".into() }),
    ]
}

proptest! {
    /// Proves: for any order of any events, each requested cycle has one outcome, in order, no more than planned are in
    /// flight, only the oldest is evaluated, and a cycle that is not ok is aborted before its outcome.
    #[test]
    fn every_order_of_events_gives_each_cycle_one_outcome(
        in_flight in 1_usize..4,
        events in proptest::collection::vec((0_u64..60, any_input()), 0..200),
    ) {
        let mut machine = overlapping(in_flight, Some(4));
        let mut now_ns = 0;
        let mut actions = Vec::new();
        for (step_ms, input) in events {
            now_ns += step_ms * MS;
            actions.extend(machine.handle(now_ns, input));
        }
        actions.extend(machine.handle(now_ns, Input::Stop { reason: "end".into() }));

        let (mut open, mut aborted) = (VecDeque::new(), Vec::new());
        let mut outcomes = Vec::new();
        for action in &actions {
            match action {
                Action::Start(cycle) => {
                    open.push_back(*cycle);
                    prop_assert!(open.len() <= in_flight);
                }
                Action::Evaluate(cycle) => prop_assert_eq!(open.front(), Some(cycle)),
                Action::Abort(cycle) => aborted.push(*cycle),
                Action::NotRun { count, .. } => outcomes.extend(outcomes.len() as u64..outcomes.len() as u64 + count),
                Action::Outcome { cycle, result } => {
                    let started = open.front() == Some(cycle);
                    prop_assert!(started || result.is_err());
                    prop_assert_eq!(aborted.contains(cycle), started && result.is_err());
                    if started {
                        open.pop_front();
                    }
                    outcomes.push(*cycle);
                }
                _ => {}
            }
        }
        prop_assert_eq!(outcomes, vec![0, 1, 2, 3]);
        prop_assert!(open.is_empty());
        prop_assert_eq!(actions.iter().filter(|a| **a == Action::Finished).count(), 1);
        prop_assert!(machine.is_finished());
    }
}

/// Proves: a host that is led runs the cycles of the numbers that are asked for, none twice, and may leave some out.
#[test]
fn cycles_that_are_asked_for_by_number_run_once_under_that_number() {
    let mut machine = machine(None).open();
    assert_eq!(ready(&mut machine, 0), []);
    let asked: Vec<_> = machine.handle(1, Input::RequestNumber { cycle: 4 }).into();
    assert_eq!(asked, [Action::Start(4), Action::Evaluate(4)]);
    assert_eq!(machine.handle(2, Input::RequestNumber { cycle: 4 }), [], "it runs already");
    let ended: Vec<_> = machine.handle(3, Input::Abort { reason: "no longer wanted".into() }).into();
    assert!(outcome(&ended).is_some_and(|result| result.is_err()));
    assert_eq!(machine.handle(4, Input::RequestNumber { cycle: 4 }), [], "it has its outcome");
    assert_eq!(machine.handle(4, Input::RequestNumber { cycle: 2 }), [], "nor an older one");
    machine.handle(5, Input::Unready { stage: 1 });
    assert_eq!(machine.handle(6, Input::RequestNumber { cycle: 5 }), []);
    let ended: Vec<_> = machine.handle(7, Input::Abort { reason: "no longer wanted".into() }).into();
    assert_eq!(ended.len(), 1, "one that waits for its stages ends before its start: {ended:?}");
    machine.handle(8, Input::Ready { stage: 1 });
    let asked: Vec<_> = machine.handle(9, Input::RequestNumber { cycle: 6 }).into();
    assert_eq!(asked, [Action::Start(6), Action::Evaluate(6)]);
}
