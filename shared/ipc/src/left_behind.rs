//! Shared memory that killed cells left: it stays until a cell of the same name starts, and may be what another one lacks.

use crate::cell::{CellName, running_pid};
use crate::runtime_folder::user;
use crate::segments::{self, SHARED_MEMORY};
use std::os::unix::fs::MetadataExt;
use std::{fmt, fs};

/// What a cell that no supervisor runs any more holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftBehind {
    /// Name of the cell.
    pub cell: String,
    /// Bytes of its segments.
    pub bytes: u64,
    /// The command that frees them.
    pub remove: String,
}

impl fmt::Display for LeftBehind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} MB are what the killed cell \"{}\" left", self.bytes / 1_000_000, self.cell)
    }
}

/// The cells of this user that left segments, by name; none where /dev/shm cannot be listed.
pub fn left_behind() -> Vec<LeftBehind> {
    let folders = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
    let names = folders.filter_map(|entry| {
        let is_ours = entry.metadata().is_ok_and(|found| found.is_dir() && found.uid() == user());
        let cell = entry.file_name().into_string().ok()?.strip_prefix("fringecell-")?.to_owned();
        CellName::new(&cell).ok().filter(|_| is_ours)
    });
    let held = names.filter(|name| running_pid(name).is_none()).filter_map(|name| {
        let bytes = segments::held_bytes(&name.prefix()).ok().filter(|bytes| *bytes > 0)?;
        let remove = format!("rm -r {} {}*", name.folder().display(), name.segments());
        Some(LeftBehind { cell: name.as_str().to_owned(), bytes, remove })
    });
    let mut all: Vec<LeftBehind> = held.collect();
    all.sort_by(|a, b| a.cell.cmp(&b.cell));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::CellLock;

    #[test]
    fn what_a_killed_cell_holds_is_named_and_a_running_one_holds_nothing() {
        let name = CellName::new(&format!("left-{}", std::process::id())).unwrap();
        let of_this = || left_behind().into_iter().find(|left| left.cell == name.as_str());
        let lock = CellLock::take(&name).unwrap();
        let segment = format!("{}abc.data", name.segments());
        fs::write(&segment, vec![1; 8192]).unwrap();
        assert_eq!(of_this(), None, "the cell runs");
        // A killed supervisor removes nothing.
        let kept = name.folder();
        drop(lock);
        fs::create_dir_all(&kept).unwrap();
        fs::write(&segment, vec![1; 8192]).unwrap();
        let left = of_this().expect("its segment is there");
        assert_eq!(left.bytes, 8192);
        assert!(left.remove.contains(kept.to_str().unwrap()), "{}", left.remove);
        let removed = std::process::Command::new("sh").args(["-c", &left.remove]).status().unwrap();
        assert!(removed.success() && !kept.exists() && !std::path::Path::new(&segment).exists());
    }
}
