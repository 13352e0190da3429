//! A cell on several computers: hosts of their own runtime folders on one machine, joined by iceoryx2's link over TCP.

#[path = "../../shared/ipc/tests/late/mod.rs"]
mod late;
mod network;
mod plans;

use crate::running::{PATIENCE, is_alive, json, signal, text, wait};
use crate::support::{SMALL_PX, root};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The hosts of the tests, the one that leads first.
const HOSTS: [&str; 3] = ["left", "right", "back"];

/// A cell with a pair on each of two or three hosts.
struct Cell {
    folder: TempDir,
    name: String,
    hosts: usize,
}

/// A host that runs.
struct Host {
    name: String,
    child: Option<Child>,
}

impl Cell {
    fn new(name: &str, hosts: usize, limits: &str) -> Self {
        let folder = TempDir::new().unwrap();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let config = configuration(hosts, limits, &format!("127.0.0.1:{port}"));
        let cell = Self { folder, name: format!("h-{name}-{}", std::process::id()), hosts };
        cell.write("cell.toml", &config);
        let rig = twin::thesis::rig_of_sides(4, SMALL_PX.0, SMALL_PX.1);
        files::rig_file::write_rig(&cell.path("rig.toml"), &rig, &toml::Table::new(), None).unwrap();
        let scene = root().join("configs/complex-artefact.scene.toml");
        std::fs::copy(scene, cell.path("complex-artefact.scene.toml")).unwrap();
        cell
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    fn command(&self, host: Option<&str>, config: &str, more: &[&str]) -> Command {
        let mut command = Command::new("env");
        command.args(["--default-signal", env!("CARGO_BIN_EXE_fringecell"), "run"]);
        command.arg(self.path(config)).args(["--cell", &self.name]);
        let out = self.path(&format!("out-{}", host.unwrap_or("alone")));
        command.arg("--out").arg(out).args(more).stdout(Stdio::piped()).stderr(Stdio::piped());
        if let Some(host) = host {
            command.args(["--host", host]);
        }
        command
    }

    fn start(&self, host: &str, more: &[&str]) -> Host {
        self.start_with(host, "cell.toml", more, &[])
    }

    fn start_with(&self, host: &str, config: &str, more: &[&str], environment: &[(&str, &str)]) -> Host {
        let mut command = self.command(Some(host), config, more);
        command.envs(environment.iter().copied());
        Host { name: host.to_owned(), child: Some(command.spawn().unwrap()) }
    }

    /// All hosts but the first.
    fn followers(&self) -> Vec<Host> {
        HOSTS[1..self.hosts].iter().map(|host| self.start(host, &[])).collect()
    }

    fn results(&self, host: &str) -> Vec<Value> {
        let folder = self.path(&format!("out-{host}")).join("results");
        let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
            .map_or(Vec::new(), |entries| entries.map(|e| e.unwrap().path()).collect());
        // One that is being written has another name, and is gone when it is read.
        paths.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
        paths.sort();
        paths.iter().filter(|path| path.exists()).map(|path| json(path)).collect()
    }

    fn outcomes(&self, host: &str) -> Vec<String> {
        self.results(host).iter().map(|result| result["outcome"].as_str().unwrap().to_owned()).collect()
    }

    /// Waits until a host has so many outcomes that are ok.
    fn until_ok(&self, host: &str, count: usize) {
        let begin = Instant::now();
        while self.outcomes(host).iter().filter(|outcome| *outcome == "ok").count() < count {
            assert!(begin.elapsed() < PATIENCE, "{host}: {:?}", self.outcomes(host));
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits until a host has an outcome that contains a text.
    fn until_outcome(&self, host: &str, part: &str) {
        let begin = Instant::now();
        while !self.outcomes(host).iter().any(|outcome| outcome.contains(part)) {
            assert!(begin.elapsed() < PATIENCE, "{host}: {part}: {:?}", self.outcomes(host));
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Hashes of a cycle on one computer.
    fn alone(&self, cycles: usize) -> Vec<Value> {
        let ran = wait(self.command(None, "cell.toml", &["--cycles", &cycles.to_string()]).spawn().unwrap());
        assert_eq!(ran.status.code(), Some(0), "{}", text(&ran.stderr));
        self.results("alone").into_iter().map(|result| result["hashes"].clone()).collect()
    }

    /// What two hosts have in shared memory after their end.
    fn left(&self) -> Vec<String> {
        let entries = std::fs::read_dir("/dev/shm").unwrap().filter_map(Result::ok);
        let prefixes: Vec<String> = HOSTS[..self.hosts]
            .iter()
            .map(|host| ipc::cell::CellName::new(&format!("{}-{host}", self.name)).unwrap().prefix())
            .collect();
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
        names
            .filter(|name| name.contains(&self.name) || prefixes.iter().any(|p| name.starts_with(p)))
            .collect()
    }
}

impl Host {
    fn pid(&self) -> u64 {
        self.child.as_ref().map_or(0, |child| u64::from(child.id()))
    }

    fn send(&self, what: &str) {
        signal(what, self.pid());
    }

    /// Ends a host; its exit code and what it said.
    fn stop(mut self) -> (Option<i32>, String) {
        self.send("TERM");
        self.end()
    }

    fn end(&mut self) -> (Option<i32>, String) {
        let output = wait(self.child.take().unwrap());
        (output.status.code(), format!("{}{}", text(&output.stdout), text(&output.stderr)))
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let output = child.wait_with_output().unwrap();
            eprintln!("host {}:\n{}{}", self.name, text(&output.stdout), text(&output.stderr));
        }
    }
}

fn configuration(hosts: usize, limits: &str, address: &str) -> String {
    let mut text = format!(
        "format = \"fringecell-config/1\"\nname = \"several\"\nrig = \"rig.toml\"\npairs = [{}]\n[limits]\n{limits}\n",
        (1..=hosts).map(|n| format!("\"pair{n}\"")).collect::<Vec<_>>().join(", ")
    );
    for side in 1..=hosts {
        let (first, second) = (2 * side - 1, 2 * side);
        let _ = write!(
            text,
            "[[projector]]\nname = \"proj{side}\"\ndriver = \"twin\"\nwidth_px = 608\nheight_px = 684\n\
             cameras = [\"cam{first}\", \"cam{second}\"]\nsequence = [{{ set = \"sine\", axis = \"x\", period_px = 16.0, \
             steps = 4 }}, {{ set = \"gray\", axis = \"x\", bits = 7, stripe_px = 8.0 }}, {{ set = \"white\" }}, \
             {{ set = \"black\" }}]\n\
             [[camera]]\nname = \"cam{first}\"\ndriver = \"twin\"\n[[camera]]\nname = \"cam{second}\"\ndriver = \"twin\"\n"
        );
    }
    for (number, host) in HOSTS[..hosts].iter().enumerate() {
        let listen = if number == 0 { format!("listen = \"{address}\"\n") } else { String::new() };
        let _ = write!(text, "[[host]]\nname = \"{host}\"\npairs = [\"pair{}\"]\n{listen}", number + 1);
    }
    text + "[twin]\nscene = \"complex-artefact.scene.toml\"\nseed = 1\n"
}

/// Patient enough for a machine that does ten other things.
const LIMITS: &str =
    "silence_ms = 3000\nstage_budget_ms = 30000\ncycle_deadline_ms = 60000\nstart_ms = 60000";

/// The hashes of a cycle on all hosts together; those of each host are also the ones of one computer.
fn check_hashes(cell: &Cell, cycle: usize, alone: &Value) {
    let mut together = BTreeMap::new();
    for host in &HOSTS[..cell.hosts] {
        let results = cell.results(host);
        let result = results
            .iter()
            .find(|result| result["cycle"] == cycle)
            .unwrap_or_else(|| panic!("host {host} has no cycle {cycle}: {:?}", cell.outcomes(host)));
        assert_eq!(result["outcome"], "ok", "{host}");
        for (output, hash) in result["hashes"].as_object().unwrap() {
            let before = together.insert(output.clone(), hash.clone());
            assert!(before.is_none_or(|before| before == *hash), "{host}: {output}");
        }
    }
    let alone: BTreeMap<String, Value> = alone.as_object().unwrap().clone().into_iter().collect();
    assert_eq!(together, alone, "cycle {cycle}");
}

fn runs_like_one(name: &str, hosts: usize) {
    let cell = Cell::new(name, hosts, LIMITS);
    let alone = cell.alone(2);
    let followers = cell.followers();
    let (code, said) = cell.start("left", &["--cycles", "2"]).end();
    assert_eq!(code, Some(0), "{said}");
    for follower in followers {
        let (code, said) = follower.stop();
        assert_eq!(code, Some(0), "{said}");
    }
    for (cycle, hashes) in alone.iter().enumerate() {
        check_hashes(&cell, cycle, hashes);
    }
    let result = &cell.results("left")[1];
    assert!(result["reports"]["cloud/pair2"]["chunks"].as_u64().unwrap() > 0, "{result}");
    assert_eq!(cell.left(), Vec::<String>::new());
}

/// Proves: frames, phases, clouds, fused cloud and result of two hosts have the hashes of one computer, and nothing is left of them.
#[test]
#[cfg_attr(
    not(feature = "hosts"),
    ignore = "needs the link: cargo test --features hosts --test main several_hosts"
)]
fn two_hosts_give_the_hashes_of_one_computer() {
    runs_like_one("two", 2);
}

/// Proves: so have three hosts.
#[test]
#[cfg_attr(
    not(feature = "hosts"),
    ignore = "needs the link: cargo test --features hosts --test main several_hosts"
)]
fn three_hosts_give_the_hashes_of_one_computer() {
    runs_like_one("three", 3);
}

