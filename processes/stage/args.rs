//! What the supervisor tells a stage when it starts it.

use crate::schedule::Kind;
use files::cycle_record::Kept;
use std::path::PathBuf;

/// Digits of a hash that stand on the command line of a stage: enough that no change is missed.
const SHORT_HASH: usize = 16;

/// The hashes of all that a configuration consists of, as in [`StageArgs::files`].
pub fn short_hashes(files: &[(String, String)]) -> Vec<String> {
    files.iter().map(|(_, sha256)| sha256.chars().take(SHORT_HASH).collect()).collect()
}

/// Arguments of the hidden subcommand `stage`, written by the supervisor.
#[derive(Debug, Clone, clap::Args)]
pub struct StageArgs {
    /// What to be.
    pub kind: Kind,
    /// Name in the schedule.
    pub name: String,
    /// Cell to join.
    #[arg(long)]
    pub cell: String,
    /// Configuration.
    #[arg(long)]
    pub config: PathBuf,
    /// Hashes of all that the supervisor read: a stage must not run with anything else.
    #[arg(long, value_delimiter = ',')]
    pub files: Vec<String>,
    /// Process of the supervisor.
    #[arg(long)]
    pub parent: u32,
    /// Whether the supervisor watches frames and phases.
    #[arg(long)]
    pub watch: bool,
    /// Which bytes the supervisor keeps in a cycle record.
    #[arg(long)]
    pub kept: Kept,
    /// Where the recording goes, if one is written.
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// Whether several cycles are recorded, each in a folder of its own.
    #[arg(long)]
    pub record_many: bool,
}
