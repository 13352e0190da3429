//! What a schedule is made of: stages, their work, the topics between them.

use fringe::pattern::Axis;
use std::str::FromStr;

/// Name of the process that owns the schedule, as a consumer of topics.
pub const SUPERVISOR: &str = "supervisor";

/// The kind of a stage; one process each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Shows patterns and triggers cameras.
    Projection,
    /// Takes the frames of one camera.
    Capture,
    /// Turns the frames of one camera into phases.
    Decode,
    /// Turns the phases of one pair into a cloud.
    Matching,
    /// Fuses the clouds of all pairs.
    Fusion,
    /// Measures and evaluates the features of the part.
    Inspection,
    /// Writes the frames as a recording.
    Record,
    /// Speaks with the other hosts of the cell.
    Link,
}

/// The two halves of a cycle. Each stage belongs to one, so that the stages of one half can be a cycle ahead of the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Half {
    /// Until all phases are there: needs the part, the light and the cameras.
    Acquisition,
    /// From the phases to the verdict.
    Evaluation,
}

impl FromStr for Kind {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        let kind = Self::ALL.into_iter().find(|kind| kind.word() == word);
        kind.ok_or_else(|| format!("\"{word}\" is no kind of stage"))
    }
}

impl Kind {
    /// All kinds, in the order of the flow.
    pub const ALL: [Self; 8] = [
        Self::Projection,
        Self::Capture,
        Self::Decode,
        Self::Matching,
        Self::Fusion,
        Self::Inspection,
        Self::Record,
        Self::Link,
    ];

    /// The half of the cycle that it works in.
    pub fn half(self) -> Half {
        match self {
            Self::Projection | Self::Capture | Self::Decode | Self::Record | Self::Link => Half::Acquisition,
            Self::Matching | Self::Fusion | Self::Inspection => Half::Evaluation,
        }
    }

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
            Self::Link => "link",
        }
    }
}

/// A stage: one process of the cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stage {
    /// The kind of work that it does.
    pub kind: Kind,
    /// The camera or pair it serves, counted in the graph; 0 for the others.
    pub subject: usize,
    /// Name with its subject: `capture/cam1`.
    pub name: String,
    /// Core that it is planned for.
    pub core: usize,
}

/// One piece of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// Show a pattern on a projector.
    Project {
        /// Index of the projector.
        projector: usize,
        /// Frame of its sequence.
        frame: usize,
    },
    /// Take a frame with a camera.
    Expose {
        /// Index of the camera.
        camera: usize,
        /// Projector that is on.
        projector: usize,
        /// Frame of its sequence.
        frame: usize,
    },
    /// Add a frame to the sums of a decoder.
    Accumulate {
        /// Index of the camera.
        camera: usize,
        /// Projector that was on.
        projector: usize,
        /// Frame of its sequence.
        frame: usize,
    },
    /// Make the absolute phase.
    Phase {
        /// Index of the camera.
        camera: usize,
        /// Projector that was on.
        projector: usize,
        /// Projector axis of the phase.
        axis: Axis,
    },
    /// Match and triangulate a pair.
    Match {
        /// Index of the pair.
        pair: usize,
    },
    /// Take the cloud of a pair for fusion while other projectors show.
    Take {
        /// Index of the pair.
        pair: usize,
    },
    /// Fuse the clouds of all pairs.
    Fuse,
    /// Measure and evaluate the features.
    Inspect,
    /// Write all frames of a cycle.
    Store,
    /// On the host that leads: let another host take its frames, and wait until its light is off.
    Remote {
        /// Index of the host.
        host: usize,
    },
    /// On the host that leads: take the cloud of another host's pair.
    Receive {
        /// Index of the pair.
        pair: usize,
    },
    /// On a host that is led: the light of this host is off; the next host may take its frames.
    HandOver,
    /// On a host that is led: the host that leads has all clouds of this one.
    Deliver,
}

/// One piece of work with its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Activation {
    /// Index of the stage that does it.
    pub stage: usize,
    /// The work that is done.
    pub work: Work,
    /// Activations that must be done before.
    pub inputs: Vec<usize>,
    /// Topic that carries what it gives.
    pub output: Option<usize>,
}

/// What a topic carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carries {
    /// Commands of the supervisor to the stages.
    Control,
    /// Reports of the stages to the supervisor.
    Event,
    /// Triggers of a projector to its cameras.
    Trigger,
    /// Images of a camera.
    Frame,
    /// Phase maps of a camera.
    Phase,
    /// Points of a pair, or the fused cloud.
    Cloud,
    /// The result of the inspection.
    Outcome,
}

/// How many ends and buffers a topic has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicSize {
    /// Senders, counting those that may overlap while one is being restarted.
    pub publishers: usize,
    /// Receivers of the topic.
    pub subscribers: usize,
    /// Messages that may wait in front of each receiver.
    pub buffer: usize,
    /// Messages that a receiver may hold at once.
    pub borrowed: usize,
}

/// A topic with its buffers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Name of the topic.
    pub name: String,
    /// Kind of its messages.
    pub carries: Carries,
    /// Names of the stages that send.
    pub producers: Vec<String>,
    /// Names of the stages that receive.
    pub consumers: Vec<String>,
    /// Number of ends and buffers.
    pub size: TopicSize,
    /// Size of the largest message, bytes.
    pub bytes: u64,
}

impl Topic {
    /// Messages that all senders can have at once.
    pub fn slots(&self) -> u64 {
        let slots = self.consumers.len() * (self.size.buffer + self.size.borrowed) + 1;
        slots as u64 * self.producers.len() as u64
    }

    /// Memory of all senders, were every slot filled: each receiver's buffer and held messages, and the one being written.
    pub fn memory_bytes(&self) -> u64 {
        self.bytes.saturating_mul(self.slots())
    }
}
