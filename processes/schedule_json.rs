//! The schedule of a cell as JSON.

use crate::schedule_hosts::{HostRow, host_rows};
use crate::schedule_memory::Memory;
use crate::schedule_together::Together;
use cell::Cell;
use cell::schedule::{Activation, Half, Stage, Topic, label};
use serde::Serialize;

/// Stages, activations and topics of a schedule.
#[derive(Debug, Serialize)]
pub struct ScheduleReport<'a> {
    cell: &'a str,
    cores: usize,
    cycles_in_flight: usize,
    cycle_deadline_ms: u64,
    stage_budget_ms: u64,
    /// Time of the frames that projectors fire by themselves, ms.
    acquisition_ms: f64,
    memory: Memory,
    /// Absent without measured times.
    within_limits: Option<bool>,
    stages: Vec<StageRow<'a>>,
    activations: Vec<ActivationRow<'a>>,
    topics: Vec<TopicRow<'a>>,
    /// The computers of the cell; empty: it runs on one.
    hosts: Vec<HostRow>,
    /// Absent where the configuration asks for no groups.
    together: Option<&'a Together>,
}

#[derive(Debug, Serialize)]
struct StageRow<'a> {
    name: &'a str,
    kind: &'static str,
    core: usize,
    half: &'static str,
}

#[derive(Debug, Serialize)]
struct ActivationRow<'a> {
    stage: &'a str,
    name: String,
    core: usize,
    /// Places in the list of activations.
    after: &'a [usize],
    output: Option<&'a str>,
}

#[derive(Debug, Serialize)]
struct TopicRow<'a> {
    name: &'a str,
    bytes: u64,
    buffer: usize,
    held: usize,
    memory_bytes: u64,
    from: &'a [String],
    to: &'a [String],
}

/// Collects the schedule of a cell.
pub fn report<'a>(
    cell: &'a Cell,
    memory: Memory,
    within_limits: Option<bool>,
    together: Option<&'a Together>,
) -> ScheduleReport<'a> {
    let (schedule, limits) = (&cell.schedule, &cell.config.limits);
    ScheduleReport {
        cell: &cell.name,
        cores: schedule.cores,
        cycles_in_flight: schedule.in_flight,
        cycle_deadline_ms: limits.cycle_deadline_ms,
        stage_budget_ms: limits.stage_budget_ms,
        acquisition_ms: cell.graph.acquisition_ms(),
        memory,
        within_limits,
        stages: schedule.stages.iter().map(stage_row).collect(),
        activations: schedule.activations.iter().map(|activation| activation_row(cell, activation)).collect(),
        topics: schedule.topics.iter().map(topic_row).collect(),
        hosts: host_rows(cell),
        together,
    }
}

fn stage_row(stage: &Stage) -> StageRow<'_> {
    let half = match stage.kind.half() {
        Half::Acquisition => "acquisition",
        Half::Evaluation => "evaluation",
    };
    StageRow { name: &stage.name, kind: stage.kind.word(), core: stage.core, half }
}

fn activation_row<'a>(cell: &'a Cell, activation: &'a Activation) -> ActivationRow<'a> {
    let stage = &cell.schedule.stages[activation.stage];
    ActivationRow {
        stage: &stage.name,
        name: label(&cell.graph, activation.work),
        core: stage.core,
        after: &activation.inputs,
        output: activation.output.map(|topic| cell.schedule.topics[topic].name.as_str()),
    }
}

fn topic_row(topic: &Topic) -> TopicRow<'_> {
    TopicRow {
        name: &topic.name,
        bytes: topic.bytes,
        buffer: topic.size.buffer,
        held: topic.size.borrowed,
        memory_bytes: topic.memory_bytes(),
        from: &topic.producers,
        to: &topic.consumers,
    }
}
