//! The devices of a cell without its processes: shows patterns and takes frames, for the commands that set a cell up.

use anyhow::{Context, Result, bail};
use cell::Options;
use cell::configuration::Driver;
use devices::{Camera, LoadedCell, Projector};
use fringe::frame::FrameView;
use ipc::os::now_ns;
use std::path::Path;
use std::time::Duration;

/// Cameras and projectors of a cell, opened.
pub struct Live {
    /// The configuration with its graph.
    pub cell: LoadedCell,
    /// The cameras that were asked for, by their number in the cell.
    cameras: Vec<(usize, Box<dyn Camera>)>,
    projector: Box<dyn Projector>,
    /// A frame as it comes.
    frame: Vec<u8>,
    cycles: u64,
}

impl Live {
    /// Opens the projectors and one camera, or all of them, of a configuration.
    ///
    /// # Errors
    /// A configuration that does not load, a camera that it lacks, a device that does not open.
    pub fn open(config: &Path, camera: Option<&str>) -> Result<Self> {
        let cell = devices::load(config, &Options::default())?;
        let names: Vec<&str> = cell.config.cameras.iter().map(|camera| camera.name.as_str()).collect();
        if let Some(name) = camera.filter(|name| !names.contains(name)) {
            bail!("--camera {name}: {} has the cameras {}", config.display(), names.join(", "));
        }
        if let Some(played) = cell.config.cameras.iter().find(|camera| camera.driver == Driver::Recording) {
            bail!(
                "{}: camera \"{}\" plays a recording; this command needs cameras, or twins",
                config.display(),
                played.name
            );
        }
        let chosen =
            names.iter().enumerate().filter(|(_, name)| camera.is_none_or(|camera| camera == **name));
        let cameras = chosen.map(|(number, _)| Ok((number, devices::camera(&cell, number)?)));
        let cameras = cameras.collect::<Result<Vec<_>>>()?;
        let projector = devices::projector(&cell)?;
        Ok(Self { cell, cameras, projector, frame: Vec::new(), cycles: 0 })
    }

    /// Numbers and names of the opened cameras.
    pub fn cameras(&self) -> Vec<(usize, String)> {
        self.cameras
            .iter()
            .map(|(number, _)| (*number, self.cell.config.cameras[*number].name.clone()))
            .collect()
    }

    /// Sets the exposure time of a camera; the time that it took, µs.
    ///
    /// # Errors
    /// The camera refuses.
    pub fn set_exposure_us(&mut self, camera: usize, exposure_us: f64) -> Result<f64> {
        let opened = self.cameras.iter_mut().find(|(number, _)| *number == camera);
        let (_, opened) = opened.context("this camera is not open")?;
        Ok(opened.set_exposure_us(exposure_us)?)
    }

    /// Shows the first `frames` patterns of a projector and gives each frame of each opened camera that looks at it to `take`: number
    /// of the camera, of the frame, and the frame.
    ///
    /// # Errors
    /// A device that fails, or what `take` states.
    pub fn show(
        &mut self,
        projector: usize,
        frames: std::ops::Range<usize>,
        mut take: impl FnMut(usize, usize, FrameView<'_>) -> Result<()>,
    ) -> Result<()> {
        self.projector.begin(self.cycles, now_ns())?;
        for (_, camera) in &mut self.cameras {
            camera.begin(self.cycles)?;
        }
        self.cycles += 1;
        let node = self.cell.graph.projectors[projector].clone();
        // A projector that runs by itself shows all of its sequence.
        let sequenced = node.trigger.name() == "sequenced";
        let shown = if sequenced { 0..node.frames } else { frames.clone() };
        for number in shown {
            while let Some(due) = self.projector.due_ns().filter(|due| *due > now_ns()) {
                std::thread::sleep(Duration::from_nanos(due.saturating_sub(now_ns())));
            }
            self.projector.show(projector, number, now_ns())?;
            for (camera, opened) in
                self.cameras.iter_mut().filter(|(camera, _)| node.cameras.contains(camera))
            {
                let format = self.cell.cell.format(projector, *camera)?;
                let size = &self.cell.graph.cameras[*camera];
                let pixels = size.width_px as usize * size.height_px as usize;
                self.frame.resize(pixels * format.bytes_per_px as usize, 0);
                opened.expose(projector, number, &mut self.frame)?;
                if frames.contains(&number) {
                    let view = FrameView::from_bytes(
                        size.width_px,
                        size.height_px,
                        format.full_scale_dn,
                        &self.frame,
                    );
                    take(*camera, number, view.context("a frame of another size than its camera")?)?;
                }
            }
        }
        Ok(())
    }
}
