//! What the supervisor makes before the first stage starts.

use super::children::StageProcess;
use super::cycle::{Budgets, Cycles, Step};
use super::restart::Policy;
use crate::graph::Cell;
use crate::schedule::{Carries, Kind, Order, Stage, Topic, label};
use crate::stage::short_hashes;
use ipc::IpcError;
use ipc::port::{Held, Node};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What a run is asked to do.
#[derive(Debug, Clone)]
pub struct Orders {
    /// Configuration, for the stages.
    pub config: PathBuf,
    /// Cycles; `None`: until stopped.
    pub cycles: Option<u64>,
    /// Whether cycles are asked for over the socket instead.
    pub serve: bool,
    /// Where a recording is written.
    pub record: Option<PathBuf>,
    /// Set when the run shall end.
    pub interrupted: Arc<AtomicBool>,
    /// The file of the cycle record.
    pub cycle_record: Option<PathBuf>,
    /// Where Prometheus may read.
    pub metrics: Option<SocketAddr>,
}

/// Creates a topic for the kind of message that it carries.
pub(super) fn create(node: &Node, topic: &Topic) -> Result<Held, IpcError> {
    use ipc::header;
    match topic.carries {
        Carries::Control => node.create_topic::<header::Control>(&topic.name, topic.size),
        Carries::Event => node.create_topic::<header::Event>(&topic.name, topic.size),
        Carries::Trigger => node.create_topic::<header::Trigger>(&topic.name, topic.size),
        Carries::Frame => node.create_topic::<header::Frame>(&topic.name, topic.size),
        Carries::Phase => node.create_topic::<header::Phase>(&topic.name, topic.size),
        Carries::Cloud => node.create_topic::<header::Cloud>(&topic.name, topic.size),
        Carries::Outcome => node.create_topic::<header::Outcome>(&topic.name, topic.size),
    }
}

/// The state machine of the cycles.
pub(super) fn machine(cell: &Cell, orders: &Orders) -> Cycles {
    let order = Order::new(&cell.schedule);
    // What is before it in its lane is awaited like what it works on.
    let steps = cell.schedule.activations.iter().zip(order.before).map(|(a, before)| Step {
        stage: a.stage,
        half: cell.schedule.half(a),
        inputs: a.inputs.iter().copied().chain(before).collect(),
        label: label(&cell.graph, a.work),
    });
    let limits = &cell.config.limits;
    let budgets =
        Budgets { stage_ns: millis(limits.stage_budget_ms), cycle_ns: millis(limits.cycle_deadline_ms) };
    let names = cell.schedule.stages.iter().map(|s| s.name.clone()).collect();
    let cycles = Cycles::new(names, steps.collect(), budgets, cell.schedule.in_flight, orders.cycles);
    if orders.serve { cycles.open() } else { cycles }
}

/// The stages, not started yet.
pub(super) fn children(cell: &Cell, orders: &Orders) -> Vec<StageProcess> {
    let limits = &cell.config.limits;
    let policy = Policy { restarts_max: limits.restarts_max, window_ns: millis(limits.restart_window_ms) };
    let stages = cell.schedule.stages.iter().map(|stage| {
        // Stages that run once per cycle get all cores, those that run side by side one each.
        let threads = match stage.kind {
            Kind::Matching | Kind::Fusion | Kind::Inspection => cell.schedule.cores,
            Kind::Projection | Kind::Capture | Kind::Decode | Kind::Record => 1,
        };
        StageProcess::new(&stage.name, arguments(cell, orders, stage), threads, policy)
    });
    stages.collect()
}

fn arguments(cell: &Cell, orders: &Orders, stage: &Stage) -> Vec<String> {
    let mut arguments: Vec<String> = ["stage", stage.kind.word(), &stage.name].map(str::to_owned).to_vec();
    let mut option = |name: &str, value: String| arguments.extend([name.to_owned(), value]);
    option("--cell", cell.name.clone());
    option("--config", orders.config.display().to_string());
    option("--files", short_hashes(&cell.config.read_files()).join(","));
    option("--parent", std::process::id().to_string());
    option("--kept", cell.graph.kept.to_string());
    if let Some(folder) = &orders.record {
        option("--record", folder.display().to_string());
        if orders.cycles != Some(1) {
            arguments.push("--record-many".into());
        }
    }
    if cell.graph.watch {
        arguments.push("--watch".into());
    }
    arguments
}

/// ms to ns.
pub(super) fn millis(ms: u64) -> u64 {
    ms.saturating_mul(1_000_000)
}
