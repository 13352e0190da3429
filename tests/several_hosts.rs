//! A cell on several computers: hosts of their own runtime folders on one machine, joined by iceoryx2's link over TCP.

use crate::running::{PATIENCE, is_alive, json, signal, text, wait};
use crate::support::{SMALL_PX, fringecell_in, root};
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
        paths.sort();
        paths.iter().map(|path| json(path)).collect()
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

/// Proves: chunks that are lost, doubled, late and damaged change no byte; the report counts what was asked for again.
#[test]
#[cfg_attr(
    not(feature = "hosts"),
    ignore = "needs the link: cargo test --features hosts --test main several_hosts"
)]
fn chunks_that_are_lost_doubled_late_and_damaged_change_no_byte() {
    let cell = Cell::new("chunks", 2, LIMITS);
    let alone = cell.alone(1);
    let drill = [("FRINGECELL_LINK_DRILL", "lose,double,delay,damage")];
    let follower = cell.start_with("right", "cell.toml", &[], &drill);
    let (code, said) = cell.start("left", &["--cycles", "6"]).end();
    assert_eq!(code, Some(0), "{said}");
    follower.stop();
    check_hashes(&cell, 0, &alone[0]);
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

/// A change of the configuration and a part of the message that has to follow.
type Fault = (&'static str, &'static str, &'static str);

/// Proves: a configuration whose hosts cannot work is refused with file, key and remedy.
#[test]
fn hosts_that_cannot_work_are_refused() {
    let cell = Cell::new("refused", 2, "");
    let good = std::fs::read_to_string(cell.path("cell.toml")).unwrap();
    let schedule = |more: &[&str]| {
        let config = cell.path("cell.toml").display().to_string();
        let mut words = vec!["schedule", &config];
        words.extend(more);
        fringecell_in(cell.folder.path(), &words)
    };
    assert_eq!(schedule(&[]).code, Some(0));
    let listen = good.lines().find(|line| line.starts_with("listen")).unwrap().to_owned();
    let faults: [Fault; 10] = [
        ("[[host]]\nname = \"right\"\npairs = [\"pair2\"]", "", "2 … 16 tables [[host]]"),
        ("pairs = [\"pair2\"]", "pairs = [\"pair2\", \"pair1\"]", "it belongs to host \"left\", too"),
        ("pairs = [\"pair2\"]", "pairs = [\"pair9\"]", "pair9"),
        ("pairs = [\"pair2\"]", "pairs = []", "a pair of host \"right\""),
        ("name = \"right\"", "name = \"left\"", "left"),
        ("name = \"right\"", "name = \"Right\"", "host[1].name"),
        ("name = \"right\"", "name = \"a-name-that-is-too-long-for-it\"", "shorten one of them"),
        ("name = \"right\"", "name = \"right\"\nlisten = \"127.0.0.1:9\"", "one host leads"),
        ("LISTEN", "", "`listen` of the host that leads"),
        ("LISTEN", "listen = \"0.0.0.0:7447\"", "an IP address and a port"),
    ];
    for (from, to, part) in faults {
        let from = if from == "LISTEN" { listen.as_str() } else { from };
        assert!(good.contains(from), "{from}");
        cell.write("cell.toml", &good.replacen(from, to, 1));
        let ran = schedule(&[]);
        assert_eq!(ran.code, Some(2), "{}", ran.stdout);
        let named = ran.stderr.contains(part) && ran.stderr.contains("cell.toml");
        assert!(named, "{}\nlacks {part}", ran.stderr);
    }
    // A camera of both hosts, and cycles in flight.
    let shared =
        good.replacen("cameras = [\"cam3\", \"cam4\"]", "cameras = [\"cam3\", \"cam4\", \"cam1\"]", 1);
    cell.write("cell.toml", &shared);
    let ran = schedule(&[]);
    assert!(ran.stderr.contains("projector \"proj2\" belongs to host"), "{}", ran.stderr);
    cell.write("cell.toml", &format!("{good}[schedule]\ncycles_in_flight = 2\n"));
    assert!(schedule(&[]).stderr.contains("1 in a cell with [[host]]"));
    cell.write("cell.toml", &good);
    let ran = schedule(&["--host", "middle"]);
    assert!(
        ran.stderr.contains("no host \"middle\"") && ran.stderr.contains("left, right"),
        "{}",
        ran.stderr
    );
    let config = cell.path("cell.toml").display().to_string();
    let run = |more: &[&str]| fringecell_in(cell.folder.path(), &[&["run", &config], more].concat());
    for refused in [
        &["--host", "right", "--serve"][..],
        &["--host", "right", "--cycles", "1"],
        &["--host", "left", "--record", "rec"],
    ] {
        let ran = run(refused);
        assert!(ran.code == Some(2) && ran.stderr.contains("leave it out"), "{}", ran.stderr);
    }
    if !ipc::link::IS_BUILT_IN {
        let ran = run(&["--host", "left"]);
        assert!(ran.code == Some(2) && ran.stderr.contains("--features hosts"), "{}", ran.stderr);
    }
}

/// Proves: the schedule of each host has its own cameras and pairs only, all of them together those of one computer.
#[test]
fn the_schedules_of_the_hosts_divide_that_of_one_computer() {
    let cell = Cell::new("divide", 3, "");
    let config = cell.path("cell.toml").display().to_string();
    let plan = |host: Option<&str>| {
        let mut words = vec!["schedule", &config, "--json", "plan.json"];
        words.extend(host.iter().flat_map(|host| ["--host", host]));
        let ran = fringecell_in(cell.folder.path(), &words);
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        crate::schema::assert_valid("schedule", &cell.path("plan.json"));
        (json(&cell.path("plan.json")), ran.stdout)
    };
    let names = |plan: &Value, list: &str| -> Vec<String> {
        plan[list].as_array().unwrap().iter().map(|row| row["name"].as_str().unwrap().to_owned()).collect()
    };
    let (whole, said) = plan(None);
    assert!(said.contains("leads") && said.contains("1 Gbit/s"), "{said}");
    assert!(!names(&whole, "stages").contains(&"link".to_owned()));
    let mut stages: Vec<String> = Vec::new();
    for (number, host) in HOSTS.iter().enumerate() {
        let (plan, said) = plan(Some(host));
        assert!(said.contains("link to other hosts"), "{said}");
        let here = names(&plan, "stages");
        assert_eq!(here.contains(&"fusion".to_owned()), number == 0);
        assert_eq!(plan["hosts"][number]["here"], true);
        let topics = names(&plan, "topics");
        for camera in 1..=6 {
            let mine = (camera - 1) / 2 == number;
            assert_eq!(topics.contains(&format!("frame/cam{camera}")), mine, "{host}: frames stay");
        }
        stages.extend(here.into_iter().filter(|stage| stage != "link"));
    }
    stages.sort();
    stages.dedup();
    let mut expected = names(&whole, "stages");
    expected.sort();
    assert_eq!(stages, expected);
    let sent = |host: usize| whole["hosts"][host]["sent_bytes"].as_u64().unwrap();
    let pixels = u64::from(SMALL_PX.0) * u64::from(SMALL_PX.1);
    assert_eq!([sent(0), sent(1), sent(2)], [0, 56 * pixels, 56 * pixels]);
    // Two cameras, 13 frames of 8 bit.
    assert_eq!(whole["hosts"][1]["frame_bytes"], 2 * 13 * pixels);
}

/// Network namespaces joined by pairs of virtual cables, the first one in the middle. They need root.
struct Network {
    names: Vec<String>,
}

/// Address of the host that leads, in the middle.
const MIDDLE: &str = "10.77.0.1";

fn ip(words: &str) {
    let ran = Command::new("ip").args(words.split(' ')).output().unwrap();
    assert!(ran.status.success(), "ip {words}: {}", text(&ran.stderr));
}

impl Network {
    fn new(hosts: usize) -> Self {
        let names: Vec<String> = (0..hosts).map(|n| format!("fc{}n{n}", std::process::id())).collect();
        let network = Self { names };
        for name in &network.names {
            ip(&format!("netns add {name}"));
            ip(&format!("-n {name} link set lo up"));
        }
        ip(&format!("-n {} addr add {MIDDLE}/32 dev lo", network.names[0]));
        for (number, name) in network.names.iter().enumerate().skip(1) {
            let middle = &network.names[0];
            ip(&format!("-n {middle} link add c{number} type veth peer name c netns {name}"));
            ip(&format!("-n {middle} addr add 10.77.{number}.1/24 dev c{number}"));
            ip(&format!("-n {name} addr add 10.77.{number}.2/24 dev c"));
            ip(&format!("-n {middle} link set c{number} up"));
            ip(&format!("-n {name} link set c up"));
            ip(&format!("-n {name} route add {MIDDLE}/32 via 10.77.{number}.1"));
        }
        network
    }

    /// A queueing discipline in both directions of every cable; whether the kernel has it.
    fn impair(&self, discipline: &str) -> bool {
        let mut done = true;
        for (number, name) in self.names.iter().enumerate().skip(1) {
            for (space, device) in [(&self.names[0], format!("c{number}")), (name, "c".to_owned())] {
                let words = format!("netns exec {space} tc qdisc replace dev {device} root {discipline}");
                done &= Command::new("ip").args(words.split(' ')).output().unwrap().status.success();
            }
        }
        done
    }

    /// Pulls the cable of a host, or puts it in again.
    fn cable(&self, host: usize, is_in: bool) {
        let (name, state) = (&self.names[host], if is_in { "up" } else { "down" });
        ip(&format!("-n {name} link set c {state}"));
        if is_in {
            ip(&format!("-n {name} route replace {MIDDLE}/32 via 10.77.{host}.1"));
        }
    }

    fn start(&self, cell: &Cell, host: usize, more: &[&str]) -> Host {
        let inner = cell.command(Some(HOSTS[host]), "cell.toml", more);
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.names[host]]).arg(inner.get_program()).args(inner.get_args());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        Host { name: HOSTS[host].to_owned(), child: Some(command.spawn().unwrap()) }
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        for name in &self.names {
            let _ = Command::new("ip").args(["netns", "del", name]).status();
        }
    }
}

