//! Registered drivers: which type drives a camera or a projector of the configuration.

use crate::device::{Camera, Projector};
use crate::error::DeviceError;
use crate::genicam::WantedCamera;
use crate::load::LoadedCell;
use crate::local_projectors::LocalProjectors;
use crate::{network_projector, reconnecting, recording, twin_camera};
use cell::configuration::{Driver, ProjectorConfig, TriggerMode};

/// Opens the camera of a capture stage with the driver of its configuration.
///
/// # Errors
/// A driver that does not open.
pub fn camera(cell: &LoadedCell, camera: usize) -> Result<Box<dyn Camera>, DeviceError> {
    let config = &cell.config.cameras[camera];
    Ok(match config.driver {
        Driver::Twin => Box::new(twin_camera::TwinCamera::new(cell, camera)?),
        Driver::Recording => Box::new(recording::RecordedCamera::new(cell, camera)?),
        // The configuration refuses cameras with the driver of a projector.
        Driver::Genicam | Driver::Network | Driver::Screen | Driver::LightCrafter => {
            let settings = config.genicam.clone().ok_or(DeviceError::Missing("camera.address"))?;
            let seen = cell.config.projectors.iter().filter(|p| p.cameras.contains(&config.name));
            // All projectors have the same trigger mode.
            let lines: Vec<&ProjectorConfig> = seen.filter(|p| p.trigger != TriggerMode::Stepped).collect();
            Box::new(reconnecting::ReconnectingCamera::new(WantedCamera {
                name: config.name.clone(),
                settings,
                size_px: [config.width_px, config.height_px],
                fired: lines.iter().map(|p| p.frames()).sum(),
            })?)
        }
    })
}

/// The projectors of the cell, of several hosts those of this one.
///
/// # Errors
/// A projector that cannot be reached.
pub fn projector(cell: &LoadedCell) -> Result<Box<dyn Projector>, DeviceError> {
    let all = &cell.config.projectors;
    let here: Vec<usize> = (0..all.len()).filter(|&number| cell.graph.has_projector(number)).collect();
    if here.len() == all.len() {
        return opened(cell, all);
    }
    let projectors: Vec<ProjectorConfig> = here.iter().map(|&number| all[number].clone()).collect();
    Ok(Box::new(OfThisHost { projectors: opened(cell, &projectors)?, here }))
}

/// The projectors of one host, under their numbers in the cell.
struct OfThisHost {
    projectors: Box<dyn Projector>,
    /// Number in the cell of each.
    here: Vec<usize>,
}

impl Projector for OfThisHost {
    fn begin(&mut self, cycle: u64, now_ns: u64) -> Result<(), DeviceError> {
        self.projectors.begin(cycle, now_ns)
    }

    fn due_ns(&self) -> Option<u64> {
        self.projectors.due_ns()
    }

    fn show(&mut self, projector: usize, frame: usize, now_ns: u64) -> Result<(), DeviceError> {
        let place = self.here.iter().position(|&number| number == projector);
        let place = place.ok_or(DeviceError::Missing("projector of this host"))?;
        self.projectors.show(place, frame, now_ns)
    }
}

fn opened(cell: &LoadedCell, projectors: &[ProjectorConfig]) -> Result<Box<dyn Projector>, DeviceError> {
    if let Some(address) = projectors.iter().find_map(|p| p.address) {
        let light = |p: &ProjectorConfig| network_projector::Light {
            name: p.name.clone(),
            frames: p.frames(),
            trigger: p.trigger,
        };
        let lights = projectors.iter().map(light).collect();
        return Ok(Box::new(network_projector::NetworkProjector::new(address, lights)?));
    }
    if projectors.iter().any(|p| matches!(p.driver, Driver::Screen | Driver::LightCrafter)) {
        return Ok(Box::new(LocalProjectors::new(projectors)?));
    }
    let rate_hz = cell.file.recording.as_ref().map_or(0.0, |r| r.rate_hz);
    // Frames of the twin and of a recording already contain the projected light; only the pace remains.
    Ok(Box::new(recording::Pace::new(rate_hz)))
}

/// Of each camera that plays a recording: its name, and one hash of all files that it will give. A process that opens the
/// camera later must find the same.
///
/// # Errors
/// A frame that cannot be read.
pub fn played_files(cell: &LoadedCell) -> Result<Vec<(String, String)>, DeviceError> {
    // The frames of other hosts are not here.
    let here = cell.config.cameras.iter().enumerate().filter(|(number, _)| cell.graph.has_camera(*number));
    let played = here.filter(|(_, c)| c.driver == Driver::Recording);
    played
        .map(|(number, c)| Ok((c.name.clone(), recording::RecordedCamera::new(cell, number)?.content())))
        .collect()
}

/// The camera of a capture stage, which must give the files that `content` is the hash of, as [`played_files`] gave it.
///
/// # Errors
/// A driver that does not open; a recording that was changed.
pub fn camera_of(
    cell: &LoadedCell,
    camera: usize,
    content: Option<&str>,
) -> Result<Box<dyn Camera>, DeviceError> {
    let config = &cell.config.cameras[camera];
    if config.driver != Driver::Recording {
        return self::camera(cell, camera);
    }
    let opened = recording::RecordedCamera::new(cell, camera)?;
    if content.is_some_and(|content| opened.content() != content) {
        return Err(DeviceError::Frame(format!(
            "the frames of camera \"{}\" in the recording have changed since the start of the cell; stop the cell and start \
             it again",
            config.name
        )));
    }
    Ok(Box::new(opened))
}
