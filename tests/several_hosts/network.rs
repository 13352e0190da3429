//! Hosts in network namespaces of their own, joined by cables that can be pulled. They need root.

use super::{Cell, HOSTS, Host, check_hashes, late};
use crate::running::{Dice, text, wait};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

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

    /// Programs at both ends of each cable that carry what the hosts tell each other, and delay it; they end when dropped.
    fn delay(&self, words: &str) -> Vec<Relay> {
        let ends = |number: usize| {
            let name = &self.names[number];
            // The host finds the program beside it where it looks for the one that leads.
            ip(&format!("-n {name} addr add {MIDDLE}/32 dev lo"));
            let (here, there) = (format!("{MIDDLE}:7447"), format!("10.77.{number}.1:7447"));
            [Relay::start(&self.names[0], &there, &here, words), Relay::start(name, &here, &there, words)]
        };
        (1..self.names.len()).flat_map(ends).collect()
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

/// A program that carries connections from one address to another.
struct Relay(Child);

impl Relay {
    /// `words`: delay and its scatter, ms, and of how many pieces one is stopped for how long, ms.
    fn start(space: &str, listen: &str, connect: &str, words: &str) -> Self {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", space]).arg(std::env::current_exe().unwrap());
        command.args(["--exact", "several_hosts::network::relay", "--ignored", "--nocapture"]);
        command.env(RELAY, format!("{listen} {connect} {words}")).stdout(Stdio::null());
        Self(command.spawn().unwrap())
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Tells the program of [`Relay`] its addresses and delays.
const RELAY: &str = "FRINGECELL_TEST_RELAY";

/// Delays and their scatter, and pieces that are held up as TCP holds them up after a loss.
#[derive(Debug, Clone, Copy)]
struct Slow {
    delay: Duration,
    scatter_ms: u64,
    one_of: u64,
    stop: Duration,
}

impl Slow {
    /// How much later the next piece arrives.
    fn next(&self, dice: &mut Dice) -> Duration {
        let stop = if dice.below(self.one_of) == 0 { self.stop } else { Duration::ZERO };
        self.delay + Duration::from_millis(dice.below(self.scatter_ms + 1)) + stop
    }
}

#[test]
#[ignore = "is the program between both ends of a cable, which other tests start: cargo test --features hosts --test main namespaces -- --ignored"]
fn relay() {
    let Ok(words) = std::env::var(RELAY) else { return };
    let words: Vec<&str> = words.split(' ').collect();
    let [listen, connect, numbers @ ..] = words.as_slice() else { panic!("{words:?}") };
    let numbers: Vec<u64> = numbers.iter().map(|word| word.parse().unwrap()).collect();
    let ms = Duration::from_millis;
    let slow =
        Slow { delay: ms(numbers[0]), scatter_ms: numbers[1], one_of: numbers[2], stop: ms(numbers[3]) };
    for near in TcpListener::bind(listen).unwrap().incoming().flatten() {
        let Ok(far) = connect.parse().map(|to| TcpStream::connect_timeout(&to, ms(2000))).unwrap() else {
            continue;
        };
        for (seed, from, to) in [(3, &near, &far), (5, &far, &near)] {
            to.set_nodelay(true).unwrap();
            let mut dice = Dice(seed);
            late::carry(from.try_clone().unwrap(), to.try_clone().unwrap(), move || slow.next(&mut dice));
        }
    }
}

/// Runs a cell, pulls a cable and puts it in again; `slow`: what the programs of [`Network::delay`] are told.
fn in_namespaces(name: &str, hosts: usize, slow: Option<&str>) {
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
    let _relays = slow.map(|words| network.delay(words));
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
    in_namespaces("ns2", 2, None);
}

/// Proves: so do three hosts.
#[test]
#[ignore = "needs root: cargo test --features hosts --test main namespaces -- --ignored --nocapture"]
fn three_namespaces_lose_a_cable_and_go_on() {
    in_namespaces("ns3", 3, None);
}

/// Proves: so do two hosts over a cable that delays everything by 20 to 30 ms each way at each end, and holds up one piece of a hundred for
/// 200 ms, as a loss does.
#[test]
#[ignore = "needs root: cargo test --features hosts --test main namespaces -- --ignored --nocapture"]
fn two_namespaces_with_a_slow_cable_lose_it_and_go_on() {
    in_namespaces("slow", 2, Some("20 10 100 200"));
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
