//! `fringecell trigger`: requests the inspection of one part from a serving cell.

use crate::client;
use crate::json;
use crate::supervisor::protocol::{Answer, Request};
use crate::terminal;
use anyhow::{Result, bail};
use files::result::CycleResult;
use metrology::verdict::Verdict;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Pause between two requests to a cell that is not ready.
const RETRY_PAUSE: Duration = Duration::from_millis(100);

/// Command-line arguments of `fringecell trigger`.
#[derive(Debug, Clone, clap::Args)]
pub struct TriggerArgs {
    /// Name or configuration file of the cell; default: the only running cell.
    #[arg(value_name = "CELL")]
    pub cell: Option<String>,
    /// Identification of the part; written to the result.
    #[arg(long, value_name = "ID")]
    pub part: String,
    /// Name of the recipe; default: the first one.
    #[arg(long, value_name = "NAME")]
    pub recipe: Option<String>,
    /// Longest wait for a cell that is starting or busy, s; 0: do not wait.
    #[arg(long, value_name = "SECONDS", default_value_t = 30)]
    pub patience: u64,
    /// Write the result of the cycle as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Inspects a part. Exit code 0: it passes, or was measured without a plan, and what was asked for is on the disk; 1: anything
/// else.
///
/// # Errors
/// The cell refuses the request.
pub fn trigger(args: &TriggerArgs) -> Result<u8> {
    // A part must not be inspected for a result that cannot be written.
    json::check_bare(args.json.as_deref(), &CycleResult::default())?;
    let cell = client::cell_name(args.cell.as_deref())?;
    let request = Request::Inspect { part: args.part.clone(), recipe: args.recipe.clone() };
    let begin = Instant::now();
    wait_for_start(args, cell.as_deref(), begin)?;
    loop {
        match client::ask_cell(cell.as_deref(), &request)? {
            Answer::Inspected(result) => return print_result(args, &result),
            Answer::NotReady { .. } if begin.elapsed() < Duration::from_secs(args.patience) => {
                std::thread::sleep(RETRY_PAUSE);
            }
            Answer::NotReady { state, reason } => {
                bail!(
                    "the part was not inspected within --patience {} s: the cell is in state {state:?}: {reason}",
                    args.patience
                )
            }
            Answer::Refused(reason) => bail!("the part was not inspected: {reason}"),
            _ => bail!("the cell sent an unexpected answer"),
        }
    }
}

/// Waits for the command socket of a named cell. Only before the request: a request is never sent twice.
fn wait_for_start(args: &TriggerArgs, cell: Option<&str>, begin: Instant) -> Result<()> {
    let mut noted = false;
    loop {
        match client::reach(cell) {
            Err(_) if cell.is_some() && begin.elapsed() < Duration::from_secs(args.patience) => {
                if !std::mem::replace(&mut noted, true) {
                    let name = cell.unwrap_or_default();
                    terminal::print_note(&format!(
                        "waiting up to {} s for cell '{name}' to start",
                        args.patience
                    ));
                }
                std::thread::sleep(RETRY_PAUSE);
            }
            other => return other,
        }
    }
}

fn print_result(args: &TriggerArgs, result: &CycleResult) -> Result<u8> {
    json::emit_bare(args.json.as_deref(), result)?;
    terminal::print_line(&terminal::cycle_line(result, None));
    if !result.features.is_empty() {
        terminal::print_line(terminal::feature_table(&result.features, None).trim_end());
    }
    if let Some(kept) = &result.kept {
        cli::error(format_args!("the files of this part are not kept: {kept}"));
    }
    let pass = matches!(result.verdict, Some(Verdict::Pass) | None) && result.is_ok();
    Ok(u8::from(!pass || result.kept.is_some()))
}
