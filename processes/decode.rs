//! The decode process of one camera: takes frames as they land, gives absolute phase.

use crate::kernels::decoder;
use crate::schedule::{Work, axes_taken};
use crate::stage::{Fault, Inbox, Link, Report, Worker, lost};
use anyhow::Result;
use fringe::decode::Decoder;
use fringe::pattern::Axis;
use ipc::IpcError;
use ipc::header::{Frame, Phase};
use ipc::os::now_ns;
use ipc::payload;
use ipc::port::{Publisher, Received};
use serde_json::json;
use xxhash_rust::xxh3::xxh3_128;

/// The decoder of one projector.
struct Light {
    projector: usize,
    decoder: Decoder,
    axes: Vec<Axis>,
    /// End of the last exposure that went in, ns.
    t_ns: u64,
}

/// State of a decode stage.
pub struct Decode {
    camera: usize,
    lights: Vec<Light>,
    frames: Inbox<Frame>,
    phases: Publisher<Phase>,
}

impl Decode {
    /// Allocates the decoders and opens the ports.
    pub fn new(link: &Link) -> Result<Self> {
        let (cell, camera) = (&link.cell, link.subject());
        let lit = cell.graph.projectors.iter().enumerate().filter(|(_, p)| p.cameras.contains(&camera));
        let lights = lit.map(|(projector, _)| {
            let decoder = decoder(cell, projector, camera)?;
            Ok(Light { projector, decoder, axes: axes_taken(&cell.graph, camera, projector), t_ns: 0 })
        });
        let name = &cell.graph.cameras[camera].name;
        Ok(Self {
            camera,
            lights: lights.collect::<Result<_>>()?,
            frames: link.inbox(&format!("frame/{name}"))?,
            phases: link.publisher(&format!("phase/{name}"))?,
        })
    }

    fn accumulate(&mut self, link: &mut Link, message: &Received<Frame>) -> Result<(), Fault> {
        let start_ns = now_ns();
        let header = message.header();
        let projector = header.projector as usize;
        let light = self.lights.iter_mut().position(|l| l.projector == projector);
        let Some(light) = light.filter(|_| header.camera as usize == self.camera) else {
            return Err(Fault::Cycle(format!(
                "a frame of camera {} under projector {} is not for this stage",
                header.camera, header.projector
            )));
        };
        let frame = header.frame as usize;
        let view = payload::frame(header, message.payload()).map_err(|e| lost(&e))?;
        let lit = &mut self.lights[light];
        lit.decoder.push(frame, &view).map_err(|e| lost(&e))?;
        lit.t_ns = header.t_ns;
        let last = frame + 1 == lit.decoder.frames();
        let work = Work::Accumulate { camera: self.camera, projector, frame };
        link.done(work, start_ns, &[], &Report::default())?;
        if last {
            for axis in self.lights[light].axes.clone() {
                self.finish(link, light, axis)?;
            }
        }
        Ok(())
    }

    fn finish(&mut self, link: &mut Link, light: usize, axis: Axis) -> Result<(), Fault> {
        let start_ns = now_ns();
        let light = &mut self.lights[light];
        let info = light.decoder.info(axis).map_err(|e| lost(&e))?;
        let header = Phase {
            cycle: link.cycle(),
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
        let mut map = payload::phase_mut(&header, loan.payload_mut()).map_err(|e| lost(&e))?;
        let report = light.decoder.finish(axis, &mut map).map_err(|e| lost(&e))?;
        loan.header_mut().valid_count = report.valid as u32;
        let output = (loan.payload().len(), xxh3_128(loan.payload()));
        loan.send()?;
        let text = json!({
            "valid": report.valid, "saturated": report.saturated, "dark": report.dark, "noisy": report.noisy,
            "ambiguous": report.ambiguous, "resolved": report.resolved,
            "spikes_repaired": report.spikes_repaired, "spikes_masked": report.spikes_masked,
            "ignored": &report.ignored[..],
        });
        let work = Work::Phase { camera: self.camera, projector: light.projector, axis };
        link.done_hashed(work, start_ns, output, &Report { count: report.valid, text: text.to_string() })
    }
}

impl Worker for Decode {
    fn connect(&self) -> Result<(), IpcError> {
        self.frames.connect()
    }

    fn begin(&mut self, _link: &mut Link) -> Result<(), Fault> {
        self.forget();
        Ok(())
    }

    fn step(&mut self, link: &mut Link) -> Result<bool, Fault> {
        match self.frames.take(link)? {
            Some(message) => self.accumulate(link, &message).map(|()| true),
            None => Ok(false),
        }
    }

    fn forget(&mut self) {
        for light in &mut self.lights {
            light.decoder.begin();
        }
    }
}
