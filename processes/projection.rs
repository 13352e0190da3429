//! The projection process: shows the patterns in order and triggers the cameras.
//!
//! A pattern stands until every camera of its projector has exposed; only then the next one is shown. Projectors of a group show theirs at
//! the same time.

use crate::stage::{Fault, Inbox, Report, StageContext, Worker, cycle_fault};
use anyhow::Result;
use cell::cycle_number::unwire;
use cell::graph::Graph;
use cell::schedule::Work;
use devices::Projector;
use ipc::IpcError;
use ipc::header::Trigger;
use ipc::os::now_ns;
use ipc::port::Publisher;
use std::collections::BTreeMap;

/// State of the projection.
pub struct Projection {
    driver: Box<dyn Projector>,
    /// By index of the projector.
    triggers: BTreeMap<usize, Publisher<Trigger>>,
    exposed: Inbox<Trigger>,
    /// Projector and frame, in the order of projection; and whether it joins the one before, of another projector of its group.
    sequence: Vec<(usize, usize, bool)>,
    next: usize,
    /// First of the patterns that stand; the last one is that before `next`.
    standing: usize,
    /// Cameras that have not yet exposed the patterns that stand.
    waiting: Vec<usize>,
    /// The next pattern is due, but the core is not there yet; it will be notified.
    held: bool,
}

impl Projection {
    /// Opens the ports of the stage.
    pub fn new(context: &StageContext) -> Result<Self> {
        let graph = &context.cell.graph;
        let here = || graph.projectors.iter().enumerate().filter(|(p, _)| graph.has_projector(*p));
        let triggers = here()
            .map(|(p, node)| Ok((p, context.publisher(&format!("trigger/{}", node.name))?)))
            .collect::<Result<_>>()?;
        // The order of the schedule; of a group that shows together only the first pattern waits for exposures.
        let mut sequence: Vec<(usize, usize, bool)> = Vec::new();
        for activation in &context.cell.schedule.activations {
            let Work::Project { projector, frame } = activation.work else { continue };
            let grouped =
                |other: usize| graph.groups.iter().any(|g| g.contains(&other) && g.contains(&projector));
            let joins =
                sequence.last().is_some_and(|(p, f, _)| *f == frame && *p != projector && grouped(*p));
            sequence.push((projector, frame, joins));
        }
        Ok(Self {
            driver: devices::projector(&context.cell)?,
            triggers,
            exposed: Inbox::subscribe(context, "exposed")?,
            sequence,
            next: 0,
            standing: 0,
            waiting: Vec::with_capacity(graph.cameras.len()),
            held: false,
        })
    }

    fn show(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        let (projector, frame, joins) = self.sequence[self.next];
        let start_ns = now_ns();
        self.driver.show(projector, frame, start_ns).map_err(|e| cycle_fault(&e))?;
        if !joins {
            self.waiting.clear();
            self.standing = self.next;
        }
        self.waiting.extend_from_slice(&context.cell.graph.projectors[projector].cameras);
        let trigger = Trigger {
            cycle: context.cycle(),
            t_ns: now_ns(),
            projector: projector as u32,
            frame: frame as u32,
            camera: Trigger::ALL,
        };
        context.sending(|| self.triggers[&projector].send(trigger, &[]))?;
        self.next += 1;
        context.done(Work::Project { projector, frame }, start_ns, &[], Report::default())
    }

    fn answer(&mut self, graph: &Graph, answer: Trigger) -> Result<(), Fault> {
        let standing = &self.sequence[self.standing..self.next];
        let shown = self.sequence[self.next - 1];
        let (projector, frame, camera) =
            (answer.projector as usize, answer.frame as usize, answer.camera as usize);
        let place = self
            .waiting
            .iter()
            .position(|&c| c == camera)
            .filter(|_| standing.iter().any(|(p, f, _)| (*p, *f) == (projector, frame)));
        match place {
            Some(place) => {
                self.waiting.swap_remove(place);
                Ok(())
            }
            None => Err(Fault::Cycle(format!(
                "{} was exposed while frame {} of projector \"{}\" was shown",
                graph.frame_name(camera, projector, frame),
                shown.1 + 1,
                graph.projector_name(shown.0)
            ))),
        }
    }
}

impl Worker for Projection {
    fn connect(&mut self) -> Result<(), IpcError> {
        self.exposed.connect()
    }

    fn begin(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        self.forget();
        let cycle = unwire(context.cycle()).unwrap_or_default();
        self.driver.begin(cycle, now_ns()).map_err(|e| cycle_fault(&e))
    }

    fn step(&mut self, context: &mut StageContext) -> Result<bool, Fault> {
        if let Some(answer) = self.exposed.take(context)? {
            let answer = *answer.header();
            if self.next == 0 {
                return Err(Fault::Cycle(format!(
                    "camera \"{}\" exposed before any pattern was shown",
                    context.cell.graph.camera_name(answer.camera as usize)
                )));
            }
            self.answer(&context.cell.graph, answer)?;
            return Ok(true);
        }
        let Some(&(projector, frame, joins)) = self.sequence.get(self.next) else { return Ok(false) };
        let due = self.driver.due_ns().is_none_or(|due| due <= now_ns());
        if !joins && (!self.waiting.is_empty() || !due) {
            return Ok(false);
        }
        self.held = !context.may_start(Work::Project { projector, frame });
        if !self.held {
            self.show(context)?;
        }
        Ok(!self.held)
    }

    fn forget(&mut self) {
        self.next = 0;
        self.standing = 0;
        self.held = false;
        self.waiting.clear();
    }

    fn due_ns(&self) -> Option<u64> {
        // With nothing left to show there is nothing to wake up for.
        let to_show = !self.held && self.waiting.is_empty() && self.next < self.sequence.len();
        self.driver.due_ns().filter(|_| to_show)
    }
}
