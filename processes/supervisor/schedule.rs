//! The static schedule: which stage does what on which core in which order, through which buffers. Pure.
//!
//! It is computed once from the graph of the cell, before anything starts; the stages compute the same one for
//! themselves and work through their part of it in order. Activations are numbered in an order in which every input
//! comes before its use, so the numbering itself proves that the graph has no cycle.

use fringe::pattern::Axis;
use ipc::header::{MAX_RESULT_BYTES, MAX_TEXT_BYTES, PHASE_BYTES_PER_PX};
use ipc::port::TopicSize;
use std::collections::BTreeSet;
use thiserror::Error;

/// Frames that wait in front of a decoder: it may lag behind the camera by that many before the camera is held.
pub const FRAME_BUFFER: usize = 8;

/// Events that wait in front of the supervisor, per stage. A stage has at most one event per frame under way and the
/// supervisor looks every 20 ms, so 64 last for a camera of 3 kHz.
pub const EVENT_BUFFER: usize = 64;

/// Commands that wait in front of a stage: start, abort, start … while it is busy with one activation.
pub const CONTROL_BUFFER: usize = 16;

/// Name of the process that owns the schedule, as a consumer of topics.
pub const SUPERVISOR: &str = "supervisor";

/// The cell as the schedule sees it. Indices count in the order of the config.
#[derive(Debug, Clone, PartialEq)]
pub struct Graph {
    /// What looks.
    pub cameras: Vec<CameraNode>,
    /// What lights, in the order of projection.
    pub projectors: Vec<ProjectorNode>,
    /// What is matched.
    pub pairs: Vec<PairNode>,
    /// Cores to plan for, at least 1.
    pub cores: usize,
    /// Whether a stage writes a recording.
    pub record: bool,
    /// Whether the supervisor watches frames, phases and the fused cloud for its report.
    pub watch: bool,
    /// Frames per second of a recording that is played, if one is and it is paced.
    pub rate_hz: Option<f64>,
    /// Longest duration of a cycle, ms.
    pub cycle_deadline_ms: u64,
}

/// A camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraNode {
    /// Name.
    pub name: String,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
}

/// A projector.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProjectorNode {
    /// Name.
    pub name: String,
    /// Frames of its sequence.
    pub frames: usize,
    /// Axes along which the sequence has sines, x before y.
    pub axes: Vec<Axis>,
    /// Cameras that look while it is on.
    pub cameras: Vec<usize>,
}

/// The right side of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Right {
    /// Another camera: stereo matching of phases.
    Camera(usize),
    /// The projector itself: the conventional approach.
    Projector,
}

/// Two views that are matched.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PairNode {
    /// Name.
    pub name: String,
    /// Left camera.
    pub left: usize,
    /// Right side.
    pub right: Right,
    /// Projector whose phase they share.
    pub projector: usize,
}

impl PairNode {
    /// Cameras whose phases it takes, left first.
    pub fn cameras(&self) -> Vec<usize> {
        match self.right {
            Right::Camera(right) => vec![self.left, right],
            Right::Projector => vec![self.left],
        }
    }

    /// Axes whose phases it takes: stereo matching needs one, and x is the one along the baseline of most cells.
    pub fn axes(&self, projector: &ProjectorNode) -> Vec<Axis> {
        match self.right {
            Right::Camera(_) => projector.axes.iter().copied().take(1).collect(),
            Right::Projector => projector.axes.clone(),
        }
    }
}

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

