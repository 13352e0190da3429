//! The matching process of one pair: takes its phases, gives its cloud.

use crate::stage::{Fault, Inbox, Report, StageContext, TextBuffer, Worker, cycle_fault};
use anyhow::Result;
use cell::executor::{Matched, PairMatcher, ProjectorCheck, Views, pair_matcher};
use cell::schedule::Work;
use fringe::cloud::Point;
use fringe::pattern::Axis;
use ipc::IpcError;
use ipc::header::{Cloud, Phase};
use ipc::os::now_ns;
use ipc::output_hash;
use ipc::payload;
use ipc::port::{Publisher, Received};

/// A phase that the pair waits for.
struct Need {
    camera: usize,
    axis: Axis,
    map: Option<Received<Phase>>,
}

/// What became of the pixels of a pair, and what a person should know of it.
#[derive(serde::Serialize)]
struct PairReport {
    #[serde(flatten)]
    matched: Matched,
    /// How far the points lie beside what the left camera sees of the projector, where the rig file has it, px.
    beside_projector_px: Option<f64>,
    warnings: Vec<String>,
}

/// State of a matching stage.
pub struct Matching {
    pair: usize,
    projector: usize,
    left: usize,
    matcher: PairMatcher,
    check: Option<ProjectorCheck>,
    needs: Vec<Need>,
    inboxes: Vec<Inbox<Phase>>,
    clouds: Publisher<Cloud>,
    text: TextBuffer,
}

impl Matching {
    /// Computes the tables and opens the ports.
    pub fn new(context: &StageContext) -> Result<Self> {
        let (cell, pair) = (&context.cell, context.subject());
        let node = &cell.graph.pairs[pair];
        let axes = node.axes(&cell.graph.projectors[node.projector]);
        let needs = node
            .cameras()
            .into_iter()
            .flat_map(|camera| axes.iter().map(move |&axis| Need { camera, axis, map: None }));
        let inboxes = node
            .cameras()
            .into_iter()
            .map(|c| Inbox::subscribe(context, &format!("phase/{}", cell.graph.cameras[c].name)));
        Ok(Self {
            pair,
            projector: node.projector,
            left: node.left,
            matcher: pair_matcher(cell, pair)?,
            check: ProjectorCheck::new(&cell.config.rig, &cell.config.rig.pairs[pair]),
            needs: needs.collect(),
            inboxes: inboxes.collect::<Result<_>>()?,
            clouds: context.publisher(&format!("cloud/{}", node.name))?,
            text: TextBuffer::new(),
        })
    }

    /// Keeps a phase that the pair needs; those of other projectors are not for it.
    fn keep(&mut self, context: &StageContext, message: Received<Phase>) -> Result<(), Fault> {
        let header = *message.header();
        if header.projector as usize != self.projector {
            return Ok(());
        }
        let axis = header.info().map_err(|e| cycle_fault(&e))?.axis;
        let need = self.needs.iter_mut().find(|n| n.camera == header.camera as usize && n.axis == axis);
        match need {
            Some(need) if need.map.is_none() => {
                need.map = Some(message);
                Ok(())
            }
            Some(_) => {
                let camera = context.cell.graph.camera_name(header.camera as usize);
                Err(Fault::Cycle(format!("a phase of camera \"{camera}\" came twice")))
            }
            None => Ok(()), // an axis that only another pair takes
        }
    }

    fn run(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        let start_ns = now_ns();
        let mut t_ns = 0;
        let (mut left, mut right) = (Views::default(), Views::default());
        for need in &self.needs {
            let Some(map) = &need.map else { return Ok(()) };
            t_ns = t_ns.max(map.header().t_ns);
            let view = payload::phase(map.header(), map.payload()).map_err(|e| cycle_fault(&e))?;
            if need.camera == self.left { left.set(view) } else { right.set(view) }
        }
        let header = Cloud {
            cycle: context.cycle(),
            t_ns,
            pair: self.pair as u32,
            capacity: self.matcher.capacity() as u32,
            points: 0,
        };
        let mut loan = self.clouds.loan(header)?;
        let room = payload::points_mut(loan.payload_mut()).map_err(|e| cycle_fault(&e))?;
        let matched = self.matcher.run(&left, &right, room).map_err(|e| cycle_fault(&e))?;
        let points = matched.points();
        let judge = |check: &mut ProjectorCheck| check.judge(&left, &room[..points as usize]);
        let (beside_projector_px, warning) = self.check.as_mut().map(judge).unwrap_or_default();
        loan.header_mut().points = points;
        let used = points as usize * size_of::<Point>();
        let output = (used, output_hash(&loan.payload()[..used]));
        context.sending(|| loan.send())?;
        self.forget();
        let report = PairReport { matched, beside_projector_px, warnings: warning.into_iter().collect() };
        let report = Report { count: points as usize, text: self.text.json(&report)? };
        context.done_hashed(Work::Match { pair: self.pair }, start_ns, output, report)
    }
}

impl Worker for Matching {
    fn connect(&mut self) -> Result<(), IpcError> {
        self.inboxes.iter_mut().try_for_each(Inbox::connect)
    }

    fn begin(&mut self, _context: &mut StageContext) -> Result<(), Fault> {
        self.forget();
        Ok(())
    }

    fn step(&mut self, context: &mut StageContext) -> Result<bool, Fault> {
        let turn = context.may_start(Work::Match { pair: self.pair });
        for inbox in 0..self.inboxes.len() {
            if let Some(message) = self.inboxes[inbox].take(context)? {
                self.keep(context, message)?;
                return Ok(true);
            }
        }
        let complete = self.needs.iter().all(|need| need.map.is_some());
        if complete && turn {
            self.inboxes.iter().try_for_each(|inbox| inbox.check_not_overtaken(context))?;
            self.run(context)?;
            return Ok(true);
        }
        Ok(false)
    }

    fn forget(&mut self) {
        for need in &mut self.needs {
            need.map = None;
        }
    }
}
