//! The store of a cell's parts: one line per cycle over all runs in an output folder, for statistics.
//!
//! `parts.jsonl` grows by sealed lines ([`sealed`](crate::sealed)). A line is on the disk whole before the next cycle's is begun; one that a
//! crash left unfinished is cut off when the next run opens the store. A full file is renamed `parts-0001.jsonl`, the next one `parts-0002.jsonl`, and
//! a new one begins. The cell removes none of them.

use crate::document::refuse_special;
use crate::error::{FileError, Problem};
use crate::guard;
use crate::result::CycleResult;
use crate::sealed::{Seal, SealedLines, append_sealed, read_sealed};
use metrology::inspection::Unit;
use metrology::verdict::Verdict;
use serde::{Deserialize, Serialize};
use std::fs::{self, File, OpenOptions};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Value of `format` in each line.
pub const PARTS_FORMAT: &str = "fringecell-parts/1";

/// Name of the file that grows.
pub const STORE: &str = "parts.jsonl";

/// A file of this length is full, bytes. Reading takes files of up to 64 MiB.
const FULL_BYTES: u64 = 48 << 20;

/// One cycle of a cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartRecord {
    /// Always the text [`PARTS_FORMAT`].
    pub format: String,
    /// When the outcome was known, UTC (ISO 8601).
    pub date: String,
    /// Name of the cell.
    pub cell: String,
    /// Number of the cycle in its run, from 1.
    pub number: u64,
    /// The part, as the job named it.
    pub part: Option<String>,
    /// The recipe that the part was inspected with.
    pub recipe: Option<String>,
    /// `ok`, or why there is no result.
    pub outcome: String,
    /// Verdict over all features; absent without limits.
    pub verdict: Option<Verdict>,
    /// SHA-256 of the rig file, hexadecimal.
    pub rig_sha256: String,
    /// SHA-256 of the inspection plan; absent without one.
    pub plan_sha256: Option<String>,
    /// All features in the order of the plan.
    pub features: Vec<FeatureRecord>,
}

/// One feature of a part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FeatureRecord {
    /// Name of the feature in the plan.
    pub name: String,
    /// Unit of all its values.
    pub unit: Unit,
    /// Measured value; absent when nothing was measured.
    pub value: Option<f64>,
    /// Standard uncertainty of the value.
    pub u: Option<f64>,
    /// Nominal value of the plan.
    pub nominal: f64,
    /// Lower limit of the value.
    pub lower: Option<f64>,
    /// Upper limit of the value.
    pub upper: Option<f64>,
    /// Decision by ISO 14253-1.
    pub verdict: Option<Verdict>,
}

impl PartRecord {
    /// What the store keeps of the result of a cycle.
    pub fn of(result: &CycleResult) -> Self {
        let feature = |feature: &metrology::inspection::FeatureResult| FeatureRecord {
            name: feature.name.clone(),
            unit: feature.unit,
            value: feature.value.filter(|value| value.is_finite()),
            u: feature.u.filter(|u| u.is_finite()),
            nominal: feature.nominal,
            lower: feature.lower,
            upper: feature.upper,
            verdict: feature.verdict,
        };
        Self {
            format: PARTS_FORMAT.into(),
            date: result.date.clone(),
            cell: result.cell.clone(),
            number: result.number,
            part: result.part.clone(),
            recipe: result.recipe.clone(),
            outcome: result.outcome.clone(),
            verdict: result.verdict,
            rig_sha256: result.rig_sha256.clone(),
            plan_sha256: result.plan_sha256.clone(),
            features: result.features.iter().map(feature).collect(),
        }
    }
}

/// A store that a run appends to.
#[derive(Debug)]
pub struct PartStore {
    path: PathBuf,
    file: File,
    last_seal: String,
    full_bytes: u64,
}