fn in_namespaces(name: &str, hosts: usize) {
    let limits = "silence_ms = 1500\nstage_budget_ms = 4000\ncycle_deadline_ms = 60000\nstart_ms = 60000\nrestarts_max = 100";
    let cell = Cell::new(name, hosts, limits);
    let config = std::fs::read_to_string(cell.path("cell.toml")).unwrap();
    let listen = config.lines().find(|line| line.starts_with("listen")).unwrap().to_owned();
    cell.write("cell.toml", &config.replace(&listen, &format!("listen = \"{MIDDLE}:7447\"")));
    let alone = cell.alone(1);
    let network = Network::new(hosts);
    if !network.impair("netem delay 5ms 2ms loss 0.5%") {
        // A short queue before a slow cable delays and loses packets as well.
        let slow = network.impair("tbf rate 100mbit burst 32k latency 5ms");
        eprintln!("this kernel has no netem; cables of 100 Mbit/s with a short queue: {slow}");
    }
    let others: Vec<Host> = (1..hosts).map(|host| network.start(&cell, host, &[])).collect();
    let left = network.start(&cell, 0, &[]);
    cell.until_ok("left", 1);
    network.cable(1, false);
    cell.until_outcome("left", "no sign of life of host \"right\"");
    network.cable(1, true);
    let ok = cell.outcomes("left").iter().filter(|outcome| *outcome == "ok").count();
    cell.until_ok("left", ok + 2);
    left.stop();
    for host in others {
        drop(host.stop());
    }
    check_hashes(&cell, 0, &alone[0]);
    eprintln!("{hosts} namespaces: {:?}", cell.outcomes("left"));
}

