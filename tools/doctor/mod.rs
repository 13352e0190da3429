//! `fringetool doctor`: whether this computer and its cameras are ready for a cell, and what mends them.

mod cameras;
mod system;

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::Result;
use cell::Options;
use devices::LoadedCell;
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Configuration of the cell that this computer shall run; without it, what any cell needs.
    #[arg(value_name = "CONFIG")]
    config: Option<PathBuf>,
    /// Write the checks as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// How a check ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum State {
    /// As it should be.
    Good,
    /// The cell runs, but slower or less reliably than it could.
    Warning,
    /// The cell does not run.
    Bad,
    /// This computer does not tell.
    Unknown,
}

/// One thing that a cell rests on.
#[derive(Debug, Clone, Serialize)]
struct Check {
    /// What was looked at.
    name: String,
    state: State,
    /// What was found, in words.
    found: String,
    /// What a cell needs, in words; absent where nothing more is needed.
    wanted: Option<String>,
    /// The command, or the line of the configuration, that mends it.
    mend: Option<String>,
}

impl Check {
    fn new(name: impl Into<String>, state: State, found: impl Into<String>) -> Self {
        Self { name: name.into(), state, found: found.into(), wanted: None, mend: None }
    }

    /// What is wanted and what mends it, for a check that is not good.
    fn mended_by(mut self, wanted: impl Into<String>, mend: impl Into<String>) -> Self {
        if self.state != State::Good {
            (self.wanted, self.mend) = (Some(wanted.into()), Some(mend.into()));
        }
        self
    }
}

/// Looks at everything and prints what it found. Exit code 1: the cell does not run as it is.
pub fn run(args: &Args) -> Result<Outcome> {
    // With what a run with --out needs.
    let options = Options { watch: true, ..Options::default() };
    let cell = match &args.config {
        Some(config) => Some(devices::load(config, &options)?),
        None => None,
    };
    let inputs: Vec<_> = cell.iter().flat_map(|cell| cell.file.paths()).collect();
    check_outputs(&[("--json", args.json.as_deref())], &inputs, None)?;
    let config = args.config.as_ref().map_or_else(|| "CONFIG".to_owned(), |path| path.display().to_string());
    let mut checks = system::checks(cell.as_ref(), &config);
    checks.extend(cameras::checks(cell.as_ref()));
    checks.iter().for_each(print);
    let count = |state| checks.iter().filter(|check| check.state == state).count();
    let (bad, warnings) = (count(State::Bad), count(State::Warning));
    println!("{} checks: {bad} bad, {warnings} warnings", checks.len());
    emit(args.json.as_deref(), &serde_json::json!({ "ready": bad == 0, "checks": checks }))?;
    Ok(if bad == 0 { Outcome::Done } else { Outcome::LimitFailed })
}

fn print(check: &Check) {
    let state = match check.state {
        State::Good => "good   ",
        State::Warning => "WARNING",
        State::Bad => "BAD    ",
        State::Unknown => "unknown",
    };
    println!("{state}  {}: {}", check.name, check.found);
    if let Some(wanted) = &check.wanted {
        println!("         wanted: {wanted}");
    }
    if let Some(mend) = &check.mend {
        println!("         mend:   {mend}");
    }
}

/// Bytes of the largest frame that a camera of the cell sends over the network, if it has one.
fn largest_frame_bytes(cell: &LoadedCell) -> Option<usize> {
    let sent = cell.config.cameras.iter().filter(|camera| camera.genicam.is_some());
    sent.map(|camera| camera.width_px as usize * camera.height_px as usize * 2).max()
}
