//! What the runtime promises, put to the proof: the same bytes whatever the timing, one outcome for every cycle whatever
//! dies, and nothing that grows. The long runs are `#[ignore]`d; CONTRIBUTING tells their commands.
//!
//! Nothing inside the cell helps: processes are stopped, killed and lied to from outside.

use crate::running::{Cell, PATIENCE, children, pid_of, poke, results, text, wait};
use ipc::cell::CellName;
use ipc::header::{Cloud, Frame, Header, Phase, Trigger};
use ipc::port::Node;
use rig::cycle_record::{CycleEntry, Next, RecordReader};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Child;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Numbers that look random and are the same every time (Marsaglia, "Xorshift RNGs", 2003).
struct Dice(u64);

impl Dice {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }

    fn pause(&mut self, limit_ms: u64) {
        std::thread::sleep(Duration::from_micros(self.below(1000 * limit_ms)));
    }
}

/// Holds the stages of a cell that has just been started, and lets them go in another order.
fn shuffle_start(run: &Child, stages: usize, dice: &mut Dice) {
    let begin = Instant::now();
    let mut held = Vec::new();
    while held.len() < stages && begin.elapsed() < Duration::from_secs(10) {
        for pid in children(run.id()) {
            if !held.contains(&pid) {
                poke("STOP", pid);
                held.push(pid);
            }
        }
    }
    for last in (1..held.len()).rev() {
        held.swap(last, dice.below(last as u64 + 1) as usize);
    }
    for pid in held {
        poke("CONT", pid);
        dice.pause(5);
    }
}

/// Stops random stages for a few ms at random moments until told to end.
fn disturb(supervisor: u32, seed: u64, end: &AtomicBool) {
    let mut dice = Dice(seed);
    while !end.load(Ordering::Relaxed) {
        let stages = children(supervisor);
        if let Some(&pid) = stages.get(dice.below(stages.len().max(1) as u64) as usize) {
            poke("STOP", pid);
            dice.pause(15);
            poke("CONT", pid);
        }
        dice.pause(10);
    }
}

/// The hashes of all cycles of a run, which must be the same for all of them.
fn hashes(cell: &Cell, cycles: usize) -> Value {
    let results = results(&cell.out());
    assert_eq!(results.len(), cycles);
    for result in &results {
        assert_eq!(result["outcome"], "ok", "{result}");
        assert_eq!(result["hashes"], results[0]["hashes"], "cycle {}", result["cycle"]);
    }
    results[0]["hashes"].clone()
}

/// One recording through the cell again and again: one and two threads, stages that come up in any order, stages that
/// stand still for a while at any moment.
fn same_bytes_whatever_the_timing(runs: u64) {
    let cell = Cell::played("same", 0.0, "");
    cell.run("played.toml", &["--cycles", "2"]);
    let undisturbed = hashes(&cell, 2);
    assert_eq!(undisturbed.as_object().unwrap().len(), 7, "{undisturbed}");
    for (cores, file) in [(1, "one.toml"), (2, "two.toml")] {
        let config = std::fs::read_to_string(cell.small.path("played.toml")).unwrap();
        std::fs::write(cell.small.path(file), format!("{config}[schedule]\ncores = {cores}\n")).unwrap();
    }
    for seed in 1..=runs {
        std::fs::remove_dir_all(cell.out()).unwrap();
        let mut dice = Dice(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let file = ["one.toml", "two.toml"][(seed % 2) as usize];
        let run = cell.program(file, &["--cycles", "2"]).spawn().unwrap();
        shuffle_start(&run, 8, &mut dice);
        let (supervisor, end) = (run.id(), AtomicBool::new(false));
        let output = std::thread::scope(|scope| {
            scope.spawn(|| disturb(supervisor, seed, &end));
            let output = wait(run);
            end.store(true, Ordering::Relaxed);
            output
        });
        assert_eq!(output.status.code(), Some(0), "seed {seed}: {}", text(&output.stderr));
        assert_eq!(hashes(&cell, 2), undisturbed, "seed {seed}, {file}");
    }
    println!("{runs} runs: {} hashes each, all equal", undisturbed.as_object().unwrap().len());
}

#[test]
fn the_same_recording_gives_the_same_bytes_whatever_the_timing() {
    same_bytes_whatever_the_timing(2);
}

#[test]
#[ignore = "a minute: twenty runs under disturbance"]
fn twenty_runs_give_the_same_bytes() {
    same_bytes_whatever_the_timing(20);
}

/// What is done to a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Harm {
    Kill,
    Abort,
    Hang,
    WrongSize,
    WrongCycle,
    Twice,
}

