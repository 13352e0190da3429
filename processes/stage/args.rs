//! Arguments that the supervisor passes to a stage.

use cell::Retention;
use cell::schedule::Kind;
use std::path::PathBuf;

/// Digits of each file hash on the command line of a stage: enough to detect every change.
const SHORT_HASH: usize = 16;

/// Shortened hashes of all files of a configuration, as in [`StageArgs::files`].
pub fn short_hashes(files: &[(String, String)]) -> Vec<String> {
    files.iter().map(|(_, sha256)| sha256.chars().take(SHORT_HASH).collect()).collect()
}

/// Arguments of the hidden subcommand `stage`, written by the supervisor.
#[derive(Debug, Clone, clap::Args)]
pub struct StageArgs {
    /// Kind of the stage.
    pub kind: Kind,
    /// Name of the stage in the schedule.
    pub name: String,
    /// Name of the cell.
    #[arg(long, value_name = "NAME")]
    pub cell: String,
    /// Path of the configuration.
    #[arg(long)]
    pub config: PathBuf,
    /// Hashes of all files that the supervisor read; the stage must read the same.
    #[arg(long, value_delimiter = ',')]
    pub files: Vec<String>,
    /// Hash of the files that a capture stage plays; it must find the same.
    #[arg(long)]
    pub frames: Option<String>,
    /// Process id of the supervisor.
    #[arg(long)]
    pub parent: u32,
    /// Whether the supervisor receives frames, phase maps and cloud for its report.
    #[arg(long)]
    pub watch: bool,
    /// Which values the supervisor keeps in a cycle record.
    #[arg(long)]
    pub retention: Retention,
    /// Folder of the recording, if one is written.
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// Whether each cycle is recorded in a folder of its own.
    #[arg(long)]
    pub record_many: bool,
}
