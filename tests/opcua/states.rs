//! Every state against every method, what each does, and the events of the way.

use super::client::Client;
use super::{Line, MARKUP};
use crate::running::{pid_of, signal};
use serde_json::{Value, json as value};

/// The object that has a method.
fn object(method: &str) -> &'static str {
    match method {
        "Halt" | "Reset" | "SelectModeAutomatic" => "VisionStateMachine",
        _ => "VisionStateMachine/AutomaticModeStateMachine",
    }
}

/// Usual arguments of a method.
pub fn arguments(method: &str) -> Value {
    match method {
        "SelectModeAutomatic" => value!([]),
        "StartSingleJob" | "StartContinuous" => {
            value!([null, null, null, null, {"type": "Variants", "value": []}])
        }
        _ => value!([{"type": "Int32", "value": 0}, {"type": "String", "value": "table"}]),
    }
}

/// Columns of the table: what each state makes of each method, as the transitions of OPC 40100-1 have it.
const METHODS: [&str; 7] =
    ["SelectModeAutomatic", "StartSingleJob", "StartContinuous", "Stop", "Abort", "Halt", "Reset"];

/// A state, whether it permits each method, and the state that follows.
const TABLE: [(&str, [Option<&str>; 7]); 6] = [
    ("Halted", [None, None, None, None, None, None, Some("Ready")]),
    ("Error", [None, None, None, None, None, Some("Halted"), Some("Ready")]),
    ("Initialized", [None, None, None, None, None, Some("Halted"), Some("Ready")]),
    (
        "Ready",
        [
            None,
            Some("SingleExecution"),
            Some("ContinuousExecution"),
            None,
            None,
            Some("Halted"),
            Some("Ready"),
        ],
    ),
    ("SingleExecution", [None, None, None, Some("Ready"), Some("Ready"), Some("Halted"), Some("Ready")]),
    ("ContinuousExecution", [None, None, None, Some("Ready"), Some("Ready"), Some("Halted"), Some("Ready")]),
];

/// Brings the cell from any state to one, past the gateway.
fn bring(line: &Line, client: &mut Client, state: &str) {
    line.ask(&value!({"command": "reset"}));
    line.cell.until("ready", |status| status["state"] == "Ready");
    match state {
        "Halted" => drop(line.ask(&value!({"command": "halt"}))),
        "Error" => signal("KILL", pid_of(&line.cell.status().unwrap(), "fusion")),
        "Initialized" => {
            for recipe in ["pass", MARKUP] {
                line.ask(&value!({"command": "unprepare", "recipe": recipe}));
            }
        }
        "SingleExecution" => drop(line.ask(&value!({"command": "begin", "part": "held"}))),
        "ContinuousExecution" => drop(line.ask(&value!({"command": "begin"}))),
        _ => {}
    }
    client.shows(state);
}

/// Proves: each state that lasts permits exactly the methods that the specification has transitions for; the others are refused with a status
/// and change nothing.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn every_state_answers_every_method_as_the_table_says() {
    let line = Line::new("opctable", 8.0, "restarts_max = 0");
    let mut client = line.client();
    for (state, row) in TABLE {
        bring(&line, &mut client, state);
        for (method, follows) in METHODS.into_iter().zip(row) {
            let shown = client.ask("read", &value!({"path": "SystemState"}));
            if shown["value"]["StateDescription"] != state {
                bring(&line, &mut client, state);
            }
            let what = format!("{state} × {method}");
            let (status, outputs) = client.call(object(method), method, &arguments(method));
            if let Some(next) = follows {
                assert_eq!(status, "Good", "{what}: {outputs}");
                assert_eq!(outputs.as_array().unwrap().last().unwrap(), 0, "{what}: {outputs}");
                client.shows(next);
            } else {
                assert_eq!(status, "BadInvalidState", "{what}: {outputs}");
                let now = client.ask("read", &value!({"path": "SystemState"}));
                assert_eq!(now["value"]["StateDescription"], state, "{what}");
            }
        }
    }
    line.stop();
}

