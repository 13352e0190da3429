//! `fringecell run`: runs a cell, writes its files and returns the exit code.

use crate::client;
use crate::json;
use crate::monitor;
use crate::run_files::{self, RunFiles};
use crate::run_folder::{self, RunFolder};
use crate::supervisor::{self, PageOptions, RunOptions, Summary};
use crate::terminal;
use anyhow::{Context, Result, bail};
use cell::Retention;
use cell::{Cell, Options};
use devices::LoadedCell;
use files::atomic;
use files::output_check::check_outputs;
use files::result::CycleResult;
use serde::Serialize;
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use twin::Truth;

/// Results for tables and report: a run until stopped must not grow.
const MAX_RESULTS: usize = 1000;

/// Command-line arguments of `fringecell run`.
#[derive(Debug, Clone, clap::Args)]
pub struct RunArgs {
    /// Configuration of the cell.
    pub config: PathBuf,
    /// Number of cycles; overrides `cycles` of the configuration. Without either the cell runs until stopped.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub cycles: Option<u32>,
    /// Write result.json, cloud.ply, report.html and trace.json to this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Record the frames to this folder; with several cycles, to one subfolder per cycle.
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// Record every cycle to this new file, for `fringetool replay`.
    #[arg(long, value_name = "FILE")]
    pub cycle_record: Option<PathBuf>,
    /// Data in the cycle record beside hashes and times: hashes (none), frames, or all (frames and stage outputs).
    #[arg(long, alias = "keep", value_name = "WHAT", default_value_t, requires = "cycle_record")]
    pub retain: Retention,
    /// Name of the cell; overrides the configuration, to run it several times at once.
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// Run the part of this host of a cell on several computers (docs/several-computers.md). One host leads; the others wait for it.
    #[arg(long, value_name = "NAME")]
    pub host: Option<String>,
    /// Wait for jobs (`fringecell trigger`, docs/control.md) instead of starting cycles.
    #[arg(long, conflicts_with = "cycles")]
    pub serve: bool,
    /// Write the times of all stages in the last cycles to this file, for ui.perfetto.dev.
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Serve the live page at this address, for example 127.0.0.1:8080; port 0: any free port. It has the metrics too.
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with = "metrics")]
    pub page: Option<SocketAddr>,
    /// File with a token of 16 to 256 characters that viewers of the page must know; needed where other machines can reach it.
    #[arg(long, value_name = "FILE", requires = "page")]
    pub page_token: Option<PathBuf>,
    /// Serve only the metrics, for Prometheus, at this address, for example 127.0.0.1:9464; port 0: any free port.
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub metrics: Option<SocketAddr>,
    /// Allow --metrics at an address that other machines can reach.
    #[arg(long, requires = "metrics")]
    pub allow_remote: bool,
    /// Write counts and results of the last 1000 cycles as JSON to this file at the end; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Cycles that a serving cell begins with; only the demo sets it.
    #[arg(skip)]
    pub first_cycles: Option<u64>,
}

/// What a run did, as JSON.
#[derive(Debug, Serialize)]
struct RunReport<'a> {
    cell: &'a str,
    config_sha256: &'a str,
    cycles_done: u64,
    cycles_ok: u64,
    /// Cycles with a plan whose verdict is not pass.
    cycles_not_pass: u64,
    /// Requested cycles that were never started.
    cycles_not_run: u64,
    /// Whether an operator stopped the run.
    stopped: bool,
    /// Why the cell gave up, if it did.
    gave_up: Option<&'a str>,
    results: &'a [CycleResult],
}

/// Runs a cell. If the truth is given, features are compared with it.
///
/// # Errors
/// Invalid input, or the machine cannot run the cell.
pub fn run(args: &RunArgs, truth: Option<&Truth>) -> Result<u8> {
    loop {
        // A host that is led begins anew with each start of the one that leads.
        if let Some(code) = run_once(args, truth)? {
            return Ok(code);
        }
    }
}

