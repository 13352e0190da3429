//! `fringetool rotation-stage`: the axis of a stage found without markers, and views at known angles brought together.

mod calibrate;
mod input;
mod merge;
mod object;

pub use input::{Axis, View};
pub use object::axis_of_object;

use crate::Outcome;
use anyhow::Result;

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Find the axis from views of a sphere, or of any object, at known angles.
    Calibrate(calibrate::Args),
    /// Bring views together by a known axis, refine by ICP, merge them into one cloud.
    Merge(merge::Args),
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    match &args.what {
        What::Calibrate(args) => calibrate::run(args),
        What::Merge(args) => merge::run(args),
    }
}
