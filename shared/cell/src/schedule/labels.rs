//! Activations in words.

use super::parts::Work;
use crate::graph::Graph;
use fringe::pattern::Axis;

/// The name of what an activation gives, as in the `hashes` of a result.
pub fn output(graph: &Graph, work: Work) -> Option<String> {
    match work {
        Work::Expose { camera, .. } => Some(format!("frame/{}", graph.cameras[camera].name)),
        Work::Phase { camera, projector, axis } => {
            let axis = if axis == Axis::X { "x" } else { "y" };
            Some(format!("phase/{}/{}/{axis}", graph.cameras[camera].name, graph.projectors[projector].name))
        }
        Work::Match { pair } | Work::Receive { pair } => Some(format!("cloud/{}", graph.pairs[pair].name)),
        Work::Fuse => Some("cloud/fused".to_owned()),
        Work::Inspect => Some("result".to_owned()),
        Work::Project { .. }
        | Work::Accumulate { .. }
        | Work::Take { .. }
        | Work::Store
        | Work::Remote { .. }
        | Work::HandOver
        | Work::Deliver => None,
    }
}

/// What an activation does: for traces, for messages and for `fringecell schedule`.
pub fn label(graph: &Graph, work: Work) -> String {
    match work {
        Work::Project { projector, frame } => {
            format!("project {} {frame:03}", graph.projectors[projector].name)
        }
        Work::Expose { projector, frame, .. } => {
            format!("expose {} {frame:03}", graph.projectors[projector].name)
        }
        Work::Accumulate { projector, frame, .. } => {
            format!("accumulate {} {frame:03}", graph.projectors[projector].name)
        }
        Work::Phase { projector, axis, .. } => {
            format!("phase {} {}", graph.projectors[projector].name, if axis == Axis::X { "x" } else { "y" })
        }
        Work::Match { pair } => format!("match {}", graph.pairs[pair].name),
        Work::Take { pair } => format!("take {}", graph.pairs[pair].name),
        Work::Fuse => "fuse".to_owned(),
        Work::Inspect => "inspect".to_owned(),
        Work::Store => "store".to_owned(),
        Work::Remote { host } => format!("frames of {}", graph.host_name(host)),
        Work::Receive { pair } => format!("receive {}", graph.pairs[pair].name),
        Work::HandOver => "hand over the light".to_owned(),
        Work::Deliver => "deliver".to_owned(),
    }
}
