//! The decode process of one camera: takes frames as they land, gives absolute phase.

use crate::stage::{Fault, Inbox, Report, StageContext, TextBuffer, Worker, cycle_fault};
use anyhow::Result;
use cell::executor::{ViewDecoder, decoder};
use cell::schedule::{Work, label};
use fringe::decode::{CodeShift, DecodeReport, Fault as FrameFault, FrameOrder, Motion};
use fringe::pattern::Axis;
use ipc::IpcError;
use ipc::header::{Frame, Phase};
use ipc::os::now_ns;
use ipc::output_hash;
use ipc::payload;
use ipc::port::{Publisher, Received};

/// Light that changes by less than this part of itself is no matter of the result.
const TOLD_FLICKER: f64 = 0.05;

/// The decoder of one projector.
struct Light {
    projector: usize,
    decoder: ViewDecoder,
    /// End of the last exposure that went in, ns.
    t_ns: u64,
}

/// State of a decode stage.
pub struct Decode {
    camera: usize,
    lights: Vec<Light>,
    frames: Inbox<Frame>,
    /// A frame that was found when the one before it was checked to be the only one; its turn comes later.
    ahead: Option<Received<Frame>>,
    phases: Publisher<Phase>,
    /// All work of a cycle, in the order of the schedule, with the number of its light.
    works: Vec<(usize, Work)>,
    /// How much of it is done.
    next: usize,
    text: TextBuffer,
}

/// What the report of a phase map states: pixels by what became of them.
#[derive(serde::Serialize)]
struct Counts<'a> {
    valid: usize,
    saturated: usize,
    dark: usize,
    noisy: usize,
    ambiguous: usize,
    resolved: usize,
    spikes_repaired: usize,
    spikes_masked: usize,
    /// Pixels whose uncertainty was raised since light from other faces falls on them, and those that it masked.
    bounce_raised: usize,
    bounce_masked: usize,
    /// Blur that was removed, px; null where none was found.
    footprint_px: Option<f64>,
    /// Whether that is of any lens in focus, since nothing shows it.
    footprint_assumed: bool,
    /// By how much its variance differs from what was removed, px², where the frames contradict the rig file, or settings do, or nothing was removed.
    #[serde(skip_serializing_if = "Option::is_none")]
    footprint_off_px2: Option<f64>,
    ignored: &'a [String],
    /// Faults of the frames, in words.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    findings: Vec<String>,
    /// What the frames proved of their order.
    order: FrameOrder,
    /// How the fringes moved between the frames; null where the steps do not tell.
    motion: Option<Motion>,
    /// How far the frames of the code stand from the fringes; null where they do not tell.
    code_shift: Option<CodeShift>,
    /// Where the frames contradict what the rig file states of the camera, motion beyond the uncertainty, and faults of frames.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
}

impl Decode {
    /// Allocates the decoders and opens the ports.
    pub fn new(context: &StageContext) -> Result<Self> {
        let (cell, camera) = (&context.cell, context.subject());
        let lit = cell.graph.projectors.iter().enumerate().filter(|(_, p)| p.cameras.contains(&camera));
        let lights = lit.map(|(projector, _)| {
            Ok(Light { projector, decoder: decoder(cell, projector, camera)?, t_ns: 0 })
        });
        let name = &cell.graph.cameras[camera].name;
        let lights = lights.collect::<Result<Vec<_>>>()?;
        let mine = cell.schedule.activations.iter().filter(|a| a.stage == context.stage);
        let works = mine.filter_map(|a| Some((light_of(&lights, a.work)?, a.work)));
        Ok(Self {
            camera,
            works: works.collect(),
            next: 0,
            lights,
            frames: Inbox::subscribe(context, &format!("frame/{name}"))?,
            ahead: None,
            phases: context.publisher(&format!("phase/{name}"))?,
            text: TextBuffer::new(),
        })
    }

    fn accumulate(&mut self, context: &mut StageContext, message: &Received<Frame>) -> Result<(), Fault> {
        let start_ns = now_ns();
        let header = message.header();
        let (camera, projector, frame) =
            (header.camera as usize, header.projector as usize, header.frame as usize);
        let work = Work::Accumulate { camera, projector, frame };
        let Some(&(light, _)) = self.works.get(self.next).filter(|(_, due)| *due == work) else {
            let due = self.works.get(self.next).map(|(_, due)| label(&context.cell.graph, *due));
            let came = context.cell.graph.frame_name(camera, projector, frame);
            return Err(Fault::Cycle(format!(
                "{came} came where \"{}\" was due",
                due.as_deref().unwrap_or("nothing")
            )));
        };
        let view = payload::frame(header, message.payload()).map_err(|e| cycle_fault(&e))?;
        payload::check_pixels(header, message.payload()).map_err(|e| {
            Fault::Cycle(format!("frame {frame:03} of {}: {e}", context.cell.graph.cameras[camera].name))
        })?;
        let lit = &mut self.lights[light];
        lit.decoder.push(frame, &view).map_err(|e| cycle_fault(&e))?;
        lit.t_ns = header.t_ns;
        self.next += 1;
        context.done(work, start_ns, &[], Report::default())
    }