/// Holds the cell in `Preoperational`: a stage starts again and is stopped before it is ready. Returns its process.
fn hold_starting(line: &Line) -> u64 {
    for _ in 0..50 {
        line.ask(&value!({"command": "reset"}));
        let before = pid_of(&line.cell.until("ready", |status| status["state"] == "Ready"), "fusion");
        line.ask(&value!({"command": "restart", "stage": "fusion"}));
        let status = line.cell.until("started again", |status| {
            let stages = status["stages"].as_array().unwrap();
            stages.iter().any(|s| s["name"] == "fusion" && s["pid"].as_u64().is_some_and(|pid| pid != before))
        });
        let pid = pid_of(&status, "fusion");
        signal("STOP", pid);
        std::thread::sleep(std::time::Duration::from_millis(200));
        if line.cell.status().unwrap()["state"] == "Preoperational" {
            return pid;
        }
        signal("CONT", pid);
    }
    panic!("the stage was ready before it could be stopped, fifty times");
}

/// Proves: while stages start, jobs are refused, automatic mode is waited for no longer than 5 s, and halting works at once.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn a_cell_that_starts_takes_no_jobs_and_can_be_halted() {
    let line = Line::new("opcstarts", 8.0, "restarts_max = 10");
    let mut client = line.client();
    let pid = hold_starting(&line);
    client.shows("Preoperational");
    for method in ["StartSingleJob", "StartContinuous", "Stop", "Abort"] {
        let (status, outputs) = client.call(object(method), method, &arguments(method));
        assert_eq!(status, "BadInvalidState", "{method}: {outputs}");
    }
    let select = "SelectModeAutomatic";
    let (status, outputs) = client.call(object(select), select, &arguments(select));
    assert_eq!((status.as_str(), outputs), ("Good", value!([9])), "not ready in time");
    client.shows("Preoperational");
    signal("CONT", pid);
    client.shows("Ready");
    hold_starting(&line);
    client.shows("Preoperational");
    let (status, outputs) = client.call(object("Halt"), "Halt", &arguments("Halt"));
    assert_eq!((status.as_str(), outputs), ("Good", value!([0])));
    client.shows("Halted");
    let (status, _) = client.call(object("Reset"), "Reset", &arguments("Reset"));
    assert_eq!(status, "Good");
    client.shows("Ready");
    line.stop();
}

/// The state changes among events: transition, from, to.
fn transitions(events: &Value) -> Vec<String> {
    let events = events.as_array().unwrap().iter();
    events.filter_map(|event| event["Transition"].as_str().map(str::to_owned)).collect()
}

/// Proves: each change of state comes as an event with the transition of the nodeset that tells its cause, also when another client
/// of the cell caused it.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn state_changes_are_events_with_the_transitions_of_the_nodeset() {
    let line = Line::new("opcways", 20.0, "");
    let mut client = line.client();
    client.ask("subscribe", &value!({}));
    let way = |client: &mut Client, method: &str, count: usize| {
        let (status, _) = client.call(object(method), method, &arguments(method));
        assert_eq!(status, "Good", "{method}");
        let mut seen = Vec::new();
        while seen.len() < count {
            let events = client.ask("take", &value!({"count": 1}));
            assert!(!events.as_array().unwrap().is_empty(), "{method}: {seen:?}");
            seen.extend(transitions(&events));
        }
        seen
    };
    assert_eq!(way(&mut client, "Halt", 1), ["OperationalToHalted"]);
    let reset = ["HaltedToPreoperational", "PreoperationalToOperationalAuto", "InitializedToReadyAuto"];
    assert_eq!(way(&mut client, "Reset", 3), reset);
    let again = ["OperationalToPreoperational", "PreoperationalToOperationalAuto", "InitializedToReadyAuto"];
    assert_eq!(way(&mut client, "Reset", 3), again);
    assert_eq!(way(&mut client, "StartContinuous", 1), ["ReadyToContinuousExecution"]);
    assert_eq!(way(&mut client, "Abort", 1), ["ContinuousExecutionToReadyAbort"]);
    assert_eq!(
        way(&mut client, "StartSingleJob", 2),
        ["ReadyToSingleExecution", "SingleExecutionToReadyAuto"]
    );
    line.ask(&value!({"command": "halt"}));
    let mut seen = Vec::new();
    while seen.is_empty() {
        seen.extend(transitions(&client.ask("take", &value!({"count": 1}))));
    }
    assert_eq!(seen, ["OperationalToHaltedAuto"], "nobody called a method");
    line.stop();
}

