//! The record stage: writes the frames of the cameras as a recording.

use crate::stage::{Fault, Inbox, Report, StageArgs, StageContext, Worker, cycle_fault};
use anyhow::{Context, Result};
use cell::cycle_number::unwire;
use cell::schedule::Work;
use files::recording::{ProjectorRecord, RecordingWriter};
use ipc::IpcError;
use ipc::header::Frame;
use ipc::os::now_ns;
use ipc::payload;
use ipc::port::Received;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Worker of the record stage.
pub struct Record {
    folder: PathBuf,
    many: bool,
    projectors: Vec<ProjectorRecord>,
    inboxes: Vec<Inbox<Frame>>,
    frames: usize,
    open: Option<Open>,
}

/// A recording in progress.
struct Open {
    writer: RecordingWriter,
    folder: PathBuf,
    written: usize,
}

impl Record {
    /// Opens the inboxes of all cameras.
    pub fn new(args: &StageArgs, context: &StageContext) -> Result<Self> {
        let projectors = context.cell.config.projectors.iter().map(|p| ProjectorRecord {
            name: p.name.clone(),
            width_px: p.width_px,
            height_px: p.height_px,
            cameras: p.cameras.clone(),
            sequence: p.sequence.clone(),
            exposures_ms: p.exposures_ms.clone(),
            full_scale_dn: BTreeMap::new(),
        });
        let graph = &context.cell.graph;
        let inboxes = graph.cameras.iter().map(|c| Inbox::subscribe(context, &format!("frame/{}", c.name)));
        Ok(Self {
            folder: args.record.clone().context("the record stage has no folder")?,
            many: args.record_many,
            projectors: projectors.collect(),
            inboxes: inboxes.collect::<Result<_>>()?,
            frames: graph.projectors.iter().map(|p| p.frames * p.cameras.len()).sum(),
            open: None,
        })
    }

    fn write(&mut self, context: &mut StageContext, message: &Received<Frame>) -> Result<(), Fault> {
        let Some(open) = &mut self.open else { return Ok(()) };
        let header = message.header();
        let (config, camera) = (&context.cell.config, header.camera as usize);
        let names = config.projectors.get(header.projector as usize).zip(config.cameras.get(camera));
        let Some((projector, camera)) = names else {
            return Err(Fault::Cycle(format!(
                "received a frame of camera {}, but the configuration has only {}",
                camera + 1,
                config.cameras.len()
            )));
        };
        let view = payload::frame(header, message.payload()).map_err(|e| cycle_fault(&e))?;
        payload::check_pixels(header, message.payload()).map_err(|e| cycle_fault(&e))?;
        open.writer
            .write(&projector.name, &camera.name, header.frame as usize, &view)
            .map_err(|e| cycle_fault(&e))?;
        open.written += 1;
        if open.written > self.frames {
            return Err(Fault::Cycle(format!("received more than the {} frames of a cycle", self.frames)));
        }
        Ok(())
    }

    fn finish(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        let Some(open) = self.open.take() else { return Ok(()) };
        let start_ns = now_ns();
        let provenance = [
            ("cell", context.cell.name.clone()),
            ("software", format!("fringecell {}", env!("CARGO_PKG_VERSION"))),
            ("config_sha256", context.cell.file.sha256.clone()),
        ];
        let mut provenance: toml::Table =
            provenance.into_iter().map(|(k, v)| (k.to_owned(), v.into())).collect();
        files::correction::note(&mut provenance, context.cell.file.corrected());
        open.writer.finish(&provenance).map_err(|e| cycle_fault(&e))?;
        context.done(Work::Store, start_ns, &[], Report { count: open.written, text: "" })
    }
}

impl Worker for Record {
    fn connect(&mut self) -> Result<(), IpcError> {
        self.inboxes.iter_mut().try_for_each(Inbox::connect)
    }

    fn begin(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        self.forget();
        let cycle = unwire(context.cycle()).unwrap_or_default();
        let folder = if self.many { self.folder.join(format!("{cycle:04}")) } else { self.folder.clone() };
        let writer = RecordingWriter::create(&folder, &self.projectors).map_err(|e| cycle_fault(&e))?;
        self.open = Some(Open { writer, folder, written: 0 });
        Ok(())
    }

    fn step(&mut self, context: &mut StageContext) -> Result<bool, Fault> {
        let may_start = context.may_start(Work::Store);
        for inbox in 0..self.inboxes.len() {
            if let Some(message) = self.inboxes[inbox].take(context)? {
                self.write(context, &message)?;
                return Ok(true);
            }
        }
        let complete = self.open.as_ref().is_some_and(|open| open.written == self.frames);
        if complete && may_start {
            self.inboxes.iter().try_for_each(|inbox| inbox.check_not_overtaken(context))?;
            self.finish(context)?;
            return Ok(true);
        }
        Ok(false)
    }

    fn forget(&mut self) {
        // An incomplete recording has no recording.toml, so its frames cannot be used.
        if let Some(open) = self.open.take() {
            let _ = std::fs::remove_dir_all(open.folder.join("frames"));
        }
    }
}
