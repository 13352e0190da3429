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

/// A sealed record of `cycles` cycles with one value each, and where each cycle ends.
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
    writer.finish().unwrap();
    (path, ends)
}

/// The complete cycles, the damaged ones and how it ends.
type Content = (Vec<RecordedCycle>, Vec<DamagedCycle>, Ending);

fn read(path: &Path) -> Result<Content, FileError> {
    let mut reader = RecordReader::open(path)?;
    let (mut cycles, mut damaged) = (Vec::new(), Vec::new());
    loop {
        match reader.next_cycle()? {
            Next::Cycle(cycle) => cycles.push(cycle),
            Next::Damaged(cycle) => damaged.push(cycle),
            Next::End(ending) => return Ok((cycles, damaged, ending)),
        }
    }
}

/// Whether a reader takes the file for a whole, undamaged record.
fn whole(path: &Path) -> bool {
    read(path).is_ok_and(|(_, damaged, ending)| damaged.is_empty() && matches!(ending, Ending::Sealed(_)))
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
    let seal = Seal { cycles: 3, lost: 0 };
    assert_eq!(reader.next_cycle().unwrap(), Next::End(Ending::Sealed(seal)));
}

/// Proves: wherever a crash or a copy cuts the file, all complete cycles are there, nothing else, and no seal.
#[test]
fn a_record_cut_anywhere_gives_its_complete_cycles_and_no_seal() {
    let folder = tempfile::tempdir().unwrap();
    let (path, ends) = written(folder.path(), 2);
    let bytes = fs::read(&path).unwrap();
    for cut in ends[0] as usize..bytes.len() {
        fs::write(&path, &bytes[..cut]).unwrap();
        let (cycles, damaged, ending) = read(&path).unwrap();
        let complete = ends[1..].iter().filter(|&&end| end <= cut as u64).count();
        assert_eq!((cycles.len(), damaged.len()), (complete, 0), "cut at {cut}");
        assert_eq!(ending, Ending::Torn(cut as u64 - ends[complete]), "cut at {cut}");
        // Room that the file system gave and never filled ends it likewise.
        fs::write(&path, [&bytes[..cut], &[0; 100]].concat()).unwrap();
        assert!(!whole(&path), "zeros from {cut}");
    }
    for cut in 0..ends[0] as usize {
        fs::write(&path, &bytes[..cut]).unwrap();
        assert!(read(&path).is_err(), "cut at {cut}");
    }
    fs::write(&path, [&bytes[..], b"x"].concat()).unwrap();
    assert!(read(&path).unwrap_err().to_string().contains("something follows its seal"));
}

/// Proves: each single bit that flips is reported, and no cycle is accepted that is not the one that was written.
#[test]
fn every_flipped_bit_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = written(folder.path(), 3);
    let bytes = fs::read(&path).unwrap();
    let intact = read(&path).unwrap().0;
    let mut named = 0;
    for bit in 0..bytes.len() * 8 {
        let mut altered = bytes.clone();
        altered[bit / 8] ^= 1 << (bit % 8);
        fs::write(&path, &altered).unwrap();
        assert!(!whole(&path), "bit {bit} of byte {} is taken for what was written", bit / 8);
        let Ok((cycles, damaged, _)) = read(&path) else { continue };
        assert!(cycles.iter().all(|cycle| intact.contains(cycle)), "bit {bit}");
        // Damage within the contents of one block costs its cycle only, and is named.
        if let [one] = &damaged[..] {
            assert_eq!(cycles.len(), 2, "bit {bit}");
            assert!(cycles.iter().all(|cycle| cycle.entry.cycle != one.cycle), "bit {bit}");
            named += 1;
        }
    }
    let contents = 8 * 3 * (5 + codec::encode(&entry(0)).unwrap().len());
    assert_eq!(named, contents, "flips within contents that are named with their cycle");
}

/// Proves: whole blocks, each with good sums, cannot be left out, repeated or exchanged.
#[test]
fn blocks_left_out_repeated_or_exchanged_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let (path, ends) = written(folder.path(), 3);
    let bytes = fs::read(&path).unwrap();
    let at = |number: usize| ends[number] as usize;
    let cycle = |number: usize| &bytes[at(number)..at(number + 1)];
    let (start, seal) = (&bytes[..at(0)], &bytes[at(3)..]);
    for (what, parts) in [
        ("left out", vec![start, cycle(0), cycle(2), seal]),
        ("the last left out", vec![start, cycle(0), cycle(1), seal]),
        ("repeated", vec![start, cycle(0), cycle(0), cycle(1), cycle(2), seal]),
        ("exchanged", vec![start, cycle(1), cycle(0), cycle(2), seal]),
        ("all left out", vec![start, seal]),
    ] {
        fs::write(&path, parts.concat()).unwrap();
        assert!(!whole(&path), "{what}");
    }
}

/// Proves: a cycle that was begun and not closed is no part of a record that is sealed.
#[test]
fn what_no_entry_closed_is_left_out_by_the_seal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b.record");
    let mut writer = RecordWriter::create(&path, &header()).unwrap();
    writer.value(ValueKey { cycle: 0, activation: 0 }, b"first").unwrap();
    assert!(writer.cycle(&entry(0)).unwrap());
    writer.value(ValueKey { cycle: 1, activation: 0 }, b"half").unwrap();
    writer.finish().unwrap();
    assert!(whole(&path));
    assert_eq!(read(&path).unwrap().0.len(), 1);
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
    assert!(error.contains("version: value 9") && error.contains("this program reads 3"), "{error}");
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
