//! A cell that takes jobs: states, recipes, refusals, metrics. Through the real binary and its socket.

use crate::running::{Cell, json, pid_of, results, signal, text, wait};
use crate::support::{fringetool, root};
use files::cycle_record::{Next, RecordReader};
use serde_json::{Value, json as value};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

/// The plan of the artefact with other tolerances, for cameras that see few points.
pub fn plan(lower: f64, upper: f64) -> String {
    let text = std::fs::read_to_string(root().join("configs/complex-artefact.plan.toml")).unwrap();
    let line = |line: &str| match line.split(" = ").next() {
        Some(key @ ("tolerance_mm" | "tolerance_deg")) => format!("{key} = [{lower:?}, {upper:?}]"),
        Some("min_points") => "min_points = 15".to_owned(),
        Some("max_reject_fraction") => "max_reject_fraction = 0.2".to_owned(),
        _ => line.to_owned(),
    };
    // A flatness needs more points than these cameras see.
    let blocks: Vec<&str> =
        text.split("[[feature]]").filter(|block| !block.contains("base_flatness")).collect();
    blocks.join("[[feature]]").lines().map(line).collect::<Vec<_>>().join("\n")
}

/// A running cell with two recipes beside the default one; it has no plan at the top, so the first one is its default.
struct Served {
    cell: Cell,
    run: Child,
}

impl Served {
    fn new(name: &str, more: &[&str]) -> Self {
        Self::limited(name, "", more)
    }

    fn limited(name: &str, limits: &str, more: &[&str]) -> Self {
        let cell = Cell::played(name, 0.0, limits);
        let (pass, fail) = (cell.small.path("pass.plan.toml"), cell.small.path("fail.plan.toml"));
        std::fs::write(pass, plan(-50.0, 50.0)).unwrap();
        std::fs::write(fail, plan(40.0, 50.0)).unwrap();
        cell.small.edit(
            "played.toml",
            "[limits]\n",
            "[[recipe]]\nname = \"pass\"\nplan = \"pass.plan.toml\"\n[[recipe]]\nname = \"fail\"\nplan = \"fail.plan.toml\"\n[limits]\n",
        );
        let record = cell.small.path("served.record");
        let mut arguments = vec!["--serve", "--cycle-record", &record];
        arguments.extend(more);
        let run = cell.program("played.toml", &arguments).spawn().unwrap();
        cell.until("ready", |status| status["state"] == "Ready");
        Self { cell, run }
    }

