//! The topics of a cell, with buffers that are just large enough.

use super::parts::{Carries, SUPERVISOR, Stage, Topic, TopicSize};
use crate::graph::{CameraNode, Graph, ProjectorNode, axes_taken};
use crate::retention::Retention;
use fringe::phase::PHASE_BYTES_PER_PX;

/// Frames that wait in front of a decoder: it may lag behind the camera by that many before the camera is held.
pub const FRAME_BUFFER: usize = 8;

/// Events that wait in front of the supervisor, per stage. A stage has at most one event per frame under way and the
/// supervisor looks every 20 ms, so 64 last for a camera of 3 kHz.
pub const EVENT_BUFFER: usize = 64;

/// Longest text of a report, bytes.
pub const REPORT_BYTES: usize = 16 * 1024;

/// Longest text of a result, bytes.
pub const RESULT_BYTES: usize = 1 << 20;

/// Commands that wait in front of a stage: start, evaluate, abort, start … while it is busy with one activation.
pub const CONTROL_BUFFER: usize = 32;

/// All topics, in the order of the flow.
pub(super) fn topics(graph: &Graph, stages: &[Stage]) -> Vec<Topic> {
    let all: Vec<String> = stages.iter().map(|s| s.name.clone()).collect();
    let supervisor = || vec![SUPERVISOR.to_owned()];
    let mut topics = vec![
        topic("control", Carries::Control, supervisor(), all.clone(), CONTROL_BUFFER, 1),
        topic("event", Carries::Event, all, supervisor(), EVENT_BUFFER, REPORT_BYTES as u64),
    ];
    let captures = |projector: &ProjectorNode| -> Vec<String> {
        projector.cameras.iter().map(|&c| format!("capture/{}", graph.cameras[c].name)).collect()
    };
    let projectors = graph.projectors.iter().enumerate().filter(|(p, _)| graph.has_projector(*p));
    let here: Vec<usize> = (0..graph.cameras.len()).filter(|&camera| graph.has_camera(camera)).collect();
    for (_, projector) in projectors {
        let name = format!("trigger/{}", projector.name);
        topics.push(topic(&name, Carries::Trigger, vec!["projection".into()], captures(projector), 4, 1));
    }
    let looking: Vec<String> = here.iter().map(|&c| format!("capture/{}", graph.cameras[c].name)).collect();
    topics.push(topic("exposed", Carries::Trigger, looking, vec!["projection".into()], 4 * here.len(), 1));
    topics.extend(here.iter().map(|&camera| frame_topic(graph, &graph.cameras[camera])));
    topics.extend(here.iter().map(|&camera| phase_topic(graph, camera)));
    topics.extend(cloud_topics(graph));
    let result = |from: &str| {
        topic("result", Carries::Outcome, vec![from.to_owned()], supervisor(), 2, RESULT_BYTES as u64)
    };
    if !graph.leads() {
        topics.push(result("link"));
        return topics;
    }
    let capacity = graph.pairs.iter().map(|pair| cloud_bytes(&graph.cameras[pair.left])).sum();
    let mut readers = vec!["inspection".to_owned()];
    readers.extend(graph.watch.then(|| SUPERVISOR.to_owned()));
    readers.extend(cycle_recorder(graph, Retention::All));
    let mut fused = topic("cloud/fused", Carries::Cloud, vec!["fusion".into()], readers, 1, capacity);
    // The supervisor holds the last good cloud and that of the running cycle while the next one comes.
    fused.size.borrowed = 3;
    topics.push(fused);
    topics.push(result("inspection"));
    topics
}

/// The clouds of the pairs of this computer, and on the host that leads those that come from others.
fn cloud_topics(graph: &Graph) -> Vec<Topic> {
    let pairs = graph.pairs.iter().enumerate().filter(|(p, _)| graph.leads() || graph.has_pair(*p));
    pairs
        .map(|(number, pair)| {
            let from = if graph.has_pair(number) { format!("matching/{}", pair.name) } else { "link".into() };
            let reader = if graph.leads() { "fusion" } else { "link" };
            let readers = [vec![reader.to_owned()], cycle_recorder(graph, Retention::All)].concat();
            let bytes = cloud_bytes(&graph.cameras[pair.left]);
            topic(&format!("cloud/{}", pair.name), Carries::Cloud, vec![from], readers, 1, bytes)
        })
        .collect()
}

/// The supervisor once more, with ports of its own, where a cycle record keeps these bytes.
fn cycle_recorder(graph: &Graph, least: Retention) -> Vec<String> {
    let keeps = graph.retention == Retention::All || graph.retention == least;
    if keeps { vec![SUPERVISOR.to_owned()] } else { Vec::new() }
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
    readers.extend(cycle_recorder(graph, Retention::Frames));
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

/// One message per projector and axis of each cycle in flight, all of which a matcher may let wait.
fn phase_topic(graph: &Graph, number: usize) -> Topic {
    let camera = &graph.cameras[number];
    let takers = graph.pairs.iter().filter(|p| p.cameras().contains(&number));
    let mut readers: Vec<String> = takers.map(|p| format!("matching/{}", p.name)).collect();
    readers.extend(graph.watch.then(|| SUPERVISOR.to_owned()));
    readers.extend(cycle_recorder(graph, Retention::All));
    let maps: usize = (0..graph.projectors.len()).map(|p| axes_taken(graph, number, p).len()).sum();
    let waiting = maps.max(1) * graph.in_flight;
    let pixels = u64::from(camera.width_px) * u64::from(camera.height_px);
    let name = format!("phase/{}", camera.name);
    let from = vec![format!("decode/{}", camera.name)];
    let mut phase = topic(&name, Carries::Phase, from, readers, waiting, pixels * PHASE_BYTES_PER_PX as u64);
    phase.size.borrowed = maps.max(1) + 1;
    phase
}

fn cloud_bytes(left: &CameraNode) -> u64 {
    u64::from(left.width_px) * u64::from(left.height_px) * size_of::<fringe::cloud::Point>() as u64
}