/// One run; without an exit code there is to be another one.
fn run_once(args: &RunArgs, truth: Option<&Truth>) -> Result<Option<u8>> {
    let config = args.config.canonicalize().with_context(|| {
        format!("{}: cannot open the configuration; check the path", args.config.display())
    })?;
    let cell = load(args, &config)?;
    let written = [
        ("--cycle-record", args.cycle_record.as_deref()),
        ("--trace", args.trace.as_deref()),
        ("--json", args.json.as_deref()),
    ];
    check_outputs(&written, &cell.file.paths(), None)?;
    let page = page_options(args, truth.is_some())?;
    devices::check(&cell)?;
    let frames = devices::played_files(&cell)?;
    // Before the folder is taken: a run that is refused leaves the files of the run before where they are.
    client::refuse_running(&cell.name)?;
    let record = record_folder(args)?;
    let folder = args.out.as_deref().map(|folder| RunFolder::take(folder, &cell)).transpose()?.map(Arc::new);
    note_overlap(args, &cell);
    let interrupted = Arc::new(AtomicBool::new(false));
    let options = RunOptions {
        interrupted: Arc::clone(&interrupted),
        config,
        cycles: if args.serve { None } else { cycles(args, &cell) },
        serve: args.serve,
        out: folder.clone(),
        frames,
        record,
        cycle_record: args.cycle_record.clone(),
        page,
        first_cycles: args.first_cycles,
    };
    let needs_stdout = needs_stdout(args, &options);
    let mut results = VecDeque::new();
    let mut summary = supervisor::run(&cell, &options, &mut |result| {
        if !print_cycle(result, &options) && needs_stdout {
            interrupted.store(true, Ordering::SeqCst);
        }
        if results.len() == MAX_RESULTS {
            results.pop_front();
        }
        results.push_back(result.clone());
    })?;
    // A disk that did not answer would not answer other outputs either, and nobody would learn of it.
    if let Some(error) = summary.unwritten.take() {
        return Err(error);
    }
    if summary.tally.renew {
        terminal::print_note("the host that leads was started again: this host begins anew");
        return Ok(None);
    }
    let results: Vec<CycleResult> = results.into();
    print_tables(&cell, &results, truth);
    let mut lost = write_files(args, &cell, &results, &mut summary, folder.as_deref(), truth);
    let code = exit_code(&cell, &summary, &options);
    lost.add(json::emit(args.json.as_deref(), &report(&cell, &summary, &results)).err());
    lost.named()?;
    Ok(Some(code))
}

/// Why outputs are lost; one that fails keeps no other from being written.
#[derive(Debug, Default)]
struct Lost(Vec<anyhow::Error>);

impl Lost {
    fn add(&mut self, reasons: impl IntoIterator<Item = anyhow::Error>) {
        self.0.extend(reasons);
    }

    /// Prints all but the last, which the end of the program prints.
    fn named(mut self) -> Result<()> {
        let last = self.0.pop();
        self.0.iter().for_each(|reason| cli::error(format_args!("{reason:#}")));
        last.map_or(Ok(()), Err)
    }
}

/// The cell of a configuration, or what a host has of it.
fn load(args: &RunArgs, config: &Path) -> Result<LoadedCell> {
    let options = Options {
        cell: args.cell.clone(),
        watch: args.out.is_some() || args.page.is_some(),
        record: args.record.is_some(),
        retention: args.retain,
        host: args.host.clone(),
    };
    let cell = devices::load(config, &options)?;
    check_host(args, &cell)?;
    if cell.graph.leads() {
        return Ok(cell);
    }
    // It has no fused cloud that could be shown.
    Ok(devices::load(config, &Options { watch: false, ..options })?)
}

/// Refuses what a host of several cannot do.
fn check_host(args: &RunArgs, cell: &LoadedCell) -> Result<()> {
    let Some(host) = &args.host else {
        if !cell.graph.hosts.is_empty() {
            terminal::print_note("note: without --host this computer runs all hosts of the cell");
        }
        return Ok(());
    };
    let refused = [
        ("--record", args.record.is_some(), false),
        ("--cycle-record", args.cycle_record.is_some(), false),
        ("--cycles", args.cycles.is_some(), true),
        ("--serve", args.serve, true),
        ("--page", args.page.is_some(), true),
    ];
    let bad = refused.iter().find(|(_, given, may_lead)| *given && !(*may_lead && cell.graph.leads()));
    if let Some((option, _, may_lead)) = bad {
        let whose = if *may_lead {
            "belongs to the host that leads"
        } else {
            "needs the frames of all hosts on one computer"
        };
        bail!("{option} with --host {host}: this {whose}; leave it out");
    }
    if !ipc::link::IS_BUILT_IN {
        bail!("--host {host}: {}", ipc::link::NOT_BUILT_IN.join("; "));
    }
    Ok(())
}

/// Prints the line of a cycle, one that failed even if only errors are wanted. Returns whether it was written.
fn print_cycle(result: &CycleResult, options: &RunOptions) -> bool {
    let line = terminal::cycle_line(result, options.cycles);
    if cli::is_quiet() && !result.is_ok() {
        cli::error(&line);
    }
    terminal::print_line(&line)
}

/// Notes that the cycles of this run do not overlap, although the configuration asks for it.
fn note_overlap(args: &RunArgs, cell: &LoadedCell) {
    if (cell.schedule.in_flight as u32) < cell.config.schedule.cycles_in_flight {
        terminal::print_note(&format!(
            "note: with --retain {} one cycle is in flight at a time, so that the record of each is complete",
            args.retain
        ));
    }
}

fn report<'a>(cell: &'a LoadedCell, summary: &'a Summary, results: &'a [CycleResult]) -> RunReport<'a> {
    RunReport {
        cell: &cell.name,
        config_sha256: &cell.file.sha256,
        cycles_done: summary.tally.done,
        cycles_ok: summary.tally.ok,
        cycles_not_pass: summary.tally.not_pass,
        cycles_not_run: summary.tally.not_run,
        stopped: summary.tally.stopped,
        gave_up: summary.tally.gave_up.as_deref(),
        results,
    }
}