const HARMS: [Harm; 6] =
    [Harm::Kill, Harm::Abort, Harm::Hang, Harm::WrongSize, Harm::WrongCycle, Harm::Twice];

/// Sends one message that no honest stage would send, on a random topic of the flow.
fn lie(cell: &CellName, harm: Harm, wire_cycle: u64, dice: &mut Dice) {
    let camera = dice.below(2) as u32;
    let name = ["cam1", "cam2"][camera as usize];
    let cycle = if harm == Harm::WrongCycle { wire_cycle + 1000 } else { wire_cycle };
    let decode = format!("decode/{name}");
    match dice.below(4) {
        0 => {
            // Beyond the last frame of the sequence, so that it is one too many even where its turn has not come.
            let header =
                Trigger { cycle, projector: 0, frame: 40, camera: Trigger::ALL, ..Trigger::default() };
            let wrong = Trigger { frame: u32::MAX, ..header };
            send(cell, "trigger/proj1", &["capture/cam1", "capture/cam2"], header, Some(wrong));
        }
        1 => {
            let (width_px, height_px) = crate::support::SMALL_PX;
            let header = Frame {
                cycle,
                camera,
                frame: 3,
                width_px,
                height_px,
                bytes_per_px: 1,
                full_scale_dn: 255,
                ..Frame::default()
            };
            let wrong = Frame { width_px: 70_000, ..header };
            let wrong = (harm == Harm::WrongSize).then_some(wrong);
            send(cell, &format!("frame/{name}"), &[&decode], header, wrong);
        }
        2 => {
            let (width_px, height_px) = crate::support::SMALL_PX;
            let header = Phase { cycle, camera, width_px, height_px, period_px: 16.0, ..Phase::default() };
            let wrong = (harm == Harm::WrongSize).then_some(Phase { height_px: 1, ..header });
            send(cell, &format!("phase/{name}"), &["matching/pair1"], header, wrong);
        }
        _ => {
            let header = Cloud { cycle, capacity: 10, points: 2, ..Cloud::default() };
            let wrong = (harm == Harm::WrongSize).then_some(Cloud { points: 4_000_000, ..header });
            send(cell, "cloud/pair1", &["fusion"], header, wrong);
        }
    }
}

/// Sends a payload that fits `honest` under the header `said`, if there is one.
fn send<H: Header>(cell: &CellName, topic: &str, consumers: &[&str], honest: H, said: Option<H>) {
    // A cell that is just ending, or a topic whose places are taken, is no harm done; the next try will do some.
    let Ok(node) = Node::join(cell, "liar") else { return };
    let consumers: Vec<String> = consumers.iter().map(|&c| c.to_owned()).collect();
    let patience = Duration::from_millis(20);
    let Ok(publisher) = node.publisher::<H>(topic, 1 << 20, &consumers, patience) else { return };
    let Ok(mut loan) = publisher.loan(honest) else { return };
    loan.payload_mut().fill(7);
    if let Some(said) = said {
        *loan.header_mut() = said;
    }
    let _ = loan.send_unchecked();
}

/// Files of the cell in shared memory and open files of its supervisor.
fn held(cell: &Cell, supervisor: u64) -> (usize, usize) {
    let name = CellName::new(&cell.name).unwrap();
    let services = walk(&name.folder());
    let fds = std::fs::read_dir(format!("/proc/{supervisor}/fd")).map_or(0, Iterator::count);
    (cell.left().len() + services, fds)
}

fn walk(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    entries.flatten().map(|e| 1 + if e.path().is_dir() { walk(&e.path()) } else { 0 }).sum()
}

/// What a storm left.
struct Storm {
    harms: BTreeMap<Harm, u32>,
    recoveries_ms: Vec<f64>,
    calm_before: (usize, usize),
    calm_after: (usize, usize),
}

