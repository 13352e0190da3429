//! A cell: a checked configuration with the graph and the schedule that follow from it.

use crate::configuration::Configuration;
use crate::error::{CellError, ScheduleError};
use crate::frame_format::FrameFormat;
use crate::graph::Graph;
use crate::options::Options;
use crate::schedule::Schedule;

/// A configuration with everything that follows from it.
#[derive(Debug, Clone)]
pub struct Cell {
    /// Name, which an option may have replaced; on a host of several, with its name behind it.
    pub name: String,
    /// Name without that of the host: the same on all hosts.
    pub shared_name: String,
    /// What the cell is.
    pub config: Configuration,
    /// What the schedule was made from.
    pub graph: Graph,
    /// The plan of a cycle.
    pub schedule: Schedule,
    /// How frames lie in memory: by projector and camera; absent where the camera takes no frames of the projector.
    pub formats: Vec<Vec<Option<FrameFormat>>>,
}

impl Cell {
    /// Plans the cell of a configuration.
    ///
    /// # Errors
    /// The first gap, excess or deadline that cannot be met.
    pub fn new(
        config: Configuration,
        formats: Vec<Vec<Option<FrameFormat>>>,
        options: &Options,
    ) -> Result<Self, ScheduleError> {
        let graph = Graph::new(&config, options)?;
        let schedule = Schedule::new(&graph)?;
        let shared_name = options.cell.clone().unwrap_or_else(|| config.name.clone());
        let name = match &options.host {
            Some(host) => format!("{shared_name}-{host}"),
            None => shared_name.clone(),
        };
        Ok(Self { name, shared_name, config, graph, schedule, formats })
    }

    /// How the frames of a camera under a projector lie in memory.
    ///
    /// # Errors
    /// The camera takes no frames of the projector.
    pub fn format(&self, projector: usize, camera: usize) -> Result<FrameFormat, CellError> {
        let format = self.formats.get(projector).and_then(|cameras| cameras.get(camera).copied().flatten());
        format.ok_or_else(|| CellError::NotSeen {
            camera: self.graph.camera_name(camera).to_owned(),
            projector: self.graph.projector_name(projector).to_owned(),
        })
    }
}
