//! A panic in any process of a cell is an outcome: it is named, the cell goes on where it can, and nothing is left over.

use crate::running::{Cell, not_run, results, signal, text, wait};
use std::path::PathBuf;
use std::process::{Child, Command};

/// Frames per second where a request must come within its cycle, also on a machine that does ten other things.
const SLOW_HZ: f64 = 20.0;

/// A played cell whose processes panic on request.
struct Drill {
    cell: Cell,
    requests: PathBuf,
}

impl Drill {
    fn new(name: &str, rate_hz: f64) -> Self {
        let cell = Cell::played(name, rate_hz, "");
        let requests = cell.small.folder.path().join("requests");
        std::fs::create_dir(&requests).unwrap();
        Self { cell, requests }
    }

    fn start(&self, more: &[&str]) -> Child {
        let mut program = self.cell.program("played.toml", more);
        program.env("FRINGECELL_PANIC_DRILL", &self.requests).spawn().unwrap()
    }

    fn request(&self, process: &str) {
        std::fs::write(self.requests.join(process.replace('/', "-")), "").unwrap();
    }
}

/// Proves: a panic of each stage ends its cycle with the place and the words of the panic; the next cycles are ok.
#[test]
fn a_panic_of_each_stage_is_an_outcome_and_the_cell_goes_on() {
    let drill = Drill::new("panics", 100.0);
    let recording = drill.cell.small.path("recorded");
    let run = drill.start(&["--record", &recording]);
    let ok = |status: &serde_json::Value| status["cycles_ok"].as_u64().unwrap_or(0);
    let status = drill.cell.until("at work", |status| ok(status) > 0);
    let stages: Vec<String> = status["stages"]
        .as_array()
        .unwrap()
        .iter()
        .map(|stage| stage["name"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(stages.len(), 9, "{stages:?}");
    for (number, stage) in stages.iter().enumerate() {
        drill.request(stage);
        let ended = drill.cell.until("past the panic", |status| status["stages"][number]["restarts"] == 1);
        let again = drill.cell.until("at work again", |status| ok(status) > ok(&ended));
        // A panic costs one cycle; to wait for this count would be to wait in vain where another one failed as well.
        assert_eq!(again["outcomes"]["not_ok"], number + 1, "{again}");
    }
    signal("TERM", run.id().into());
    let output = wait(run);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let results = results(&drill.cell.out());
    let panicked = |stage: &String| {
        let begin = format!("stage {stage} ended (exit code 101): thread 'main'");
        let is_this = |outcome: &str| {
            outcome.starts_with(&begin)
                && outcome.contains("panicked at processes/panic_drill.rs")
                && outcome.ends_with("a panic was requested")
        };
        results.iter().filter(|result| is_this(result["outcome"].as_str().unwrap())).count()
    };
    let counts: Vec<usize> = stages.iter().map(panicked).collect();
    let outcomes: Vec<_> = results.iter().map(|result| &result["outcome"]).collect();
    assert_eq!(counts, vec![1; stages.len()], "{outcomes:?}");
    let good: Vec<_> = results.iter().filter(|result| result["outcome"] == "ok").collect();
    assert!(good.iter().all(|result| result["hashes"] == good[0]["hashes"]));
    assert_eq!(drill.cell.left(), Vec::<String>::new());
}

/// Proves: after a panic of the supervisor every requested cycle is accounted for, every client has an answer, and no process
/// and no shared memory is left.
#[test]
fn a_panic_of_the_supervisor_is_the_outcome_of_its_cycle() {
    let drill = Drill::new("panicked", SLOW_HZ);
    let run = drill.start(&["--cycles", "50"]);
    let status = drill.cell.until_a_cycle_begins();
    let stages: Vec<u64> =
        status["stages"].as_array().unwrap().iter().filter_map(|stage| stage["pid"].as_u64()).collect();
    drill.request("supervisor");
    let output = wait(run);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("panic: a panic was requested"), "{said}");
    let results = results(&drill.cell.out());
    assert_eq!(results.len() + not_run(&output), 50, "{}", text(&output.stdout));
    assert_eq!(
        results.last().unwrap()["outcome"],
        "the supervisor failed: panic: a panic was requested",
        "{said}"
    );
    assert!(!stages.into_iter().any(crate::running::is_alive), "a stage outlives its supervisor");
    assert_eq!(drill.cell.left(), Vec::<String>::new());
}

#[test]
fn a_client_of_a_supervisor_that_panics_has_its_answer() {
    let drill = Drill::new("asked", SLOW_HZ);
    let run = drill.start(&["--serve"]);
    drill.cell.until("ready", |status| status["state"] == "Ready");
    let trigger = ["trigger", &drill.cell.name, "--part", "1", "--json", "-"];
    let mut asked = Command::new(env!("CARGO_BIN_EXE_fringecell"));
    let asked = asked.args(trigger).stdout(std::process::Stdio::piped()).spawn().unwrap();
    drill.cell.until("in its cycle", |status| status["cycle"].is_u64());
    drill.request("supervisor");
    let answer = wait(asked);
    assert_eq!(answer.status.code(), Some(1));
    assert!(text(&answer.stdout).contains("the supervisor failed: panic"), "{}", text(&answer.stdout));
    assert_eq!(wait(run).status.code(), Some(2));
    assert_eq!(drill.cell.left(), Vec::<String>::new());
}
