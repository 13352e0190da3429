//! Arguments that the supervisor passes to a stage.

use anyhow::{Result, bail};
use cell::Retention;
use cell::schedule::Kind;
use devices::LoadedCell;
use std::path::PathBuf;

/// Digits of each file hash on the command line of a stage: enough to detect every change.
const SHORT_HASH: usize = 16;

/// Shortened hashes of all files of a configuration, as in [`StageArgs::files`].
pub fn short_hashes(files: &[(String, String)]) -> Vec<String> {
    files.iter().map(|(_, sha256)| sha256.chars().take(SHORT_HASH).collect()).collect()
}

/// Refuses files that changed since the supervisor read them; `then`: their shortened hashes then.
///
/// # Errors
/// The first file that has changed.
pub fn check_files(cell: &LoadedCell, then: &[String]) -> Result<()> {
    let files = cell.file.read_files();
    // A list of another length implies another configuration, which is its first entry.
    let changed = files.iter().zip(short_hashes(&files)).zip(then).find(|((_, now), then)| now != *then);
    match changed {
        None => Ok(()),
        Some((((name, _), _), _)) => {
            bail!("{name} has changed since the start of the cell; stop the cell and start it again")
        }
    }
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
    /// The host of the cell that this computer is.
    #[arg(long)]
    pub host: Option<String>,
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
