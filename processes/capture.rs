//! The capture process of one camera: exposes on a trigger, straight into shared memory.

use crate::stage::{Fault, Inbox, Report, StageArgs, StageContext, TextBuffer, Worker, cycle_fault};
use anyhow::Result;
use cell::FrameFormat;
use cell::cycle_number::unwire;
use cell::schedule::Work;
use devices::{Camera, CameraState};
use ipc::IpcError;
use ipc::header::{Frame, Trigger};
use ipc::os::now_ns;
use ipc::output_hash;
use ipc::port::Publisher;

/// What the camera needs of one projector.
struct Light {
    projector: usize,
    frames: usize,
    format: FrameFormat,
    triggers: Inbox<Trigger>,
    next: usize,
}

/// State of a capture.
pub struct Capture {
    camera: usize,
    width_px: u32,
    height_px: u32,
    driver: Box<dyn Camera>,
    lights: Vec<Light>,
    frames: Publisher<Frame>,
    exposed: Publisher<Trigger>,
    text: TextBuffer,
}

impl Capture {
    /// Opens driver and ports.
    pub fn new(args: &StageArgs, context: &StageContext) -> Result<Self> {
        let (cell, camera) = (&context.cell, context.subject());
        let node = &cell.graph.cameras[camera];
        let lit = cell.graph.projectors.iter().enumerate().filter(|(_, p)| p.cameras.contains(&camera));
        let lights = lit.map(|(projector, p)| {
            Ok(Light {
                projector,
                frames: p.frames,
                format: cell.format(projector, camera)?,
                triggers: Inbox::subscribe(context, &format!("trigger/{}", p.name))?,
                next: 0,
            })
        });
        Ok(Self {
            camera,
            width_px: node.width_px,
            height_px: node.height_px,
            lights: lights.collect::<Result<_>>()?,
            driver: devices::camera_of(cell, camera, args.frames.as_deref())?,
            frames: context.publisher(&format!("frame/{}", node.name))?,
            exposed: context.publisher("exposed")?,
            text: TextBuffer::new(),
        })
    }

    fn expose(&mut self, context: &mut StageContext, light: usize, trigger: Trigger) -> Result<(), Fault> {
        let light = &mut self.lights[light];
        let (projector, frame, frames) = (light.projector, light.next, light.frames);
        if (trigger.projector as usize, trigger.frame as usize) != (projector, frame) || frame >= light.frames
        {
            return Err(Fault::Cycle(format!(
                "a trigger for frame {} of projector \"{}\" came where frame {} of projector \"{}\" was due",
                u64::from(trigger.frame) + 1,
                context.cell.graph.projector_name(trigger.projector as usize),
                frame + 1,
                context.cell.graph.projector_name(projector)
            )));
        }
        light.next += 1;
        let start_ns = now_ns();
        let mut loan = self.frames.loan(Frame {
            cycle: context.cycle(),
            camera: self.camera as u32,
            projector: projector as u32,
            frame: frame as u32,
            width_px: self.width_px,
            height_px: self.height_px,
            bytes_per_px: light.format.bytes_per_px,
            full_scale_dn: light.format.full_scale_dn.into(),
            ..Frame::default()
        })?;
        self.driver.expose(projector, frame, loan.payload_mut()).map_err(|e| cycle_fault(&e))?;
        let t_ns = now_ns();
        loan.header_mut().t_ns = t_ns;
        let output = (loan.payload().len(), output_hash(loan.payload()));
        loan.header_mut().set_hash(output.1);
        context.sending(|| loan.send())?;
        let exposed = Trigger { t_ns, camera: self.camera as u32, ..trigger };
        context.sending(|| self.exposed.send(exposed, &[]))?;
        let work = Work::Expose { camera: self.camera, projector, frame };
        // After its last frame a camera has time to tell its temperature.
        let state = if frame + 1 == frames { self.driver.state() } else { CameraState::default() };
        let text = if state == CameraState::default() { "" } else { self.text.json(&state)? };
        context.done_hashed(work, start_ns, output, Report { count: 0, text })
    }
}

impl Worker for Capture {
    fn connect(&mut self) -> Result<(), IpcError> {
        self.lights.iter_mut().try_for_each(|light| light.triggers.connect())
    }

    fn begin(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        self.forget();
        let cycle = unwire(context.cycle()).unwrap_or_default();
        self.driver.begin(cycle).map_err(|e| cycle_fault(&e))?;
        // The twin traced the new pose: in a real cell a gripper did that, and nobody counts it as waiting.
        context.reset_counters();
        Ok(())
    }

    fn step(&mut self, context: &mut StageContext) -> Result<bool, Fault> {
        for light in 0..self.lights.len() {
            let Light { projector, next: frame, frames, .. } = self.lights[light];
            // One trigger too many is taken, to be refused.
            if frame < frames && !context.may_start(Work::Expose { camera: self.camera, projector, frame }) {
                continue;
            }
            if let Some(trigger) = self.lights[light].triggers.take(context)? {
                let header = *trigger.header();
                drop(trigger);
                self.expose(context, light, header)?;
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn forget(&mut self) {
        for light in &mut self.lights {
            light.next = 0;
        }
    }
}
