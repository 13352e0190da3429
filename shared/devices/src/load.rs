//! From the file of a configuration to a cell whose devices are known.

use crate::error::DeviceError;
use crate::genicam::missing_feature;
use crate::twin_source;
use cell::configuration::Driver;
use cell::{Cell, FrameFormat, Options, executor};
use files::config::Config;
use files::error::{FileError, Problem};
use fringe::text::is_cell_name;
use std::ops::Deref;
use std::path::Path;

/// A cell with the files that it came from.
#[derive(Debug, Clone)]
pub struct LoadedCell {
    /// The configuration with the files that it names.
    pub file: Config,
    /// The checked cell of the configuration.
    pub cell: Cell,
}

impl Deref for LoadedCell {
    type Target = Cell;

    fn deref(&self) -> &Cell {
        &self.cell
    }
}

/// Reads a configuration and plans its cell.
///
/// # Errors
/// Anything that would keep the cell from running: every setting is parsed here, before a process starts.
pub fn load(path: &Path, options: &Options) -> Result<LoadedCell, DeviceError> {
    if let Some(name) = options.cell.as_ref().filter(|name| !is_cell_name(name)) {
        return Err(DeviceError::CellName(name.clone()));
    }
    let file = Config::load(path)?;
    let formats = formats(&file)?;
    let cell = Cell::new(file.cell.clone(), formats, options)
        .map_err(|source| DeviceError::Schedule { path: path.to_owned(), source: Box::new(source) })?;
    Ok(LoadedCell { file, cell })
}

/// Builds what the stages will build, to find out before a process starts whether it can be built.
///
/// # Errors
/// Settings that a kernel refuses, cameras that make no pair, a scene that cannot be traced, a camera that this program
/// is built without.
pub fn check(cell: &LoadedCell) -> Result<(), DeviceError> {
    transports(&cell.file)?;
    let path = || cell.file.document.path.clone();
    executor::check(cell).map_err(|source| DeviceError::Cell { path: path(), source: Box::new(source) })?;
    if cell.file.twin.is_some() {
        twin_source::build(&cell.file)?;
    }
    Ok(())
}

/// Each camera is reached by a way that this program is built with.
fn transports(config: &Config) -> Result<(), FileError> {
    for (index, camera) in config.cell.cameras.iter().enumerate() {
        let missing = camera.genicam.as_ref().and_then(|genicam| missing_feature(genicam.transport));
        if let Some([problem, remedy]) = missing {
            let key = format!("camera[{index}].transport");
            return Err(config.document.fault(&key, Problem::Unsupported(problem), remedy));
        }
    }
    Ok(())
}

/// How the frames of each camera under each projector lie in memory.
fn formats(config: &Config) -> Result<Vec<Vec<Option<FrameFormat>>>, DeviceError> {
    let mut formats = Vec::new();
    for projector in &config.cell.projectors {
        let mut row = Vec::new();
        for camera in &config.cell.cameras {
            if !projector.cameras.contains(&camera.name) {
                row.push(None);
                continue;
            }
            let full_scale_dn = match camera.driver {
                Driver::Twin => {
                    let twin = config.twin.as_ref().ok_or(DeviceError::Missing("twin"))?;
                    twin.settings.full_scale_dn()
                }
                Driver::Genicam | Driver::Network | Driver::Screen | Driver::LightCrafter => {
                    camera.genicam.as_ref().map_or(255, |g| g.pixel_format.full_scale_dn())
                }
                Driver::Recording => recorded_full_scale_dn(config, &projector.name, &camera.name)?,
            };
            row.push(Some(FrameFormat::of(full_scale_dn)));
        }
        formats.push(row);
    }
    Ok(formats)
}

fn recorded_full_scale_dn(config: &Config, projector: &str, camera: &str) -> Result<u16, DeviceError> {
    let recording = config.recording.as_ref().ok_or(DeviceError::Missing("recording"))?;
    let seen = recording.recording.projector(projector).and_then(|p| p.camera(camera));
    seen.map(|c| c.full_scale_dn).ok_or_else(|| {
        DeviceError::Frame(format!("the recording has no frames of \"{camera}\" under \"{projector}\""))
    })
}
