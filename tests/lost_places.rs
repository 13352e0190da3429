//! Places that are not there or take no more: no shared memory, none left, outputs of a run that cannot be written.

use crate::adversity::{in_own_namespace, programs};
use crate::running::{Cell, json, text};

#[test]
fn without_shared_memory_the_message_says_so() {
    let cell = Cell::played("noshm", 0.0, "");
    let script = format!(
        "mount -t tmpfs none /dev || exit 9
         {program} run {config} --cell {name} --cycles 1; echo run $?",
        program = programs().0,
        config = cell.small.path("played.toml"),
        name = cell.name
    );
    let Some(output) = in_own_namespace(&script) else { return };
    let (said, cried) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(said.trim(), "run 2", "{cried}");
    assert!(cried.contains("/dev/shm is missing") && cried.contains("mount -t tmpfs"), "{cried}");
    assert!(!cried.contains("already running"), "{cried}");
}

/// Proves: when a cell is ready it has all shared memory that it needs for a part, the supervisor too.
#[test]
fn shared_memory_that_fills_up_before_the_first_part_costs_nothing() {
    let cell = Cell::played("ready", 0.0, "");
    let script = format!(
        "mount -t tmpfs -o size=80m shm /dev/shm || exit 9
         {program} run {config} --cell {name} --serve --out {out} & run=$!
         until {program} status {name} --once 2>/dev/null | grep -q Ready; do
           kill -0 $run 2>/dev/null || break; sleep 0.05
         done
         dd if=/dev/zero of=/dev/shm/fill bs=4k 2>/dev/null
         for part in 1 2 3; do {program} trigger {name} --part $part --patience 10 >/dev/null; echo part $?; done
         rm /dev/shm/fill; {program} stop {name}; wait $run; echo run $?; ls /dev/shm | wc -l",
        program = programs().0,
        config = cell.small.path("played.toml"),
        out = cell.small.path("out"),
        name = cell.name
    );
    let Some(output) = in_own_namespace(&script) else { return };
    let (said, cried) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(said.matches("part 0").count(), 3, "{said}{cried}");
    assert!(said.trim().ends_with("run 0\n0"), "{said}{cried}");
}

/// Proves: an output that is lost is named, and the others are written.
#[test]
fn an_output_that_is_lost_keeps_no_other_from_being_written() {
    let cell = Cell::played("lost", 0.0, "");
    let written = cell.small.path("run.json");
    let output = cell.run("played.toml", &["--cycles", "1", "--trace", "/dev/full", "--json", &written]);
    let cried = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{cried}");
    assert!(cried.contains("error: /dev/full: ") && cried.matches("error:").count() == 1, "{cried}");
    assert_eq!(json(written.as_ref())["cycles_ok"], 1, "{cried}");
    assert!(cell.out().join("report.html").exists(), "{cried}");
}

#[test]
fn points_that_the_fusion_leaves_out_are_the_reason_of_the_outcome() {
    let cell = Cell::played("isolated", 0.0, "");
    let config = std::fs::read_to_string(cell.small.path("played.toml")).unwrap();
    let text_of = format!("{config}[fusion]\nradius_mm = 1e-6\n");
    std::fs::write(cell.small.path("isolated.toml"), text_of).unwrap();
    let output = cell.run("isolated.toml", &["--cycles", "1"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let outcome = json(&cell.out().join("result.json"))["outcome"].as_str().unwrap().to_owned();
    let parts = ["stage fusion: no point at all: the pairs have ", "as isolated", "radius_mm = 0.000001"];
    assert!(parts.iter().all(|part| outcome.contains(part)) && !outcome.contains("dark"), "{outcome}");
}
