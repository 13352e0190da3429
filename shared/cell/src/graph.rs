//! The cell as the schedule sees it: who looks, who lights, who is matched.

use files::cycle_record::Kept;
use fringe::pattern::Axis;
use std::collections::BTreeSet;

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
    /// Cycles that may be under way at once, at least 1.
    pub in_flight: usize,
    /// Whether a stage writes a recording.
    pub record: bool,
    /// Whether the supervisor watches frames, phases and the fused cloud for its report.
    pub watch: bool,
    /// Which bytes the supervisor keeps in a cycle record.
    pub kept: Kept,
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

/// Axes whose phases of a camera and a projector somebody takes.
pub fn axes_taken(graph: &Graph, camera: usize, projector: usize) -> Vec<Axis> {
    let takers = graph.pairs.iter().filter(|p| p.projector == projector && p.cameras().contains(&camera));
    let axes: BTreeSet<Axis> = takers.flat_map(|p| p.axes(&graph.projectors[projector])).collect();
    axes.into_iter().collect()
}
