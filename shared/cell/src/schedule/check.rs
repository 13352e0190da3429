//! Whether a graph can be run at all.

use crate::graph::{Graph, PairNode, axes_taken};
use thiserror::Error;

/// Why a graph cannot be run.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ScheduleError {
    /// The cell has no camera, no projector or no pair.
    #[error("the cell has no {0}")]
    Empty(&'static str),
    /// A projector whose light nobody sees.
    #[error("projector \"{0}\" lights no camera; name some in its `cameras`, or remove it")]
    Unseen(String),
    /// A camera without light.
    #[error("camera \"{0}\" is in no projector's `cameras`; add it to one, or remove it")]
    Dark(String),
    /// A camera that a pair names and the cell lacks.
    #[error(
        "pair \"{pair}\" needs camera \"{camera}\", but this cell has no such [[camera]]; add the camera, or list pairs = […] without \"{pair}\""
    )]
    NoCamera {
        /// Name of the pair.
        pair: String,
        /// Name of the camera.
        camera: String,
    },
    /// A projector that a pair names and the cell lacks.
    #[error("pair \"{pair}\" needs projector \"{projector}\", but this cell has no such [[projector]]")]
    NoProjector {
        /// Name of the pair.
        pair: String,
        /// Name of the projector.
        projector: String,
    },
    /// A sequence without phase.
    #[error(
        "pair \"{pair}\" needs a phase, but the sequence of projector \"{projector}\" has no sine set; add one"
    )]
    NoPhase {
        /// Name of the pair.
        pair: String,
        /// Name of the projector.
        projector: String,
    },
    /// One end of a pair has no frames.
    #[error(
        "pair \"{pair}\" takes camera \"{camera}\", but projector \"{projector}\" lights only {lit}; add it to the projector's `cameras`"
    )]
    Gap {
        /// Name of the pair.
        pair: String,
        /// Name of the camera.
        camera: String,
        /// Name of the projector.
        projector: String,
        /// Cameras that it does light.
        lit: String,
    },
    /// Frames whose phase nobody takes.
    #[error(
        "camera \"{camera}\" looks at projector \"{projector}\", but no pair takes its phase; name a pair, or remove the camera"
    )]
    Unused {
        /// Name of the camera.
        camera: String,
        /// Name of the projector.
        projector: String,
    },
    /// The frames alone last longer than a cycle may.
    #[error(
        "{frames} frames at {rate_hz} Hz last {needed_ms} ms, the cycle must end within {deadline_ms} ms; raise limits.cycle_deadline_ms or recording.rate_hz"
    )]
    Deadline {
        /// Frames of a cycle.
        frames: usize,
        /// Frames per second of the recording.
        rate_hz: f64,
        /// Time for the frames.
        needed_ms: u64,
        /// Time of the cycle.
        deadline_ms: u64,
    },
    /// Sizes that no memory holds.
    #[error("topic \"{topic}\" would need messages of {bytes} bytes, the limit is {limit}")]
    TooLarge {
        /// Name of the topic.
        topic: String,
        /// Largest message of the topic, bytes.
        bytes: u64,
        /// Largest message allowed, bytes.
        limit: u64,
    },
}

/// Finds the first fault of a graph.
pub(super) fn check(graph: &Graph) -> Result<(), ScheduleError> {
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
