//! How much of its results a cell that runs without end keeps in its output folder, earlier runs included: the oldest are
//! removed.

use crate::result_formats::beside;
use crate::run_folder;
use anyhow::{Context, Result};
use files::config::{ResultFormat, ResultRetention};
use std::collections::VecDeque;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Files of an earlier run, beside its parts, that count as one more part.
const RUN_FILES: [&str; 3] = ["cloud.ply", "report.html", "trace.json"];

/// What is removed together.
#[derive(Debug)]
struct Entry {
    paths: Vec<PathBuf>,
    bytes: u64,
}

/// What there is in an output folder, the oldest first.
#[derive(Debug)]
pub struct Retention {
    limits: ResultRetention,
    /// Clouds and reports of parts.
    parts: VecDeque<Entry>,
    /// Results; after those of an earlier run the folder of that run.
    results: VecDeque<PathBuf>,
}

impl Retention {
    /// For an output folder, with what earlier runs left in `runs/`.
    pub fn new(folder: &Path, limits: ResultRetention) -> Self {
        let mut kept = Self { limits, parts: VecDeque::new(), results: VecDeque::new() };
        for run in run_folder::earlier_runs(folder) {
            kept.parts.extend(entries(&run.join("parts")).into_iter().map(|part| Entry::of(vec![part])));
            let rest = RUN_FILES.map(|name| run.join(name)).into_iter().filter(|path| path.exists());
            kept.parts.extend(Some(Entry::of(rest.collect())).filter(|entry| !entry.paths.is_empty()));
            let is_json = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "json");
            kept.results.extend(entries(&run.join("results")).into_iter().filter(is_json));
            kept.results.push_back(run);
        }
        kept
    }

    /// Counts a new result and removes the oldest ones beyond the limit.
    ///
    /// # Errors
    /// A file cannot be removed.
    pub fn result(&mut self, path: PathBuf) -> Result<()> {
        self.results.push_back(path);
        while self.results.len() as u64 > self.limits.results {
            let Some(oldest) = self.results.pop_front() else { break };
            remove(&oldest)?;
            ResultFormat::ALL.iter().try_for_each(|format| remove(&beside(&oldest, *format)))?;
        }
        Ok(())
    }

    /// Counts the folder of a new part and removes the oldest ones beyond the limits. The last one stays, whatever its size.
    ///
    /// # Errors
    /// A folder cannot be removed.
    pub fn part(&mut self, folder: PathBuf) -> Result<()> {
        self.parts.push_back(Entry::of(vec![folder]));
        while self.parts.len() > 1 && self.is_over() {
            let Some(oldest) = self.parts.pop_front() else { break };
            oldest.paths.iter().try_for_each(|path| remove(path))?;
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        let bytes: u64 = self.parts.iter().map(|entry| entry.bytes).sum();
        self.parts.len() as u64 > self.limits.parts || bytes > self.limits.size_mb * 1_000_000
    }
}

impl Entry {
    fn of(paths: Vec<PathBuf>) -> Self {
        let bytes = paths.iter().map(|path| size(path)).sum();
        Self { paths, bytes }
    }
}

/// Files and folders in a folder in the order of the number that their names begin with; links are left out.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let number = |name: &str| {
        let digits = name.find(|c: char| !c.is_ascii_digit()).unwrap_or(name.len());
        name[..digits].parse::<u64>().ok()
    };
    let listed = fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
    let mut numbered: Vec<(u64, PathBuf)> = listed
        .filter(|entry| entry.file_type().is_ok_and(|kind| !kind.is_symlink()))
        .filter_map(|entry| Some((number(entry.file_name().to_str()?)?, entry.path())))
        .collect();
    numbered.sort();
    numbered.into_iter().map(|(_, path)| path).collect()
}

/// Size of a file, or of the files in a folder, bytes.
fn size(path: &Path) -> u64 {
    let Ok(metadata) = fs::symlink_metadata(path) else { return 0 };
    if metadata.is_dir() {
        return fs::read_dir(path).into_iter().flatten().flatten().map(|entry| size(&entry.path())).sum();
    }
    metadata.len()
}

fn remove(path: &Path) -> Result<()> {
    let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    match removed {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("--out: cannot remove {}", path.display()))
        }
        _ => Ok(()),
    }
}
