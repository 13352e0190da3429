//! What the supervisor tells a stage when it starts it.

use crate::schedule::Kind;
use rig::cycle_record::Kept;
use std::path::PathBuf;

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
    /// Its hash: a stage must not run another configuration than its supervisor.
    #[arg(long)]
    pub config_sha256: String,
    /// Hash of the rig file.
    #[arg(long)]
    pub rig_sha256: String,
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