/// Proves: chunks that are lost, doubled and late change no byte; the report counts what was asked for again.
#[test]
#[cfg_attr(
    not(feature = "hosts"),
    ignore = "needs the link: cargo test --features hosts --test main several_hosts"
)]
fn chunks_that_are_lost_doubled_and_late_change_no_byte() {
    let cell = Cell::new("chunks", 2, LIMITS);
    // A cloud is one chunk here, and every fifth has a fault: each of them once at least.
    let cycles = 22;
    let alone = cell.alone(cycles);
    let drill = [("FRINGECELL_LINK_DRILL", "lose,double,delay")];
    let follower = cell.start_with("right", "cell.toml", &[], &drill);
    let (code, said) = cell.start("left", &["--cycles", &cycles.to_string()]).end();
    assert_eq!(code, Some(0), "{said}");
    follower.stop();
    for (cycle, hashes) in alone.iter().enumerate() {
        check_hashes(&cell, cycle, hashes);
    }
    let repeated = |result: &Value| result["reports"]["cloud/pair2"]["repeated"].as_u64().unwrap();
    let doubled = |result: &Value| result["reports"]["cloud/pair2"]["doubled"].as_u64().unwrap();
    let results = cell.results("left");
    assert!(results.iter().map(repeated).sum::<u64>() > 0, "{results:?}");
    assert!(results.iter().map(doubled).sum::<u64>() > 0, "{results:?}");
}