    /// Before a phase is made of sums: the last frame must not have come twice. With it done, its true message has been
    /// seen, so what follows is of the next projector, or too much.
    fn check_complete(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        if self.ahead.is_none() {
            self.ahead = self.frames.take(context)?;
        }
        self.frames.check_not_overtaken(context)?;
        let Some(header) = self.ahead.as_ref().map(Received::header) else { return Ok(()) };
        let came = (header.projector as usize, header.frame as usize);
        let mut sums = self.works.iter().skip(self.next).filter_map(|(_, work)| match *work {
            Work::Accumulate { projector, frame, .. } => Some((projector, frame)),
            _ => None,
        });
        if sums.next() == Some(came) {
            return Ok(());
        }
        let (projector, frame) = came;
        let came = context.cell.graph.frame_name(self.camera, projector, frame);
        Err(Fault::Cycle(format!("{came} came twice or out of place")))
    }

    fn finish(&mut self, context: &mut StageContext, light: usize, axis: Axis) -> Result<(), Fault> {
        let start_ns = now_ns();
        self.next += 1;
        let light = &mut self.lights[light];
        let info = light.decoder.info(axis).map_err(|e| cycle_fault(&e))?;
        let header = Phase {
            cycle: context.cycle(),
            t_ns: light.t_ns,
            period_px: info.period_px,
            camera: self.camera as u32,
            projector: light.projector as u32,
            axis: Phase::axis_number(axis),
            width_px: info.width_px,
            height_px: info.height_px,
            valid_count: 0,
        };
        let mut loan = self.phases.loan(header)?;
        let mut map = payload::phase_mut(&header, loan.payload_mut()).map_err(|e| cycle_fault(&e))?;
        let report = light.decoder.finish(axis, &mut map).map_err(|e| cycle_fault(&e))?;
        loan.header_mut().valid_count = report.valid as u32;
        let output = (loan.payload().len(), output_hash(loan.payload()));
        context.sending(|| loan.send())?;
        let text = self.text.json(&Counts {
            valid: report.valid,
            saturated: report.saturated,
            dark: report.dark,
            noisy: report.noisy,
            ambiguous: report.ambiguous,
            resolved: report.resolved,
            spikes_repaired: report.spikes_repaired,
            spikes_masked: report.spikes_masked,
            bounce_raised: report.bounced.raised,
            bounce_masked: report.bounced.masked,
            footprint_px: report.footprint_px,
            footprint_assumed: report.footprint_assumed,
            footprint_off_px2: report.footprint_off_px2(),
            ignored: &report.ignored,
            order: report.order,
            motion: report.motion,
            code_shift: report.code_shift,
            findings: report.findings.iter().map(ToString::to_string).collect(),
            warnings: warnings(&report, context.cell.graph.camera_name(self.camera)),
        })?;
        let work = Work::Phase { camera: self.camera, projector: light.projector, axis };
        context.done_hashed(work, start_ns, output, Report { count: report.valid, text })
    }
}

/// What stands beside the verdict: what was made up for as well, for it says that something is wrong with light, part or camera.
fn warnings(report: &DecodeReport, camera: &str) -> Vec<String> {
    let mut all = report.warnings(camera);
    all.extend(report.findings.iter().filter_map(|found| match found.fault {
        FrameFault::Flicker(part) if part < TOLD_FLICKER => None,
        FrameFault::Flicker(_) => Some(format!(
            "camera \"{camera}\": {found}; the lamp is not steady, or the part or the camera moved between the frames: measure again"
        )),
        _ => Some(format!("camera \"{camera}\": {found}")),
    }));
    all
}

fn light_of(lights: &[Light], work: Work) -> Option<usize> {
    match work {
        Work::Accumulate { projector, .. } | Work::Phase { projector, .. } => {
            lights.iter().position(|light| light.projector == projector)
        }
        _ => None,
    }
}

impl Worker for Decode {
    fn connect(&mut self) -> Result<(), IpcError> {
        self.frames.connect()
    }

    fn begin(&mut self, _context: &mut StageContext) -> Result<(), Fault> {
        self.forget();
        Ok(())
    }

    fn step(&mut self, context: &mut StageContext) -> Result<bool, Fault> {
        let due = self.works.get(self.next).copied();
        if due.is_some_and(|(_, work)| !context.may_start(work)) {
            return Ok(false);
        }
        if let Some((light, Work::Phase { axis, .. })) = due {
            self.check_complete(context)?;
            return self.finish(context, light, axis).map(|()| true);
        }
        let ahead = self.ahead.take();
        let next = if ahead.is_some() { ahead } else { self.frames.take(context)? };
        match next {
            Some(message) => self.accumulate(context, &message).map(|()| true),
            None => Ok(false),
        }
    }

    fn forget(&mut self) {
        self.next = 0;
        self.ahead = None;
        for light in &mut self.lights {
            light.decoder.begin();
        }
    }
}
