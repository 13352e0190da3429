//! `fringecell run`: runs a cell, writes its files and returns the exit code.

use crate::run_files::{self, RunFiles};
use crate::run_folder::RunFolder;
use crate::supervisor::{self, RunOptions, Summary};
use crate::terminal;
use anyhow::{Context, Result, bail};
use cell::Retention;
use cell::{Cell, Options};
use devices::LoadedCell;
use files::atomic;
use files::output_check::check_outputs;
use files::result::CycleResult;
use ipc::payload;
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::path::PathBuf;
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
    /// Wait for jobs (`fringecell trigger`, docs/control.md) instead of starting cycles.
    #[arg(long, conflicts_with = "cycles")]
    pub serve: bool,
    /// Write the times of all stages in the last cycles to this file, for ui.perfetto.dev.
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Serve metrics for Prometheus at this address, for example 127.0.0.1:9464; port 0: any free port.
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub metrics: Option<SocketAddr>,
    /// Allow --metrics at an address that other machines can reach.
    #[arg(long, requires = "metrics")]
    pub allow_remote: bool,
}

/// Runs a cell. If the truth is given, features are compared with it.
///
/// # Errors
/// Invalid input, or the machine cannot run the cell.
pub fn run(args: &RunArgs, truth: Option<&Truth>) -> Result<u8> {
    let config = args
        .config
        .canonicalize()
        .with_context(|| format!("{}: cannot open the configuration", args.config.display()))?;
    let graph_options = Options {
        cell: args.cell.clone(),
        watch: args.out.is_some(),
        record: args.record.is_some(),
        retention: args.retain,
    };
    let cell = devices::load(&config, &graph_options)?;
    let written = [("--cycle-record", args.cycle_record.as_deref()), ("--trace", args.trace.as_deref())];
    check_outputs(&written, &cell.file.paths(), None)?;
    check_address(args)?;
    devices::check(&cell)?;
    let record = record_folder(args)?;
    let frames = devices::played_files(&cell)?;
    let folder = args.out.as_deref().map(|folder| RunFolder::take(folder, &cell)).transpose()?.map(Arc::new);
    if (cell.schedule.in_flight as u32) < cell.config.schedule.cycles_in_flight {
        terminal::print_error(&format!(
            "note: with --retain {} one cycle is in flight at a time, so that the record of each is complete",
            args.retain
        ));
    }
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
        metrics: args.metrics,
    };
    let needs_stdout = needs_stdout(args, &options);
    let mut results = VecDeque::new();
    let mut summary = supervisor::run(&cell, &options, &mut |result| {
        let printed = terminal::print_line(&terminal::cycle_line(result, options.cycles));
        if !printed && needs_stdout {
            interrupted.store(true, Ordering::SeqCst);
        }
        if results.len() == MAX_RESULTS {
            results.pop_front();
        }
        results.push_back(result.clone());
    })?;
    if let Some(error) = summary.unwritten.take() {
        return Err(error);
    }
    let results: Vec<CycleResult> = results.into();
    print_tables(&cell, &results, truth);
    write_files(args, &cell, &results, &mut summary, folder.as_deref(), truth)?;
    Ok(exit_code(&summary, &options))
}

/// Writes the files at the end of a run. Cycles that are missing in the cycle record are an error.
fn write_files(
    args: &RunArgs,
    cell: &LoadedCell,
    results: &[CycleResult],
    summary: &mut Summary,
    folder: Option<&RunFolder>,
    truth: Option<&Truth>,
) -> Result<()> {
    let history = &summary.history;
    if let (Some(folder), Some(snapshot)) = (folder, &summary.snapshot) {
        folder.check()?;
        let (images, maps) = (&snapshot.images, &snapshot.maps);
        let cloud = snapshot.cloud.as_ref().map(|cloud| payload::points(cloud.header(), cloud.payload()));
        let points = cloud.transpose()?;
        let run = RunFiles { cell, results, history, images, maps, points, truth };
        run_files::files(folder.path(), &run)?;
    }
    if let Some(error) = summary.unrecorded.take() {
        return Err(error);
    }
    match &args.trace {
        Some(file) => run_files::trace(file, cell, history),
        None => Ok(()),
    }
}

/// Refuses an address that other machines can reach, unless that is wanted: metrics disclose rate and verdicts of production.
fn check_address(args: &RunArgs) -> Result<()> {
    match args.metrics {
        Some(address) if !address.ip().is_loopback() && !args.allow_remote => {
            bail!(
                "--metrics {address}: other machines can reach this address; add --allow-remote, or use 127.0.0.1"
            )
        }
        _ => Ok(()),
    }
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
    args.cycles.or(cell.config.cycles).or(once).map(u64::from)
}

fn record_folder(args: &RunArgs) -> Result<Option<PathBuf>> {
    let Some(folder) = &args.record else { return Ok(None) };
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

fn exit_code(summary: &Summary, options: &RunOptions) -> u8 {
    if let Some(reason) = &summary.gave_up {
        terminal::print_error(&format!("error: the cell gave up: {reason}"));
        return 1;
    }
    if options.serve {
        // Each client has its result; a part that fails is not a failure of the cell.
        return 0;
    }
    // Stopping an unbounded run is no failure, although it ends the last cycle.
    let stopped = u64::from(summary.stopped && options.cycles.is_none());
    u8::from(summary.not_ok > stopped || summary.not_pass > 0 || summary.not_run > 0)
}