/// Proves: over cables between namespaces two hosts give the hashes of one computer; a pulled cable is an outcome, and when it is in
/// again the cell goes on.
#[test]
#[ignore = "needs root: cargo test --features hosts --test main namespaces -- --ignored --nocapture"]
fn two_namespaces_lose_their_cable_and_go_on() {
    in_namespaces("ns2", 2);
}

/// Proves: so do three hosts.
#[test]
#[ignore = "needs root: cargo test --features hosts --test main namespaces -- --ignored --nocapture"]
fn three_namespaces_lose_a_cable_and_go_on() {
    in_namespaces("ns3", 3);
}

/// Proves: a second host of one name and a second one that leads, each on what looks like another computer, are refused by name and end;
/// the first ones go on.
#[test]
#[ignore = "needs root: cargo test --features hosts --test main twins_of_a_host -- --ignored --nocapture"]
fn twins_of_a_host_are_refused_and_the_first_goes_on() {
    let limits = "silence_ms = 1500\nstage_budget_ms = 4000\ncycle_deadline_ms = 60000\nstart_ms = 60000\nrestarts_max = 0";
    let cell = Cell::new("twins", 2, limits);
    let right = cell.start("right", &[]);
    let left = cell.start("left", &[]);
    cell.until_ok("left", 1);
    let elsewhere = |host: &str| {
        let inner = cell.command(None, "cell.toml", &["--host", host]);
        let words: Vec<String> =
            inner.get_args().map(|word| word.to_string_lossy().replace("out-alone", "out-twin")).collect();
        let script = "mount -t tmpfs tmpfs /dev/shm && exec env \"$@\"";
        let mut command = Command::new("unshare");
        command.args(["--mount", "sh", "-c", script, "env"]).args(words);
        let output = wait(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap());
        (output.status.code(), text(&output.stderr))
    };
    let (code, said) = elsewhere("right");
    assert!(
        code == Some(1) && said.contains("another supervisor is host \"right\" of this cell already"),
        "{said}"
    );
    let (code, said) = elsewhere("left");
    assert!(code == Some(1) && said.contains("opening the link at"), "{said}");
    let ok = cell.outcomes("left").iter().filter(|outcome| *outcome == "ok").count();
    cell.until_ok("left", ok + 2);
    assert!(cell.outcomes("left").iter().all(|outcome| outcome == "ok"), "{:?}", cell.outcomes("left"));
    left.stop();
    right.stop();
}
