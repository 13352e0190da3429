//! The stages and the order of their work.

use super::parts::{Activation, Kind, Stage, Topic, Work};
use crate::graph::{Graph, axes_taken};
use std::collections::BTreeMap;

/// A camera's capture and decode share a core: its frames then stay in that core's cache.
pub(super) fn stages(graph: &Graph) -> Vec<Stage> {
    let stage = |kind: Kind, subject: usize, of: Option<&str>, core: usize| Stage {
        kind,
        subject,
        name: of.map_or_else(|| kind.word().to_owned(), |of| format!("{}/{of}", kind.word())),
        core: core % graph.cores,
    };
    let cameras = || graph.cameras.iter().enumerate().filter(|(i, _)| graph.has_camera(*i));
    let pairs = graph.pairs.iter().enumerate().filter(|(i, _)| graph.has_pair(*i));
    let mut stages = vec![stage(Kind::Projection, 0, None, 0)];
    for kind in [Kind::Capture, Kind::Decode] {
        stages.extend(cameras().map(|(i, c)| stage(kind, i, Some(&c.name), i)));
    }
    stages.extend(pairs.map(|(i, p)| stage(Kind::Matching, i, Some(&p.name), i)));
    if graph.leads() {
        stages.push(stage(Kind::Fusion, 0, None, 0));
        stages.push(stage(Kind::Inspection, 0, None, 0));
    }
    if graph.here.is_some() {
        stages.push(Stage { core: graph.cores, ..stage(Kind::Link, 0, None, 0) });
    }
    if graph.record {
        stages.push(stage(Kind::Record, 0, None, 1));
    }
    stages
}

/// All work of a cycle, numbered in the order of time.
pub(super) fn activations(graph: &Graph, stages: &[Stage], topics: &[Topic]) -> Vec<Activation> {
    Planner { graph, stages, topics, activations: Vec::new() }.plan()
}

/// Numbers the work in the order of time.
struct Planner<'a> {
    graph: &'a Graph,
    stages: &'a [Stage],
    topics: &'a [Topic],
    activations: Vec<Activation>,
}

impl Planner<'_> {
    fn plan(mut self) -> Vec<Activation> {
        // What is planned of each pair's cloud last, by the pair.
        let mut clouds = BTreeMap::new();
        let mut before = None;
        let graph = self.graph;
        for (number, group) in graph.groups.iter().enumerate() {
            let frames = |projector: usize| graph.projectors[projector].frames;
            let here = group.iter().filter(|&&projector| graph.has_projector(projector));
            let frames: Vec<(usize, usize)> = here.map(|p| (*p, frames(*p))).collect();
            // The last exposures of each projector of the group, by its place in it.
            let mut exposed: Vec<Vec<usize>> = vec![Vec::new(); group.len()];
            for frame in 0..frames.iter().map(|(_, frames)| *frames).max().unwrap_or(0) {
                let showing = || frames.iter().enumerate().filter(|(_, (_, frames))| frame < *frames);
                let shown: Vec<usize> =
                    showing().map(|(_, (p, _))| self.show(*p, frame, before.clone())).collect();
                // While a pattern is being exposed, the frame before it is summed.
                for (place, (p, _)) in showing() {
                    self.sum(*p, frame.checked_sub(1), &exposed[place]);
                }
                for (place, (p, _)) in showing() {
                    exposed[place] = self.expose(*p, frame, &shown);
                }
                before = Some(showing().flat_map(|(place, _)| exposed[place].clone()).collect());
            }
            for (place, (p, frames)) in frames.iter().enumerate() {
                let sums = self.sum(*p, frames.checked_sub(1), &exposed[place]);
                clouds.extend(self.evaluate(*p, &sums));
            }
            if number + 1 < graph.groups.len() && graph.leads() {
                self.take(&mut clouds);
            }
        }
        if self.graph.leads() {
            clouds.extend(self.remote(before));
            let clouds = clouds.into_values().collect();
            let fused = self.add(Kind::Fusion, 0, Work::Fuse, clouds, "cloud/fused");
            self.add(Kind::Inspection, 0, Work::Inspect, vec![fused], "result");
        } else {
            self.add(Kind::Link, 0, Work::HandOver, before.unwrap_or_default(), "");
            self.add(Kind::Link, 0, Work::Deliver, clouds.into_values().collect(), "result");
        }
        if self.graph.record {
            let exposed = |a: &Activation| matches!(a.work, Work::Expose { .. });
            let frames = (0..self.activations.len()).filter(|&i| exposed(&self.activations[i])).collect();
            self.add(Kind::Record, 0, Work::Store, frames, "");
        }
        self.activations
    }

    /// While other projectors show, fusion takes the clouds that are there, in the order of the pairs.
    fn take(&mut self, clouds: &mut BTreeMap<usize, usize>) {
        for (pair, (_, planned)) in clouds.iter_mut().enumerate().take_while(|(pair, (of, _))| pair == *of) {
            if matches!(self.activations[*planned].work, Work::Match { .. }) {
                *planned = self.add(Kind::Fusion, 0, Work::Take { pair }, vec![*planned], "");
            }
        }
    }

    /// The other hosts take their frames one after another, because their light may meet; then their clouds come.
    fn remote(&mut self, mut before: Option<Vec<usize>>) -> Vec<(usize, usize)> {
        let graph = self.graph;
        let mut measured = Vec::new();
        for host in graph.led() {
            let taken = self.add(Kind::Link, 0, Work::Remote { host }, before.unwrap_or_default(), "");
            measured.push((host, taken));
            before = Some(vec![taken]);
        }
        let mut clouds = Vec::new();
        for (host, taken) in measured {
            for &pair in &graph.hosts[host].pairs {
                let topic = format!("cloud/{}", graph.pairs[pair].name);
                clouds.push((pair, self.add(Kind::Link, 0, Work::Receive { pair }, vec![taken], &topic)));
            }
        }
        clouds
    }

    /// The patterns of a group stand until all its cameras have exposed; the next ones wait for that.
    fn show(&mut self, projector: usize, frame: usize, before: Option<Vec<usize>>) -> usize {
        let trigger = format!("trigger/{}", self.graph.projectors[projector].name);
        let work = Work::Project { projector, frame };
        self.add(Kind::Projection, 0, work, before.unwrap_or_default(), &trigger)
    }

    /// Cameras expose when all projectors of the group show.
    fn expose(&mut self, projector: usize, frame: usize, shown: &[usize]) -> Vec<usize> {
        let graph = self.graph;
        let expose = |&camera: &usize| {
            let topic = format!("frame/{}", graph.cameras[camera].name);
            let work = Work::Expose { camera, projector, frame };
            self.add(Kind::Capture, camera, work, shown.to_vec(), &topic)
        };
        graph.projectors[projector].cameras.iter().map(expose).collect()
    }

    fn sum(&mut self, projector: usize, frame: Option<usize>, exposed: &[usize]) -> Vec<usize> {
        let (graph, Some(frame)) = (self.graph, frame) else { return Vec::new() };
        let sum = |(&camera, &exposed): (&usize, &usize)| {
            let work = Work::Accumulate { camera, projector, frame };
            self.add(Kind::Decode, camera, work, vec![exposed], "")
        };
        graph.projectors[projector].cameras.iter().zip(exposed).map(sum).collect()
    }

    /// After the last frame of a projector: phases, then the pairs that share it, each with its work.
    fn evaluate(&mut self, projector: usize, sums: &[usize]) -> Vec<(usize, usize)> {
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
            clouds.push((
                number,
                self.add(Kind::Matching, number, Work::Match { pair: number }, inputs, &topic),
            ));
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
