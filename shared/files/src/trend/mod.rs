//! The trend file of rig checks: one line per check, each sealed with the line before it, see [`sealed`](crate::sealed).

use crate::error::FileError;
use crate::guard;
use crate::sealed::{SealedLines, append_sealed, read_sealed};
use serde::{Deserialize, Serialize};
use std::fs::OpenOptions;
use std::path::Path;

pub use crate::sealed::Seal;

/// Value of `format` in each line.
pub const TREND_FORMAT: &str = "fringecell-trend/1";

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

/// A trend file, read and verified.
pub type Trend = SealedLines<TrendEntry>;

/// Reads and verifies a trend file; an absent one is empty.
///
/// # Errors
/// As [`read_sealed`].
pub fn read_trend(path: &Path, seal: &Seal) -> Result<Trend, FileError> {
    read_sealed(path, seal, TREND_FORMAT)
}

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
    trend.last_seal = append_sealed(path, &mut file, seal, &trend.last_seal, &entry)?;
    trend.entries.push(entry);
    Ok(trend)
}

#[cfg(test)]
mod tests;
