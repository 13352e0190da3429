//! The fusion process: joins the clouds of all pairs in the world frame.

use crate::stage::{Fault, Inbox, Report, StageContext, TextBuffer, Worker, cycle_fault};
use anyhow::{Result, ensure};
use cell::executor::no_point;
use cell::schedule::Work;
use fringe::cloud::Point;
use fringe::fusion::Fuser;
use fringe::geometry::rig::pictures;
use ipc::IpcError;
use ipc::header::Cloud;
use ipc::os::now_ns;
use ipc::output_hash;
use ipc::payload;
use ipc::port::{Publisher, Received};

/// Bytes of the report on one overlap of two pairs, at most.
const OVERLAP_BYTES: usize = 256;

/// Pairs of a cell: a point names its pair with one byte.
const MAX_PAIRS: usize = 256;

/// A pair whose cloud is joined.
struct Part {
    inbox: Inbox<Cloud>,
    cloud: Option<Received<Cloud>>,
}

/// State of the fusion.
pub struct Fusion {
    /// In the order of the rig file: the order of the points follows it.
    parts: Vec<Part>,
    /// How many of the clouds were taken before the others exist.
    taken: usize,
    capacity: usize,
    fuser: Fuser,
    clouds: Publisher<Cloud>,
    text: TextBuffer,
}

impl Fusion {
    /// Allocates room for all points and opens the ports.
    pub fn new(context: &StageContext) -> Result<Self> {
        let graph = &context.cell.graph;
        let parts = graph.pairs.iter().map(|pair| {
            Ok(Part { inbox: Inbox::subscribe(context, &format!("cloud/{}", pair.name))?, cloud: None })
        });
        let pixels = |camera: usize| {
            graph.cameras[camera].width_px as usize * graph.cameras[camera].height_px as usize
        };
        let capacity = graph.pairs.iter().map(|pair| pixels(pair.left)).sum();
        ensure!(
            graph.pairs.len() <= MAX_PAIRS,
            "{} pairs; a cell has at most {MAX_PAIRS}",
            graph.pairs.len()
        );
        Ok(Self {
            parts: parts.collect::<Result<_>>()?,
            taken: 0,
            capacity,
            fuser: Fuser::of_pictures(pictures(&context.cell.config.rig.pairs)),
            clouds: context.publisher("cloud/fused")?,
            text: TextBuffer::with_capacity(OVERLAP_BYTES * graph.pairs.len().pow(2) / 2),
        })
    }

    /// Takes the next cloud where the schedule wants that before the others exist; returns whether it did.
    fn take(&mut self, context: &mut StageContext) -> Result<bool, Fault> {
        let (pair, work) = (self.taken, Work::Take { pair: self.taken });
        let Some((part, message)) = self.parts.get(pair).and_then(|part| Some((part, part.cloud.as_ref()?)))
        else {
            return Ok(false);
        };
        if !context.may_start(work) {
            return Ok(false);
        }
        part.inbox.check_not_overtaken(context)?;
        let start_ns = now_ns();
        let points = payload::points(message.header(), message.payload()).map_err(|e| cycle_fault(&e))?;
        self.fuser.take(pair, points, &context.cell.config.settings.fusion);
        self.taken += 1;
        context.done(work, start_ns, &[], Report { count: points.len(), text: "" })?;
        Ok(true)
    }

    fn run(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        let start_ns = now_ns();
        let mut t_ns = 0;
        let mut clouds: [&[Point]; MAX_PAIRS] = [&[]; MAX_PAIRS];
        let messages = self.parts.iter().filter_map(|part| part.cloud.as_ref());
        for (message, cloud) in messages.zip(&mut clouds) {
            t_ns = t_ns.max(message.header().t_ns);
            *cloud = payload::points(message.header(), message.payload()).map_err(|e| cycle_fault(&e))?;
        }
        let clouds = &clouds[..self.parts.len()];
        let header = Cloud {
            cycle: context.cycle(),
            t_ns,
            pair: Cloud::FUSED,
            capacity: self.capacity as u32,
            points: 0,
        };
        let mut loan = self.clouds.loan(header)?;
        let room = payload::points_mut(loan.payload_mut()).map_err(|e| cycle_fault(&e))?;
        let Some(report) = self.fuser.fuse_into(clouds, &context.cell.config.settings.fusion, room) else {
            return Err(Fault::Cycle(format!("more points came than the {} that may", self.capacity)));
        };
        let points = report.points as usize;
        if points == 0 {
            release(&mut self.parts);
            return Err(Fault::Cycle(no_point(report, &context.cell.config.settings.fusion)));
        }
        loan.header_mut().points = report.points;
        let used = points * size_of::<Point>();
        let output = (used, output_hash(&loan.payload()[..used]));
        context.sending(|| loan.send())?;
        release(&mut self.parts);
        let text = self.text.json(report)?;
        context.done_hashed(Work::Fuse, start_ns, output, Report { count: points, text })
    }
}

impl Worker for Fusion {
    fn connect(&mut self) -> Result<(), IpcError> {
        self.parts.iter_mut().try_for_each(|part| part.inbox.connect())
    }

    fn begin(&mut self, _context: &mut StageContext) -> Result<(), Fault> {
        self.forget();
        Ok(())
    }

    fn step(&mut self, context: &mut StageContext) -> Result<bool, Fault> {
        let turn = context.may_start(Work::Fuse);
        for (number, part) in self.parts.iter_mut().enumerate() {
            if let Some(message) = part.inbox.take(context)? {
                if part.cloud.is_some() || message.header().pair as usize != number {
                    let pair = context.cell.graph.pair_name(message.header().pair as usize);
                    return Err(Fault::Cycle(format!(
                        "the cloud of pair \"{pair}\" came twice or out of place"
                    )));
                }
                part.cloud = Some(message);
                return Ok(true);
            }
        }
        if self.take(context)? {
            return Ok(true);
        }
        if self.parts.iter().all(|part| part.cloud.is_some()) && turn {
            self.parts.iter().try_for_each(|part| part.inbox.check_not_overtaken(context))?;
            self.run(context)?;
            return Ok(true);
        }
        Ok(false)
    }

    fn forget(&mut self) {
        self.fuser.forget();
        self.taken = 0;
        release(&mut self.parts);
    }
}

/// Gives the clouds back to their senders.
fn release(parts: &mut [Part]) {
    for part in parts {
        part.cloud = None;
    }
}
