//! The output folder of a run: one cell at a time writes to it, and what an earlier run left there is moved aside.
//!
//! ```text
//! DIR/.fringecell.lock                    who writes here now: host, pid, cell, start; absent otherwise
//! DIR/run.json                            which run the files of DIR are of
//! DIR/result.json, results/, parts/, cloud.ply, report.html, trace.json
//! DIR/parts.jsonl                         a line for each cycle of all runs, for statistics
//! DIR/runs/20260131T080000Z-1/            the same files of the first run, moved here when the second one began
//! ```

use crate::software::FRINGECELL;
use anyhow::{Context, Result, bail, ensure};
use files::result::write_json;
use files::{atomic, clock, guard};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs::{self, File, TryLockError};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Name of the lock file.
const LOCK: &str = ".fringecell.lock";

/// Name of the file that states which run a folder is of.
const RUN: &str = "run.json";

/// Value of `format` in it.
const RUN_FORMAT: &str = "fringecell-run/1";

/// Names of all that a run writes to its folder; the first states that a run began here.
const OWN: [&str; 7] = [RUN, "result.json", "results", "parts", "cloud.ply", "report.html", "trace.json"];

/// Folder that earlier runs are moved to, and the one that a move begins with.
const RUNS: &str = "runs";
const MOVING: &str = ".moving";

/// A run, as its folder and its lock name it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Owner {
    format: String,
    cell: String,
    host: String,
    pid: u32,
    started: String,
    software: String,
    config: String,
    config_sha256: String,
}

impl Owner {
    fn line(&self) -> String {
        format!("cell '{}' (process {} on {}, since {})", self.cell, self.pid, self.host, self.started)
    }
}

/// A folder that this run alone writes to.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    lock: File,
    /// Bytes of the lock file that are known: others append to it what they were refused.
    known_bytes: AtomicU64,
}

impl RunFolder {
    /// Takes a folder for a run and moves what an earlier run left in it to `runs/`.
    ///
    /// # Errors
    /// Another cell writes there; files of these names are there that no run wrote; the folder cannot be written.
    pub fn take(path: &Path, cell: &devices::LoadedCell) -> Result<Self> {
        refuse_inside_of_a_run("--out", path)?;
        atomic::create_dir(path)?;
        let owner = Owner {
            format: RUN_FORMAT.into(),
            cell: cell.name.clone(),
            host: host(),
            pid: std::process::id(),
            started: clock::rfc3339_now(),
            software: FRINGECELL.line(),
            config: cell.file.document.path.display().to_string(),
            config_sha256: cell.file.sha256.clone(),
        };
        let lock = lock(path, &owner)?;
        let known_bytes = lock.metadata().map_or(0, |metadata| metadata.len());
        let folder = Self { path: path.to_owned(), lock, known_bytes: AtomicU64::new(known_bytes) };
        folder.move_earlier_run()?;
        write_json(&path.join(RUN), &owner)?;
        Ok(folder)
    }

    /// Path of the run folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the folder still belongs to this run, to be asked before every write. Tells of cells that wanted it.
    ///
    /// # Errors
    /// Its lock was removed or replaced.
    pub fn check(&self) -> Result<()> {
        let here = self.lock.metadata().ok().map(|m| (m.dev(), m.ino()));
        let there = fs::metadata(self.path.join(LOCK)).ok().map(|m| (m.dev(), m.ino()));
        ensure!(
            here.is_some() && here == there,
            "--out {}: the lock of this run was removed or replaced; another cell may write there",
            self.path.display()
        );
        let bytes = self.lock.metadata().map_or(0, |metadata| metadata.len());
        let known = self.known_bytes.swap(bytes, Ordering::Relaxed);
        if bytes > known {
            let mut text = String::new();
            let mut file = &self.lock;
            let _ = file.seek(std::io::SeekFrom::Start(known)).and_then(|_| file.read_to_string(&mut text));
            for line in text.lines() {
                tracing::warn!("--out {}: {line}", self.path.display());
            }
        }
        Ok(())
    }

    /// Moves the files of an earlier run into a folder of its own. A move that was broken off is continued.
    fn move_earlier_run(&self) -> Result<()> {
        let there: Vec<&str> =
            OWN.into_iter().filter(|name| self.path.join(name).symlink_metadata().is_ok()).collect();
        let moving = self.path.join(RUNS).join(MOVING);
        if there.is_empty() && !moving.exists() {
            return Ok(());
        }
        let earlier = [&self.path, &moving].into_iter().find_map(|folder| started(folder));
        let Some(started) = earlier else {
            bail!(
                "--out {}: the folder holds {}, which no run wrote; name a new or empty folder",
                self.path.display(),
                there.join(", ")
            );
        };
        atomic::create_dir(&moving)?;
        for name in &there {
            let from = self.path.join(name);
            guard::may_write(&from, "--out")?;
            let what = || format!("--out: cannot move {} of an earlier run aside", from.display());
            fs::rename(&from, moving.join(name)).with_context(what)?;
        }
        let (runs, stamp) = (self.path.join(RUNS), started.replace(['-', ':'], ""));
        let free = (1..100_000).map(|number| runs.join(format!("{stamp}-{number}"))).find(|to| !to.exists());
        let to = free.context("no free name")?;
        fs::rename(&moving, &to).with_context(|| format!("--out: cannot make {}", to.display()))?;
        tracing::info!("--out {}: the earlier run is in {}", self.path.display(), to.display());
        Ok(())
    }
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        // Only while it is this run's: another cell may have taken a folder whose lock somebody removed.
        if self.check().is_ok() {
            let _ = fs::remove_file(self.path.join(LOCK));
        }
    }
}

