//! Transport: how long a frame takes from one process to another, through shared memory, a Unix socket and a pipe.
//!
//! The frame is made by this process and read by a second one. Latency: from the moment the frame is complete to the moment
//! the other process can read all of it; frames are paced. Throughput: frames are written anew, sent, received and read
//! in full as fast as both can. Contents are compared by hash, so that nothing is counted that did not arrive.

mod receive;
mod send;
mod share;

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, ensure};
use cell::Options;
use files::trace::read_trace;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Number of frames per measurement.
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(10..100_000))]
    frames: u32,
    /// Columns of a frame, px; with the default rows 13.5 MB at 8 bits.
    #[arg(long = "width-px", alias = "width", value_name = "PX", default_value_t = 4500, value_parser = clap::value_parser!(u32).range(1..65_536))]
    width: u32,
    /// Rows of a frame, px.
    #[arg(long = "height-px", alias = "height", value_name = "PX", default_value_t = 3000, value_parser = clap::value_parser!(u32).range(1..65_536))]
    height: u32,
    /// Frames per second in the measurement of latency.
    #[arg(long, value_name = "HZ", default_value_t = 50.0)]
    rate_hz: f64,
    /// The trace.json of a run: report the share of its cycles that transport takes, instead of measuring frames.
    #[arg(long, value_name = "FILE", requires = "config")]
    trace: Option<PathBuf>,
    /// Configuration of that run (TOML, docs/formats.md).
    #[arg(long, value_name = "FILE", requires = "trace")]
    config: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// The receiving process of the benchmark.
    #[arg(long, hide = true)]
    receive: Option<receive::Source>,
}

/// Size and number of the frames.
#[derive(Debug, Clone, Copy)]
struct Plan {
    frames: u32,
    width_px: u32,
    height_px: u32,
    period_ns: u64,
}

impl Plan {
    fn bytes(self) -> usize {
        self.width_px as usize * self.height_px as usize
    }
}

/// What one way of transport does.
#[derive(Debug, Serialize)]
struct Figures {
    transport: &'static str,
    bytes: usize,
    frames: u32,
    latency_median_us: f64,
    latency_p99_us: f64,
    latency_max_us: f64,
    throughput_gb_per_s: f64,
}

/// Runs the benchmark, or the other process of it.
pub fn run(args: &Args) -> Result<Outcome> {
    let plan = Plan {
        frames: args.frames,
        width_px: args.width,
        height_px: args.height,
        period_ns: period_ns(args.rate_hz)?,
    };
    if let Some(from) = &args.receive {
        return receive::run(from, plan).map(|()| Outcome::Done);
    }
    let inputs: Vec<&Path> = args.trace.iter().chain(&args.config).map(PathBuf::as_path).collect();
    check_outputs(&[("--json", args.json.as_deref())], &inputs, None)?;
    if let (Some(trace), Some(config)) = (&args.trace, &args.config) {
        return share_of(trace, config, args.json.as_deref());
    }
    let mut all = Vec::new();
    println!(
        "{} frames of {} × {} px, {:.1} MB each; latency at {} Hz\n\n{:<18} {:>12} {:>12} {:>12} {:>14}",
        plan.frames,
        plan.width_px,
        plan.height_px,
        plan.bytes() as f64 / 1e6,
        args.rate_hz,
        "transport",
        "median µs",
        "99 % µs",
        "max µs",
        "GB/s, filled and read"
    );
    for way in send::WAYS {
        let figures = measure(way, plan)?;
        println!(
            "{:<18} {:>12.1} {:>12.1} {:>12.1} {:>14.2}",
            figures.transport,
            figures.latency_median_us,
            figures.latency_p99_us,
            figures.latency_max_us,
            figures.throughput_gb_per_s
        );
        all.push(figures);
    }
    emit(args.json.as_deref(), &serde_json::json!({ "transports": all }))?;
    Ok(Outcome::Done)
}

/// Reports the share of the cycles of a run that transport takes.
fn share_of(trace: &Path, config: &Path, json: Option<&Path>) -> Result<Outcome> {
    let cell = devices::load(config, &Options::default())?;
    let share = share::share(&cell, &read_trace(trace)?).with_context(|| trace.display().to_string())?;
    println!(
        "{} cycles; in the median one, from start to outcome: {:.1} ms, of which {} hand-overs take {:.2} ms \
         ({:.2} ms sending) = {:.2} %; at most {:.2} %\n\n{:<12} {:<12} {:>8} {:>12} {:>12}",
        share.cycles,
        share.chain_ms,
        share.hops,
        share.handing_over_ms,
        share.sending_ms,
        100.0 * share.fraction,
        100.0 * share.largest_fraction,
        "from",
        "to",
        "times",
        "median µs",
        "sum ms"
    );
    for row in &share.between {
        println!(
            "{:<12} {:<12} {:>8} {:>12.1} {:>12.2}",
            row.from, row.to, row.count, row.median_us, row.sum_ms
        );
    }
    emit(json, &share)?;
    Ok(Outcome::Done)
}

fn period_ns(rate_hz: f64) -> Result<u64> {
    ensure!((0.1..=100_000.0).contains(&rate_hz), "--rate-hz {rate_hz}: 0.1 to 100000 are possible");
    Ok((1e9 / rate_hz) as u64)
}

fn measure(way: send::Way, plan: Plan) -> Result<Figures> {
    let paced = send::run(way, plan)?;
    let free = send::run(way, Plan { period_ns: 0, ..plan })?;
    let mut latencies = paced.latencies;
    latencies.sort_unstable();
    let at = |percent: usize| {
        let rank = (latencies.len() * percent).div_ceil(100).max(1);
        latencies.get(rank - 1).copied().unwrap_or(0) as f64 / 1e3
    };
    let whole_ns = free.read_ns.saturating_sub(free.begun_ns).max(1);
    Ok(Figures {
        transport: way.name(),
        bytes: plan.bytes(),
        frames: plan.frames,
        latency_median_us: at(50),
        latency_p99_us: at(99),
        latency_max_us: at(100),
        throughput_gb_per_s: plan.bytes() as f64 * f64::from(plan.frames) / whole_ns as f64,
    })
}
