//! The static schedule: which stage does what on which core in which order, through which buffers. Pure.
//!
//! It is computed once from the graph of the cell, before anything starts; the stages compute the same one for
//! themselves and work through their part of it in order. Activations are numbered in an order in which every input
//! comes before its use, so the numbering itself proves that the graph has no cycle.

mod check;
mod graph;
mod order;
mod parts;
mod plan;
mod topics;
mod words;

pub use check::ScheduleError;
pub use graph::{CameraNode, Graph, PairNode, ProjectorNode, Right, axes_taken};
pub use order::{Interval, Order, violation};
pub use parts::{Activation, Carries, Kind, SUPERVISOR, Stage, Topic, Work};
pub use words::{label, output};

/// The whole plan of a cycle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schedule {
    /// Processes, in the order of the flow.
    pub stages: Vec<Stage>,
    /// Work, in an order in which inputs come first.
    pub activations: Vec<Activation>,
    /// Topics.
    pub topics: Vec<Topic>,
    /// Cores planned for.
    pub cores: usize,
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
        let stages = plan::stages(graph);
        let topics = topics::topics(graph, &stages);
        if let Some(topic) = topics.iter().find(|t| t.bytes > MAX_MESSAGE_BYTES) {
            return Err(ScheduleError::TooLarge {
                topic: topic.name.clone(),
                bytes: topic.bytes,
                limit: MAX_MESSAGE_BYTES,
            });
        }
        let activations = plan::activations(graph, &stages, &topics);
        Ok(Self { stages, activations, topics, cores: graph.cores })
    }

    /// Number of an activation.
    pub fn find(&self, work: Work) -> Option<usize> {
        self.activations.iter().position(|a| a.work == work)
    }

    /// A topic by name.
    pub fn topic(&self, name: &str) -> Option<&Topic> {
        self.topics.iter().find(|t| t.name == name)
    }

    /// Order of the activations on a core.
    pub fn on_core(&self, core: usize) -> impl Iterator<Item = (usize, &Activation)> {
        self.activations.iter().enumerate().filter(move |(_, a)| self.stages[a.stage].core == core)
    }

    /// Shared memory, were every buffer full.
    pub fn memory_bytes(&self) -> u64 {
        self.topics.iter().map(Topic::memory_bytes).fold(0, u64::saturating_add)
    }
}

#[cfg(test)]
mod tests;
