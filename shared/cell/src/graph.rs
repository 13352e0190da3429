//! The graph of a cell for the schedule: cameras, projectors and pairs by index.

use crate::configuration::{CameraConfig, Configuration, ProjectorConfig, TriggerMode};
use crate::error::ScheduleError;
pub use crate::host_node::HostNode;
use crate::host_node::hosts;
use crate::options::Options;
use crate::retention::Retention;
use crate::together::frames_of;
use fringe::decode::decoded_axes;
use fringe::pattern::{Axis, PatternSet};
use std::collections::BTreeSet;

/// The cell as the schedule sees it. Indices count in the order of the config.
#[derive(Debug, Clone, PartialEq)]
pub struct Graph {
    /// Cameras, in the order of the configuration.
    pub cameras: Vec<CameraNode>,
    /// What lights, in the order of projection.
    pub projectors: Vec<ProjectorNode>,
    /// The projectors that show at the same time: each in one group, alone in most cells.
    pub groups: Vec<Vec<usize>>,
    /// Pairs, in the order of the rig file.
    pub pairs: Vec<PairNode>,
    /// Cores to plan for, at least 1.
    pub cores: usize,
    /// Cycles that may be under way at once, at least 1.
    pub in_flight: usize,
    /// Whether a stage writes a recording.
    pub record: bool,
    /// Whether the supervisor watches frames, phases and the fused cloud for its report.
    pub watch: bool,
    /// Which bytes the supervisor keeps in a cycle record.
    pub retention: Retention,
    /// Frames per second of a recording that is played, if one is and it is paced.
    pub rate_hz: Option<f64>,
    /// Longest duration of a cycle, ms.
    pub cycle_deadline_ms: u64,
    /// The computers of the cell, in the order of the configuration; none: it runs on one.
    pub hosts: Vec<HostNode>,
    /// Index of the host that this computer is; absent: it runs the whole cell.
    pub here: Option<usize>,
}

impl Graph {
    /// The graph of a configuration.
    ///
    /// # Errors
    /// A camera or projector that a pair names and the cell lacks, with both names; a host that the cell does not have.
    pub fn new(config: &Configuration, options: &Options) -> Result<Self, ScheduleError> {
        let camera = |name: &str| config.cameras.iter().position(|c| c.name == name);
        let projectors = config.projectors.iter().map(|p| ProjectorNode {
            name: p.name.clone(),
            frames: p.frames(),
            trigger: p.trigger,
            axes: phase_axes(config, p),
            cameras: p.cameras.iter().filter_map(|name| camera(name)).collect(),
        });
        let pairs = config.rig.pairs.iter().map(|pair| {
            let number = |name: &str| {
                let absent = || ScheduleError::NoCamera { pair: pair.name.clone(), camera: name.to_owned() };
                camera(name).ok_or_else(absent)
            };
            let left = number(&pair.left)?;
            let right = match config.rig.camera(&pair.right) {
                Some(_) => Right::Camera(number(&pair.right)?),
                None => Right::Projector,
            };
            let projector = config.projectors.iter().position(|p| p.name == pair.projector);
            let projector = projector.ok_or_else(|| ScheduleError::NoProjector {
                pair: pair.name.clone(),
                projector: pair.projector.clone(),
            })?;
            Ok(PairNode { name: pair.name.clone(), left, right, projector })
        });
        let node = |c: &CameraConfig| CameraNode {
            name: c.name.clone(),
            width_px: c.width_px,
            height_px: c.height_px,
        };
        // A record that keeps bytes takes them cycle by cycle, so that a crash loses one cycle and not all that follow.
        let in_flight = match options.retention {
            Retention::Hashes => config.schedule.cycles_in_flight as usize,
            Retention::Frames | Retention::All => 1,
        };
        let (hosts, here) = hosts(config, options.host.as_deref())?;
        Ok(Self {
            hosts,
            here,
            cameras: config.cameras.iter().map(node).collect(),
            projectors: projectors.collect(),
            groups: all_groups(config),
            pairs: pairs.collect::<Result<_, _>>()?,
            cores: config.schedule.cores as usize,
            in_flight,
            record: options.record,
            watch: options.watch,
            retention: options.retention,
            rate_hz: config.rate_hz,
            cycle_deadline_ms: config.limits.cycle_deadline_ms,
        })
    }