/// Proves: a host that dies in a cycle is its outcome, by name; the host comes back and the cell goes on by itself. The cell that leads
/// dies and comes back, too, and counts from 1 again.
#[test]
#[cfg_attr(
    not(feature = "hosts"),
    ignore = "needs the link: cargo test --features hosts --test main several_hosts"
)]
fn a_host_that_dies_is_an_outcome_and_comes_back() {
    let limits = "silence_ms = 1500\nstage_budget_ms = 4000\ncycle_deadline_ms = 60000\nstart_ms = 60000\nrestarts_max = 100";
    let cell = Cell::new("dies", 2, limits);
    let mut right = cell.start("right", &[]);
    let left = cell.start("left", &[]);
    cell.until_ok("left", 1);
    right.send("KILL");
    right.end();
    cell.until_outcome("left", "host \"right\"");
    let right = cell.start("right", &[]);
    let before = cell.outcomes("left").iter().filter(|outcome| *outcome == "ok").count();
    cell.until_ok("left", before + 2);
    let lost = cell.outcomes("left").into_iter().find(|outcome| outcome != "ok").unwrap();
    assert!(lost.contains("no sign of life of host \"right\"") || lost.contains("started again"), "{lost}");
    // A host that stands still is as good as dead, and goes on where it stood.
    right.send("STOP");
    let failed = |cell: &Cell| cell.outcomes("left").iter().filter(|outcome| *outcome != "ok").count();
    let (begin, count) = (Instant::now(), failed(&cell));
    let stages: Vec<u64> = crate::running::children(right.pid() as u32);
    for pid in &stages {
        crate::running::poke("STOP", *pid);
    }
    while failed(&cell) == count {
        assert!(begin.elapsed() < PATIENCE);
        std::thread::sleep(Duration::from_millis(20));
    }
    for pid in &stages {
        crate::running::poke("CONT", *pid);
    }
    right.send("CONT");
    let ok = cell.outcomes("left").iter().filter(|outcome| *outcome == "ok").count();
    cell.until_ok("left", ok + 1);
    let (_, said) = left.stop();
    assert!(is_alive(right.pid()), "{said}");
    // Another run that leads.
    let (code, said) = cell.start("left", &["--cycles", "2"]).end();
    assert_eq!(code, Some(0), "{said}");
    let (_, said) = right.stop();
    assert!(said.contains("this host begins anew"), "{said}");
    let results = cell.results("left");
    assert_eq!(results.iter().map(|r| r["number"].as_u64().unwrap()).collect::<Vec<_>>(), [1, 2]);
}

