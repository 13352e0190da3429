//! The static schedule: which stage does what on which core in which order, through which buffers. Pure.
//!
//! It is computed once from the graph of the cell, before anything starts; the stages compute the same one for
//! themselves and work through their part of it in order. Activations are numbered in an order in which every input
//! comes before its use, so the numbering itself proves that the graph has no cycle.

mod activations;
mod check;
mod labels;
mod order;
mod parts;
mod topics;

pub use labels::{label, output};
pub use order::{Interval, Order, violation};
pub use parts::{Activation, Carries, Half, Kind, SUPERVISOR, Stage, Topic, TopicSize, Work};
pub use topics::{FRAME_BUFFER, REPORT_BYTES, RESULT_BYTES};

use crate::error::ScheduleError;
use crate::graph::Graph;

/// Shared memory that a service takes beside its messages, bytes: its lists of processes and ports, its file, its connections.
const SERVICE_BYTES: u64 = 448 << 10;

/// Shared memory of the link to another host, bytes: both directions with their waiting messages.
const LINK_BYTES: u64 = 64 << 20;

/// Shared memory of a message beside its payload, bytes: header and alignment.
const SLOT_BYTES: u64 = 512;

/// The whole plan of a cycle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schedule {
    /// Processes, in the order of the flow.
    pub stages: Vec<Stage>,
    /// Work, in an order in which inputs come first.
    pub activations: Vec<Activation>,
    /// Topics of all messages, with their buffers.
    pub topics: Vec<Topic>,
    /// Number of cores planned for.
    pub cores: usize,
    /// Cycles that may be under way at once: while one is evaluated the next ones are acquired.
    pub in_flight: usize,
    /// Hosts that a stage speaks with: it waits for them in a lane of its own, after those of the cores.
    pub links: usize,
}

/// Work of one core that is done one after another. A core has a lane for each half of a cycle: what one projector showed is evaluated
/// while the next one shows, and with several cycles in flight a cycle is evaluated while the next one is acquired.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lane {
    /// Number of the core, from 0; one more than the last core: the link to other hosts, which waits and hardly computes.
    pub core: usize,
    /// The half of the cycle.
    pub half: Half,
}

impl Lane {
    /// Whether the work of a stage lies in it.
    pub fn has(self, stage: &Stage) -> bool {
        stage.core == self.core && self.half == stage.kind.half()
    }
}

/// Largest message: 4 GB hold the points of 76 megapixels.
const MAX_MESSAGE_BYTES: u64 = 1 << 32;

impl Schedule {
    /// Plans a cell.
    ///
    /// # Errors
    /// The first gap, excess or deadline that cannot be met, with both ends and both numbers.
    pub fn new(graph: &Graph) -> Result<Self, ScheduleError> {
        check::check(graph)?;
        let stages = activations::stages(graph);
        let topics = topics::topics(graph, &stages);
        if let Some(topic) = topics.iter().find(|t| t.bytes > MAX_MESSAGE_BYTES) {
            return Err(ScheduleError::TooLarge {
                topic: topic.name.clone(),
                bytes: topic.bytes,
                limit: MAX_MESSAGE_BYTES,
            });
        }
        let activations = activations::activations(graph, &stages, &topics);
        let links = if graph.leads() { graph.led().len() } else { 1 };
        Ok(Self { stages, activations, topics, cores: graph.cores, in_flight: graph.in_flight, links })
    }

    /// Number of an activation.
    pub fn find(&self, work: Work) -> Option<usize> {
        self.activations.iter().position(|a| a.work == work)
    }

    /// A topic by name.
    pub fn topic(&self, name: &str) -> Option<&Topic> {
        self.topics.iter().find(|t| t.name == name)
    }

    /// All lanes, core by core.
    pub fn lanes(&self) -> Vec<Lane> {
        let of_core = |core| [Half::Acquisition, Half::Evaluation].map(|half| Lane { core, half });
        let links = (self.links > 0).then_some(Lane { core: self.cores, half: Kind::Link.half() });
        (0..self.cores).flat_map(of_core).chain(links).collect()
    }

    /// The activations of a lane, in their order.
    pub fn on_lane(&self, lane: Lane) -> impl Iterator<Item = (usize, &Activation)> {
        self.activations.iter().enumerate().filter(move |(_, a)| lane.has(&self.stages[a.stage]))
    }

    /// The half of the cycle that an activation belongs to.
    pub fn half(&self, activation: &Activation) -> Half {
        self.stages[activation.stage].kind.half()
    }

    /// Shared memory of a running cell, were every buffer full; a stage that is started again needs no more.
    pub fn memory_bytes(&self) -> u64 {
        // Each stage and the supervisor have a notification.
        let services = (self.topics.len() + self.stages.len() + 1) as u64;
        let slots: u64 = self.topics.iter().map(Topic::slots).fold(0, u64::saturating_add);
        let beside = (services * SERVICE_BYTES).saturating_add(slots.saturating_mul(SLOT_BYTES));
        let beside = beside.saturating_add(self.links as u64 * LINK_BYTES);
        self.topics.iter().map(Topic::memory_bytes).fold(beside, u64::saturating_add)
    }
}

#[cfg(test)]
mod tests;