/// Writes the files at the end of a run, and returns why some are lost. Cycles that are missing in the cycle record are, too.
fn write_files(
    args: &RunArgs,
    cell: &LoadedCell,
    results: &[CycleResult],
    summary: &mut Summary,
    folder: Option<&RunFolder>,
    truth: Option<&Truth>,
) -> Lost {
    let mut lost = Lost::default();
    let history = &summary.history;
    if let (Some(folder), Some(snapshot)) = (folder, &summary.snapshot) {
        match folder.check().and_then(|()| snapshot.points()) {
            Ok(points) => {
                let (images, maps) = (&snapshot.images, &snapshot.maps);
                let run = RunFiles { cell, results, history, images, maps, points, truth };
                lost.add(run_files::files(folder.path(), &run));
            }
            Err(error) => lost.add([error]),
        }
    }
    lost.add(summary.unrecorded.take());
    if let Some(file) = &args.trace {
        lost.add(run_files::trace(file, cell, history).err());
    }
    lost
}

/// What the monitor serves. Refuses an address that other machines can reach, unless that is wanted: metrics disclose rate and
/// verdicts of production, and the page takes commands.
fn page_options(args: &RunArgs, demo: bool) -> Result<Option<PageOptions>> {
    let remote = |address: &SocketAddr| !address.ip().is_loopback();
    if let Some(address) = args.metrics.filter(remote).filter(|_| !args.allow_remote) {
        bail!(
            "--metrics {address}: other machines can reach this address; add --allow-remote, or use 127.0.0.1"
        );
    }
    if let Some(address) = args.page.filter(remote).filter(|_| args.page_token.is_none()) {
        bail!(
            "--page {address}: other machines can reach this address; add --page-token FILE, or use 127.0.0.1"
        );
    }
    let token = args.page_token.as_ref();
    let token =
        token.map(|file| monitor::read_token(file).and(Ok(std::path::absolute(file)?))).transpose()?;
    let options = |address, metrics_only| PageOptions { address, metrics_only, token, demo };
    Ok(match (args.page, args.metrics) {
        (Some(address), _) => Some(options(address, false)),
        (None, Some(address)) => Some(options(address, true)),
        (None, None) => None,
    })
}

/// Whether standard output is the only output of an unbounded run: then the run stops when it closes.
fn needs_stdout(args: &RunArgs, options: &RunOptions) -> bool {
    !options.serve
        && options.cycles.is_none()
        && args.out.is_none()
        && args.record.is_none()
        && args.cycle_record.is_none()
}

/// The number of cycles; a recording without `loop` has one.
fn cycles(args: &RunArgs, cell: &LoadedCell) -> Option<u64> {
    let once = cell.file.recording.as_ref().is_some_and(|r| !r.repeat).then_some(1);
    // The host that leads counts.
    args.cycles.or(cell.config.cycles).or(once).map(u64::from).filter(|_| cell.graph.leads())
}

fn record_folder(args: &RunArgs) -> Result<Option<PathBuf>> {
    let Some(folder) = &args.record else { return Ok(None) };
    run_folder::refuse_inside_of_a_run("--record", folder)?;
    atomic::create_dir(folder)?;
    if let Ok(mut entries) = std::fs::read_dir(folder)
        && entries.next().is_some()
    {
        bail!("--record {}: the folder is not empty; name a new folder", folder.display());
    }
    Ok(Some(std::path::absolute(folder)?))
}

fn print_tables(cell: &Cell, results: &[CycleResult], truth: Option<&Truth>) {
    let pairs: Vec<&str> = cell.graph.pairs.iter().map(|p| p.name.as_str()).collect();
    let stages = terminal::stage_table(results);
    if !stages.is_empty() {
        terminal::print_line(&format!("\n{stages}"));
    }
    if let Some(last) = results.iter().rev().find(|r| r.outcome == files::result::OUTCOME_OK) {
        terminal::print_line(&format!("cycle {}: {}", last.number, terminal::cloud_lines(last, &pairs)));
        if !last.features.is_empty() {
            terminal::print_line(&terminal::feature_table(&last.features, truth));
        }
    }
}

fn exit_code(cell: &Cell, summary: &Summary, options: &RunOptions) -> u8 {
    if let Some(reason) = &summary.tally.gave_up {
        cli::error(format_args!("the cell gave up: {reason}"));
        return 1;
    }
    if options.serve || !cell.graph.leads() {
        // Each client, or the host that leads, has its result; a part that fails is not a failure of the cell.
        return 0;
    }
    // Stopping an unbounded run is no failure, although it ends the last cycle.
    let stopped = u64::from(summary.tally.stopped && options.cycles.is_none());
    u8::from(
        summary.tally.done - summary.tally.ok > stopped
            || summary.tally.not_pass > 0
            || summary.tally.not_run > 0,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::anyhow;

    #[test]
    fn what_is_lost_is_an_error_and_the_last_reason_ends_the_program() {
        assert!(Lost::default().named().is_ok());
        let mut lost = Lost::default();
        lost.add(None);
        lost.add([anyhow!("trace"), anyhow!("cloud")]);
        lost.add(Some(anyhow!("json")));
        assert_eq!(lost.0.len(), 3);
        assert_eq!(lost.named().unwrap_err().to_string(), "json");
    }
}
