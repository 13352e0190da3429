//! The frames of a cell, one after another in one process.

use crate::device::Camera;
use crate::error::DeviceError;
use crate::load::LoadedCell;
use cell::executor::{Frames, SourceError};
use cell::schedule::Work;

/// The frames that the drivers of the cell give.
pub struct Driven<'a> {
    cell: &'a LoadedCell,
    cameras: Vec<Box<dyn Camera>>,
}

impl<'a> Driven<'a> {
    /// Opens the drivers.
    ///
    /// # Errors
    /// A driver that does not open.
    pub fn new(cell: &'a LoadedCell) -> Result<Self, DeviceError> {
        let cameras = (0..cell.graph.cameras.len()).map(|number| crate::camera(cell, number));
        Ok(Self { cell, cameras: cameras.collect::<Result<_, _>>()? })
    }

    /// A cycle starts.
    ///
    /// # Errors
    /// There is none with this number.
    pub fn begin(&mut self, cycle: u64) -> Result<(), DeviceError> {
        self.cameras.iter_mut().try_for_each(|camera| camera.begin(cycle))
    }
}

impl Frames for Driven<'_> {
    fn expose(&mut self, activation: usize, out: &mut [u8]) -> Result<(), SourceError> {
        match self.cell.schedule.activations[activation].work {
            Work::Expose { camera, projector, frame } => {
                Ok(self.cameras[camera].expose(projector, frame, out)?)
            }
            other => Err(format!("{other:?} is no exposure").into()),
        }
    }
}
