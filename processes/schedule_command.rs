//! `fringecell schedule`: shows the schedule of a cycle as tables and as a chart.

use crate::demo;
use crate::json;
use crate::schedule_chart::ScheduleChart;
use crate::schedule_hosts::hosts_table;
use crate::schedule_json;
use crate::schedule_memory::Memory;
use crate::schedule_together::{Together, of_trial};
use crate::terminal;
use anyhow::{Context, Result};
use cell::configuration::TriggerMode;
use cell::schedule::{Half, Lane, Schedule, label};
use cell::{Cell, Options};
use files::atomic;
use files::output_check::check_outputs;
use files::result::read_json;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Command-line arguments of `fringecell schedule`.
#[derive(Debug, Clone, clap::Args)]
pub struct ScheduleArgs {
    /// Configuration of the cell; default: that of the demo, which is part of the program.
    pub config: Option<PathBuf>,
    /// Write the schedule as a chart to this file.
    #[arg(long, value_name = "FILE.svg")]
    pub picture: Option<PathBuf>,
    /// Plan the part of this host of a cell on several computers.
    #[arg(long, value_name = "NAME")]
    pub host: Option<String>,
    /// Take the durations of the chart from this result.json of the same cell.
    #[arg(long, value_name = "FILE")]
    pub result: Option<PathBuf>,
    /// Find the projectors that can show at the same time from this recording, in which each projector lights all cameras with
    /// white and black.
    #[arg(long, value_name = "DIR")]
    pub trial: Option<PathBuf>,
    /// Write the schedule as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Plans a cell and prints tables and chart. Exit code 1: measured times exceed the limits, or projectors meet that show together.
///
/// # Errors
/// The cell cannot be planned, the result is of another cell, or an output cannot be written.
pub fn schedule(args: &ScheduleArgs) -> Result<u8> {
    // Removed when dropped.
    let mut bundled = None;
    let config = if let Some(config) = &args.config {
        config.clone()
    } else {
        terminal::print_note("schedule of the demo; name a configuration for another one");
        demo::write_files(bundled.insert(tempfile::tempdir()?).path(), false)?
    };
    let cell = devices::load(&config, &Options { host: args.host.clone(), ..Options::default() })?;
    devices::check(&cell)?;
    let mut inputs = cell.file.paths();
    inputs.extend(args.result.as_deref());
    let outputs = [("--picture", args.picture.as_deref()), ("--json", args.json.as_deref())];
    check_outputs(&outputs, &inputs, None)?;
    let measured = args.result.as_ref().map(|file| read_json(file)).transpose()?;
    let chart = ScheduleChart::new(&cell.schedule, measured.as_ref());
    let chart = match &args.result {
        Some(file) => chart.with_context(|| file.display().to_string())?,
        None => chart?,
    };
    if let Some(file) = &args.picture {
        atomic::write(file, chart.svg(&cell).as_bytes())?;
    }
    let limits = chart.check_limits(&cell);
    let memory = Memory::of(&config, &cell)?;
    let together = Together::of(&cell)?;
    let trial = args.trial.as_ref().map(|folder| of_trial(&cell, folder)).transpose()?;
    let is_within = limits.as_ref().map(|l| l.1);
    json::emit(args.json.as_deref(), &schedule_json::report(&cell, memory, is_within, together.as_ref()))?;
    let (limits, within_limits) = limits.unwrap_or((String::new(), true));
    let apart = together.as_ref().is_none_or(Together::is_fine);
    let groups =
        together.map_or_else(String::new, |together| together.to_string()) + &trial.unwrap_or_default();
    let text = format!("{groups}{}{memory}\n{}{limits}", render(&cell), chart.text(&cell));
    terminal::print_line(text.trim_end());
    Ok(u8::from(!within_limits || !apart))
}

/// The order of the activations on each core, then the topics with their buffers.
fn render(cell: &Cell) -> String {
    let schedule = &cell.schedule;
    let mut text = format!(
        "cell {}: {} stages, {} activations on {} cores, deadline {} ms, stage budget {} ms\n{}\n",
        cell.name,
        schedule.stages.len(),
        schedule.activations.len(),
        schedule.cores,
        cell.config.limits.cycle_deadline_ms,
        cell.config.limits.stage_budget_ms,
        overlap(schedule)
    );
    text.push_str(&fired(cell));
    text += &hosts_table(cell);
    text += &lights(cell);
    for lane in schedule.lanes() {
        let _ = writeln!(
            text,
            "\n{}\n{:>5}  {:<20} {:<24} {:<18} after",
            lane_name(schedule, lane),
            "no.",
            "stage",
            "activation",
            "output"
        );
        for (number, activation) in schedule.on_lane(lane) {
            let after: Vec<String> = activation.inputs.iter().map(usize::to_string).collect();
            let output = activation.output.map_or("", |topic| schedule.topics[topic].name.as_str());
            let _ = writeln!(
                text,
                "{number:>5}  {:<20} {:<24} {output:<18} {}",
                schedule.stages[activation.stage].name,
                label(&cell.graph, activation.work),
                shorten(&after)
            );
        }
    }
    let _ = writeln!(
        text,
        "\n{:<18} {:>12} {:>7} {:>5} {:>14}  from → to",
        "topic", "bytes", "buffer", "held", "memory"
    );
    for topic in &schedule.topics {
        let _ = writeln!(
            text,
            "{:<18} {:>12} {:>7} {:>5} {:>14}  {} → {}",
            topic.name,
            topic.bytes,
            topic.size.buffer,
            topic.size.borrowed,
            topic.memory_bytes(),
            shorten(&topic.producers),
            shorten(&topic.consumers)
        );
    }
    text
}

/// A core and the half of the cycle, or the link that waits beside them.
fn lane_name(schedule: &Schedule, lane: Lane) -> String {
    match lane {
        Lane { core, .. } if core == schedule.cores => "link to other hosts".to_owned(),
        Lane { core, half: Half::Acquisition } => format!("core {core}, acquisition"),
        Lane { core, half: Half::Evaluation } => format!("core {core}, evaluation"),
    }
}

/// How long projectors take whose light comes in known periods.
fn lights(cell: &Cell) -> String {
    let mut text = String::new();
    for projector in &cell.config.projectors {
        let (TriggerMode::Stepped, Some(period_us)) = (projector.trigger, projector.light_period_us()) else {
            continue;
        };
        let exposures = cell.config.cameras.iter().filter(|camera| projector.cameras.contains(&camera.name));
        let exposures_us = exposures.filter_map(|camera| camera.genicam.as_ref()?.exposure_us);
        let exposure_us = exposures_us.fold(0.0, f64::max);
        let (frames, settle_us) = (projector.frames(), projector.settle_us());
        let _ = writeln!(
            text,
            "projector {}: {frames} frames of {:.1} ms until the light stands and {:.1} ms of exposure, {:.0} periods of {:.3} ms: \
             {:.2} s at least",
            projector.name,
            settle_us / 1e3,
            exposure_us / 1e3,
            exposure_us / period_us,
            period_us / 1e3,
            frames as f64 * (settle_us + exposure_us) / 1e6
        );
    }
    text
}

/// What projectors show in their own time, a line for each.
fn fired(cell: &Cell) -> String {
    let mut text = String::new();
    for projector in &cell.graph.projectors {
        let (name, frames) = (&projector.name, projector.frames);
        if let TriggerMode::Sequenced { period_ms } = projector.trigger {
            let last_ms = frames as f64 * period_ms;
            let _ = writeln!(
                text,
                "{name} fires the cameras: {frames} frames, one every {period_ms} ms, {last_ms} ms in all"
            );
        }
    }
    text
}

/// The overlap of cycles in words.
fn overlap(schedule: &Schedule) -> String {
    match schedule.in_flight {
        1 => "1 cycle in flight: a cycle starts when the previous one has its outcome (schedule.cycles_in_flight);\n\
              what a projector showed is evaluated while the next one shows; both lists of a core share the core"
            .into(),
        n => format!(
            "{n} cycles in flight: a cycle is acquired while the previous one is evaluated; both lists of a core share the core"
        ),
    }
}

/// Shortens a long list to its first and last element.
fn shorten(names: &[String]) -> String {
    match names {
        [first, .., last] if names.len() > 4 => format!("{first} … {last} ({})", names.len()),
        _ => names.join(" "),
    }
}
