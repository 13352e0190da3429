//! `fringetool bench`: accuracy on the twin, speed on this machine. Measured, never asserted.

mod accuracy;
mod calibration;
mod scan;
mod speed;
mod transport;
mod unwrap;

use crate::Outcome;
use anyhow::Result;
use std::path::PathBuf;

/// Arguments of `bench`.
#[derive(clap::Args)]
pub struct Args {
    /// What to measure.
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// The twin's part, ideal and with each imperfection alone: cloud and features against the truth.
    Accuracy(Common),
    /// Rigs characterised from the twin's boards against the truth: parameters, reprojection, sphere spacings, time.
    Calibration(calibration::Args),
    /// Decode and matching: nanoseconds per pixel, share of the memory bandwidth, whole compute of a pair.
    Speed(speed::Args),
    /// Spatial unwrapping on maps whose answer is known: wrong pixels and time of every method.
    Unwrap(unwrap::Args),
    /// A frame from one process to another: shared memory beside a Unix socket and a pipe; the share of a cycle.
    Transport(transport::Args),
}

/// Arguments of one that has none of its own.
#[derive(clap::Args)]
pub struct Common {
    /// Machine-readable result.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<Outcome> {
    match &args.what {
        What::Accuracy(common) => accuracy::run(common.json.as_deref()),
        What::Calibration(args) => calibration::run(args),
        What::Speed(args) => speed::run(args),
        What::Unwrap(args) => unwrap::run(args),
        What::Transport(args) => transport::run(args),
    }
}