/// Every third cycle something is done to a random stage at a random moment.
fn storm(cell: &Cell, cycles: u64, seed: u64) -> Storm {
    let name = CellName::new(&cell.name).unwrap();
    let run = cell.program("played.toml", &["--cycles", &cycles.to_string()]).spawn().unwrap();
    let supervisor = u64::from(run.id());
    let mut dice = Dice(seed);
    let mut storm =
        Storm { harms: BTreeMap::new(), recoveries_ms: Vec::new(), calm_before: (0, 0), calm_after: (0, 0) };
    let calm = |status: &Value| {
        let up = |s: &Value| s["state"] == "up";
        status["cycle"].is_u64() && status["stages"].as_array().is_some_and(|all| all.iter().all(up))
    };
    let ok = |status: &Value| status["cycles_ok"].as_u64().unwrap_or(0);
    cell.until("two good cycles", |s| ok(s) >= 2);
    storm.calm_before = held(cell, supervisor);
    while let Some(status) = cell.status() {
        let cycle = status["cycle"].as_u64();
        if cycle.is_none_or(|c| c % 3 != 2) || !calm(&status) {
            std::thread::sleep(Duration::from_millis(2));
            continue;
        }
        let cycle = cycle.unwrap_or_default();
        dice.pause(60);
        let stages = status["stages"].as_array().unwrap();
        let stage = stages[dice.below(stages.len() as u64) as usize]["name"].as_str().unwrap().to_owned();
        let harm = HARMS[dice.below(HARMS.len() as u64) as usize];
        let good_before = ok(&cell.status().unwrap_or(status.clone()));
        match harm {
            Harm::Kill => poke("KILL", pid_of(&status, &stage)),
            Harm::Abort => poke("ABRT", pid_of(&status, &stage)),
            Harm::Hang => poke("STOP", pid_of(&status, &stage)),
            Harm::WrongSize | Harm::WrongCycle | Harm::Twice => lie(&name, harm, cycle + 1, &mut dice),
        }
        *storm.harms.entry(harm).or_default() += 1;
        let done = Instant::now();
        // The next good outcome, past the cycle that was harmed.
        let next = loop {
            match cell.status() {
                None => break None,
                Some(s) if ok(&s) > good_before && s["cycle"].as_u64() != Some(cycle) && calm(&s) => {
                    break Some(s);
                }
                Some(_) => std::thread::sleep(Duration::from_millis(2)),
            }
            assert!(done.elapsed() < PATIENCE, "{harm:?} of {stage} in cycle {cycle}: {:?}", cell.status());
        };
        let Some(_) = next else { break };
        storm.recoveries_ms.push(done.elapsed().as_secs_f64() * 1e3);
        storm.calm_after = held(cell, supervisor);
    }
    let output = wait(run);
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", text(&output.stderr));
    storm
}

fn survives_a_storm(cycles: u64, seed: u64) {
    let limits = "stage_budget_ms = 700\nrestarts_max = 1000\nrestart_window_ms = 1000";
    let cell = Cell::played("storm", 200.0, limits);
    cell.run("played.toml", &["--cycles", "1"]);
    let undisturbed = hashes(&cell, 1);
    std::fs::remove_dir_all(cell.out()).unwrap();
    let mut storm = storm(&cell, cycles, seed);

    let results = results(&cell.out());
    assert_eq!(results.len() as u64, cycles, "every requested cycle has one outcome");
    let mut reasons: BTreeMap<String, u32> = BTreeMap::new();
    for (number, result) in results.iter().enumerate() {
        assert_eq!(result["cycle"], number);
        let outcome = result["outcome"].as_str().unwrap();
        if outcome == "ok" {
            assert_eq!(result["hashes"], undisturbed, "a wrong cloud in cycle {number}");
        } else {
            *reasons.entry(outcome.split_whitespace().take(4).collect::<Vec<_>>().join(" ")).or_default() +=
                1;
        }
    }
    let bad: u32 = reasons.values().sum();
    assert!(storm.harms.values().sum::<u32>() > 0 && bad > 0, "this storm did no harm");
    assert_eq!(cell.left(), Vec::<String>::new());
    storm.recoveries_ms.sort_by(f64::total_cmp);
    let at = |share: usize| storm.recoveries_ms[(storm.recoveries_ms.len() - 1) * share / 100];
    println!("{cycles} cycles, {} harmed: {:?}", storm.recoveries_ms.len(), storm.harms);
    println!("{bad} cycles not ok: {reasons:#?}");
    println!(
        "from harm to the next good outcome: median {:.0} ms, 90 % {:.0} ms, maximum {:.0} ms",
        at(50),
        at(90),
        at(100)
    );
    println!(
        "shared memory files, open files: {:?} before, {:?} at the end",
        storm.calm_before, storm.calm_after
    );
    assert!(
        storm.calm_after.1 <= storm.calm_before.1 + 2,
        "open files leak: {:?} {:?}",
        storm.calm_before,
        storm.calm_after
    );
}