/// Why a graph cannot be run.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ScheduleError {
    /// Nothing to do.
    #[error("the cell has no {0}")]
    Empty(&'static str),
    /// A projector whose light nobody sees.
    #[error("projector \"{0}\" lights no camera; name some in its `cameras`, or remove it")]
    Unseen(String),
    /// A camera without light.
    #[error("camera \"{0}\" is in no projector's `cameras`; add it to one, or remove it")]
    Dark(String),
    /// A sequence without phase.
    #[error(
        "pair \"{pair}\" needs a phase, but the sequence of projector \"{projector}\" has no sine set; add one"
    )]
    NoPhase {
        /// Pair.
        pair: String,
        /// Projector.
        projector: String,
    },
    /// One end of a pair has no frames.
    #[error(
        "pair \"{pair}\" takes camera \"{camera}\", but projector \"{projector}\" lights only {lit}; add it to the projector's `cameras`"
    )]
    Gap {
        /// Pair.
        pair: String,
        /// Camera.
        camera: String,
        /// Projector.
        projector: String,
        /// Cameras that it does light.
        lit: String,
    },
    /// Frames whose phase nobody takes.
    #[error(
        "camera \"{camera}\" looks at projector \"{projector}\", but no pair takes its phase; name a pair, or remove the camera"
    )]
    Unused {
        /// Camera.
        camera: String,
        /// Projector.
        projector: String,
    },
    /// The frames alone last longer than a cycle may.
    #[error(
        "{frames} frames at {rate_hz} Hz last {needed_ms} ms, the cycle must end within {deadline_ms} ms; raise limits.cycle_deadline_ms or recording.rate_hz"
    )]
    Deadline {
        /// Frames of a cycle.
        frames: usize,
        /// Frames per second.
        rate_hz: f64,
        /// Time for the frames.
        needed_ms: u64,
        /// Time of the cycle.
        deadline_ms: u64,
    },
    /// Sizes that no memory holds.
    #[error("topic \"{topic}\" would need messages of {bytes} bytes, the limit is {limit}")]
    TooLarge {
        /// Topic.
        topic: String,
        /// Needed.
        bytes: u64,
        /// Limit.
        limit: u64,
    },
}

/// Largest message: 4 GB hold the points of 76 megapixels.
const MAX_MESSAGE_BYTES: u64 = 1 << 32;

