//! Transport: how long a frame takes from one process to another, through shared memory, a Unix socket and a pipe.
//!
//! The frame is made by this process and read by a second one. Latency: from the moment the frame is complete to the moment
//! the other process can read all of it; frames are paced. Throughput: frames are written anew, sent, received and read
//! in full as fast as both can. Contents are compared by hash, so that nothing is counted that did not arrive.

mod receive;
mod send;

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, ensure};
use rig::result::{CycleResult, read_json};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Arguments of `bench transport`.
#[derive(clap::Args)]
pub struct Args {
    /// Frames per measurement.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(10..100_000))]
    frames: u32,
    /// Columns of a frame; with the default height 13.5 MB at 8 bits.
    #[arg(long, default_value_t = 4500, value_parser = clap::value_parser!(u32).range(1..65_536))]
    width: u32,
    /// Rows of a frame.
    #[arg(long, default_value_t = 3000, value_parser = clap::value_parser!(u32).range(1..65_536))]
    height: u32,
    /// Frames per second while latency is measured.
    #[arg(long, default_value_t = 50.0)]
    rate_hz: f64,
    /// The result.json of a cycle: says which share of it transport takes.
    #[arg(long, value_name = "FILE")]
    cycle: Option<PathBuf>,
    /// Machine-readable result.
    #[arg(long)]
    json: Option<PathBuf>,
    /// The other process.
    #[arg(long, hide = true)]
    receive: Option<receive::From>,
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

/// What transport takes of a cycle.
#[derive(Debug, Serialize)]
struct Share {
    /// From start to outcome, ms.
    cycle_ms: f64,
    /// Spent by all stages together on handing outputs over, ms.
    sending_ms: f64,
    /// Messages that follow each other on the way from the first pattern to the verdict.
    hops: u32,
    /// Their median latencies, ms.
    latency_ms: f64,
    /// Sending and latencies over the cycle.
    fraction: f64,
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
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
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
    let share = args.cycle.as_deref().map(|file| share(file, all[0].latency_median_us)).transpose()?;
    if let Some(share) = &share {
        println!(
            "\na cycle of {:.0} ms: {:.2} ms sending in all stages + {} hops of {:.3} ms = {:.2} %",
            share.cycle_ms,
            share.sending_ms,
            share.hops,
            all[0].latency_median_us / 1e3,
            100.0 * share.fraction
        );
    }
    emit(args.json.as_deref(), &serde_json::json!({ "transports": all, "cycle": share }))?;
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

fn share(file: &Path, latency_us: f64) -> Result<Share> {
    let result: CycleResult = read_json(file)?;
    let number = |key: &str| {
        let value = result.more.get(key).and_then(serde_json::Value::as_f64);
        value.with_context(|| format!("{}: key \"{key}\" is absent; is it a cycle's result?", file.display()))
    };
    let cycle_ms = number("duration_ns")? / 1e6;
    ensure!(cycle_ms > 0.0, "{}: the cycle has no duration", file.display());
    let shown: u32 =
        result.stages.iter().filter(|stage| stage.name == "projection").map(|stage| stage.activations).sum();
    // Each pattern: trigger and its answer. Then frame, phase, cloud, fused cloud and result.
    let hops = 2 * shown + 5;
    let sending_ms = result.stages.iter().map(|stage| stage.send_ns).sum::<u64>() as f64 / 1e6;
    let latency_ms = f64::from(hops) * latency_us / 1e3;
    Ok(Share { cycle_ms, sending_ms, hops, latency_ms, fraction: (sending_ms + latency_ms) / cycle_ms })
}
