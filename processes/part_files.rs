//! The files of every part that a serving cell inspects, and how many of them are kept.

use crate::run_files::{self, RunFiles};
use crate::run_folder::RunFolder;
use crate::supervisor::collect::Span;
use crate::supervisor::history::History;
use crate::supervisor::snapshot::CameraImage;
use anyhow::{Context, Result, bail};
use devices::LoadedCell;
use files::atomic;
use files::result::{CycleResult, write_json};
use fringe::cloud::Point;
use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Longest part of a folder's name that comes from the name of the part.
const NAME_CHARS: usize = 64;

/// What cloud and report of one part are made of. Phase maps are left out: they stay in shared memory.
#[derive(Debug, Default)]
pub struct Scan {
    /// The fused cloud; empty unless the cycle is ok.
    pub points: Vec<Point>,
    /// One image of each camera under each projector.
    pub images: BTreeMap<(u32, u32), CameraImage>,
    /// Times of the activations.
    pub spans: Vec<Span>,
}

/// The files of one cycle.
#[derive(Debug)]
pub enum Kept {
    /// The result alone, without cloud and report.
    Result,
    /// Cloud and report too.
    Scan(Box<Scan>),
    /// They are lost: too many wait for the disk.
    TooMany,
}

/// Writes the files of cycles, one after another.
pub struct PartFiles {
    folder: Arc<RunFolder>,
    cell: LoadedCell,
    /// Folders of this run with their sizes, the oldest first.
    parts: VecDeque<(PathBuf, u64)>,
}

impl PartFiles {
    /// For the folder of a run.
    pub fn new(folder: Arc<RunFolder>, cell: &LoadedCell) -> Self {
        Self { folder, cell: cell.clone(), parts: VecDeque::new() }
    }

    /// Writes what is kept of a cycle.
    ///
    /// # Errors
    /// Something is not on the disk.
    pub fn write(&mut self, result: &CycleResult, kept: &Kept) -> Result<()> {
        self.folder.check()?;
        run_files::cycle(self.folder.path(), result)?;
        match kept {
            Kept::Result => Ok(()),
            Kept::Scan(scan) => self.part(result, scan),
            Kept::TooMany => {
                bail!("--out: cloud and report of the part are lost: the disk is slower than the cell")
            }
        }
    }

    /// Writes the folder of a part in one step, then removes the oldest ones beyond what is kept.
    fn part(&mut self, result: &CycleResult, scan: &Scan) -> Result<()> {
        let all = self.folder.path().join("parts");
        let making = all.join(".making");
        // Left by a part that could not be written.
        if making.exists() {
            fs::remove_dir_all(&making).with_context(|| format!("cannot empty {}", making.display()))?;
        }
        atomic::create_dir(&making)?;
        write_json(&making.join("result.json"), result)?;
        if result.is_ok() {
            run_files::cloud(&making.join("cloud.ply"), &self.cell, &scan.points)?;
        }
        let history = History { spans: scan.spans.clone().into(), ..History::default() };
        let run = RunFiles {
            cell: &self.cell,
            results: std::slice::from_ref(result),
            history: &history,
            images: &scan.images,
            maps: &BTreeMap::new(),
            points: result.is_ok().then_some(&scan.points),
            truth: None,
        };
        run_files::report(&making, &run)?;
        let place = all.join(folder_name(result));
        let moved = fs::rename(&making, &place);
        moved.with_context(|| format!("cannot create the folder {}", place.display()))?;
        let bytes = size(&place);
        self.parts.push_back((place, bytes));
        self.remove_oldest()
    }

    fn remove_oldest(&mut self) -> Result<()> {
        let limits = self.cell.file.results;
        loop {
            let bytes: u64 = self.parts.iter().map(|(_, bytes)| bytes).sum();
            let over = self.parts.len() as u64 > limits.keep_parts || bytes > limits.keep_mb * 1_000_000;
            // The last one stays, whatever its size.
            if !over || self.parts.len() < 2 {
                return Ok(());
            }
            if let Some((oldest, _)) = self.parts.pop_front() {
                match fs::remove_dir_all(&oldest) {
                    Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                        return Err(error).with_context(|| format!("cannot remove {}", oldest.display()));
                    }
                    _ => {}
                }
            }
        }
    }
}

/// Number and part: `0007-bracket_12`.
fn folder_name(result: &CycleResult) -> String {
    let safe = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' };
    let part: String = result.part.iter().flat_map(|part| part.chars().take(NAME_CHARS).map(safe)).collect();
    if part.is_empty() { format!("{:04}", result.number) } else { format!("{:04}-{part}", result.number) }
}

fn size(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
    entries.filter_map(|entry| entry.metadata().ok()).map(|metadata| metadata.len()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_of_a_part_carries_its_number_and_a_safe_name() {
        let named = |part: Option<&str>| {
            folder_name(&CycleResult { number: 7, part: part.map(str::to_owned), ..CycleResult::default() })
        };
        assert_eq!(named(None), "0007");
        assert_eq!(named(Some("bracket 12")), "0007-bracket_12");
        assert_eq!(named(Some("../ä/x")), "0007-..___x");
        assert_eq!(named(Some(&"x".repeat(300))).len(), 5 + NAME_CHARS);
    }
}
