//! The trend file of rig checks: one line per check, each sealed with the line before it.
//!
//! ```text
//! {"format":"fringecell-trend/1","date":"2026-01-31T08:00:00Z","rig_sha256":"…",…}<TAB>sha256:<64 digits>
//! ```
//! The seal of a line is the SHA-256 of the seal before it (of the format's name for the first line), a line feed and the
//! line's JSON. So a line that was changed, moved, inserted or taken out shows at its place. What a seal without a secret
//! cannot show: a file that was sealed again from the first changed line on, or whose last lines were cut off; note
//! the last seal elsewhere, or use a key. With a key the seals are `hmac-sha256:`, which only its holders can make; cut
//! ends still need the note.

use crate::document::{read_bytes, read_text};
use crate::error::{FileError, Problem};
use crate::guard;
use crate::hash::{hmac_sha256_hex, sha256_hex};
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

/// Value of `format` in each line.
pub const TREND_FORMAT: &str = "fringecell-trend/1";

/// A shorter key can be guessed.
const SHORTEST_KEY_BYTES: usize = 16;

/// A longer file is no key.
const LONGEST_KEY_BYTES: u64 = 4096;

/// The result of one drift check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrendEntry {
    /// Always the text [`TREND_FORMAT`].
    pub format: String,
    /// When the recording was made, RFC 3339.
    pub date: String,
    /// SHA-256 of the rig file.
    pub rig_sha256: String,
    /// SHA-256 of `recording.toml`, hexadecimal.
    pub recording_sha256: String,
    /// Whether all pairs are healthy.
    pub healthy: bool,
    /// The result of each pair.
    pub pairs: Vec<TrendPair>,
}

/// One pair of a check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrendPair {
    /// Name of the pair.
    pub name: String,
    /// Number of matched places used.
    pub used: usize,
    /// Mean epipolar residual, px.
    pub mean_px: f64,
    /// Root mean square, px.
    pub rms_px: f64,
    /// Root mean square of the fitted drift, px.
    pub drift_px: f64,
    /// Test statistic of the drift.
    pub statistic: f64,
    /// Limit of the test statistic.
    pub limit: f64,
    /// Whether the statistic is below the limit.
    pub healthy: bool,
}

/// What seals the lines.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Seal {
    /// SHA-256: shows damage and careless changes.
    Chain,
    /// HMAC with a secret: shows changes by all who do not hold it.
    Key(Vec<u8>),
}

impl Seal {
    /// Reads a key file; all its bytes are the key.
    ///
    /// # Errors
    /// Absent, or shorter than 16 or longer than 4096 bytes.
    pub fn read_key(path: &Path) -> Result<Self, FileError> {
        let key = read_bytes(path, LONGEST_KEY_BYTES)?;
        if key.len() < SHORTEST_KEY_BYTES {
            let problem = Problem::Value {
                value: format!("{} bytes", key.len()),
                limit: format!("a key has at least {SHORTEST_KEY_BYTES} bytes"),
            };
            return Err(FileError::new(path, problem, "make one: head -c 32 /dev/urandom > FILE"));
        }
        Ok(Self::Key(key))
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Chain => "sha256",
            Self::Key(_) => "hmac-sha256",
        }
    }

    fn of(&self, before: &str, json: &str) -> String {
        let text = format!("{before}\n{json}");
        let digits = match self {
            Self::Chain => sha256_hex(text.as_bytes()),
            Self::Key(key) => hmac_sha256_hex(key, text.as_bytes()),
        };
        format!("{}:{digits}", self.name())
    }
}

/// A trend file, read and verified.
#[derive(Debug, Clone, PartialEq)]
pub struct Trend {
    /// All checks, the oldest line first.
    pub entries: Vec<TrendEntry>,
    /// Seal of the last line: what the next one is sealed with.
    pub last_seal: String,
}

