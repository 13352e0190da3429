//! A record gives back what was written, ends where a crash cut it, and is refused when it was altered.

use super::*;
use crate::error::FileError;
use std::fs;
use std::path::{Path, PathBuf};

fn header() -> RecordHeader {
    RecordHeader {
        cell: "small".into(),
        software: "fringecell 0".into(),
        started: "2026-01-31T08:00:00Z".into(),
        config: "/tmp/cell.toml".into(),
        config_sha256: "ab".into(),
        rig_sha256: "cd".into(),
        recipes: vec![RecordedRecipe { name: "default".into(), plan_sha256: Some("12".into()) }],
        recording_sha256: Some("ef".into()),
        retention: Retention::Frames,
        activations: vec![ActivationName { stage: "fusion".into(), label: "fuse".into(), output: None }],
    }
}

fn entry(cycle: u64) -> CycleEntry {
    let done = ActivationEntry {
        activation: 0,
        bytes: 5,
        hash: [u64::MAX, cycle],
        count: 3,
        wait_ns: 1,
        start_ns: 2,
        end_ns: 3,
    };
    CycleEntry {
        cycle,
        recipe: 0,
        outcome: "ok".into(),
        verdict: Some(Verdict::Pass),
        latency_ns: Some(7),
        activations: vec![done],
    }
}

/// A record of `cycles` cycles with one value each, and where each cycle ends.
fn written(folder: &Path, cycles: u64) -> (PathBuf, Vec<u64>) {
    let path = folder.join("a.record");
    let mut writer = RecordWriter::create(&path, &header()).unwrap();
    let size = || fs::metadata(&path).unwrap().len();
    let mut ends = vec![size()];
    for cycle in 0..cycles {
        writer.value(ValueKey { cycle, activation: 0 }, &[cycle as u8; 5]).unwrap();
        assert!(writer.cycle(&entry(cycle)).unwrap());
        ends.push(size());
    }
    (path, ends)
}

/// The complete cycles and how it ends.
fn read(path: &Path) -> Result<(Vec<RecordedCycle>, Ending), FileError> {
    let mut reader = RecordReader::open(path)?;
    let mut cycles = Vec::new();
    loop {
        match reader.next_cycle()? {
            Next::Cycle(cycle) => cycles.push(cycle),
            Next::End(ending) => return Ok((cycles, ending)),
        }
    }
}

#[test]
fn what_was_written_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = written(folder.path(), 3);
    let mut reader = RecordReader::open(&path).unwrap();
    assert_eq!(reader.header, header());
    for number in 0..3 {
        let Next::Cycle(cycle) = reader.next_cycle().unwrap() else { panic!("cycle {number} is missing") };
        assert_eq!(cycle.entry, entry(number));
        assert_eq!(reader.load(&cycle.values[&0]).unwrap(), [number as u8; 5]);
    }
    assert_eq!(reader.next_cycle().unwrap(), Next::End(Ending::Whole));
}

/// Proves: wherever a crash cuts the file, all complete cycles are there and nothing else.
#[test]
fn a_record_cut_anywhere_gives_its_complete_cycles() {
    let folder = tempfile::tempdir().unwrap();
    let (path, ends) = written(folder.path(), 2);
    let whole = fs::read(&path).unwrap();
    for cut in ends[0] as usize..whole.len() {
        fs::write(&path, &whole[..cut]).unwrap();
        let (cycles, ending) = read(&path).unwrap();
        let complete = ends[1..].iter().filter(|&&end| end <= cut as u64).count();
        assert_eq!(cycles.len(), complete, "cut at {cut}");
        let expected = cut as u64 - ends[complete];
        assert_eq!(
            ending,
            if expected == 0 { Ending::Whole } else { Ending::Torn(expected) },
            "cut at {cut}"
        );
        // Room that the file system gave and never filled is no damage either.
        fs::write(&path, [&whole[..cut], &[0; 100]].concat()).unwrap();
        assert_eq!(read(&path).unwrap().0.len(), complete, "zeros from {cut}");
    }
    for cut in 0..ends[0] as usize {
        fs::write(&path, &whole[..cut]).unwrap();
        assert!(read(&path).is_err(), "cut at {cut}");
    }
}

/// Proves: no altered byte is taken for what was written.
#[test]
fn an_altered_byte_is_found_wherever_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = written(folder.path(), 3);
    let whole = fs::read(&path).unwrap();
    let intact = read(&path).unwrap().0;
    for at in 0..whole.len() {
        let mut altered = whole.clone();
        altered[at] ^= 0x40;
        fs::write(&path, &altered).unwrap();
        let Ok((cycles, _)) = read(&path) else { continue };
        let mut reader = RecordReader::open(&path).unwrap();
        let values = cycles.iter().flat_map(|c| c.values.values());
        let loads = values.map(|value| reader.load(value)).all(|loaded| loaded.is_ok());
        // Only an end that was not written whole may go unnoticed, and then its cycle is not there.
        assert!(!loads || (cycles.len() < 3 && cycles[..] == intact[..cycles.len()]), "byte {at}");
    }
}

#[test]
fn other_files_and_versions_are_refused_and_nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = written(folder.path(), 1);
    let error = RecordWriter::create(&path, &header()).unwrap_err().to_string();
    assert!(error.contains("exists already") && error.contains("name a new file"), "{error}");
    let mut bytes = fs::read(&path).unwrap();
    bytes[12] = 9;
    fs::write(&path, &bytes).unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("version: value 9") && error.contains("this program reads 2"), "{error}");
    for nonsense in [&b""[..], b"fringe", b"format = \"fringecell-config/1\""] {
        fs::write(&path, nonsense).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("is no cycle record"));
    }
}

#[test]
fn a_full_disk_is_told_and_leaves_no_half_record() {
    let error = RecordWriter::create(Path::new("/dev/full"), &header()).unwrap_err();
    assert!(error.to_string().contains("/dev/full: cannot write the cycle record"), "{error}");
    assert!(error.to_string().contains("free space on the disk"), "{error}");
}
