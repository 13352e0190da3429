//! The cycle record: one file that keeps of every cycle what went in, what came out, and how it ended.
//!
//! ```text
//! "fringecycles" version(u32)                       16 bytes
//! block*: kind(u32) activation(u32) cycle(u64) length(u64) checksum(u64) chain(u64), then `length` bytes
//! ```
//! All numbers little-endian; the sums are xxh3 (64 bits). `checksum` is of the contents of the block; `chain` is of the
//! 32 bytes before it, seeded with the chain of the block before (at first with the sum of the first 16 bytes). So every
//! byte is under a sum, and no block can be altered, left out, repeated or moved unnoticed. The first block is the
//! [`RecordHeader`]. A cycle is any number of value blocks (frames and stage outputs, if they are kept) closed by one
//! [`CycleEntry`]; what no entry closes does not count. The last block is the [`Seal`]: a record without one was cut
//! off, its run was killed, or still goes on. So the file is readable after a crash, up to the last complete cycle; half a
//! cycle is never taken for a whole one, nor half a record for a whole record.

mod block;
mod codec;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use read::{DamagedCycle, Ending, Next, RecordReader, RecordedCycle, StoredValue};
pub use write::RecordWriter;

use crate::hash::sha256_hex;
pub use cell::Retention;
use metrology::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// Version of the file; another one is refused. 2: the recipes of the cell, and of each cycle its recipe. 3: every byte
/// is under a sum, the sums are chained, the end is sealed.
pub const RECORD_VERSION: u32 = 3;

/// What stands at the beginning, before the version.
const MAGIC: [u8; 12] = *b"fringecycles";

/// Description of the run: cell, files, schedule.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordHeader {
    /// Name of the cell.
    pub cell: String,
    /// Program that recorded, with version and commit.
    pub software: String,
    /// Start of the run, RFC 3339.
    pub started: String,
    /// Absolute path of the configuration.
    pub config: String,
    /// SHA-256 of the configuration.
    pub config_sha256: String,
    /// SHA-256 of the rig file.
    pub rig_sha256: String,
    /// All recipes of the cell.
    pub recipes: Vec<RecordedRecipe>,
    /// SHA-256 of the description of the recording that was played.
    pub recording_sha256: Option<String>,
    /// Which bytes are kept.
    pub retention: Retention,
    /// The schedule: what the numbers of the activations mean.
    pub activations: Vec<ActivationName>,
}

/// A way to inspect a part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedRecipe {
    /// Name of the recipe.
    pub name: String,
    /// SHA-256 of its inspection plan, with shares of the calibration that of the plan's and theirs one after the other; absent when nothing is
    /// inspected.
    pub plan_sha256: Option<String>,
}

impl From<&cell::Recipe> for RecordedRecipe {
    fn from(recipe: &cell::Recipe) -> Self {
        let both = |(plan, shares): (&String, &String)| sha256_hex(format!("{plan}{shares}").as_bytes());
        let together = recipe.plan_sha256.as_ref().zip(recipe.calibration_shares_sha256.as_ref()).map(both);
        Self { name: recipe.name.clone(), plan_sha256: together.or(recipe.plan_sha256.clone()) }
    }
}

/// An activation of the schedule.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ActivationName {
    /// Its stage, such as `decode/cam1`.
    pub stage: String,
    /// What it does, such as `expose proj1 003`.
    pub label: String,
    /// What it gives, such as `phase/cam1/proj1/x`; absent when nothing leaves the stage.
    pub output: Option<String>,
}

/// How one cycle went.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CycleEntry {
    /// Number of the cycle, from 0.
    pub cycle: u64,
    /// Recipe that it was inspected with, counted in the header.
    pub recipe: u32,
    /// `ok` or the reason.
    pub outcome: String,
    /// The verdict, if there was one.
    pub verdict: Option<Verdict>,
    /// From the last frame to the verdict, ns.
    pub latency_ns: Option<u64>,
    /// What was done, in the order of the schedule; after a failure some are absent.
    pub activations: Vec<ActivationEntry>,
}

/// How one activation went.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ActivationEntry {
    /// Number in the schedule.
    pub activation: u32,
    /// Bytes of its output; 0 when nothing leaves the stage.
    pub bytes: u64,
    /// Hash of its output (xxh3, 128 bits): high and low half.
    pub hash: [u64; 2],
    /// Valid pixels, points, features.
    pub count: u32,
    /// Waiting before the start, ns.
    pub wait_ns: u64,
    /// Start on the machine's monotonic clock, ns.
    pub start_ns: u64,
    /// End on the machine's monotonic clock, ns.
    pub end_ns: u64,
}

/// The end of a record whose run came to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seal {
    /// Cycles in the record.
    pub cycles: u64,
    /// Cycles that could not be recorded.
    pub lost: u64,
}

/// Whose bytes a value block holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ValueKey {
    /// Number of the cycle, from 0.
    pub cycle: u64,
    /// Activation of the schedule.
    pub activation: u32,
}
