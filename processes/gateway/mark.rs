//! What a gateway leaves for the next one, in the runtime folder of the cell: which changes were delivered, and what clients called
//! their jobs. The cell removes it with the rest of the folder.

use super::names::JobNames;
use ipc::cell::CellName;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::PathBuf;

/// Delivered changes and named jobs of a run.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mark {
    /// Run of the cell.
    pub run: String,
    /// Number of the last change whose events were delivered.
    pub change: u64,
    /// What clients called their jobs.
    pub jobs: BTreeMap<u64, JobNames>,
}

/// The file of a cell.
pub struct MarkFile {
    path: PathBuf,
    written: Mark,
}

impl MarkFile {
    /// In the runtime folder of a cell.
    pub fn new(cell: &CellName) -> Self {
        Self { path: cell.folder().join("gateway"), written: Mark::default() }
    }

    /// What the last gateway left for a run; nothing of another run, nor of a file that was cut short.
    pub fn read(&mut self, run: &str) -> Option<Mark> {
        let text = std::fs::read(&self.path).ok()?;
        let mark: Mark = serde_json::from_slice(&text).ok()?;
        (mark.run == run).then_some(mark)
    }

    /// Writes what has changed since the last time.
    pub fn write(&mut self, mark: Mark) {
        if mark.run.is_empty() || self.written == mark {
            return;
        }
        let written = || -> std::io::Result<()> {
            let new = self.path.with_extension("new");
            std::fs::File::create(&new)?.write_all(&serde_json::to_vec(&mark)?)?;
            std::fs::rename(&new, &self.path)
        };
        if let Err(error) = written() {
            // Without the cell there is no folder, and nothing to remember.
            tracing::debug!("{}: {error}", self.path.display());
            return;
        }
        self.written = mark;
    }
}
