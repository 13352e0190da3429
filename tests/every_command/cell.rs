//! Every command of `fringecell`, to a running cell and without one.

use super::{expect_json, expect_kept, expect_lost, full, output, print_row, unread};
use crate::running::{Cell, text, wait};
use serde_json::Value;
use std::collections::BTreeSet;
use std::process::{Child, Command, Output, Stdio};

/// Commands of `fringecell`; those from `status` on speak with a running cell.
pub const CELL: &[&str] = &[
    "demo",
    "run",
    "schedule",
    "completions",
    "man",
    "status",
    "trigger",
    "start",
    "finish",
    "abort",
    "halt",
    "reset",
    "prepare",
    "unprepare",
    "restart",
    "stop",
    "opcua",
];

/// Fails unless a document follows its schema.
fn follows(schema: &str, value: &Value) {
    let schema = crate::schema::schema(schema).unwrap();
    assert_eq!(crate::schema::faults(&schema, value), Vec::<String>::new());
}

fn fringecell(arguments: &[&str], stdout: Stdio) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_fringecell"));
    output(program.args(arguments).stdout(stdout).stderr(Stdio::piped()))
}

fn serve(cell: &Cell) -> Child {
    let run = cell.program("played.toml", &["--serve", "--json", "-"]).spawn().unwrap();
    cell.until("ready", |status| status["state"] == "Ready");
    run
}

/// Every command to a running cell, in an order that its states allow.
fn operate(cell: &Cell, mut each: impl FnMut(&str, &[&str])) {
    let ready = || cell.until("ready", |status| status["state"] == "Ready");
    let name = cell.name.as_str();
    each("status", &["status", name]);
    each("trigger", &["trigger", name, "--part", "1"]);
    each("unprepare", &["unprepare", name, "--recipe", "default"]);
    each("prepare", &["prepare", name, "--recipe", "default"]);
    each("start", &["start", name]);
    each("finish", &["finish", name]);
    ready();
    each("start", &["start", name]);
    each("abort", &["abort", name]);
    each("halt", &["halt", name]);
    each("reset", &["reset", name]);
    each("restart", &["restart", "fusion", "--cell", name]);
    ready();
    each("stop", &["stop", name]);
}

#[test]
fn every_command_to_a_cell_gives_pure_json_and_tells_lost_output() {
    let cell = Cell::played("operated", 0.0, "");
    let run = serve(&cell);
    let mut seen = BTreeSet::new();
    operate(&cell, |command, arguments| {
        seen.insert(command.to_owned());
        let value =
            expect_json(command, &fringecell(&[arguments, &["--json", "-"]].concat(), Stdio::piped()));
        assert_eq!(value["cell"], cell.name.as_str(), "{command}: {value}");
        match command {
            "status" => follows("status", &value),
            "trigger" => follows("result", &value),
            _ => follows("operate", &value),
        }
    });
    let report = expect_json("run", &run.wait_with_output().unwrap());
    follows("run", &report);
    assert!(report["cycles_done"].as_u64() >= Some(2), "{report}");
    assert_eq!(
        report["results"].as_array().map(Vec::len),
        report["cycles_done"].as_u64().map(|n| n as usize)
    );
    let run = serve(&cell);
    let foreign = cell.small.path("foreign.json");
    operate(&cell, |command, arguments| {
        // Refused before anything is asked of the cell: no part is inspected, and the command itself follows.
        let cycles = || cell.status().unwrap()["cycles_done"].clone();
        let before = cycles();
        expect_kept(command, &foreign, |file| {
            fringecell(&[arguments, &["--json", file]].concat(), Stdio::piped())
        });
        assert!(command != "trigger" || cycles() == before, "a part was inspected for nothing");
        expect_lost(command, &fringecell(arguments, full()), "No space left on device");
        print_row(command);
    });
    wait(run);
    let run = serve(&cell);
    operate(&cell, |command, arguments| {
        expect_lost(command, &fringecell(arguments, unread()), "Broken pipe");
    });
    wait(run);
    let operated = CELL
        .iter()
        .skip_while(|command| **command != "status")
        .filter(|command| **command != "opcua")
        .map(|c| (*c).to_owned())
        .collect();
    assert_eq!(seen, operated);
}

/// Proves: `run`, `demo` and `schedule` measure whoever reads, and say what was lost.
#[test]
fn cells_and_schedules_give_pure_json_and_tell_lost_output() {
    let cell = Cell::played("piped", 0.0, "");
    let folder = cell.small.path("demo");
    let config = cell.small.path("played.toml");
    let lines: [(&str, Vec<&str>); 4] = [
        ("run", vec!["run", &config, "--cell", &cell.name, "--cycles", "2"]),
        ("schedule", vec!["schedule", &config]),
        // The configuration of the demo is part of the program.
        ("bare schedule", vec!["schedule"]),
        ("demo", vec!["demo", "--cycles", "1", "--cell", &cell.name, "--out", &folder]),
    ];
    for (what, arguments) in lines {
        expect_kept(what, &cell.small.path("foreign.json"), |file| {
            fringecell(&[&arguments[..], &["--json", file]].concat(), Stdio::piped())
        });
        std::fs::remove_dir_all(&folder).ok();
        print_row(what);
        let value =
            expect_json(what, &fringecell(&[&arguments[..], &["--json", "-"]].concat(), Stdio::piped()));
        if matches!(what, "run" | "demo") {
            follows("run", &value);
            let cycles = if what == "run" { 2 } else { 1 };
            assert_eq!(value["cycles_ok"], cycles, "{what}: {value}");
        } else {
            follows("schedule", &value);
            assert!(value["memory"]["run_bytes"].as_u64() > Some(1_000_000), "{what}: {value}");
        }
        std::fs::remove_dir_all(&folder).ok();
        assert_eq!(cell.left(), Vec::<String>::new());
        // The demo is a run of full size; what follows is the same for both.
        if what == "demo" {
            continue;
        }
        let output = fringecell(&[&arguments[..], &["--json", "-"]].concat(), full());
        expect_lost(what, &output, "No space left on device");
        assert_eq!(cell.left(), Vec::<String>::new());
        expect_lost(what, &fringecell(&arguments, unread()), "Broken pipe");
        assert_eq!(cell.left(), Vec::<String>::new());
        // Silent: only the exit code.
        std::fs::remove_dir_all(&folder).ok();
        let quiet = fringecell(&[&arguments[..], &["--quiet"]].concat(), Stdio::piped());
        let silent = (quiet.status.code(), text(&quiet.stdout), text(&quiet.stderr));
        assert_eq!(silent, (Some(0), String::new(), String::new()), "{what}");
    }
}