    fn connect(&self) -> UnixStream {
        let stream =
            UnixStream::connect(ipc::cell::CellName::new(&self.cell.name).unwrap().socket()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    }

    fn ask(&self, request: &Value) -> Value {
        exchange(&self.connect(), &format!("{request}\n"))
    }

    fn trigger(&self, arguments: &[&str]) -> Output {
        let program = env!("CARGO_BIN_EXE_fringecell");
        Command::new(program).args(["trigger", &self.cell.name]).args(arguments).output().unwrap()
    }

    /// The first line that the run printed.
    fn run_output_line(&mut self) -> String {
        let mut line = String::new();
        BufReader::new(self.run.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
        line
    }

    fn stop(self) {
        self.ask(&value!({"command": "stop"}));
        wait(self.run);
    }
}

fn exchange(mut stream: &UnixStream, line: &str) -> Value {
    stream.write_all(line.as_bytes()).unwrap();
    let mut answer = String::new();
    BufReader::new(stream).read_line(&mut answer).unwrap();
    serde_json::from_str(&answer).unwrap_or_else(|e| panic!("{e}: {answer:?}"))
}

/// Proves: a record of a cell that serves is replayed, each cycle with the recipe that it was inspected with, and not when a
/// plan was changed since.
fn replays_each_part_with_its_recipe(cell: &Cell) {
    let (record, report) = (cell.small.path("served.record"), cell.small.path("replay.json"));
    let replay = || fringetool(&["replay", &record, "--json", &report]);
    let ran = replay();
    assert_eq!(ran.code, Some(0), "{}{}", ran.stdout, ran.stderr);
    assert_eq!(json(report.as_ref())["cycles"], 3);
    let mut reader = RecordReader::open(record.as_ref()).unwrap();
    let mut recipes = Vec::new();
    while let Next::Cycle(cycle) = reader.next_cycle().unwrap() {
        recipes.push(reader.header.recipes[cycle.entry.recipe as usize].name.clone());
    }
    assert_eq!(recipes, ["pass", "fail", "pass"]);
    cell.small.edit("fail.plan.toml", "40.0", "41.0");
    let ran = replay();
    assert_eq!(ran.code, Some(2), "{}", ran.stdout);
    assert!(
        ran.stderr.contains("the inspection plan or the calibration_shares of recipe \"fail\" changed"),
        "{}",
        ran.stderr
    );
}

/// Proves: a stage that starts again never measures with another plan than the cell began with.
#[test]
fn a_plan_that_was_changed_while_the_cell_runs_ends_in_error_and_not_in_a_mixed_result() {
    let served = Served::limited("edited", "restarts_max = 1", &[]);
    served.cell.small.edit("fail.plan.toml", "40.0", "41.0");
    served.ask(&value!({"command": "restart", "stage": "inspection"}));
    let status = served.cell.until("in error", |status| status["state"] == "Error");
    let reason = status["reason"].as_str().unwrap();
    assert!(
        reason.contains("fail.plan.toml has changed since the start of the cell; stop the cell"),
        "{reason}"
    );
    served.stop();
}

/// Proves: recipes are chosen per request without a stage being restarted, and every request has its answer and exit code.
#[test]
fn parts_are_inspected_on_request_each_with_its_recipe() {
    let served = Served::new("ctl", &[]);
    let before = served.cell.status().unwrap();
    for (part, recipe, code, verdict) in
        [("a 1", "pass", 0, "pass"), ("b/2", "fail", 1, "fail"), ("ü", "pass", 0, "pass")]
    {
        let file = served.cell.small.path("one.json");
        let output = served.trigger(&["--part", part, "--recipe", recipe, "--json", &file]);
        crate::schema::assert_valid("result", file.as_ref());
        let result = json(file.as_ref());
        assert_eq!(
            output.status.code(),
            Some(code),
            "{}{}\n{result}",
            text(&output.stdout),
            text(&output.stderr)
        );
        assert_eq!((&result["part"], &result["recipe"]), (&part.into(), &recipe.into()));
        let written = json(&served.cell.out().join("result.json"));
        assert_eq!(written, result, "who has the answer finds the file");
        assert_eq!((&result["outcome"], &result["verdict"]), (&"ok".into(), &verdict.into()), "{result}");
        assert!(result["duration_ns"].as_u64() >= result["latency_ns"].as_u64(), "{result}");
    }
    let unknown = served.trigger(&["--part", "c", "--recipe", "none"]);
    assert_eq!(unknown.status.code(), Some(2));
    let said = text(&unknown.stderr);
    assert!(said.contains("no recipe \"none\"; known recipes: pass, fail"), "{said}");
    assert_eq!(served.trigger(&["--part", "\n"]).status.code(), Some(2));

    let after = served.cell.status().unwrap();
    for stage in before["stages"].as_array().unwrap() {
        let name = stage["name"].as_str().unwrap();
        assert_eq!(pid_of(&before, name), pid_of(&after, name), "{name} was restarted");
    }
    assert_eq!((&after["outcomes"]["pass"], &after["outcomes"]["fail"]), (&2.into(), &1.into()));
    served.ask(&value!({"command": "stop"}));
    let Served { cell, run } = served;
    let output = wait(run);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(results(&cell.out()).len(), 3);
    replays_each_part_with_its_recipe(&cell);
}

#[test]
fn the_socket_follows_the_states_and_refuses_what_they_do_not_allow() {
    let served = Served::new("states", &[]);
    let state = |served: &Served| served.ask(&value!({"command": "state"}))["state"]["state"].clone();
    for (request, key, words, then) in [
        (value!({"command": "finish"}), "refused", "no job is running", "Ready"),
        (value!({"command": "unprepare", "recipe": "pass"}), "done", "no longer prepared", "Ready"),
        (value!({"command": "inspect", "part": "p"}), "refused", "not prepared", "Ready"),
        (value!({"command": "unprepare", "recipe": "fail"}), "done", "no longer", "Initialized"),
        (value!({"command": "prepare", "recipe": "fail"}), "done", "prepared", "Ready"),
        (value!({"command": "halt"}), "done", "halted", "Halted"),
        (value!({"command": "inspect", "part": "p", "recipe": "fail"}), "refused", "Halted: ", "Halted"),
        (value!({"command": "reset"}), "done", "reset", "Ready"),
        (value!({"command": "start", "cycles": 0}), "refused", "the minimum is 1", "Ready"),
        (value!({"command": "start", "recipe": "fail"}), "done", "started", "ContinuousExecution"),
        (value!({"command": "inspect", "part": "p"}), "not_ready", "a job is running", "ContinuousExecution"),
    ] {
        let answer = served.ask(&request);
        assert!(answer[key].to_string().contains(words), "{request}: {answer}");
        assert_eq!(state(&served), then, "{request}");
    }
    served.cell.until("at work", |status| status["cycles_done"].as_u64() > Some(1));
    served.ask(&value!({"command": "abort"}));
    let status = served.cell.until("ready again", |status| status["state"] == "Ready");
    assert_eq!(status["outcomes"]["not_ok"], 1, "{status}");
    assert!(status["last_failure"][1].as_str().unwrap().contains("aborted by the operator"), "{status}");
    let three = served.ask(&value!({"command": "start", "cycles": 3}));
    assert!(three["done"].is_string(), "{three}");
    let done = status["cycles_done"].as_u64().unwrap() + 3;
    served.cell.until("ready after three", |s| s["state"] == "Ready" && s["cycles_done"] == done);
    served.stop();
}

/// Proves: a stage that keeps failing leaves a cell in error that states why, to status and to clients, until it is reset.
#[test]
fn a_cell_in_error_says_why_until_it_is_reset() {
    let cell = Cell::played("inerror", 0.0, "restarts_max = 1");
    let run = cell.program("played.toml", &["--serve"]).spawn().unwrap();
    for restarts in 0..2 {
        let ready = cell.until("ready", |s| s["state"] == "Ready" && restarts_of(s, "fusion") == restarts);
        signal("KILL", pid_of(&ready, "fusion"));
    }
    let status = cell.until("in error", |s| s["state"] == "Error");
    let why = "stage fusion failed 2 times within 60 s, the last time: died (signal 9)";
    assert_eq!(status["reason"], why, "{status}");
    let shown = Command::new(env!("CARGO_BIN_EXE_fringecell")).args(["status", &cell.name]).output().unwrap();
    assert!(text(&shown.stdout).contains(&format!("in error: {why}")), "{}", text(&shown.stdout));
    let served = Served { cell, run };
    let asked = served.trigger(&["--part", "x"]);
    assert_eq!(asked.status.code(), Some(2), "{}", text(&asked.stderr));
    assert!(text(&asked.stderr).contains(why), "{}", text(&asked.stderr));
    served.ask(&value!({"command": "reset"}));
    let status = served.cell.until("ready again", |s| s["state"] == "Ready");
    assert_eq!(status["reason"], Value::Null);
    served.ask(&value!({"command": "stop"}));
    assert_eq!(wait(served.run).status.code(), Some(0));
}

fn restarts_of(status: &Value, name: &str) -> u64 {
    let stages = status["stages"].as_array().unwrap();
    stages.iter().find(|s| s["name"] == name).unwrap()["restarts"].as_u64().unwrap()
}

/// Proves: a stage that dies gives the waiting client its outcome, and the next request is served.
#[test]
fn a_stage_that_dies_during_an_inspection_is_an_outcome_and_no_hang() {
    let served = Served::new("died", &[]);
    let stream = served.connect();
    let pid = pid_of(&served.cell.status().unwrap(), "fusion");
    // Stopped, it cannot finish the cycle before it is killed.
    signal("STOP", pid);
    (&stream).write_all(b"{\"command\":\"inspect\",\"part\":\"x\"}\n").unwrap();
    served.cell.until("at work", |status| status["state"] == "SingleExecution");
    signal("KILL", pid);
    let mut answer = String::new();
    BufReader::new(&stream).read_line(&mut answer).unwrap();
    let answer: Value = serde_json::from_str(&answer).unwrap();
    assert_eq!(answer["inspected"]["outcome"], "stage fusion died (signal 9)", "{answer}");
    assert_eq!(answer["inspected"]["part"], "x");
    let next = served.trigger(&["--part", "y"]);
    assert_eq!(next.status.code(), Some(0), "{}{}", text(&next.stdout), text(&next.stderr));
    served.stop();
}

/// Proves: a client may come before the cell and waits for it.
#[test]
fn a_trigger_waits_for_a_cell_that_is_still_starting() {
    let cell = Cell::played("early", 0.0, "");
    let program = env!("CARGO_BIN_EXE_fringecell");
    let trigger = |patience: &str| {
        let mut trigger = Command::new(program);
        trigger.args(["trigger", &cell.name, "--part", "1", "--patience", patience]);
        trigger.stdout(Stdio::piped()).stderr(Stdio::piped());
        trigger
    };
    let none = trigger("0").output().unwrap();
    assert_eq!(none.status.code(), Some(2));
    assert!(
        text(&none.stderr).contains(&format!("no cell '{}' is running", cell.name)),
        "{}",
        text(&none.stderr)
    );
    let early = trigger("100").spawn().unwrap();
    std::thread::sleep(Duration::from_millis(300));
    let run = cell.program("played.toml", &["--serve"]).spawn().unwrap();
    let output = wait(early);
    assert_eq!(output.status.code(), Some(0), "{}{}", text(&output.stdout), text(&output.stderr));
    let stop = Command::new(program).args(["stop", "--cell", &cell.name]).output().unwrap();
    assert!(stop.status.success(), "{}", text(&stop.stderr));
    wait(run);
}

/// The grammar of the text format, version 0.0.4, as far as the cell uses it: one sample or comment per line.
fn check_sample(line: &str) -> (String, f64) {
    let (series, value) = line.rsplit_once(' ').unwrap_or_else(|| panic!("{line}"));
    let (name, labels) = series.split_once('{').unwrap_or_else(|| panic!("{line}"));
    assert!(name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_'), "{line}");
    let labels = labels.strip_suffix('}').unwrap_or_else(|| panic!("{line}"));
    for label in labels.split("\",") {
        let (key, text) = label.split_once("=\"").unwrap_or_else(|| panic!("{line}"));
        assert!(!key.is_empty() && key.chars().all(|c| c.is_ascii_lowercase()), "{line}");
        assert!(!text.trim_end_matches('"').contains('"'), "{line}");
    }
    (name.to_owned(), value.parse().unwrap_or_else(|_| panic!("{line}")))
}

#[test]
fn every_line_of_the_metrics_is_of_the_text_format_and_counts_the_cycles() {
    let mut served = Served::new("metrics", &["--metrics", "127.0.0.1:0"]);
    assert_eq!(served.trigger(&["--part", "1"]).status.code(), Some(0));
    assert_eq!(served.trigger(&["--part", "2", "--recipe", "fail"]).status.code(), Some(1));
    let stdout = served.run_output_line();
    let address = stdout.trim().strip_prefix("metrics at http://").and_then(|a| a.strip_suffix("/metrics"));
    let mut stream = TcpStream::connect(address.unwrap()).unwrap();
    stream.write_all(b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n").unwrap();
    let mut said = String::new();
    stream.read_to_string(&mut said).unwrap();
    let (head, body) = said.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 200 OK") && head.contains("version=0.0.4"), "{head}");
    let over_socket = served.ask(&value!({"command": "metrics"}));
    assert_eq!(over_socket["metrics"].as_str().unwrap().lines().count(), body.lines().count());

    let (mut family, mut kind, mut counted, mut last) = (String::new(), String::new(), 0, 0.0);
    for line in body.lines() {
        if let Some(help) = line.strip_prefix("# HELP ") {
            family = help.split(' ').next().unwrap().to_owned();
            continue;
        }
        if let Some(of) = line.strip_prefix("# TYPE ") {
            kind = of.strip_prefix(&format!("{family} ")).unwrap_or_else(|| panic!("{line}")).to_owned();
            assert!(matches!(kind.as_str(), "counter" | "gauge" | "histogram"), "{line}");
            continue;
        }
        let (name, sample) = check_sample(line);
        let suffix = name.strip_prefix(&family).unwrap_or_else(|| panic!("{line} in family {family}"));
        match (kind.as_str(), suffix) {
            ("counter", "") => assert!(family.ends_with("_total") && sample >= 0.0, "{line}"),
            ("gauge", "") | ("histogram", "_sum") => {}
            // Buckets are cumulative, and the last one is the count.
            ("histogram", "_bucket") => {
                assert!(sample >= last || line.contains("le=\"0.0001\""), "{line} after {last}");
                last = sample;
            }
            ("histogram", "_count") => assert_eq!(sample, last, "{line}"),
            _ => panic!("{line} is no sample of a {kind}"),
        }
        if family == "fringecell_cycles_total" {
            counted += sample as u64;
        }
    }
    assert_eq!(counted, 2);
    served.stop();
}

#[test]
fn a_run_that_goes_by_itself_takes_no_jobs() {
    let cell = Cell::played("batch", 20.0, "");
    let run = cell.program("played.toml", &["--cycles", "3"]).spawn().unwrap();
    cell.until("at work", |status| status["state"] == "ContinuousExecution");
    let program = env!("CARGO_BIN_EXE_fringecell");
    let output = Command::new(program).args(["trigger", &cell.name, "--part", "1"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("fringecell run --serve"), "{}", text(&output.stderr));
    let trace = cell.small.path("live-trace.json");
    cell.until("past a cycle", |status| status["cycles_done"].as_u64() > Some(0));
    let output = Command::new(program).args(["status", &cell.name, "--trace", &trace]).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let trace = json(trace.as_ref());
    let events = trace["traceEvents"].as_array().unwrap();
    assert!(events.len() > 50);
    assert!(events.iter().any(|e| e["cat"] == "cycle" && e["name"] == "cycle 1: ok"), "{trace}");
    let output = wait(run);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let result = json(&cell.out().join("result.json"));
    for stage in result["stages"].as_array().unwrap() {
        for key in ["activations", "cpu_ns"] {
            assert!(stage[key].as_u64().unwrap() > 0, "{key}: {stage}");
        }
    }
    let capture = &result["stages"][1];
    assert_eq!(capture["bytes"], 19 * 168 * 112, "{capture}");
}