/// The folders of earlier runs in an output folder, the oldest first. Folders that no run wrote are left out.
pub fn earlier_runs(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder.join(RUNS)).into_iter().flatten().filter_map(Result::ok);
    let mut runs: Vec<(String, u64, PathBuf)> = entries
        .filter_map(|entry| {
            let name = entry.file_name();
            let (stamp, number) = name.to_str()?.rsplit_once('-')?;
            Some((stamp.to_owned(), number.parse().ok()?, entry.path()))
        })
        .filter(|(_, _, path)| !path.is_symlink() && started(path).is_some())
        .collect();
    runs.sort();
    runs.into_iter().map(|(_, _, path)| path).collect()
}

/// When the run began whose files are in a folder; `None`: no run wrote them.
fn started(folder: &Path) -> Option<String> {
    let text = |file: &str, key: &str| {
        // Not an input of the run: the files are moved, and new ones take their names.
        let value: Value = serde_json::from_slice(&fs::read(folder.join(file)).ok()?).ok()?;
        Some(value.get(key)?.as_str()?.to_owned())
    };
    let format = text(RUN, "format");
    let run = format.filter(|format| format == RUN_FORMAT).and_then(|_| text(RUN, "started"));
    // Runs of earlier versions left no `run.json`; the date of a result is as good.
    run.or_else(|| text("result.json", "outcome").and_then(|_| text("result.json", "date")))
}

/// Takes the lock of a folder. The system releases it when this process ends in whatever way, so that the file of a run
/// that was killed stops nobody.
/// Refuses a folder within the files of a run: they are moved aside when the next run begins there.
///
/// # Errors
/// The folder lies in one that a run owns.
pub fn refuse_inside_of_a_run(option: &str, folder: &Path) -> Result<()> {
    let whole = std::path::absolute(folder)?;
    // What exists of the path is taken without links.
    let there = whole.ancestors().find_map(|part| Some((part.canonicalize().ok()?, part.to_owned())));
    let Some((real, part)) = there else { return Ok(()) };
    let whole = whole.strip_prefix(&part).map_or(real.clone(), |rest| real.join(rest));
    for owner in whole.ancestors().skip(1).filter(|owner| owner.join(RUN).is_file()) {
        let within = whole.strip_prefix(owner).ok().and_then(|rest| rest.iter().next());
        let own =
            within.and_then(|name| name.to_str()).is_some_and(|name| OWN.contains(&name) || name == RUNS);
        ensure!(
            !own,
            "{option} {}: lies within the results of a run in {}; name a folder outside of it",
            folder.display(),
            owner.display()
        );
    }
    Ok(())
}

fn lock(folder: &Path, owner: &Owner) -> Result<File> {
    let path = folder.join(LOCK);
    let failed = || format!("--out {}: cannot lock the folder", folder.display());
    loop {
        if path.is_symlink() {
            bail!("{}: is a link; remove it", path.display());
        }
        let mut file =
            File::options().read(true).append(true).create(true).open(&path).with_context(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return refuse(folder, file, owner),
            Err(TryLockError::Error(error)) => return Err(error).with_context(failed),
        }
        // The owner may have removed the file between opening and locking.
        let same = |m: std::fs::Metadata| (m.dev(), m.ino());
        if fs::metadata(&path).ok().map(same) != file.metadata().ok().map(same) {
            continue;
        }
        if let Some(earlier) = first_line(&mut file) {
            tracing::warn!(
                "--out {}: the run of {} ended without removing its lock; its files are kept",
                folder.display(),
                earlier.line()
            );
        }
        file.set_len(0).with_context(failed)?;
        let line = serde_json::to_string(owner).with_context(failed)?;
        file.write_all(format!("{line}\n").as_bytes()).and_then(|()| file.sync_all()).with_context(failed)?;
        return Ok(file);
    }
}

/// Tells both: the caller by the error, the owner by a line in its lock file.
fn refuse(folder: &Path, mut file: File, owner: &Owner) -> Result<File> {
    let by = first_line(&mut file).map_or_else(|| "another cell".to_owned(), |owner| owner.line());
    let _ = writeln!(file, "{} wanted this folder and was refused", owner.line());
    bail!("--out {}: {by} writes there; name another folder", folder.display())
}

fn first_line(file: &mut File) -> Option<Owner> {
    let mut text = String::new();
    file.rewind().and_then(|()| file.read_to_string(&mut text)).ok()?;
    serde_json::from_str(text.lines().next()?).ok()
}

fn host() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    if name.trim().is_empty() { "this host".into() } else { name.trim().to_owned() }
}