impl Schedule {
    /// Plans a cell.
    ///
    /// # Errors
    /// The first gap, excess or deadline that cannot be met, with both ends and both numbers.
    pub fn new(graph: &Graph) -> Result<Self, ScheduleError> {
        check(graph)?;
        let stages = stages(graph);
        let topics = topics(graph, &stages);
        if let Some(topic) = topics.iter().find(|t| t.bytes > MAX_MESSAGE_BYTES) {
            return Err(ScheduleError::TooLarge {
                topic: topic.name.clone(),
                bytes: topic.bytes,
                limit: MAX_MESSAGE_BYTES,
            });
        }
        let activations = Planner::new(graph, &stages, &topics).plan();
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

/// Axes whose phases of a camera and a projector somebody takes.
pub fn axes_taken(graph: &Graph, camera: usize, projector: usize) -> Vec<Axis> {
    let takers = graph.pairs.iter().filter(|p| p.projector == projector && p.cameras().contains(&camera));
    let axes: BTreeSet<Axis> = takers.flat_map(|p| p.axes(&graph.projectors[projector])).collect();
    axes.into_iter().collect()
}

fn check(graph: &Graph) -> Result<(), ScheduleError> {
    for (empty, what) in [
        (graph.cameras.is_empty(), "camera"),
        (graph.projectors.is_empty(), "projector"),
        (graph.pairs.is_empty(), "pair"),
        (graph.cores == 0, "core"),
    ] {
        if empty {
            return Err(ScheduleError::Empty(what));
        }
    }
    if let Some(projector) = graph.projectors.iter().find(|p| p.cameras.is_empty()) {
        return Err(ScheduleError::Unseen(projector.name.clone()));
    }
    for pair in &graph.pairs {
        check_pair(graph, pair)?;
    }
    let lit = |camera: &usize| graph.projectors.iter().any(|p| p.cameras.contains(camera));
    if let Some(dark) = (0..graph.cameras.len()).find(|camera| !lit(camera)) {
        return Err(ScheduleError::Dark(graph.cameras[dark].name.clone()));
    }
    for (number, projector) in graph.projectors.iter().enumerate() {
        for &camera in &projector.cameras {
            if axes_taken(graph, camera, number).is_empty() {
                return Err(ScheduleError::Unused {
                    camera: graph.cameras[camera].name.clone(),
                    projector: projector.name.clone(),
                });
            }
        }
    }
    check_deadline(graph)
}

fn check_pair(graph: &Graph, pair: &PairNode) -> Result<(), ScheduleError> {
    let projector = &graph.projectors[pair.projector];
    if pair.axes(projector).is_empty() {
        return Err(ScheduleError::NoPhase { pair: pair.name.clone(), projector: projector.name.clone() });
    }
    for camera in pair.cameras() {
        if !projector.cameras.contains(&camera) {
            let lit: Vec<&str> = projector.cameras.iter().map(|&c| graph.cameras[c].name.as_str()).collect();
            return Err(ScheduleError::Gap {
                pair: pair.name.clone(),
                camera: graph.cameras[camera].name.clone(),
                projector: projector.name.clone(),
                lit: lit.join(", "),
            });
        }
    }
    Ok(())
}

fn check_deadline(graph: &Graph) -> Result<(), ScheduleError> {
    let frames: usize = graph.projectors.iter().map(|p| p.frames).sum();
    let Some(rate_hz) = graph.rate_hz.filter(|rate| *rate > 0.0) else {
        return Ok(());
    };
    let needed_ms = (frames as f64 * 1e3 / rate_hz).ceil() as u64;
    if needed_ms > graph.cycle_deadline_ms {
        let deadline_ms = graph.cycle_deadline_ms;
        return Err(ScheduleError::Deadline { frames, rate_hz, needed_ms, deadline_ms });
    }
    Ok(())
}

/// A camera's capture and decode share a core: its frames then stay in that core's cache.
fn stages(graph: &Graph) -> Vec<Stage> {
    let stage = |kind: Kind, subject: usize, of: Option<&str>, core: usize| Stage {
        kind,
        subject,
        name: of.map_or_else(|| kind.word().to_owned(), |of| format!("{}/{of}", kind.word())),
        core: core % graph.cores,
    };
    let mut stages = vec![stage(Kind::Projection, 0, None, 0)];
    for kind in [Kind::Capture, Kind::Decode] {
        stages.extend(graph.cameras.iter().enumerate().map(|(i, c)| stage(kind, i, Some(&c.name), i)));
    }
    stages.extend(graph.pairs.iter().enumerate().map(|(i, p)| stage(Kind::Matching, i, Some(&p.name), i)));
    stages.push(stage(Kind::Fusion, 0, None, 0));
    stages.push(stage(Kind::Inspection, 0, None, 0));
    if graph.record {
        stages.push(stage(Kind::Record, 0, None, 1));
    }
    stages
}

fn topics(graph: &Graph, stages: &[Stage]) -> Vec<Topic> {
    let all: Vec<String> = stages.iter().map(|s| s.name.clone()).collect();
    let supervisor = || vec![SUPERVISOR.to_owned()];
    let mut topics = vec![
        topic("control", Carries::Control, supervisor(), all.clone(), CONTROL_BUFFER, 1),
        topic("event", Carries::Event, all, supervisor(), EVENT_BUFFER, MAX_TEXT_BYTES as u64),
    ];
    let captures = |projector: &ProjectorNode| -> Vec<String> {
        projector.cameras.iter().map(|&c| format!("capture/{}", graph.cameras[c].name)).collect()
    };
    for projector in &graph.projectors {
        let name = format!("trigger/{}", projector.name);
        topics.push(topic(&name, Carries::Trigger, vec!["projection".into()], captures(projector), 4, 1));
    }
    let looking: Vec<String> = graph.cameras.iter().map(|c| format!("capture/{}", c.name)).collect();
    topics.push(topic(
        "exposed",
        Carries::Trigger,
        looking,
        vec!["projection".into()],
        4 * graph.cameras.len(),
        1,
    ));
    for camera in &graph.cameras {
        topics.push(frame_topic(graph, camera));
    }
    for number in 0..graph.cameras.len() {
        topics.push(phase_topic(graph, number));
    }
    let mut capacity = 0;
    for pair in &graph.pairs {
        let bytes = cloud_bytes(&graph.cameras[pair.left]);
        capacity += bytes;
        let from = vec![format!("matching/{}", pair.name)];
        let name = format!("cloud/{}", pair.name);
        topics.push(topic(&name, Carries::Cloud, from, vec!["fusion".into()], 1, bytes));
    }
    let mut readers = vec!["inspection".to_owned()];
    readers.extend(graph.watch.then(|| SUPERVISOR.to_owned()));
    let mut fused = topic("cloud/fused", Carries::Cloud, vec!["fusion".into()], readers, 1, capacity);
    // The supervisor holds the last good cloud and that of the running cycle while the next one comes.
    fused.size.borrowed = 3;
    topics.push(fused);
    topics.push(topic(
        "result",
        Carries::Outcome,
        vec!["inspection".into()],
        supervisor(),
        2,
        MAX_RESULT_BYTES as u64,
    ));
    topics
}

fn topic(
    name: &str,
    carries: Carries,
    producers: Vec<String>,
    consumers: Vec<String>,
    buffer: usize,
    bytes: u64,
) -> Topic {
    // A receiver holds the message it works on and one that came early. The fusion holds one per topic.
    let size = TopicSize {
        // Twice: a restarted process may join before its dead predecessor is cleaned up.
        publishers: 2 * producers.len(),
        subscribers: consumers.len(),
        buffer,
        borrowed: 2,
    };
    Topic { name: name.to_owned(), carries, producers, consumers, size, bytes }
}

fn frame_topic(graph: &Graph, camera: &CameraNode) -> Topic {
    let mut readers = vec![format!("decode/{}", camera.name)];
    readers.extend(graph.record.then(|| "record".to_owned()));
    readers.extend(graph.watch.then(|| SUPERVISOR.to_owned()));
    let pixels = u64::from(camera.width_px) * u64::from(camera.height_px);
    // Two bytes per pixel: whether a driver gives 8 or 16 bits is known only when it runs.
    topic(
        &format!("frame/{}", camera.name),
        Carries::Frame,
        vec![format!("capture/{}", camera.name)],
        readers,
        FRAME_BUFFER,
        2 * pixels,
    )
}

/// One message per projector and axis, all of which a matcher may let wait.
fn phase_topic(graph: &Graph, number: usize) -> Topic {
    let camera = &graph.cameras[number];
    let takers = graph.pairs.iter().filter(|p| p.cameras().contains(&number));
    let mut readers: Vec<String> = takers.map(|p| format!("matching/{}", p.name)).collect();
    readers.extend(graph.watch.then(|| SUPERVISOR.to_owned()));
    let maps: usize = (0..graph.projectors.len()).map(|p| axes_taken(graph, number, p).len()).sum();
    let pixels = u64::from(camera.width_px) * u64::from(camera.height_px);
    let name = format!("phase/{}", camera.name);
    let from = vec![format!("decode/{}", camera.name)];
    let mut phase =
        topic(&name, Carries::Phase, from, readers, maps.max(1), pixels * PHASE_BYTES_PER_PX as u64);
    phase.size.borrowed = maps.max(1) + 1;
    phase
}

fn cloud_bytes(left: &CameraNode) -> u64 {
    u64::from(left.width_px) * u64::from(left.height_px) * size_of::<fringe::cloud::Point>() as u64
}

/// Numbers the work in the order of time.
struct Planner<'a> {
    graph: &'a Graph,
    stages: &'a [Stage],
    topics: &'a [Topic],
    activations: Vec<Activation>,
}

impl<'a> Planner<'a> {
    fn new(graph: &'a Graph, stages: &'a [Stage], topics: &'a [Topic]) -> Self {
        Self { graph, stages, topics, activations: Vec::new() }
    }

