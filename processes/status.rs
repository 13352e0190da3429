//! `fringecell status`: shows the status of a running cell, once or as a live view.

mod view;

use crate::client;
use crate::json;
use crate::supervisor::protocol::Spans;
use crate::terminal;
use anyhow::Result;
use files::trace::{TraceSpan, write_trace};
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::time::Duration;
use view::{View, table};

/// Refresh interval of the live view.
const REFRESH: Duration = Duration::from_millis(500);

/// Command-line arguments of `fringecell status`.
#[derive(Debug, Clone, clap::Args)]
pub struct StatusArgs {
    /// Name or configuration file of the cell; default: the only running cell.
    #[arg(value_name = "CELL")]
    pub which: Option<String>,
    /// Name of the cell; alternative to CELL.
    #[arg(long, value_name = "NAME", conflicts_with = "which")]
    pub cell: Option<String>,
    /// Write the times of all stages in the last cycles to this file, for ui.perfetto.dev.
    #[arg(long, value_name = "FILE", conflicts_with = "json")]
    pub trace: Option<PathBuf>,
    /// Write the status as JSON to this file; without FILE or with -, to standard output.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    pub json: Option<PathBuf>,
    /// Print the status once instead of a live view; default if standard output is not a terminal.
    #[arg(long)]
    pub once: bool,
}

/// Shows the status of a cell.
///
/// # Errors
/// The cell does not exist or does not answer.
pub fn status(args: &StatusArgs) -> Result<()> {
    let which = client::cell_name(args.cell.as_deref().or(args.which.as_deref()))?;
    if let Some(file) = &args.trace {
        return trace(file, which.as_deref());
    }
    let mut status = client::status(which.as_deref())?;
    match &args.json {
        Some(file) => json::emit(Some(file), &status)?,
        None if args.once || !std::io::stdout().is_terminal() => {
            terminal::print_line(table(&status, view::columns()).trim_end());
        }
        None => {
            let mut view = View::default();
            loop {
                view.draw(&status)?;
                std::thread::sleep(REFRESH);
                // Stay with this cell, even if others start or end.
                match client::status(Some(&status.cell)) {
                    Ok(now) => status = now,
                    Err(_) => break,
                }
            }
            terminal::print_line(&format!("cell '{}' has ended", status.cell));
        }
    }
    Ok(())
}

/// Writes the times of the last cycles as a trace.
fn trace(file: &Path, cell: Option<&str>) -> Result<()> {
    let Spans { activations: rows, cycles } = client::spans(cell)?;
    let mut stages: Vec<&str> = Vec::new();
    for row in &rows {
        if !stages.contains(&row.stage.as_str()) {
            stages.push(&row.stage);
        }
    }
    let spans: Vec<TraceSpan> = rows
        .iter()
        .map(|row| TraceSpan {
            stage: stages.iter().position(|stage| *stage == row.stage).unwrap_or_default(),
            name: row.name.clone(),
            cycle: row.cycle,
            wait_ns: row.wait_ns,
            start_ns: row.start_ns,
            end_ns: row.end_ns,
            send_ns: row.send_ns,
        })
        .collect();
    Ok(write_trace(file, &stages, &spans, &cycles)?)
}