impl PartStore {
    /// Opens the store of a folder, or begins it. A last line without an end is cut off; its length in bytes is returned.
    ///
    /// # Errors
    /// A line was changed; the file cannot be read or written; it is no plain file.
    pub fn open(folder: &Path) -> Result<(Self, u64), FileError> {
        let path = folder.join(STORE);
        refuse_special(&path)?;
        let cut = cut_unfinished(&path)?;
        let last_seal = read_sealed::<PartRecord>(&path, &Seal::Chain, PARTS_FORMAT)?.last_seal;
        let file = append(&path)?;
        Ok((Self { path, file, last_seal, full_bytes: FULL_BYTES }, cut))
    }

    /// Appends a cycle; its line is on the disk when this returns.
    ///
    /// # Errors
    /// The file cannot be written; it holds whole lines only then, too.
    pub fn append(&mut self, record: &PartRecord) -> Result<(), FileError> {
        let length = self.file.metadata().map_or(0, |metadata| metadata.len());
        if length >= self.full_bytes {
            self.rotate()?;
        }
        self.last_seal = append_sealed(&self.path, &mut self.file, &Seal::Chain, &self.last_seal, record)?;
        Ok(())
    }

    /// Puts the full file aside under the next free number.
    fn rotate(&mut self) -> Result<(), FileError> {
        let io = |source| FileError::io(&self.path, "put the full store aside", source);
        let folder = self.path.parent().unwrap_or(Path::new("."));
        let last = numbered(folder).map_err(io)?.last().map_or(0, |(number, _)| *number);
        fs::rename(&self.path, folder.join(format!("parts-{:04}.jsonl", last + 1))).map_err(io)?;
        self.file = append(&self.path)?;
        PARTS_FORMAT.clone_into(&mut self.last_seal);
        Ok(())
    }
}

fn append(path: &Path) -> Result<File, FileError> {
    let opened = OpenOptions::new().append(true).create(true).open(path);
    let file = opened.map_err(|source| FileError::io(path, "open it", source))?;
    guard::appending(&file.metadata().map_err(|source| FileError::io(path, "inspect it", source))?);
    Ok(file)
}

/// Cuts off what stands behind the last line feed; returns its length, bytes.
fn cut_unfinished(path: &Path) -> Result<u64, FileError> {
    let io = |source| FileError::io(path, "cut off a line that a crash left unfinished", source);
    let mut file = match OpenOptions::new().read(true).write(true).open(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(0),
        opened => opened.map_err(io)?,
    };
    let length = file.metadata().map_err(io)?.len();
    // One line has a few kilobytes; the end of a file that is no store need not be understood.
    let from = length.saturating_sub(8 << 20);
    file.seek(SeekFrom::Start(from)).map_err(io)?;
    let mut end = Vec::new();
    file.read_to_end(&mut end).map_err(io)?;
    let whole = end.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
    let cut = (end.len() - whole) as u64;
    // A file without any line is cut only if it begins as a line does.
    if cut > 0 && (whole > 0 || (from == 0 && end.starts_with(b"{\"format\":\"fringecell-parts/"))) {
        file.set_len(length - cut).map_err(io)?;
        return Ok(cut);
    }
    Ok(0)
}

/// Full files of a folder with their numbers, the oldest first.
fn numbered(folder: &Path) -> std::io::Result<Vec<(u64, PathBuf)>> {
    let number = |path: &Path| -> Option<u64> {
        path.file_name()?.to_str()?.strip_prefix("parts-")?.strip_suffix(".jsonl")?.parse().ok()
    };
    let mut all = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        all.extend(number(&path).map(|number| (number, path)));
    }
    all.sort();
    Ok(all)
}

/// Files of the store of a folder, the oldest first; empty where there is none.
///
/// # Errors
/// The folder cannot be listed.
pub fn store_files(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let all = numbered(folder).map_err(|source| FileError::io(folder, "list it", source))?;
    let current = Some(folder.join(STORE)).filter(|path| path.exists());
    Ok(all.into_iter().map(|(_, path)| path).chain(current).collect())
}

