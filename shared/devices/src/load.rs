//! From the file of a configuration to a cell whose devices are known.

use crate::error::DeviceError;
use crate::twin_source;
use cell::{Cell, FrameFormat, Options};
use files::config::{Config, Driver};
use std::path::Path;

/// Reads a configuration and plans its cell.
///
/// # Errors
/// Anything that would keep the cell from running: every setting is parsed here, before a process starts.
pub fn load(path: &Path, options: &Options) -> Result<Cell, DeviceError> {
    let config = Config::load(path)?;
    let formats = formats(&config)?;
    Ok(Cell::new(config, formats, options)?)
}

/// Builds what the stages will build, to find out before a process starts whether it can be built.
///
/// # Errors
/// Settings that a kernel refuses, cameras that make no pair, a scene that cannot be traced.
pub fn check(cell: &Cell) -> Result<(), DeviceError> {
    cell::kernels::check(cell)?;
    if cell.config.twin.is_some() {
        twin_source::build(&cell.config)?;
    }
    Ok(())
}

/// How the frames of each camera under each projector lie in memory.
fn formats(config: &Config) -> Result<Vec<Vec<Option<FrameFormat>>>, DeviceError> {
    let twin = config.twin.as_ref().map(|_| twin_source::settings(config)).transpose()?;
    let mut formats = Vec::new();
    for projector in &config.projectors {
        let mut row = Vec::new();
        for camera in &config.cameras {
            if !projector.cameras.contains(&camera.name) {
                row.push(None);
                continue;
            }
            let full_scale_dn = match camera.driver {
                Driver::Twin => twin.as_ref().ok_or(DeviceError::Missing("twin"))?.full_scale_dn(),
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
