//! The static schedule: which stage does what on which core in which order, through which buffers. Pure.
//!
//! It is computed once from the graph of the cell, before anything starts; the stages compute the same one for
//! themselves and work through their part of it in order. Activations are numbered in an order in which every input
//! comes before its use, so the numbering itself proves that the graph has no cycle.

mod check;
mod graph;
mod plan;
mod topics;

pub use check::ScheduleError;
pub use graph::{CameraNode, Graph, PairNode, ProjectorNode, Right, axes_taken};

use fringe::pattern::Axis;
use ipc::port::TopicSize;

/// Name of the process that owns the schedule, as a consumer of topics.
pub const SUPERVISOR: &str = "supervisor";

/// The kind of a stage; one process each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum Kind {
    /// Shows patterns and triggers cameras.
    Projection,
    /// Exposes one camera.
    Capture,
    /// Turns the frames of one camera into phases.
    Decode,
    /// Turns the phases of one pair into a cloud.
    Matching,
    /// Joins the clouds.
    Fusion,
    /// Measures the features.
    Inspection,
    /// Writes a recording.
    Record,
}

impl Kind {
    /// As on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::Projection => "projection",
            Self::Capture => "capture",
            Self::Decode => "decode",
            Self::Matching => "matching",
            Self::Fusion => "fusion",
            Self::Inspection => "inspection",
            Self::Record => "record",
        }
    }
}

/// A process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stage {
    /// What it is.
    pub kind: Kind,
    /// The camera or pair it serves, counted in the graph; 0 for the others.
    pub subject: usize,
    /// `capture/cam1`.
    pub name: String,
    /// Core that it is planned for.
    pub core: usize,
}

/// One piece of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// Show a pattern.
    Project {
        /// Projector.
        projector: usize,
        /// Frame of its sequence.
        frame: usize,
    },
    /// Take a frame.
    Expose {
        /// Camera.
        camera: usize,
        /// Projector that is on.
        projector: usize,
        /// Frame of its sequence.
        frame: usize,
    },
    /// Add a frame to the sums of a decoder.
    Accumulate {
        /// Camera.
        camera: usize,
        /// Projector that was on.
        projector: usize,
        /// Frame of its sequence.
        frame: usize,
    },
    /// Make the absolute phase.
    Phase {
        /// Camera.
        camera: usize,
        /// Projector that was on.
        projector: usize,
        /// Axis.
        axis: Axis,
    },
    /// Match and triangulate a pair.
    Match {
        /// Pair.
        pair: usize,
    },
    /// Join all clouds.
    Fuse,
    /// Measure and judge.
    Inspect,
    /// Write all frames of a cycle.
    Store,
}

/// One piece of work with its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Activation {
    /// Who does it.
    pub stage: usize,
    /// What.
    pub work: Work,
    /// Activations that must be done before.
    pub inputs: Vec<usize>,
    /// Topic that carries what it gives.
    pub output: Option<usize>,
}

/// What a topic carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carries {
    /// Commands.
    Control,
    /// Reports of stages.
    Event,
    /// Triggers.
    Trigger,
    /// Images.
    Frame,
    /// Phase maps.
    Phase,
    /// Points.
    Cloud,
    /// The result.
    Outcome,
}

/// A topic with its buffers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Name.
    pub name: String,
    /// Kind of message.
    pub carries: Carries,
    /// Senders.
    pub producers: Vec<String>,
    /// Receivers.
    pub consumers: Vec<String>,
    /// Buffers.
    pub size: TopicSize,
    /// Largest message, bytes.
    pub bytes: u64,
}

impl Topic {
    /// Memory of all senders, were every slot filled: each receiver's buffer and held messages, and the one being written.
    pub fn memory_bytes(&self) -> u64 {
        let slots = self.consumers.len() * (self.size.buffer + self.size.borrowed) + 1;
        self.bytes.saturating_mul(slots as u64).saturating_mul(self.producers.len() as u64)
    }
}

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
