//! `fringecell status`: how a running cell is, once or as a view that stays up to date.

use crate::client;
use crate::print;
use crate::supervisor::profile::Percentiles;
use crate::supervisor::protocol::{StageStatus, Status};
use anyhow::Result;
use rig::result::write_json;
use rig::trace::{TraceSpan, write_trace};
use std::fmt::Write as _;
use std::io::{IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How often the live view looks: fast enough to see single cycles pass, slow enough to read.
const REFRESH: Duration = Duration::from_millis(500);

/// From this width on the table shows everything.
const WIDE: usize = 120;

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
            print::say(table(&status, WIDE).trim_end());
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
    let rows = client::spans(cell)?;
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
        })
        .collect();
    Ok(write_trace(file, &stages, &spans)?)
}

/// Draws over what it drew before.
#[derive(Default)]
struct View {
    lines: usize,
}

impl View {
    fn draw(&mut self, status: &Status) -> std::io::Result<()> {
        let terminal = console::Term::stdout();
        let (rows, columns) = terminal.size();
        let text = table(status, columns.into());
        // One line less than the terminal has, or the cursor cannot go back to the first one.
        let lines: Vec<&str> = text.lines().take(usize::from(rows).saturating_sub(1).max(1)).collect();
        let mut frame = String::new();
        if self.lines > 0 {
            let _ = write!(frame, "\x1b[{}A", self.lines);
        }
        for line in &lines {
            let shown: String = line.chars().take(columns.into()).collect();
            let _ = writeln!(frame, "\x1b[2K{shown}");
        }
        // What a taller frame left below.
        frame.push_str("\x1b[J");
        self.lines = lines.len();
        let mut out = std::io::stdout().lock();
        out.write_all(frame.as_bytes())?;
        out.flush()
    }
}

/// The status for people, in lines of at most `columns` (80 at least).
fn table(status: &Status, columns: usize) -> String {
    let wide = columns >= WIDE;
    let mut text = head(status);
    let _ = writeln!(
        text,
        "\n{:<22} {:>9} {:>9} {:>9} {:>9} {:>7}",
        "ms", "median", "95 %", "99 %", "max", "cycles"
    );
    for (name, times) in [("start → outcome", status.cycle_time), ("last frame → verdict", status.latency)]
    {
        let _ = writeln!(
            text,
            "{name:<22} {:>9} {:>9} {:>9} {:>9} {:>7}",
            ms(times.p50_ms, &times),
            ms(times.p95_ms, &times),
            ms(times.p99_ms, &times),
            ms(times.max_ms, &times),
            times.cycles
        );
    }
    let name = status.stages.iter().map(|s| s.name.chars().count()).max().unwrap_or(0).clamp(5, 24);
    let _ = write!(
        text,
        "\n{:<name$} {:<9} {:>7} {:>3} {:>8} {:>8} {:>8} {:>8} {:>7}",
        "stage", "state", "pid", "rst", "wait", "compute", "99 %", "max", "send"
    );
    text.push_str(if wide { "    cpu   faults  switches  MB/cycle\n" } else { "\n" });
    for stage in &status.stages {
        row(&mut text, stage, name, wide);
    }
    text
}

fn head(status: &Status) -> String {
    let of = status.cycles_requested.map_or_else(String::new, |n| format!(" of {n}"));
    let running: Vec<String> = status.running.iter().map(|cycle| (cycle + 1).to_string()).collect();
    let now = match running.len() {
        0 => "between cycles".to_owned(),
        1 => format!("in cycle {}", running[0]),
        _ => format!("in cycles {}", running.join(", ")),
    };
    let rate = status.cycles_per_minute.map_or_else(|| "–".to_owned(), |r| format!("{r:.1}"));
    let o = &status.outcomes;
    let mut text = format!(
        "cell '{}', pid {}: {:?}, {now}, {}{of} done, {rate} per minute\n\
         pass {}  indeterminate {}  fail {}  no verdict {}  not ok {}  deadline misses {}\n",
        status.cell,
        status.pid,
        status.state,
        status.cycles_done,
        o.pass,
        o.indeterminate,
        o.fail,
        o.no_verdict,
        o.not_ok,
        status.deadline_misses
    );
    if let Some(reason) = &status.reason {
        let _ = writeln!(text, "in error: {reason}; the control command reset begins anew");
    }
    if let Some((cycle, reason)) = &status.last_failure {
        let _ = writeln!(text, "last failure, cycle {}: {reason}", cycle + 1);
    }
    text
}

fn row(text: &mut String, stage: &StageStatus, name: usize, wide: bool) {
    let pid = stage.pid.map_or_else(|| "–".to_owned(), |pid| pid.to_string());
    let compute = &stage.compute;
    let _ = write!(
        text,
        "{:<name$.name$} {:<9.9} {pid:>7} {:>3} {:>8} {:>8} {:>8} {:>8} {:>7}",
        stage.name,
        stage.state,
        stage.restarts,
        ms(stage.wait.p50_ms, &stage.wait),
        ms(compute.p50_ms, compute),
        ms(compute.p99_ms, compute),
        ms(compute.max_ms, compute),
        ms(stage.send.p50_ms, &stage.send)
    );
    if wide {
        let (total, cycles) = (&stage.total, stage.cycles.max(1) as f64);
        let mean = |sum: u64| sum as f64 / cycles;
        let _ = write!(
            text,
            " {:>6.1} {:>8.1} {:>9.1} {:>9.2}",
            mean(total.cpu_ns) / 1e6,
            mean(total.minor_faults + total.major_faults),
            mean(total.voluntary_switches + total.involuntary_switches),
            mean(total.bytes) / 1e6
        );
    }
    text.push('\n');
}

/// A time, or a dash where nothing was measured yet.
fn ms(value: f64, of: &Percentiles) -> String {
    match value {
        _ if of.cycles == 0 => "–".to_owned(),
        v if v >= 10_000.0 => format!("{v:.0}"),
        v if v >= 100.0 => format!("{v:.1}"),
        v => format!("{v:.2}"),
    }
}
