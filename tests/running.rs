//! How the tests run a cell, look at it, and harm it.

use crate::support::Small;
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Long enough for a machine that does ten other things.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// A cell of its own name, so that tests run side by side.
pub struct Cell {
    pub small: Small,
    pub name: String,
}

impl Cell {
    pub fn new(name: &str) -> Self {
        Self { small: Small::new(), name: format!("t-{name}-{}", std::process::id()) }
    }

    /// Plays the small recording instead of looking at the twin: `rate_hz` frames per second, again and again.
    pub fn played(name: &str, rate_hz: f64, limits: &str) -> Self {
        let cell = Self::new(name);
        let text = format!(
            "format = \"fringecell-config/1\"\nname = \"played\"\nrig = \"rig.toml\"\npairs = [\"pair1\"]\n\
             [limits]\n{limits}\n\
             [[projector]]\nname = \"proj1\"\ndriver = \"recording\"\n\
             [[camera]]\nname = \"cam1\"\ndriver = \"recording\"\n\
             [[camera]]\nname = \"cam2\"\ndriver = \"recording\"\n\
             [recording]\npath = \"rec\"\nrate_hz = {rate_hz:?}\nloop = true\n"
        );
        std::fs::write(cell.small.folder.path().join("played.toml"), text).unwrap();
        cell
    }

    /// The played configuration once more, with a schedule of its own.
    pub fn schedule(&self, file: &str, schedule: &str) {
        let config = std::fs::read_to_string(self.small.path("played.toml")).unwrap();
        std::fs::write(self.small.path(file), format!("{config}[schedule]\n{schedule}\n")).unwrap();
    }

    pub fn program(&self, config: &str, more: &[&str]) -> Command {
        // Signals that the caller ignores, as `nohup` does, would stay ignored.
        let mut program = Command::new("env");
        program.args(["--default-signal", env!("CARGO_BIN_EXE_fringecell")]);
        program.args([
            "run",
            &self.small.path(config),
            "--cell",
            &self.name,
            "--out",
            &self.small.path("out"),
        ]);
        program.args(more).stdout(Stdio::piped()).stderr(Stdio::piped());
        program
    }

    pub fn run(&self, config: &str, more: &[&str]) -> Output {
        wait(self.program(config, more).spawn().unwrap())
    }

    pub fn out(&self) -> PathBuf {
        self.small.folder.path().join("out")
    }

    pub fn status(&self) -> Option<Value> {
        let socket = ipc::cell::CellName::new(&self.name).unwrap().socket();
        let mut stream = UnixStream::connect(socket).ok()?;
        stream.set_read_timeout(Some(PATIENCE)).ok()?;
        stream.write_all(b"{\"command\":\"status\"}\n").ok()?;
        let mut line = String::new();
        BufReader::new(stream).read_line(&mut line).ok()?;
        let answer: Value = serde_json::from_str(&line).ok()?;
        answer.get("status").cloned()
    }

    /// Waits until the cell states what is asked for.
    pub fn until(&self, what: &str, test: impl Fn(&Value) -> bool) -> Value {
        let begin = Instant::now();
        loop {
            if let Some(status) = self.status().filter(|status| test(status)) {
                return status;
            }
            assert!(begin.elapsed() < PATIENCE, "the cell never was: {what}; last: {:?}", self.status());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Waits until a cycle has just begun, so that what is done to it now is done to a running cycle.
    pub fn until_a_cycle_begins(&self) -> Value {
        let done = |status: &Value| status["cycles_done"].as_u64().unwrap_or(0);
        let before = done(&self.until("running", |status| status["cycle"].is_u64()));
        self.until("in the next cycle", |status| status["cycle"].is_u64() && done(status) > before)
    }

    /// Names in shared memory that belong to the cell.
    pub fn left(&self) -> Vec<String> {
        let prefix = ipc::cell::CellName::new(&self.name).unwrap().prefix();
        let entries = std::fs::read_dir("/dev/shm").unwrap().filter_map(Result::ok);
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
        names.filter(|name| name.contains(&self.name) || name.starts_with(&prefix)).collect()
    }
}

pub fn wait(mut child: Child) -> Output {
    let begin = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if begin.elapsed() > PATIENCE {
            child.kill().unwrap();
            panic!("the program did not end: {:?}", child.wait_with_output());
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    child.wait_with_output().unwrap()
}

pub fn signal(name: &str, pid: u64) {
    assert!(Command::new("kill").args([format!("-{name}"), pid.to_string()]).status().unwrap().success());
}

/// A zombie that nobody reaps does not count.
pub fn is_alive(pid: u64) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit(')').next().is_some_and(|rest| !rest.trim().is_empty() && !rest.trim_start().starts_with('Z'))
}

pub fn pid_of(status: &Value, stage: &str) -> u64 {
    let stages = status["stages"].as_array().unwrap();
    stages.iter().find(|s| s["name"] == stage).and_then(|s| s["pid"].as_u64()).expect(stage)
}

pub fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

pub fn results(folder: &Path) -> Vec<Value> {
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder.join("results")).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let result = |path: &PathBuf| {
        crate::schema::assert_valid("result", path);
        json(path)
    };
    paths.iter().map(result).collect()
}

/// Requested cycles that were never started, as the run printed them.
pub fn not_run(output: &Output) -> usize {
    let said = text(&output.stdout);
    let count = |line: &str| line.split_once(" not run: ")?.0.split(' ').next()?.parse().ok();
    said.lines().find_map(count).unwrap_or(0)
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The stages of a supervisor, whether they have joined the cell yet or not.
pub fn children(supervisor: u32) -> Vec<u64> {
    let path = format!("/proc/{supervisor}/task/{supervisor}/children");
    let listed = std::fs::read_to_string(path).unwrap_or_default();
    listed.split_whitespace().filter_map(|pid| pid.parse().ok()).collect()
}

/// A signal to a process that may be gone already.
pub fn poke(name: &str, pid: u64) {
    let done = Command::new("kill").args([format!("-{name}"), pid.to_string()]).output();
    assert!(done.is_ok());
}

/// The hashes of all cycles of a run, which must be the same for all of them.
pub fn hashes(cell: &Cell, cycles: usize) -> Value {
    let results = results(&cell.out());
    assert_eq!(results.len(), cycles);
    for result in &results {
        assert_eq!(result["outcome"], "ok", "{result}");
        assert_eq!(result["hashes"], results[0]["hashes"], "cycle {}", result["cycle"]);
    }
    results[0]["hashes"].clone()
}

/// Numbers that look random and are the same every time (Marsaglia, "Xorshift RNGs", 2003).
pub struct Dice(pub u64);

impl Dice {
    pub fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }

    pub fn pause(&mut self, limit_ms: u64) {
        std::thread::sleep(Duration::from_micros(self.below(1000 * limit_ms)));
    }
}
