//! `fringecell run`: a cell from its configuration to its files and its exit code.

use crate::graph::{self, Cell, Options};
use crate::kernels;
use crate::output::{self, Run};
use crate::outputs::check_outputs;
use crate::print;
use crate::supervisor::{self, Orders, Summary};
use anyhow::{Context, Result, bail};
use files::atomic;
use files::cycle_record::Kept;
use files::result::CycleResult;
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use twin::Truth;

/// Results kept for tables and report: a run until stopped must not grow.
const KEPT_RESULTS: usize = 1000;

/// Arguments of `run`.
#[derive(Debug, Clone, clap::Args)]
pub struct RunArgs {
    /// Configuration of the cell.
    pub config: PathBuf,
    /// Number of cycles instead of the configuration's; without either the cell runs until stopped.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub cycles: Option<u32>,
    /// Folder for result.json, cloud.ply, report.html and trace.json.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Folder for a recording of the frames; with several cycles it gets one folder per cycle.
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// Keep a record of every cycle in this new file, for `fringetool replay`.
    #[arg(long, value_name = "FILE")]
    pub cycle_record: Option<PathBuf>,
    /// What the cycle record keeps beside hashes and times: hashes (nothing), frames, or all (frames and stage outputs).
    #[arg(long, value_name = "WHAT", default_value_t, requires = "cycle_record")]
    pub keep: Kept,
    /// Another name, to run one configuration several times at once.
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// Wait for jobs (`fringecell trigger`, docs/control.md) instead of running cycles.
    #[arg(long, conflicts_with = "cycles")]
    pub serve: bool,
    /// Write when each stage did what in the last cycles to this file, for ui.perfetto.dev.
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Answer Prometheus at this address, as in 127.0.0.1:9464; port 0: any that is free.
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub metrics: Option<SocketAddr>,
}

/// Runs a cell. With a truth the features are compared with it.
///
/// # Errors
/// Bad input, or a machine that cannot run the cell.
pub fn run(args: &RunArgs, truth: Option<&Truth>) -> Result<u8> {
    let config =
        args.config.canonicalize().with_context(|| format!("{}: cannot open it", args.config.display()))?;
    let options = Options {
        cell: args.cell.clone(),
        watch: args.out.is_some(),
        record: args.record.is_some(),
        kept: args.keep,
    };
    let cell = graph::load(&config, &options)?;
    ipc::cell::CellName::new(&cell.name)?;
    let written = [("--cycle-record", args.cycle_record.as_deref()), ("--trace", args.trace.as_deref())];
    check_outputs(&written, &cell.config.paths(), None)?;
    kernels::rehearse(&cell)?;
    if let Some(folder) = &args.out {
        atomic::create_dir(folder)?;
    }
    if (cell.schedule.in_flight as u32) < cell.config.schedule.cycles_in_flight {
        eprintln!("--keep {}: one cycle is in flight at a time, so that each is kept whole", args.keep);
    }
    let interrupted = Arc::new(AtomicBool::new(false));
    let orders = Orders {
        interrupted: Arc::clone(&interrupted),
        config,
        cycles: if args.serve { None } else { cycles(args, &cell) },
        serve: args.serve,
        record: record_folder(args)?,
        cycle_record: args.cycle_record.clone(),
        metrics: args.metrics,
    };
    let cut_off = needs_reader(args, &orders);
    let mut results = VecDeque::new();
    let mut unwritten = None;
    let mut summary = supervisor::run(&cell, &orders, &mut |result| {
        let heard = print::say(&print::cycle_line(result, orders.cycles));
        if !heard && cut_off {
            interrupted.store(true, Ordering::SeqCst);
        }
        if let Some(Err(error)) = args.out.as_ref().map(|folder| output::cycle(folder, result)) {
            tracing::error!("{error:#}");
            unwritten.get_or_insert(error);
        }
        if results.len() == KEPT_RESULTS {
            results.pop_front();
        }
        results.push_back(result.clone());
    })?;
    if let Some(error) = unwritten {
        return Err(error);
    }
    let results: Vec<CycleResult> = results.into();
    tell(&cell, &results, truth);
    write_files(args, &cell, &results, &mut summary, truth)?;
    Ok(exit_code(&summary, &orders))
}

/// Writes what a run leaves; what is missing in the cycle record ends it as an error.
fn write_files(
    args: &RunArgs,
    cell: &Cell,
    results: &[CycleResult],
    summary: &mut Summary,
    truth: Option<&Truth>,
) -> Result<()> {
    let history = &summary.history;
    if let (Some(folder), Some(watch)) = (&args.out, &summary.watch) {
        output::files(folder, &Run { cell, results, history, watch, truth })?;
    }
    if let Some(error) = summary.unrecorded.take() {
        return Err(error);
    }
    match &args.trace {
        Some(file) => output::trace(file, cell, history),
        None => Ok(()),
    }
}

/// Measuring for ever, for nobody: then the last reader takes the cell with him. One that serves is asked over its socket.
fn needs_reader(args: &RunArgs, orders: &Orders) -> bool {
    !orders.serve
        && orders.cycles.is_none()
        && args.out.is_none()
        && args.record.is_none()
        && args.cycle_record.is_none()
}

/// A recording that does not begin again has one cycle.
fn cycles(args: &RunArgs, cell: &Cell) -> Option<u64> {
    let once = cell.config.recording.as_ref().is_some_and(|r| !r.repeat).then_some(1);
    args.cycles.or(cell.config.cycles).or(once).map(u64::from)
}

fn record_folder(args: &RunArgs) -> Result<Option<PathBuf>> {
    let Some(folder) = &args.record else { return Ok(None) };
    atomic::create_dir(folder)?;
    if let Ok(mut entries) = std::fs::read_dir(folder)
        && entries.next().is_some()
    {
        bail!("--record {}: the folder is not empty; name a new one", folder.display());
    }
    Ok(Some(std::path::absolute(folder)?))
}

fn tell(cell: &Cell, results: &[CycleResult], truth: Option<&Truth>) {
    let pairs: Vec<&str> = cell.graph.pairs.iter().map(|p| p.name.as_str()).collect();
    let stages = print::stage_table(results);
    if !stages.is_empty() {
        print::say(&format!("\n{stages}"));
    }
    if let Some(last) = results.iter().rev().find(|r| r.outcome == files::result::OUTCOME_OK) {
        print::say(&format!("cycle {}: {}", last.cycle + 1, print::cloud_lines(last, &pairs)));
        if !last.features.is_empty() {
            print::say(&print::feature_table(&last.features, truth));
        }
    }
}

fn exit_code(summary: &Summary, orders: &Orders) -> u8 {
    if let Some(reason) = &summary.held {
        eprintln!("the cell gave up: {reason}");
        return 1;
    }
    if orders.serve {
        // Who asked for a part has its result; that a part failed is no failure of the cell.
        return 0;
    }
    // A cell that runs until stopped was not cut short by being stopped; its last cycle was.
    let cut = u64::from(summary.stopped && orders.cycles.is_none());
    u8::from(summary.not_ok > cut || summary.not_pass > 0)
}
