//! `fringetool bench`: accuracy on the twin, speed on this machine. Measured, never asserted.

mod accuracy;
mod bit_errors;
mod calibrated;
mod calibration;
mod drift;
mod error_sources;
mod exposures;
mod features;
mod order_errors;
mod peers_case;
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

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Accuracy on the twin, ideal and with each imperfection alone: cloud and features compared with the truth.
    Accuracy(Common),
    /// Calibrations from the twin's boards compared with the truth: parameters, reprojection, sphere spacings, time.
    Calibration(calibration::Args),
    /// Corrections of a camera that drifted, without and with a length standard: model chosen, sphere spacings.
    Drift(drift::Args),
    /// Effect of each source of error on phase and point, one at a time.
    ErrorSources(error_sources::Args),
    /// One exposure compared with several, on a shiny part.
    Exposures(exposures::Args),
    /// Errors of features over their stated uncertainty, calibrations times placements; single points too.
    Features(features::Args),
    /// Predicted phase noise and rates of wrong bits and orders compared with counted ones.
    OrderErrors(order_errors::Args),
    /// One case of a comparison with programs in other languages, on inputs that a foreign script wrote.
    PeersCase(peers_case::Args),
    /// Every phase method and every fringe order method: error, wrong orders, time.
    PhaseMethods(phase_methods::Args),
    /// Predictions of `plan-patterns` compared with results on the twin.
    PlanPatterns(planned::Args),
    /// Speed of decoding, matching, fusion and inspection of the demo's part: time per pixel and point, share of the memory bandwidth.
    Speed(speed::Args),
    /// Stated uncertainty of a rotation stage's axis compared with its errors, over many seeds.
    StageAxis(stage_axis::Args),
    /// Spatial unwrapping on maps with known solution: wrong pixels and time of every method.
    Unwrap(unwrap::Args),
    /// Transport of a frame between processes: shared memory, Unix socket and pipe; its share of a cycle.
    Transport(transport::Args),
}

/// Arguments of a benchmark without further options.
#[derive(clap::Args)]
pub struct Common {
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    match &args.what {
        What::Accuracy(common) => accuracy::run(common.json.as_deref()),
        What::Calibration(args) => calibration::run(args),
        What::Drift(args) => drift::run(args),
        What::ErrorSources(args) => error_sources::run(args),
        What::Exposures(args) => exposures::run(args),
        What::Features(args) => features::run(args),
        What::OrderErrors(args) => order_errors::run(args),
        What::PeersCase(args) => peers_case::run(args),
        What::PhaseMethods(args) => phase_methods::run(args),
        What::PlanPatterns(args) => planned::run(args),
        What::Speed(args) => speed::run(args),
        What::StageAxis(args) => stage_axis::run(args),
        What::Unwrap(args) => unwrap::run(args),
        What::Transport(args) => transport::run(args),
    }
}

/// Reports a number outside of its limits.
fn out_of_range(flag: &str, value: u64, limit: &str) -> Result<Outcome> {
    bail!("{flag} {value}: must be {limit}")
}
