//! Setup of a run before the first stage starts.

use super::cycle::{Budgets, Cycles, Step};
use super::restart::Policy;
use super::result_writer::ResultWriter;
use super::stage_process::StageProcess;
use crate::part_files::PartFiles;
use crate::run_folder::RunFolder;
use crate::stage::short_hashes;
use anyhow::Result;
use cell::Cell;
use cell::schedule::{Carries, Kind, Order, Stage, Topic, label};
use devices::LoadedCell;
use ipc::IpcError;
use ipc::port::{Node, ServiceHandle, TopicSize};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What the monitor serves.
#[derive(Debug, Clone)]
pub struct PageOptions {
    /// Address of the page, or of the metrics alone.
    pub address: SocketAddr,
    /// Whether it serves nothing but the metrics.
    pub metrics_only: bool,
    /// File with the token that viewers must know.
    pub token: Option<PathBuf>,
    /// Whether the part is simulated by the demo.
    pub demo: bool,
}

/// Options of a run.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// Path of the configuration, for the stages.
    pub config: PathBuf,
    /// Number of cycles; `None`: until stopped.
    pub cycles: Option<u64>,
    /// Whether cycles are requested over the command socket instead.
    pub serve: bool,
    /// Folder for the results of the cycles.
    pub out: Option<Arc<RunFolder>>,
    /// Of each camera that plays a recording: name, and hash of the files.
    pub frames: Vec<(String, String)>,
    /// Folder for a recording.
    pub record: Option<PathBuf>,
    /// Set to end the run.
    pub interrupted: Arc<AtomicBool>,
    /// File for the cycle record.
    pub cycle_record: Option<PathBuf>,
    /// What the monitor serves, if there is one.
    pub page: Option<PageOptions>,
    /// Cycles that a serving cell begins with.
    pub first_cycles: Option<u64>,
}

/// Creates the service of a topic.
pub(super) fn create(node: &Node, topic: &Topic) -> Result<ServiceHandle, IpcError> {
    use ipc::header;
    let cell::schedule::TopicSize { publishers, subscribers, buffer, borrowed } = topic.size;
    let size = TopicSize { publishers, subscribers, buffer, borrowed };
    match topic.carries {
        Carries::Control => node.create_topic::<header::Control>(&topic.name, size),
        Carries::Event => node.create_topic::<header::Event>(&topic.name, size),
        Carries::Trigger => node.create_topic::<header::Trigger>(&topic.name, size),
        Carries::Frame => node.create_topic::<header::Frame>(&topic.name, size),
        Carries::Phase => node.create_topic::<header::Phase>(&topic.name, size),
        Carries::Cloud => node.create_topic::<header::Cloud>(&topic.name, size),
        Carries::Outcome => node.create_topic::<header::Outcome>(&topic.name, size),
    }
}

/// The state machine of the cycles.
pub(super) fn machine(cell: &Cell, options: &RunOptions) -> Cycles {
    let order = Order::new(&cell.schedule);
    // An activation also needs the previous one in its lane.
    let steps = cell.schedule.activations.iter().zip(order.before).map(|(a, before)| Step {
        stage: a.stage,
        half: cell.schedule.half(a),
        inputs: a.inputs.iter().copied().chain(before).collect(),
        label: label(&cell.graph, a.work),
    });
    let limits = &cell.config.limits;
    let budgets =
        Budgets { stage_ns: ns_of_ms(limits.stage_budget_ms), cycle_ns: ns_of_ms(limits.cycle_deadline_ms) };
    let names = cell.schedule.stages.iter().map(|s| s.name.clone()).collect();
    let cycles = Cycles::new(names, steps.collect(), budgets, cell.schedule.in_flight, options.cycles);
    // A host that is led gets its cycles from the one that leads.
    if options.serve || !cell.graph.leads() { cycles.open() } else { cycles }
}

/// The stage processes, not started yet.
pub(super) fn stages(cell: &LoadedCell, options: &RunOptions) -> Vec<StageProcess> {
    let limits = &cell.config.limits;
    let policy = Policy { restarts_max: limits.restarts_max, window_ns: ns_of_ms(limits.restart_window_ms) };
    let stages = cell.schedule.stages.iter().map(|stage| {
        // Stages that run alone get all cores, stages that run in parallel one each.
        let threads = match stage.kind {
            Kind::Matching | Kind::Fusion | Kind::Inspection => cell.schedule.cores,
            Kind::Projection | Kind::Capture | Kind::Decode | Kind::Record | Kind::Link => 1,
        };
        StageProcess::new(&stage.name, arguments(cell, options, stage), threads, policy)
    });
    stages.collect()
}

/// Arguments of the hidden subcommand `monitor`.
pub(super) fn monitor_arguments(cell: &LoadedCell, options: &RunOptions, page: &PageOptions) -> Vec<String> {
    let mut arguments = vec!["monitor".to_owned()];
    arguments.extend(common_arguments(cell, options));
    let mut option = |name: &str, value: String| arguments.extend([name.to_owned(), value]);
    if let Some(folder) = &options.out {
        option("--out", folder.path().display().to_string());
    }
    if let Some(file) = &page.token {
        option("--page-token", file.display().to_string());
    }
    if page.metrics_only {
        arguments.push("--metrics-only".into());
    }
    if page.demo {
        arguments.push("--demo".into());
    }
    arguments
}

/// Arguments of every process of the cell: which cell, which files, which supervisor.
fn common_arguments(cell: &LoadedCell, options: &RunOptions) -> Vec<String> {
    let values = [
        ("--cell", cell.shared_name.clone()),
        ("--config", options.config.display().to_string()),
        ("--files", short_hashes(&cell.file.read_files()).join(",")),
        ("--parent", std::process::id().to_string()),
    ];
    let host = cell.graph.here.map(|here| ("--host", cell.graph.host_name(here).to_owned()));
    values.into_iter().chain(host).flat_map(|(name, value)| [name.to_owned(), value]).collect()
}

fn arguments(cell: &LoadedCell, options: &RunOptions, stage: &Stage) -> Vec<String> {
    let mut arguments: Vec<String> = ["stage", stage.kind.word(), &stage.name].map(str::to_owned).to_vec();
    arguments.extend(common_arguments(cell, options));
    let mut option = |name: &str, value: String| arguments.extend([name.to_owned(), value]);
    let camera = (stage.kind == Kind::Capture).then(|| &cell.config.cameras[stage.subject].name);
    if let Some((_, hash)) = options.frames.iter().find(|(name, _)| Some(name) == camera) {
        option("--frames", hash.clone());
    }
    option("--retention", cell.graph.retention.to_string());
    if let Some(folder) = &options.record {
        option("--record", folder.display().to_string());
        if options.cycles != Some(1) {
            arguments.push("--record-many".into());
        }
    }
    if cell.graph.watch {
        arguments.push("--watch".into());
    }
    arguments
}

/// The thread that writes the results, if they are written.
pub(super) fn result_writer(cell: &LoadedCell, options: &RunOptions) -> Result<Option<ResultWriter>> {
    let Some(folder) = options.out.clone() else { return Ok(None) };
    let mut files = PartFiles::new(folder, cell, options.cycles.is_none())?;
    ResultWriter::start(move |result, output| files.write(result, output)).map(Some)
}

/// Converts ms to ns.
pub(super) fn ns_of_ms(ms: u64) -> u64 {
    ms.saturating_mul(1_000_000)
}