    fn plan(mut self) -> Vec<Activation> {
        let mut clouds = Vec::new();
        let mut before = None;
        for projector in 0..self.graph.projectors.len() {
            let mut sums = Vec::new();
            for frame in 0..self.graph.projectors[projector].frames {
                (before, sums) = self.frame(projector, frame, before);
            }
            clouds.extend(self.evaluate(projector, &sums));
        }
        let fused = self.add(Kind::Fusion, 0, Work::Fuse, clouds, "cloud/fused");
        self.add(Kind::Inspection, 0, Work::Inspect, vec![fused], "result");
        if self.graph.record {
            let exposed = |a: &Activation| matches!(a.work, Work::Expose { .. });
            let frames = (0..self.activations.len()).filter(|&i| exposed(&self.activations[i])).collect();
            self.add(Kind::Record, 0, Work::Store, frames, "");
        }
        self.activations
    }

    /// A pattern stands until all its cameras have exposed; the next one waits for that.
    fn frame(
        &mut self,
        projector: usize,
        frame: usize,
        before: Option<Vec<usize>>,
    ) -> (Option<Vec<usize>>, Vec<usize>) {
        let node = &self.graph.projectors[projector];
        let trigger = format!("trigger/{}", node.name);
        let shown = self.add(
            Kind::Projection,
            0,
            Work::Project { projector, frame },
            before.unwrap_or_default(),
            &trigger,
        );
        let expose = |this: &mut Self, camera: usize| {
            let topic = format!("frame/{}", this.graph.cameras[camera].name);
            this.add(Kind::Capture, camera, Work::Expose { camera, projector, frame }, vec![shown], &topic)
        };
        let exposed: Vec<usize> = node.cameras.iter().map(|&camera| expose(self, camera)).collect();
        let sums = node.cameras.iter().zip(&exposed).map(|(&camera, &exposed)| {
            self.add(Kind::Decode, camera, Work::Accumulate { camera, projector, frame }, vec![exposed], "")
        });
        let sums = sums.collect();
        (Some(exposed), sums)
    }

