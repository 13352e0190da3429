//! Cycle records: what replays say of them, and what a crash, a change or a full disk leaves of them.

use crate::running::{Cell, json, pid_of, signal, text, wait};
use crate::support::{Ran, fringetool};
use cell::Retention;
use files::cycle_record::{Next, RecordReader, RecordWriter, RecordedCycle, ValueKey};
use serde_json::Value;
use std::path::Path;
use xxhash_rust::xxh3::xxh3_128;

impl Cell {
    /// A played cell with its record.
    fn recorded(&self, cycles: &str, keep: &str) -> String {
        let record = self.small.path("cycles.record");
        let output =
            self.run("played.toml", &["--cycles", cycles, "--cycle-record", &record, "--keep", keep]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        record
    }

    fn replay(&self, record: &str) -> (Ran, Value) {
        let report = self.small.path("replay.json");
        let ran = fringetool(&["replay", record, "--json", &report]);
        let written = Path::new(&report).exists();
        let value = if written { json(Path::new(&report)) } else { Value::Null };
        (ran, value)
    }
}

/// The complete cycles of a record with their bytes.
fn cycles(path: &str) -> (RecordReader, Vec<RecordedCycle>) {
    let mut reader = RecordReader::open(Path::new(path)).unwrap();
    let mut cycles = Vec::new();
    while let Next::Cycle(cycle) = reader.next_cycle().unwrap() {
        cycles.push(cycle);
    }
    (reader, cycles)
}

#[test]
fn a_replay_of_the_same_frames_gives_every_byte_again_and_another_frame_does_not() {
    let cell = Cell::played("replay", 0.0, "");
    let record = cell.recorded("3", "hashes");
    let (ran, found) = cell.replay(&record);
    assert_eq!(ran.code, Some(0), "{}{}", ran.stdout, ran.stderr);
    // 19 frames and one phase of each of two cameras, a cloud, the fused one, the result.
    assert_eq!((&found["cycles"], &found["outputs"]), (&3.into(), &(3 * 43).into()), "{found}");
    assert!(found["differences"].as_array().unwrap().is_empty());

    let frame = cell.small.path("rec/frames/proj1/cam2/004.png");
    let mut image = image::open(&frame).unwrap().to_luma8();
    image.get_pixel_mut(80, 60).0[0] ^= 1;
    image.save(&frame).unwrap();
    let (ran, found) = cell.replay(&record);
    assert_eq!(ran.code, Some(1), "{}{}", ran.stdout, ran.stderr);
    assert!(
        ran.stdout.contains("cycle 1: stage capture/cam2, \"expose proj1 004\": the hash of"),
        "{}",
        ran.stdout
    );
    assert_eq!(found["differences"][0]["output"], "frame/cam2");
}

/// Proves: a difference is found at its cycle, stage and byte. The record is written again with one byte changed.
#[test]
fn a_difference_names_cycle_stage_and_byte() {
    let cell = Cell::played("byte", 0.0, "");
    let record = cell.recorded("2", "all");
    let (mut reader, mut all) = cycles(&record);
    let fuse = reader.header.activations.iter().position(|a| a.label == "fuse").unwrap() as u32;
    let altered = cell.small.path("altered.record");
    let mut writer = RecordWriter::create(Path::new(&altered), &reader.header).unwrap();
    for cycle in &mut all {
        for (&activation, value) in &cycle.values {
            let mut bytes = reader.load(value).unwrap();
            if (cycle.entry.cycle, activation) == (1, fuse) {
                bytes[1000] ^= 0x10;
                let hash = xxh3_128(&bytes);
                let done = cycle.entry.activations.iter_mut().find(|a| a.activation == fuse).unwrap();
                done.hash = [(hash >> 64) as u64, hash as u64];
            }
            writer.value(ValueKey { cycle: cycle.entry.cycle, activation }, &bytes).unwrap();
        }
        assert!(writer.cycle(&cycle.entry).unwrap());
    }
    writer.finish().unwrap();
    assert_eq!(cell.replay(&record).0.code, Some(0));
    let (ran, found) = cell.replay(&altered);
    assert_eq!(ran.code, Some(1), "{}{}", ran.stdout, ran.stderr);
    assert!(ran.stdout.contains("cycle 2: stage fusion, \"fuse\": byte 1000 of"), "{}", ran.stdout);
    let differences = found["differences"].as_array().unwrap();
    assert_eq!((differences.len(), &differences[0]["first_byte"]), (1, &1000.into()), "{found}");
}

#[test]
fn a_record_is_replayed_only_with_what_was_recorded() {
    let cell = Cell::played("strict", 0.0, "");
    let record = cell.recorded("1", "hashes");
    let refused = |words: &str| {
        let ran = cell.replay(&record).0;
        assert_eq!(ran.code, Some(2), "{}", ran.stdout);
        assert!(ran.stderr.contains(words) && ran.stderr.lines().count() == 1, "{}", ran.stderr);
    };
    cell.small.edit("played.toml", "loop = true", "loop = true # again");
    refused("the configuration of");
    cell.small.edit("played.toml", "loop = true # again", "loop = true");
    cell.small.edit("rig.toml", "format", "# \nformat");
    refused("the rig file of");
    std::fs::write(&record, "format = \"fringecell-recording/1\"").unwrap();
    refused("is no cycle record");
    std::fs::remove_file(&record).unwrap();
    refused("cannot open it");
}

/// Proves: a kill at any moment leaves the complete cycles, and the next run does not touch them.
#[test]
fn a_killed_run_leaves_a_record_of_its_complete_cycles() {
    let cell = Cell::played("torn", 20.0, "");
    let record = cell.small.path("cycles.record");
    let run = cell.program("played.toml", &["--cycle-record", &record, "--keep", "frames"]).spawn().unwrap();
    cell.until("two cycles done", |s| s["cycles_done"].as_u64() >= Some(2));
    // One second a cycle at this rate: frames of the next one are in the file now.
    let status = cell.until_a_cycle_begins();
    std::thread::sleep(std::time::Duration::from_millis(300));
    signal("KILL", status["pid"].as_u64().unwrap());
    wait(run);
    let (ran, found) = cell.replay(&record);
    assert_eq!(ran.code, Some(2), "{}{}", ran.stdout, ran.stderr);
    assert!(ran.stderr.contains("the record has no seal after its"), "{}", ran.stderr);
    assert!(ran.stdout.ends_with("what could be compared is equal\n"), "{}", ran.stdout);
    assert_eq!((&found["sealed"], &found["differences"]), (&false.into(), &serde_json::json!([])));
    let complete = found["cycles"].as_u64().unwrap();
    assert!(complete >= 3 && complete <= status["cycles_done"].as_u64().unwrap() + 1, "{found}");
    assert!(ran.stdout.contains("the record ends within a cycle"), "{}", ran.stdout);
    let again = cell.run("played.toml", &["--cycles", "1", "--cycle-record", &record]);
    assert_eq!(again.status.code(), Some(2));
    assert!(text(&again.stderr).contains("exists already"), "{}", text(&again.stderr));
    assert_eq!(cell.left(), Vec::<String>::new());
}

#[test]
fn the_record_of_a_failed_cycle_holds_its_reason_and_what_was_done() {
    let cell = Cell::played("reason", 20.0, "");
    let record = cell.small.path("cycles.record");
    let more = ["--cycles", "3", "--cycle-record", &record, "--retain", "all"];
    let run = cell.program("played.toml", &more).spawn().unwrap();
    signal("KILL", pid_of(&cell.until_a_cycle_begins(), "matching/pair1"));
    wait(run);
    let (reader, all) = cycles(&record);
    assert_eq!((all.len(), reader.header.retention), (3, Retention::All));
    let outcomes: Vec<&str> = all.iter().map(|c| c.entry.outcome.as_str()).collect();
    assert_eq!(outcomes.iter().filter(|o| **o == "ok").count(), 2, "{outcomes:?}");
    assert!(outcomes.contains(&"stage matching/pair1 died (signal 9)"), "{outcomes:?}");
    for cycle in &all {
        let given = cycle.entry.activations.iter().filter(|a| a.bytes > 0);
        assert!(given.clone().all(|a| cycle.values.contains_key(&a.activation)), "{:?}", cycle.entry);
        assert!(cycle.entry.outcome != "ok" || given.count() == 43);
    }
    assert_eq!(cell.replay(&record).0.code, Some(0));
}

/// Proves: a flipped bit anywhere in a record, and a record cut anywhere, is never "all equal", and damage within a cycle
/// is named. The reader's own tests flip every bit; here a sample goes through the program.
#[test]
fn a_replay_of_a_damaged_record_says_what_is_damaged() {
    let cell = Cell::played("flip", 0.0, "");
    let record = cell.recorded("2", "all");
    let bytes = std::fs::read(&record).unwrap();
    let told = |altered: &[u8]| {
        std::fs::write(&record, altered).unwrap();
        let _ = std::fs::remove_file(cell.small.path("replay.json"));
        let (ran, found) = cell.replay(&record);
        assert_eq!(ran.code, Some(2), "{}{}", ran.stdout, ran.stderr);
        assert!(!ran.stdout.contains("all equal"), "{}", ran.stdout);
        (ran, found)
    };
    let (mut by_cycle, places) = (0, 12);
    for place in 0..places {
        let at = place * (bytes.len() - 1) / (places - 1);
        let mut altered = bytes.clone();
        altered[at] ^= 1 << (place % 8);
        let (ran, _) = told(&altered);
        by_cycle += usize::from(ran.stderr.contains("the record is damaged: cycle "));
    }
    // Nearly all bytes of this record are kept frames and outputs.
    assert!(by_cycle >= places - 4, "{by_cycle} of {places} named with their cycle");
    for cut in [bytes.len() - 1, bytes.len() - 60, bytes.len() / 2] {
        told(&bytes[..cut]);
    }
    std::fs::write(&record, &bytes).unwrap();
    assert_eq!(cell.replay(&record).0.code, Some(0));
}

/// Proves: a record of a run that was stopped before its first cycle ended is not "all equal".
#[test]
fn a_record_without_an_output_is_an_error() {
    let cell = Cell::played("none", 0.0, "");
    let record = cell.recorded("1", "hashes");
    let reader = RecordReader::open(Path::new(&record)).unwrap();
    let empty = cell.small.path("empty.record");
    RecordWriter::create(Path::new(&empty), &reader.header).unwrap().finish().unwrap();
    let ran = cell.replay(&empty).0;
    assert_eq!(ran.code, Some(2), "{}", ran.stdout);
    assert!(ran.stderr.contains("the record holds 0 cycles and no output to compare"), "{}", ran.stderr);
    assert!(!ran.stdout.contains("equal"), "{}", ran.stdout);
}

#[test]
fn a_record_that_cannot_be_written_is_refused_before_anything_starts() {
    let cell = Cell::played("full", 0.0, "");
    let output = cell.run("played.toml", &["--cycles", "1", "--cycle-record", "/dev/full"]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(said.contains("/dev/full: cannot write the cycle record; free space on the disk"), "{said}");
    assert_eq!(cell.left(), Vec::<String>::new());
}
