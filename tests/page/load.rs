//! Viewers, many and slow ones, and a monitor that dies or hangs: none of them costs a cycle or changes a byte.

use super::Page;
use super::http::{Events, connect, get_if};
use crate::running::{Cell, hashes, signal, wait};
use serde_json::json as value;
use std::io::{Read as _, Write as _};
use std::net::SocketAddr;
use std::thread::JoinHandle;
use std::time::Duration;

/// Resident memory of a process, MB.
fn resident_mb(pid: u64) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.trim().split(' ').next().unwrap().parse::<u64>().unwrap() / 1024
}

/// Proves: ten viewers who look at everything change no byte of any cycle.
#[test]
fn ten_viewers_change_no_byte() {
    viewed(12);
}

#[test]
#[ignore = "minutes, the short form always runs: cargo test --test main ten_viewers -- --ignored"]
fn ten_viewers_change_no_byte_of_500_cycles() {
    viewed(500);
}

/// A viewer that looks at everything until the cell ends; returns how much it saw.
fn look(at: SocketAddr) -> JoinHandle<usize> {
    std::thread::spawn(move || {
        let events = Events::open(at);
        let mut seen = 0;
        while let Some(scan) = events.next("scan") {
            let number = scan["number"].as_u64().unwrap();
            for path in [format!("/api/cloud/{number}"), format!("/api/picture/{number}/0/0/phase")] {
                seen += usize::from(get_if(at, &path).is_some_and(|answer| answer.status == 200));
            }
        }
        seen
    })
}

/// Prints the processor time of the monitor and of the supervisor per cycle, without and with viewers.
#[test]
#[ignore = "prints figures for docs/page.md: cargo test --test main processor_time_without -- --ignored --nocapture"]
fn processor_time_without_and_with_viewers() {
    const CYCLES: u64 = 60;
    for viewers in [0, 1, 10] {
        let page = Page::serving(&format!("cpu{viewers}"), &[]).ready();
        let monitor = page.monitor().unwrap();
        let looking: Vec<_> = (0..viewers).map(|_| look(page.address)).collect();
        let before = [monitor, page.run.id().into()].map(processor_ms);
        assert_eq!(page.command(&value!({"command": "start", "cycles": CYCLES})).status, 200);
        page.cell.until("done", |status| status["cycles_done"] == CYCLES && status["state"] == "Ready");
        let after = [monitor, page.run.id().into()].map(processor_ms);
        let idle = after[0];
        std::thread::sleep(Duration::from_secs(20));
        let idle = (processor_ms(monitor) - idle) / 20.0;
        let [monitor, supervisor] = [0, 1].map(|n| (after[n] - before[n]) / CYCLES as f64);
        println!(
            "{viewers} viewers: monitor {monitor:.1} ms a cycle, supervisor {supervisor:.1} ms; idle {idle:.1} ms a second"
        );
        page.stop();
        for viewer in looking {
            assert!(viewer.join().is_ok());
        }
    }
}

/// Processor time of a process with all its threads, ms.
pub fn processor_ms(pid: u64) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    [11, 12].iter().map(|at| fields[*at].parse::<f64>().unwrap() * 10.0).sum()
}

/// The hashes of cycles that ten viewers look at are those of cycles that nobody looks at.
fn viewed(cycles: usize) {
    viewed_beside(cycles, "viewed", |_| ());
}

/// The same beside others that look at the cell.
pub fn viewed_beside<T>(cycles: usize, name: &str, others: impl FnOnce(&Page) -> T) -> T {
    let alone = Cell::played(&format!("{name}-alone{cycles}"), 200.0, "");
    assert_eq!(alone.run("played.toml", &["--cycles", "2"]).status.code(), Some(0));
    let count = cycles.to_string();
    let page = Page::start(Cell::played(&format!("{name}{cycles}"), 200.0, ""), &["--cycles", &count]);
    let viewers: Vec<_> = (0..10).map(|_| look(page.address)).collect();
    let others = others(&page);
    let ended = wait(page.run);
    assert_eq!(ended.status.code(), Some(0), "{}", String::from_utf8_lossy(&ended.stderr));
    let seen: Vec<usize> = viewers.into_iter().map(|viewer| viewer.join().unwrap()).collect();
    assert!(seen.iter().sum::<usize>() > 10, "{seen:?}");
    assert_eq!(hashes(&page.cell, cycles), hashes(&alone, 2));
    others
}