#[test]
fn a_short_storm_leaves_one_outcome_per_cycle_and_no_wrong_cloud() {
    survives_a_storm(12, 5);
}

#[test]
#[ignore = "five minutes: five hundred cycles, every third one harmed"]
fn a_long_storm_leaves_one_outcome_per_cycle_and_no_wrong_cloud() {
    survives_a_storm(500, 1);
}

/// Resident memory of a process, kB.
fn resident_kb(pid: u64) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:")).unwrap_or("0");
    line.split_whitespace().next().and_then(|kb| kb.parse().ok()).unwrap_or(0)
}

fn memory(status: &Value) -> BTreeMap<String, u64> {
    let stages = status["stages"].as_array().unwrap().iter();
    let mut memory: BTreeMap<String, u64> = stages
        .filter_map(|s| Some((s["name"].as_str()?.to_owned(), resident_kb(s["pid"].as_u64()?))))
        .collect();
    memory.insert("supervisor".into(), resident_kb(status["pid"].as_u64().unwrap()));
    memory
}

fn entries(path: &str) -> Vec<CycleEntry> {
    let mut reader = RecordReader::open(Path::new(path)).unwrap();
    let mut entries = Vec::new();
    while let Next::Cycle(cycle) = reader.next_cycle().unwrap() {
        entries.push(cycle.entry);
    }
    entries
}

#[test]
#[ignore = "ten minutes and more: ten thousand cycles"]
fn ten_thousand_cycles_grow_nothing() {
    let (cycles, settled) = (10_000_u64, 2_000);
    let cell = Cell::played("soak", 0.0, "");
    let record = cell.small.path("soak.record");
    let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_fringecell"));
    program.args([
        "run",
        &cell.small.path("played.toml"),
        "--cell",
        &cell.name,
        "--cycles",
        &cycles.to_string(),
    ]);
    let run = program.args(["--cycle-record", &record]).stdout(std::process::Stdio::null()).spawn().unwrap();
    let done = |s: &Value| s["cycles_done"].as_u64().unwrap_or(0);
    let patience = Instant::now();
    let mut begin = None;
    let mut last = None;
    while let Some(status) = cell.status().or_else(|| last.is_none().then_some(Value::Null)) {
        assert!(patience.elapsed() < Duration::from_secs(3 * 3600), "{status}");
        if status.is_object() {
            if begin.is_none() && done(&status) >= settled {
                begin = Some(memory(&status));
            }
            // A stage that is just leaving has no memory left to be measured.
            let now = memory(&status);
            if now.values().all(|&kb| kb > 0) {
                last = Some((done(&status), now));
            }
        }
        std::thread::sleep(Duration::from_millis(500));
    }
    assert_eq!(run.wait_with_output().unwrap().status.code(), Some(0));
    let entries = entries(&record);
    assert_eq!(entries.len() as u64, cycles);
    assert!(entries.iter().all(|e| e.outcome == "ok"));
    let outputs = |e: &CycleEntry| e.activations.iter().map(|a| a.hash).collect::<Vec<_>>();
    assert!(entries.iter().all(|e| outputs(e) == outputs(&entries[0])), "all cycles saw the same frames");
    let ms = |part: &[CycleEntry], share: usize| {
        let mut all: Vec<u64> = part.iter().filter_map(|e| e.latency_ns).collect();
        all.sort_unstable();
        all[(all.len() - 1) * share / 100] as f64 / 1e6
    };
    for (name, part) in [("first", &entries[..1000]), ("last", &entries[entries.len() - 1000..])] {
        println!(
            "{name} 1000: last frame to verdict, ms: 50 % {:.2}, 90 % {:.2}, 99 % {:.2}",
            ms(part, 50),
            ms(part, 90),
            ms(part, 99)
        );
    }
    let (begin, (at, end)) = (begin.unwrap(), last.unwrap());
    for (name, before) in &begin {
        let after = end[name];
        println!("{name}: {before} kB after {settled} cycles, {after} kB after {at}");
        // A leak of one small thing a cycle, 100 bytes, would add 800 kB.
        assert!(after < before + 800, "{name} grew from {before} to {after} kB");
    }
}