/// Reads and verifies a trend file; an absent one is empty.
///
/// # Errors
/// A line whose seal is not that of its text and the line before: the message names the line.
pub fn read_trend(path: &Path, seal: &Seal) -> Result<Trend, FileError> {
    let text = if path.exists() { read_text(path)? } else { String::new() };
    let mut trend = Trend { entries: Vec::new(), last_seal: TREND_FORMAT.to_owned() };
    let fault = |number: usize, problem: Problem, remedy: &str| {
        let mut fault = FileError::new(path, problem, remedy);
        fault.line = Some(number + 1);
        fault
    };
    if !text.is_empty() && !text.ends_with('\n') {
        let problem = Problem::Syntax("ends in the middle of a line".into());
        return Err(fault(text.lines().count().saturating_sub(1), problem, RESTORE));
    }
    for (number, line) in text.lines().enumerate() {
        let Some((json, found)) = line.split_once('\t') else {
            let problem = Problem::Syntax("has no seal: JSON, a tab and the seal are expected".into());
            return Err(fault(number, problem, RESTORE));
        };
        if found.split_once(':').map(|(kind, _)| kind) != Some(seal.name()) {
            let problem = Problem::Disagreement {
                what: "seals",
                here: format!(
                    "this line is sealed by {}",
                    found.split_once(':').map_or("nothing known", |(kind, _)| kind)
                ),
                there: format!("{} is asked for", seal.name()),
            };
            return Err(fault(
                number,
                problem,
                "give --key for a file sealed with one, and leave it out for one that is not",
            ));
        }
        if seal.of(&trend.last_seal, json) != found {
            let problem = Problem::Syntax(
                "the seal does not fit this line and the one before: the file was changed here, or the key is another one"
                    .into(),
            );
            return Err(fault(number, problem, RESTORE));
        }
        let entry: TrendEntry = serde_json::from_str(json).map_err(|error| {
            fault(number, Problem::Syntax(error.to_string()), "was it written by a later version?")
        })?;
        trend.entries.push(entry);
        found.clone_into(&mut trend.last_seal);
    }
    Ok(trend)
}

const RESTORE: &str = "restore it from a copy, or begin a new file";

/// Reads and verifies a trend file that will be appended to; an absent one is empty.
///
/// # Errors
/// As [`read_trend`]; the file is an input of the same command.
pub fn verify_trend(path: &Path, seal: &Seal) -> Result<Trend, FileError> {
    guard::may_write(path, "--trend")?;
    if path.exists() {
        guard::appending(&path.metadata().map_err(|source| FileError::io(path, "inspect it", source))?);
    }
    read_trend(path, seal)
}

/// Appends a check to a trend file after verifying all of it; the file grows by one whole line or stays as it is.
///
/// # Errors
/// As [`read_trend`]; a place that cannot be written.
pub fn append_trend(path: &Path, seal: &Seal, entry: TrendEntry) -> Result<Trend, FileError> {
    crate::document::refuse_special(path)?;
    // It is read and then appended to, which only an input must not be.
    guard::may_write(path, "--trend")?;
    let io = |action: &'static str| move |source| FileError::io(path, action, source);
    let mut file = OpenOptions::new().append(true).create(true).open(path).map_err(io("open it"))?;
    guard::appending(&file.metadata().map_err(io("inspect it"))?);
    // Two checks at once would seal their lines with the same line before.
    file.lock().map_err(io("lock it"))?;
    let mut trend = read_trend(path, seal)?;
    let json = serde_json::to_string(&entry)
        .map_err(|error| FileError::new(path, Problem::Syntax(error.to_string()), ""))?;
    let sealed = seal.of(&trend.last_seal, &json);
    let length = file.seek(SeekFrom::End(0)).map_err(io("inspect it"))?;
    let written = write_line(&mut file, &format!("{json}\t{sealed}\n"));
    if written.is_err() {
        // A line that is half there would break the chain.
        let _ = file.set_len(length);
    }
    written.map_err(io("write it"))?;
    trend.entries.push(entry);
    trend.last_seal = sealed;
    Ok(trend)
}

fn write_line(file: &mut File, line: &str) -> std::io::Result<()> {
    file.write_all(line.as_bytes())?;
    file.sync_all()
}

#[cfg(test)]
mod tests;
