//! `fringetool bench`: accuracy on the twin, speed on this machine. Measured, never asserted.

mod accuracy;
mod bit_errors;
mod calibration;
mod error_sources;
mod exposures;
mod order_errors;
mod phase_methods;
mod planned;
mod recorded;
mod scan;
mod shown;
mod speed;
mod stage_axis;
mod transport;
mod unwrap;

use crate::Outcome;
use anyhow::{Result, bail};
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
    /// What each source of error does to phase and point, alone.
    ErrorSources(error_sources::Args),
    /// One exposure against several on a shiny part.
    Exposures(exposures::Args),
    /// Predicted phase noise and rates of wrong bits and orders against counted ones.
    OrderErrors(order_errors::Args),
    /// Every phase method and every order: error, wrong orders, time.
    PhaseMethods(phase_methods::Args),
    /// What plan-patterns promises against what comes out on the twin.
    PlanPatterns(planned::Args),
    /// Decode and matching: nanoseconds per pixel, share of the memory bandwidth, whole compute of a pair.
    Speed(speed::Args),
    /// The stated uncertainty of a stage's axis against its errors, over many seeds.
    StageAxis(stage_axis::Args),
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
        What::ErrorSources(args) => error_sources::run(args),
        What::Exposures(args) => exposures::run(args),
        What::OrderErrors(args) => order_errors::run(args),
        What::PhaseMethods(args) => phase_methods::run(args),
        What::PlanPatterns(args) => planned::run(args),
        What::Speed(args) => speed::run(args),
        What::StageAxis(args) => stage_axis::run(args),
        What::Unwrap(args) => unwrap::run(args),
        What::Transport(args) => transport::run(args),
    }
}

/// Refuses a number.
fn out_of_range(flag: &str, value: u64, limit: &str) -> Result<Outcome> {
    bail!("{flag} {value}: must be {limit}")
}
