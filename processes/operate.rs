//! Commands of an operator to a running cell: start, finish, abort, halt, reset, prepare, restart, stop.

use crate::client;
use crate::json;
use crate::supervisor::protocol::{Answer, Request};
use crate::terminal;
use anyhow::{Result, bail};
use serde::Serialize;
use std::path::PathBuf;

/// Which cell, and where the answer goes.
#[derive(Debug, Clone, clap::Args)]
pub struct CellArgs {
    /// Name or configuration file of the cell; default: the only running cell.
    #[arg(value_name = "CELL")]
    which: Option<String>,
    /// Name of the cell; alternative to CELL.
    #[arg(long, value_name = "NAME", conflicts_with = "which")]
    cell: Option<String>,
    /// Write the answer as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Command-line arguments of `start`.
#[derive(Debug, Clone, clap::Args)]
pub struct StartArgs {
    #[command(flatten)]
    cell: CellArgs,
    /// Name of the recipe; default: the first one.
    #[arg(long, value_name = "NAME")]
    recipe: Option<String>,
    /// Number of cycles; default: until `finish`.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    cycles: Option<u64>,
}

/// Arguments of `prepare` and `unprepare`.
#[derive(Debug, Clone, clap::Args)]
pub struct RecipeArgs {
    #[command(flatten)]
    cell: CellArgs,
    /// Name of the recipe.
    #[arg(long, value_name = "NAME")]
    recipe: String,
}

/// Command-line arguments of `restart`.
#[derive(Debug, Clone, clap::Args)]
pub struct RestartArgs {
    /// Name of the stage, as shown by `status`.
    stage: String,
    /// Name of the cell, if several run.
    #[arg(long, value_name = "NAME")]
    cell: Option<String>,
    /// Write the answer as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What a cell did.
#[derive(Debug, Default, Serialize)]
struct Done<'a> {
    cell: &'a str,
    done: &'a str,
}

/// Sends a request.
///
/// # Errors
/// The cell does not exist, does not answer, or refuses.
pub fn send(args: &CellArgs, request: &Request) -> Result<u8> {
    json::check(args.json.as_deref(), &Done::default())?;
    let (name, answer) = client::request(args.name()?.as_deref(), request)?;
    match answer {
        Answer::Done(text) => args.report(name.as_str(), &text),
        Answer::NotReady { state, reason } => {
            bail!("cell '{}' is in state {state:?}: {reason}; try again later", name.as_str())
        }
        _ => bail!("the cell sent an unexpected answer"),
    }
}

/// Starts a job.
///
/// # Errors
/// As [`send`].
pub fn start(args: &StartArgs) -> Result<u8> {
    send(&args.cell, &Request::Start { recipe: args.recipe.clone(), cycles: args.cycles })
}

/// Makes a recipe selectable, or not.
///
/// # Errors
/// As [`send`].
pub fn prepare(args: &RecipeArgs, prepare: bool) -> Result<u8> {
    let recipe = args.recipe.clone();
    send(&args.cell, &if prepare { Request::Prepare { recipe } } else { Request::Unprepare { recipe } })
}

/// Restarts a stage.
///
/// # Errors
/// As [`send`]; or the stage does not exist.
pub fn restart(args: &RestartArgs) -> Result<u8> {
    let cell = CellArgs { which: None, cell: args.cell.clone(), json: args.json.clone() };
    send(&cell, &Request::Restart { stage: args.stage.clone() })
}

/// Stops a cell and waits for its end.
///
/// # Errors
/// As [`send`]; or it does not end.
pub fn stop(args: &CellArgs) -> Result<u8> {
    json::check(args.json.as_deref(), &Done::default())?;
    let (name, text) = client::stop(args.name()?.as_deref())?;
    args.report(name.as_str(), &text)
}

impl CellArgs {
    fn name(&self) -> Result<Option<String>> {
        client::cell_name(self.cell.as_deref().or(self.which.as_deref()))
    }

    fn report(&self, cell: &str, done: &str) -> Result<u8> {
        json::emit(self.json.as_deref(), &Done { cell, done })?;
        terminal::print_line(done);
        Ok(0)
    }
}