/// Proves: a monitor that is killed, again and again, costs no cycle; it comes back at its address and knows what was.
#[test]
fn a_monitor_that_dies_or_hangs_costs_no_cycle() {
    let page = Page::start(Cell::played("killed", 100.0, ""), &["--cycles", "16"]);
    page.until("seen a cycle", |page| {
        page.get("/api/state").json()["history"].as_array().is_some_and(|h| !h.is_empty())
    });
    let first = page.monitor().unwrap();
    page.cell.until_a_cycle_begins();
    signal("KILL", first);
    page.until("started again", |page| page.monitor().is_some_and(|pid| pid != first));
    let state = page.get("/api/state").json();
    assert_eq!(state["cell"]["run"], page.run.id());
    page.until("told again", |page| {
        page.get("/api/state").json()["history"].as_array().is_some_and(|h| h.len() > 1)
    });
    // One that hangs takes no messages; the cycles go on.
    signal("STOP", page.monitor().unwrap());
    let ended = wait(page.run);
    assert_eq!(ended.status.code(), Some(0), "{}", String::from_utf8_lossy(&ended.stderr));
    hashes(&page.cell, 16);
    assert_eq!(page.cell.left(), Vec::<String>::new());
}

/// Proves: a monitor that panics costs no cycle either.
#[test]
fn a_monitor_that_panics_is_started_again() {
    let cell = Cell::played("panicked", 100.0, "");
    let drill = cell.small.folder.path().join("drill");
    std::fs::create_dir(&drill).unwrap();
    std::fs::write(drill.join("monitor"), "").unwrap();
    let mut program = cell.program("played.toml", &["--cycles", "12", "--page", "127.0.0.1:0"]);
    let mut run = program.env("FRINGECELL_PANIC_DRILL", &drill).spawn().unwrap();
    let address = super::address(&mut run, "page at http://");
    let page = Page { cell, run, address };
    let number = |page: &Page| Some(get_if(page.address, "/api/state")?.json()["history"].as_array()?.len());
    page.until("served", |page| number(page).is_some_and(|number| number > 2));
    assert!(!drill.join("monitor").exists());
    let ended = wait(page.run);
    assert_eq!(ended.status.code(), Some(0), "{}", String::from_utf8_lossy(&ended.stderr));
    hashes(&page.cell, 12);
}

/// Proves: `restart monitor` starts it again like a stage.
#[test]
fn the_monitor_is_restarted_on_request() {
    let page = Page::serving("again", &[]).ready();
    let before = page.monitor().unwrap();
    // Over the command socket: what the page is asked for may not be answered, because its process ends.
    let restart = ["restart", "monitor", "--cell", &page.cell.name];
    let restarted =
        std::process::Command::new(env!("CARGO_BIN_EXE_fringecell")).args(restart).output().unwrap();
    assert_eq!(restarted.status.code(), Some(0));
    page.until("another process", |page| page.monitor().is_some_and(|pid| pid != before));
    page.until("served again", |page| page.get("/api/state").json()["state"]["state"] == "Ready");
    page.stop();
}

/// Proves: a thousand connections, and viewers that never read, take neither the memory of the monitor nor the cycles; most
/// are told to come later, and those who stay silent lose their place.
#[test]
fn a_thousand_connections_and_viewers_that_never_read_hold_nothing() {
    // Both ends of the connections are files, on many machines 1024 at most.
    let own = std::process::id().to_string();
    let raised = std::process::Command::new("prlimit").args(["--pid", &own, "--nofile=4096:"]).status();
    assert!(raised.unwrap().success());
    let page = Page::serving("thousand", &[]).ready();
    assert_eq!(page.command(&value!({"command": "inspect", "part": "1"})).status, 200);
    let events = Events::open(page.address);
    events.until("scan");
    // They ask for the cloud, many times, and take nothing.
    let greedy: Vec<_> = (0..20)
        .map(|_| {
            let mut stream = connect(page.address);
            let ask = format!("GET /api/cloud/1 HTTP/1.1\r\nHost: {}\r\n\r\n", page.address);
            stream.write_all(ask.repeat(50).as_bytes()).unwrap();
            stream
        })
        .collect();
    let silent: Vec<_> = (0..1000).map(|_| connect(page.address)).collect();
    let told_later = silent.iter().filter(|stream| {
        let mut stream = *stream;
        stream.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        let mut answer = [0; 12];
        stream.read_exact(&mut answer).is_ok() && &answer == b"HTTP/1.1 503"
    });
    let told_later = told_later.count();
    assert!(told_later >= 850, "{told_later} of 1000 were told to come later");
    // The cell answers its other clients, and inspects.
    let inspected = std::process::Command::new(env!("CARGO_BIN_EXE_fringecell"))
        .args(["trigger", &page.cell.name, "--part", "2"])
        .output()
        .unwrap();
    assert_eq!(inspected.status.code(), Some(0));
    assert_eq!(events.until("ended")["brief"]["part"], "2", "a viewer that was there before hears of it");
    let memory = resident_mb(page.monitor().unwrap());
    println!("{memory} MB");
    assert!(memory < 150, "{memory} MB");
    // The silent ones lose their places within the time limit, without being asked.
    page.until("served again", |page| page.get("/api/state").status == 200);
    drop((greedy, silent));
    page.stop();
}
