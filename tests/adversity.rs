//! A machine that is in the way: no memory, no room, nobody who reads, somebody else's cell beside.

use crate::running::{Cell, pid_of, results, signal, text, wait};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Command, Output};

/// Runs a script as root of file systems of its own. `None`, said in one line, where the machine does not permit that.
fn in_own_namespace(script: &str) -> Option<Output> {
    let inside = |command: &str| Command::new("unshare").args(["-rm", "sh", "-c", command]).output();
    if !inside("true").is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: this machine permits no file systems of one's own (unshare -rm)");
        return None;
    }
    Some(inside(script).unwrap())
}

fn programs() -> (&'static str, &'static str) {
    (env!("CARGO_BIN_EXE_fringecell"), env!("CARGO_BIN_EXE_fringetool"))
}

/// Proves: two cells that see different parts at the same time each measure their own, and the death of one is nothing to
/// the other.
#[test]
fn two_cells_do_not_hear_each_other() {
    let cells = ["left", "right"].map(|name| Cell::played(name, 100.0, ""));
    // The other sees one pixel otherwise: enough for another hash of every output.
    let frame = cells[1].small.path("rec/frames/proj1/cam1/018.png");
    let mut image = image::open(&frame).unwrap().to_luma8();
    image.get_pixel_mut(80, 60).0[0] ^= 1;
    image.save(&frame).unwrap();
    let alone = cells.each_ref().map(|cell| {
        assert_eq!(cell.run("played.toml", &["--cycles", "1"]).status.code(), Some(0));
        results(&cell.out())[0]["hashes"].clone()
    });
    assert_ne!(alone[0]["frame/cam1"], alone[1]["frame/cam1"]);
    let runs = cells.each_ref().map(|cell| cell.program("played.toml", &["--cycles", "4"]).spawn().unwrap());
    signal("KILL", pid_of(&cells[0].until_a_cycle_begins(), "decode/cam1"));
    let outputs = runs.map(wait);
    assert_eq!(outputs.map(|output| output.status.code()), [Some(1), Some(0)]);
    for (cell, alone) in cells.iter().zip(&alone) {
        let results = results(&cell.out());
        assert_eq!(results.len(), 4);
        for result in results.iter().filter(|r| r["outcome"] == "ok") {
            assert_eq!(result["hashes"], *alone, "{}", cell.name);
        }
        assert_eq!(cell.left(), Vec::<String>::new());
    }
}

#[test]
fn a_stage_without_memory_ends_its_cycle_and_is_replaced() {
    let cell = Cell::played("memory", 50.0, "");
    let run = cell.program("played.toml", &["--cycles", "5"]).spawn().unwrap();
    let fusion = pid_of(&cell.until_a_cycle_begins(), "fusion");
    // The address space as it is and not a page more.
    let limited = Command::new("prlimit").args(["--as=1", "--pid", &fusion.to_string()]).status();
    assert!(limited.is_ok_and(|status| status.success()));
    wait(run);
    let outcomes: Vec<Value> = results(&cell.out()).iter().map(|r| r["outcome"].clone()).collect();
    let bad: Vec<&Value> = outcomes.iter().filter(|o| **o != "ok").collect();
    println!("{bad:?}");
    assert_eq!((outcomes.len(), outcomes[4].as_str()), (5, Some("ok")), "{outcomes:?}");
    assert!(bad.iter().all(|o| o.as_str().is_some_and(|o| o.starts_with("stage fusion"))), "{bad:?}");
    assert_eq!(cell.left(), Vec::<String>::new());
}

#[test]
fn a_reader_that_goes_away_does_not_stop_a_run_of_so_many_cycles() {
    let cell = Cell::played("head", 0.0, "");
    let mut run = cell.program("played.toml", &["--cycles", "3"]).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(run.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.contains("cycle   1/3  ok"), "{line}");
    let output = wait(run);
    assert_eq!((output.status.code(), text(&output.stderr).as_str()), (Some(0), ""));
    assert_eq!(results(&cell.out()).len(), 3);
}

#[test]
fn an_output_folder_that_cannot_be_written_is_refused_before_anything_starts() {
    let cell = Cell::played("sealed", 0.0, "");
    let output = Command::new(programs().0)
        .args(["run", &cell.small.path("played.toml"), "--cell", &cell.name, "--out", "/proc/fringecell"])
        .output()
        .unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("/proc/fringecell: cannot create the folder") && said.lines().count() == 1,
        "{said}"
    );
    assert_eq!(cell.left(), Vec::<String>::new());
}

/// Proves: on a disk that fills up the cell measures on, the cycles that fitted are whole, and the exit code tells.
#[test]
fn a_disk_that_fills_up_costs_cycles_of_the_record_and_nothing_else() {
    let cell = Cell::played("disk", 0.0, "");
    let (fringecell, fringetool) = programs();
    let script = format!(
        "mkdir -p {disk} && mount -t tmpfs -o size=2m disk {disk} || exit 9
         {fringecell} run {config} --cell {name} --cycles 6 --cycle-record {disk}/r --keep frames; echo run $?
         {fringetool} replay {disk}/r; echo replay $?",
        disk = cell.small.path("disk"),
        config = cell.small.path("played.toml"),
        name = cell.name
    );
    let Some(output) = in_own_namespace(&script) else { return };
    let (said, cried) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(said.matches("  ok  ").count(), 6, "{said}{cried}");
    assert!(
        said.contains("run 2") && said.contains("replay 0") && said.contains("all equal"),
        "{said}{cried}"
    );
    assert!(cried.contains("cycles are not in the record"), "{cried}");
    assert!(cried.contains("cannot write the cycle record; make room on the disk: No space left"), "{cried}");
    let replayed: u64 = said.split("disk/r: ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((1..6).contains(&replayed), "{said}");
}

#[test]
fn too_little_shared_memory_is_refused_with_both_numbers() {
    let cell = Cell::played("shm", 0.0, "");
    let script = format!(
        "mount -t tmpfs -o size=2m shm /dev/shm || exit 9
         {} run {} --cell {} --cycles 1; echo run $?; ls /dev/shm | wc -l",
        programs().0,
        cell.small.path("played.toml"),
        cell.name
    );
    let Some(output) = in_own_namespace(&script) else { return };
    let (said, cried) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(said.trim(), "run 2\n0", "{cried}");
    assert!(cried.contains("/dev/shm has 2 MB free") && cried.contains("need up to"), "{cried}");
}