/// Proves: a second host of one name and a second leader are refused by name, another configuration by the name of its file; what was
/// there goes on.
#[test]
#[cfg_attr(
    not(feature = "hosts"),
    ignore = "needs the link: cargo test --features hosts --test main several_hosts"
)]
fn second_hosts_and_other_configurations_are_refused_by_name() {
    let limits = "silence_ms = 1500\nstage_budget_ms = 4000\ncycle_deadline_ms = 60000\nstart_ms = 8000\nrestarts_max = 0";
    let cell = Cell::new("second", 2, limits);
    // The same rig in another file is another configuration.
    let other = std::fs::read_to_string(cell.path("rig.toml")).unwrap() + "\n# edited\n";
    cell.write("other-rig.toml", &other);
    let config = std::fs::read_to_string(cell.path("cell.toml")).unwrap();
    std::fs::create_dir(cell.path("elsewhere")).unwrap();
    for name in ["cell.toml", "complex-artefact.scene.toml"] {
        std::fs::copy(cell.path(name), cell.path("elsewhere").join(name)).unwrap();
    }
    std::fs::write(cell.path("elsewhere/rig.toml"), other).unwrap();
    assert!(!config.is_empty());
    let stranger = cell.start_with("right", "elsewhere/cell.toml", &[], &[]);
    let (code, said) = cell.start("left", &["--cycles", "1"]).end();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("rig.toml is another file on host \"right\""), "{said}");
    stranger.stop();
    let right = cell.start("right", &[]);
    let left = cell.start("left", &[]);
    cell.until_ok("left", 1);
    // A second process of the same host on one machine.
    let runtime = format!("/dev/shm/fringecell-{}-right", cell.name);
    assert!(Path::new(&runtime).exists());
    let output = wait(cell.command(None, "cell.toml", &["--host", "right"]).spawn().unwrap());
    assert_eq!(output.status.code(), Some(2), "one machine: the lock refuses it");
    assert!(text(&output.stderr).contains("already running"), "{}", text(&output.stderr));
    let ok = cell.outcomes("left").iter().filter(|outcome| *outcome == "ok").count();
    cell.until_ok("left", ok + 1);
    left.stop();
    right.stop();
}