/// Proves: recipes are prepared and unprepared by their names, through the management and through their own nodes.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn recipes_are_prepared_and_unprepared() {
    let line = Line::new("opcrecipes", 0.0, "");
    let mut client = line.client();
    let external = |id: &str| value!({"type": "RecipeIdExternalDataType", "value": {"Id": id}});
    let internal = |id: &str| value!({"type": "RecipeIdInternalDataType", "value": {"Id": id}});
    let management = "RecipeManagement";
    let (status, outputs) = client.call(management, "UnprepareRecipe", &value!([external(MARKUP), null]));
    assert_eq!((status.as_str(), &outputs[0]["Id"], &outputs[1]), ("Good", &MARKUP.into(), &0.into()));
    let start = |client: &mut Client, recipe: &str| {
        let arguments = value!([null, null, external(recipe), null, null]);
        client.call("VisionStateMachine/AutomaticModeStateMachine", "StartSingleJob", &arguments)
    };
    assert_eq!(start(&mut client, MARKUP).1[1], 3, "not prepared");
    assert_eq!(start(&mut client, "none").1[1], 2, "not known");
    let (status, outputs) = client.call(&format!("{management}/Recipes/1"), "Prepare", &value!([]));
    assert_eq!((status.as_str(), outputs), ("Good", value!([true, 0])));
    let listed = |client: &mut Client, prepared: i32| {
        let arguments = value!([null, null, {"type": "Int32", "value": prepared}, {"type": "UInt32", "value": 0},
            {"type": "UInt32", "value": 0}, {"type": "Int32", "value": 0}]);
        let (status, outputs) = client.call(management, "GetRecipeListFiltered", &arguments);
        assert_eq!((status.as_str(), &outputs[0], &outputs[4]), ("Good", &true.into(), &0.into()));
        let names = outputs[3].as_array().unwrap().iter().map(|id| id["Id"].as_str().unwrap().to_owned());
        names.collect::<Vec<_>>()
    };
    assert_eq!(listed(&mut client, 2), ["pass", MARKUP]);
    let (_, outputs) = client.call(management, "UnprepareRecipe", &value!([null, internal("pass")]));
    assert_eq!(outputs[1], 0);
    assert_eq!(listed(&mut client, 1), [MARKUP]);
    assert_eq!(listed(&mut client, 0), ["pass"]);
    // A list, a node and a state that are asked for at once show what the method has done.
    let shown = |client: &mut Client, name: &str| client.ask("read", &value!({"path": name}))["value"].take();
    for _ in 0..20 {
        let (_, outputs) = client.call(management, "UnprepareRecipe", &value!([null, internal(MARKUP)]));
        assert_eq!((&outputs[1], listed(&mut client, 1).len()), (&0.into(), 0));
        assert_eq!(
            shown(&mut client, "VisionStateMachine/AutomaticModeStateMachine/CurrentState"),
            "Initialized"
        );
        let (_, outputs) = client.call(management, "PrepareRecipe", &value!([null, internal(MARKUP)]));
        assert_eq!((&outputs[2], listed(&mut client, 1)), (&0.into(), vec![MARKUP.to_owned()]));
        assert_eq!(shown(&mut client, &format!("{management}/Recipes/1/IsPrepared")), true);
    }
    let (_, outputs) =
        client.call(management, "PrepareRecipe", &value!([external("pass"), internal(MARKUP)]));
    assert_eq!(outputs[2], 2, "two names for one recipe");
    line.stop();
}
