//! `fringecell status`: how a running cell is, once or as a view that stays up to date.

mod view;

use crate::client;
use crate::print;
use crate::supervisor::protocol::Spans;
use anyhow::Result;
use files::result::write_json;
use files::trace::{TraceSpan, write_trace};
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::time::Duration;
use view::{View, table};

/// How often the live view looks: fast enough to see single cycles pass, slow enough to read.
const REFRESH: Duration = Duration::from_millis(500);

/// Arguments of `status`.
#[derive(Debug, Clone, clap::Args)]
pub struct StatusArgs {
    /// Which cell, if several run: its name or its configuration.
    #[arg(value_name = "CELL")]
    pub which: Option<String>,
    /// The same.
    #[arg(long, value_name = "NAME", conflicts_with = "which")]
    pub cell: Option<String>,
    /// Write when each stage did what in the last cycles to this file, for ui.perfetto.dev.
    #[arg(long, value_name = "FILE", conflicts_with = "json")]
    pub trace: Option<PathBuf>,
    /// As JSON, to a file or, with - or no name, to standard output.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    pub json: Option<PathBuf>,
    /// Print once and end, as when the output is not a terminal.
    #[arg(long)]
    pub once: bool,
}

/// Says how a cell is.
///
/// # Errors
/// No such cell, or none that answers.
pub fn status(args: &StatusArgs) -> Result<()> {
    let which = client::named(args.cell.as_deref().or(args.which.as_deref()))?;
    if let Some(file) = &args.trace {
        return trace(file, which.as_deref());
    }
    let mut status = client::status(which.as_deref())?;
    match &args.json {
        Some(file) if file == Path::new("-") => {
            print::say(&serde_json::to_string_pretty(&status)?);
        }
        Some(file) => write_json(file, &status)?,
        None if args.once || !std::io::stdout().is_terminal() => {
            print::say(table(&status, view::columns()).trim_end());
        }
        None => {
            let mut view = View::default();
            loop {
                view.draw(&status)?;
                std::thread::sleep(REFRESH);
                // The cell that was chosen first, even if others come or go.
                match client::status(Some(&status.cell)) {
                    Ok(now) => status = now,
                    Err(_) => break,
                }
            }
            print::say(&format!("cell '{}' has ended", status.cell));
        }
    }
    Ok(())
}

/// Writes the spans of the last cycles.
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
