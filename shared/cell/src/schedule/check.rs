//! Whether a graph can be run at all.

use crate::error::ScheduleError;
use crate::graph::{Graph, PairNode};

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
    // A camera of some pair may also look at the projector of another one: recordings for a calibration are made so.
    let paired = |camera: &usize| graph.pairs.iter().any(|pair| pair.cameras().contains(camera));
    for projector in &graph.projectors {
        if let Some(&camera) = projector.cameras.iter().find(|camera| !paired(camera)) {
            return Err(ScheduleError::Unused {
                camera: graph.cameras[camera].name.clone(),
                projector: projector.name.clone(),
            });
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

/// Projectors that show their sequences in their own time must be done before the cycle ends.
fn check_projected(graph: &Graph) -> Result<(), ScheduleError> {
    let needed_ms = graph.acquisition_ms();
    let deadline_ms = graph.cycle_deadline_ms;
    if needed_ms.ceil() <= deadline_ms as f64 {
        return Ok(());
    }
    Err(ScheduleError::Projected { needed_ms, deadline_ms })
}

fn check_deadline(graph: &Graph) -> Result<(), ScheduleError> {
    check_projected(graph)?;
    let frames = graph.shown_frames();
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
