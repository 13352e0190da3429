//! The requests of `docs/control.md` against a cell: each is sent as it stands there and gets the answer that the page promises.

use crate::control::plan;
use crate::running::{Cell, pid_of, text, wait};
use crate::support::root;
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;

/// A request of the page, and the key of the answer that stands first beside it.
#[derive(Debug)]
struct Row {
    request: String,
    answer: String,
}

/// Texts between backticks of a page.
fn quoted(cell: &str) -> impl Iterator<Item = &str> {
    cell.split('`').skip(1).step_by(2)
}

fn rows() -> Vec<Row> {
    let page = std::fs::read_to_string(root().join("docs/control.md")).unwrap();
    let lines = page.lines().filter(|line| line.starts_with("| `{\"command\""));
    let row = |line: &str| {
        let (requests, answers) = line.split_once("` | ").unwrap();
        let answer = quoted(answers).next().expect("an answer").to_owned();
        let all: Vec<Row> = quoted(&format!("{requests}`"))
            .map(|request| Row { request: request.to_owned(), answer: answer.clone() })
            .collect();
        all
    };
    lines.flat_map(row).collect()
}

fn command(request: &str) -> String {
    let value: Value = serde_json::from_str(request).unwrap_or_else(|error| panic!("{request}: {error}"));
    value["command"].as_str().unwrap().to_owned()
}

fn ask(cell: &Cell, request: &str) -> Value {
    let socket = ipc::cell::CellName::new(&cell.name).unwrap().socket();
    let mut stream = UnixStream::connect(socket).unwrap();
    stream.set_read_timeout(Some(crate::running::PATIENCE)).unwrap();
    stream.write_all(format!("{request}\n").as_bytes()).unwrap();
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap_or_else(|error| panic!("{request}: {error}: {line:?}"))
}

#[test]
fn every_request_of_the_page_gets_the_answer_of_the_page() {
    let cell = Cell::played("page", 200.0, "");
    std::fs::write(cell.small.path("spheres.plan.toml"), plan(-50.0, 50.0)).unwrap();
    let recipe = "[[recipe]]\nname = \"spheres\"\nplan = \"spheres.plan.toml\"\n[limits]\n";
    cell.small.edit("played.toml", "[limits]\n", recipe);
    // A job of ten cycles may be faster than the disk takes ten clouds.
    cell.small.edit("played.toml", "loop = true\n", "loop = true\n[results]\nkeep_parts = 0\n");
    let run = cell.program("played.toml", &["--serve"]).spawn().unwrap();
    let ready = || cell.until("ready", |status| status["state"] == "Ready");
    let mut seen = BTreeSet::new();
    for Row { request, answer } in rows() {
        let before = ready();
        let command = command(&request);
        match command.as_str() {
            // There must be a job to end.
            "finish" | "abort" => assert!(ask(&cell, "{\"command\":\"start\"}")["done"].is_string()),
            "reset" => assert!(ask(&cell, "{\"command\":\"halt\"}")["done"].is_string()),
            _ => {}
        }
        let given = ask(&cell, &request);
        assert!(given.get(&answer).is_some(), "{request}: {answer} is promised, {given} came");
        match command.as_str() {
            "halt" => assert!(ask(&cell, "{\"command\":\"reset\"}")["done"].is_string()),
            "unprepare" => {
                let prepare = request.replace("unprepare", "prepare");
                assert!(ask(&cell, &prepare)["done"].is_string());
            }
            "restart" => {
                let old = pid_of(&before, "decode/cam1");
                cell.until("restarted", |status| {
                    status["state"] == "Ready" && pid_of(status, "decode/cam1") != old
                });
            }
            _ => {}
        }
        seen.insert(command);
    }
    let output = wait(run);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    // The cell lists the requests that it knows when it gets another one.
    let cell = Cell::played("page2", 0.0, "");
    let run = cell.program("played.toml", &["--serve"]).spawn().unwrap();
    cell.until("ready", |status| status["state"] == "Ready");
    let refused = ask(&cell, "{\"command\":\"dance\"}")["refused"].as_str().unwrap().to_owned();
    let (_, known) = refused.split_once("expected one of ").unwrap();
    let known: BTreeSet<String> = quoted(known).map(str::to_owned).collect();
    assert_eq!(seen, known, "{refused}");
    ask(&cell, "{\"command\":\"stop\"}");
    wait(run);
}