    /// After the last frame of a projector: phases, then the pairs that share it.
    fn evaluate(&mut self, projector: usize, sums: &[usize]) -> Vec<usize> {
        let mut phases = Vec::new();
        let node = &self.graph.projectors[projector];
        for (&camera, &sum) in node.cameras.iter().zip(sums) {
            let topic = format!("phase/{}", self.graph.cameras[camera].name);
            for axis in axes_taken(self.graph, camera, projector) {
                let work = Work::Phase { camera, projector, axis };
                phases.push((camera, axis, self.add(Kind::Decode, camera, work, vec![sum], &topic)));
            }
        }
        let mut clouds = Vec::new();
        for (number, pair) in self.graph.pairs.iter().enumerate().filter(|(_, p)| p.projector == projector) {
            let (cameras, axes) = (pair.cameras(), pair.axes(node));
            let taken =
                phases.iter().filter(|(camera, axis, _)| cameras.contains(camera) && axes.contains(axis));
            let inputs = taken.map(|(_, _, phase)| *phase).collect();
            let topic = format!("cloud/{}", pair.name);
            clouds.push(self.add(Kind::Matching, number, Work::Match { pair: number }, inputs, &topic));
        }
        clouds
    }

    fn add(&mut self, kind: Kind, subject: usize, work: Work, inputs: Vec<usize>, output: &str) -> usize {
        let stage =
            self.stages.iter().position(|s| s.kind == kind && s.subject == subject).unwrap_or_default();
        let output = self.topics.iter().position(|t| t.name == output);
        self.activations.push(Activation { stage, work, inputs, output });
        self.activations.len() - 1
    }
}

#[cfg(test)]
#[path = "schedule_tests.rs"]
mod tests;
