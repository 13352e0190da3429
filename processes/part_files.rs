//! The files of every part that a serving cell inspects, and how many of them are kept.

use crate::retention::Retention;
use crate::run_files::{self, RunFiles};
use crate::run_folder::RunFolder;
use crate::supervisor::collect::Span;
use crate::supervisor::history::History;
use crate::supervisor::snapshot::CameraImage;
use anyhow::{Context, Result, bail};
use devices::LoadedCell;
use files::atomic;
use files::part_store::{PartRecord, PartStore};
use files::result::{CycleResult, write_json};
use fringe::cloud::Point;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
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

/// What is written of one cycle.
#[derive(Debug)]
pub enum PartOutput {
    /// The result alone, without cloud and report.
    ResultOnly,
    /// Cloud and report too.
    Scan(Box<Scan>),
    /// The result alone; cloud and report are lost, because too many wait for the disk.
    Lost,
}

/// Writes the files of cycles, one after another.
pub struct PartFiles {
    folder: Arc<RunFolder>,
    cell: LoadedCell,
    /// What is removed when there is more; `None`: nothing ever.
    retention: Option<Retention>,
    /// What statistics are made from.
    store: PartStore,
}

impl PartFiles {
    /// For the folder of a run; one that is `endless` removes the oldest results as its configuration states.
    ///
    /// # Errors
    /// The store of earlier parts was changed, or cannot be written.
    pub fn new(folder: Arc<RunFolder>, cell: &LoadedCell, endless: bool) -> Result<Self> {
        let retention = endless.then(|| Retention::new(folder.path(), cell.file.results));
        let (store, cut) = PartStore::open(folder.path())?;
        if cut > 0 {
            tracing::warn!("--out: {cut} bytes of an unfinished line were cut off the store of parts");
        }
        Ok(Self { folder, cell: cell.clone(), retention, store })
    }

    /// Writes the files of a cycle.
    ///
    /// # Errors
    /// Something is not on the disk.
    pub fn write(&mut self, result: &CycleResult, output: &PartOutput) -> Result<()> {
        self.folder.check()?;
        let path = run_files::cycle(self.folder.path(), &self.cell, result)?;
        self.store.append(&PartRecord::of(result))?;
        if let Some(retention) = &mut self.retention {
            retention.result(path)?;
        }
        match output {
            PartOutput::ResultOnly => Ok(()),
            PartOutput::Scan(scan) => self.part(result, scan),
            PartOutput::Lost => {
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
            run_files::cloud(&making.join("cloud.ply"), &self.cell, &scan.points, Some(result))?;
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
        link_latest(&all, &place)?;
        self.retention.as_mut().map_or(Ok(()), |retention| retention.part(place))
    }
}

/// Makes the link `latest` beside a folder point to it, in one step.
fn link_latest(all: &Path, place: &Path) -> Result<()> {
    let (link, making) = (all.join("latest"), all.join(".latest"));
    let Some(name) = place.file_name() else { return Ok(()) };
    let linked = match fs::remove_file(&making) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
        _ => std::os::unix::fs::symlink(name, &making).and_then(|()| fs::rename(&making, &link)),
    };
    linked.with_context(|| format!("cannot create the link {}", link.display()))
}

/// Number and part: `0007-bracket_12`.
fn folder_name(result: &CycleResult) -> String {
    let safe = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' };
    let part: String = result.part.iter().flat_map(|part| part.chars().take(NAME_CHARS).map(safe)).collect();
    if part.is_empty() { format!("{:04}", result.number) } else { format!("{:04}-{part}", result.number) }
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
