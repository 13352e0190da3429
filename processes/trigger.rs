//! `fringecell trigger`: asks a cell that serves for the inspection of one part.

use crate::client;
use crate::print;
use crate::supervisor::protocol::{Answer, Request};
use anyhow::{Result, bail};
use files::result::{CycleResult, OUTCOME_OK, ResultVerdict, write_json};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// How often a cell that is not ready is asked again.
const AGAIN: Duration = Duration::from_millis(100);

/// Arguments of `trigger`.
#[derive(Debug, Clone, clap::Args)]
pub struct TriggerArgs {
    /// Which cell: its name or its configuration; the only one that runs if left out.
    #[arg(value_name = "CELL")]
    pub cell: Option<String>,
    /// Which part; stands in the result.
    #[arg(long, value_name = "ID")]
    pub part: String,
    /// How it is inspected; the first recipe if left out.
    #[arg(long, value_name = "NAME")]
    pub recipe: Option<String>,
    /// Wait so long for a cell that starts or is busy, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 30)]
    pub patience: u64,
    /// The result of the cycle as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Inspects a part. Exit code 0: it passes, or was measured where there is nothing to judge; 1: anything else.
///
/// # Errors
/// A request that the cell refuses.
pub fn trigger(args: &TriggerArgs) -> Result<u8> {
    let cell = client::named(args.cell.as_deref())?;
    let request = Request::Inspect { part: args.part.clone(), recipe: args.recipe.clone() };
    let begin = Instant::now();
    loop {
        match client::ask_cell(cell.as_deref(), &request)? {
            Answer::Inspected(result) => return tell(args, &result),
            Answer::NotReady { .. } if begin.elapsed() < Duration::from_secs(args.patience) => {
                std::thread::sleep(AGAIN);
            }
            Answer::NotReady { state, reason } => {
                bail!("not inspected within --patience {} s: the cell is {state:?}, {reason}", args.patience)
            }
            Answer::Refused(reason) => bail!("not inspected: {reason}"),
            _ => bail!("the cell gave no result"),
        }
    }
}

fn tell(args: &TriggerArgs, result: &CycleResult) -> Result<u8> {
    if let Some(file) = &args.json {
        write_json(file, result)?;
    }
    print::say(&print::cycle_line(result, None));
    if !result.features.is_empty() {
        print::say(print::feature_table(&result.features, None).trim_end());
    }
    let pass = matches!(result.verdict, Some(ResultVerdict::Pass) | None) && result.outcome == OUTCOME_OK;
    Ok(u8::from(!pass))
}
