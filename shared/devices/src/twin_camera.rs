//! A camera that looks at the digital twin.

use crate::device::Camera;
use crate::error::DeviceError;
use crate::load::LoadedCell;
use crate::twin_source;
use std::collections::BTreeSet;
use twin::{PixelsMut, Renderer, Twin, View};

/// Exposure time that the exposure 1 of the twin's settings stands for, µs.
pub(crate) const NOMINAL_EXPOSURE_US: f64 = 10_000.0;

/// Traces its own view once per pose; a frame is then a look-up.
pub struct TwinCamera {
    name: String,
    twin: Twin,
    /// Projectors that it sees, and the frames of their sequences.
    lamps: Vec<(usize, Renderer)>,
    lamp_names: Vec<String>,
    view: Option<View>,
    is_8bit: bool,
}

impl TwinCamera {
    /// Builds the twin of one camera.
    pub fn new(cell: &LoadedCell, camera: usize) -> Result<Self, DeviceError> {
        let config = &cell.config;
        let twin = twin_source::build(&cell.file)?;
        let lit = cell.graph.projectors.iter().enumerate().filter(|(_, p)| p.cameras.contains(&camera));
        let lamps = lit
            .map(|(number, p)| {
                let shown = &config.projectors[number];
                let table = shown.level_table.as_ref();
                let mut renderer = twin.corrected_renderer(&p.name, &shown.sequence, table)?;
                for other in cell.graph.beside(number).map(|other| &config.projectors[other]) {
                    renderer.shine_beside(&other.name, &other.sequence, other.level_table.as_ref())?;
                }
                Ok((number, renderer))
            })
            .collect::<Result<Vec<_>, DeviceError>>()?;
        // The light of projectors that shine at the same time reaches the camera, too, if it does.
        let shining: BTreeSet<usize> =
            lamps.iter().flat_map(|(number, _)| cell.graph.beside(*number).chain([*number])).collect();
        let lamp_names = shining.iter().map(|number| config.projectors[*number].name.clone()).collect();
        let is_8bit = twin.settings().full_scale_dn() <= 255;
        Ok(Self { name: config.cameras[camera].name.clone(), twin, lamps, lamp_names, view: None, is_8bit })
    }
}

impl Camera for TwinCamera {
    fn begin(&mut self, cycle: u64) -> Result<(), DeviceError> {
        if let Some(view) = &mut self.view {
            return Ok(self.twin.retrace(view, cycle)?);
        }
        let lamps: Vec<&str> = self.lamp_names.iter().map(String::as_str).collect();
        self.view = Some(self.twin.view_lit_by(&self.name, &lamps, cycle)?);
        Ok(())
    }

    fn expose(&mut self, projector: usize, frame: usize, out: &mut [u8]) -> Result<(), DeviceError> {
        let missing = |what: &str| DeviceError::Frame(what.to_owned());
        let view = self.view.as_ref().ok_or_else(|| missing("there is no part in this cycle"))?;
        let lamp = self.lamps.iter_mut().find(|(number, _)| *number == projector);
        let (_, renderer) = lamp.ok_or_else(|| missing("the camera does not see this projector"))?;
        let pixels = if self.is_8bit {
            PixelsMut::Mono8(out)
        } else {
            let unaligned = |_| missing("memory of an odd number of bytes for a frame of 16 bits");
            PixelsMut::Mono16(bytemuck::try_cast_slice_mut(out).map_err(unaligned)?)
        };
        Ok(renderer.render(view, frame, pixels)?)
    }

    fn set_exposure_us(&mut self, exposure_us: f64) -> Result<f64, DeviceError> {
        let factor = exposure_us / NOMINAL_EXPOSURE_US;
        if !(1e-4..=1e4).contains(&factor) {
            let (least, most) = (NOMINAL_EXPOSURE_US * 1e-4, NOMINAL_EXPOSURE_US * 1e4);
            let reason = format!("an exposure of {exposure_us} µs: a twin takes {least} to {most} µs");
            return Err(DeviceError::Frame(reason));
        }
        self.lamps.iter_mut().for_each(|(_, renderer)| renderer.expose(0, factor));
        Ok(exposure_us)
    }
}