    /// Least time for all frames of a cycle of projectors that show their sequences in their own time, ms; 0 without one.
    pub fn acquisition_ms(&self) -> f64 {
        let last = |p: &ProjectorNode| match p.trigger {
            TriggerMode::Stepped => 0.0,
            TriggerMode::Sequenced { period_ms } => p.frames as f64 * period_ms,
        };
        self.projectors.iter().map(last).sum()
    }

    /// Patterns that are shown one after another in a cycle; those of a group count once.
    pub fn shown_frames(&self) -> usize {
        let frames: Vec<usize> = self.projectors.iter().map(|p| p.frames).collect();
        frames_of(&frames, &self.groups)
    }

    /// The other projectors that show at the same time as one.
    pub fn beside(&self, projector: usize) -> impl Iterator<Item = usize> {
        let group = self.groups.iter().find(|group| group.contains(&projector));
        group.into_iter().flatten().copied().filter(move |other| *other != projector)
    }

    /// The name of a camera, for messages.
    pub fn camera_name(&self, camera: usize) -> &str {
        self.cameras.get(camera).map_or("unknown", |c| &c.name)
    }

    /// The name of a projector, for messages.
    pub fn projector_name(&self, projector: usize) -> &str {
        self.projectors.get(projector).map_or("unknown", |p| &p.name)
    }

    /// The name of a pair, for messages.
    pub fn pair_name(&self, pair: usize) -> &str {
        self.pairs.get(pair).map_or("unknown", |p| &p.name)
    }

    /// A frame of a camera in words that an operator knows; frames count from 1.
    pub fn frame_name(&self, camera: usize, projector: usize, frame: usize) -> String {
        let (camera, projector) = (self.camera_name(camera), self.projector_name(projector));
        format!("frame {} of camera \"{camera}\" under projector \"{projector}\"", frame + 1)
    }
}

/// The groups of a configuration with the projectors that are in none, in the order of their first.
fn all_groups(config: &Configuration) -> Vec<Vec<usize>> {
    let grouped = |p: &usize| config.together.iter().any(|group| group.contains(p));
    let alone = (0..config.projectors.len()).filter(|p| !grouped(p)).map(|p| vec![p]);
    let mut groups: Vec<Vec<usize>> = config.together.iter().cloned().chain(alone).collect();
    for group in &mut groups {
        group.sort_unstable();
    }
    groups.sort_unstable();
    groups
}

/// Axes along which the decoder finds a phase in a projector's sequence, x before y; what it refuses is reported when it is built.
fn phase_axes(config: &Configuration, projector: &ProjectorConfig) -> Vec<Axis> {
    let extent_px = [projector.width_px, projector.height_px];
    decoded_axes(&projector.sequence, extent_px, &config.settings.decode).unwrap_or_else(|_| {
        let varied: BTreeSet<Axis> = projector.sequence.iter().filter_map(PatternSet::axis).collect();
        varied.into_iter().collect()
    })
}

/// A camera of the graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraNode {
    /// Name of the camera.
    pub name: String,
    /// Columns of the camera, px.
    pub width_px: u32,
    /// Rows of the camera, px.
    pub height_px: u32,
}

/// A projector of the graph.
#[derive(Debug, Clone, PartialEq)]
pub struct ProjectorNode {
    /// Name of the projector.
    pub name: String,
    /// Frames of a cycle.
    pub frames: usize,
    /// Who fires the cameras.
    pub trigger: TriggerMode,
    /// Axes along which the sequence gives a phase, x before y.
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
    /// Name of the pair.
    pub name: String,
    /// Index of the left camera.
    pub left: usize,
    /// The right camera, or the projector.
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

    /// Axes whose phases it takes: all that the projector shows. Two cameras match the one that changes most along their
    /// epipolar lines, which only the phases show.
    pub fn axes<'a>(&self, projector: &'a ProjectorNode) -> &'a [Axis] {
        &projector.axes
    }
}

/// Axes whose phases of a camera under a projector are used by a pair.
pub fn axes_taken(graph: &Graph, camera: usize, projector: usize) -> Vec<Axis> {
    let takers = graph.pairs.iter().filter(|p| p.projector == projector && p.cameras().contains(&camera));
    let axes: BTreeSet<Axis> =
        takers.flat_map(|p| p.axes(&graph.projectors[projector]).iter().copied()).collect();
    axes.into_iter().collect()
}