/// Reads and verifies one file of a store.
///
/// # Errors
/// It is absent, or a line was changed: the message names the line.
pub fn read_parts(path: &Path) -> Result<Vec<PartRecord>, FileError> {
    if !path.exists() {
        let problem = Problem::Syntax("does not exist".into());
        return Err(FileError::new(
            path,
            problem,
            "name a store of parts, or the folder of a cell's results",
        ));
    }
    let lines: SealedLines<PartRecord> = read_sealed(path, &Seal::Chain, PARTS_FORMAT)?;
    Ok(lines.entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(number: u64) -> PartRecord {
        PartRecord::of(&CycleResult { number, outcome: "ok".into(), ..CycleResult::default() })
    }

    #[test]
    fn parts_of_all_runs_come_back_in_their_order() {
        let dir = tempfile::tempdir().unwrap();
        for run in 0..3 {
            let (mut store, cut) = PartStore::open(dir.path()).unwrap();
            assert_eq!(cut, 0);
            (1..=2).for_each(|number| store.append(&record(10 * run + number)).unwrap());
        }
        let parts = read_parts(&store_files(dir.path()).unwrap()[0]).unwrap();
        assert_eq!(parts.iter().map(|p| p.number).collect::<Vec<_>>(), [1, 2, 11, 12, 21, 22]);
    }

    #[test]
    fn a_line_that_a_crash_left_unfinished_is_cut_wherever_it_ends() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(STORE);
        let (mut store, _) = PartStore::open(dir.path()).unwrap();
        (1..=2).for_each(|number| store.append(&record(number)).unwrap());
        let whole = fs::read(&path).unwrap();
        let first = whole.iter().position(|b| *b == b'\n').unwrap() + 1;
        for end in (30..whole.len()).step_by(97) {
            fs::write(&path, &whole[..end]).unwrap();
            let (mut store, cut) = PartStore::open(dir.path()).unwrap();
            let kept = if end < first { 0 } else { first };
            assert_eq!(cut as usize, end - kept, "cut at {end}");
            store.append(&record(7)).unwrap();
            let numbers: Vec<u64> = read_parts(&path).unwrap().iter().map(|p| p.number).collect();
            assert_eq!(numbers, if end < first { vec![7] } else { vec![1, 7] });
        }
        fs::write(&path, "notes of somebody").unwrap();
        assert!(PartStore::open(dir.path()).is_err(), "a file that is no store stays as it is");
        assert_eq!(fs::read_to_string(&path).unwrap(), "notes of somebody");
    }

    #[test]
    fn a_changed_value_is_refused_at_its_line() {
        let dir = tempfile::tempdir().unwrap();
        let (mut store, _) = PartStore::open(dir.path()).unwrap();
        (1..=3).for_each(|number| store.append(&record(number)).unwrap());
        let path = dir.path().join(STORE);
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, text.replacen("\"number\":2", "\"number\":9", 1)).unwrap();
        for error in [read_parts(&path).unwrap_err(), PartStore::open(dir.path()).unwrap_err()] {
            assert!(error.to_string().contains("parts.jsonl:2: the seal does not fit"), "{error}");
        }
    }

    #[test]
    fn a_full_file_is_put_aside_and_none_is_lost() {
        let dir = tempfile::tempdir().unwrap();
        let (mut store, _) = PartStore::open(dir.path()).unwrap();
        store.full_bytes = 700;
        (1..=12).for_each(|number| store.append(&record(number)).unwrap());
        let files = store_files(dir.path()).unwrap();
        assert!(files.len() > 3, "{files:?}");
        let all: Vec<u64> = files.iter().flat_map(|f| read_parts(f).unwrap()).map(|p| p.number).collect();
        assert_eq!(all, (1..=12).collect::<Vec<u64>>());
    }
}
