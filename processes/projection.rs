//! The projection process: shows the patterns in order and triggers the cameras.
//!
//! A pattern stands until every camera of its projector has exposed; only then the next one is shown.

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

/// State of the projection.
pub struct Projection {
    driver: Box<dyn Projector>,
    triggers: Vec<Publisher<Trigger>>,
    exposed: Inbox<Trigger>,
    /// Projector and frame, in the order of projection.
    sequence: Vec<(usize, usize)>,
    next: usize,
    /// Cameras that have not yet exposed the pattern that stands.
    waiting: Vec<usize>,
    /// The next pattern is due, but the core is not there yet; it will be notified.
    held: bool,
}

impl Projection {
    /// Opens the ports of the stage.
    pub fn new(context: &StageContext) -> Result<Self> {
        let graph = &context.cell.graph;
        let triggers = graph
            .projectors
            .iter()
            .map(|p| context.publisher(&format!("trigger/{}", p.name)))
            .collect::<Result<_>>()?;
        let sequence =
            graph.projectors.iter().enumerate().flat_map(|(p, node)| (0..node.frames).map(move |f| (p, f)));
        Ok(Self {
            driver: devices::projector(&context.cell)?,
            triggers,
            exposed: context.inbox("exposed")?,
            sequence: sequence.collect(),
            next: 0,
            waiting: Vec::with_capacity(graph.cameras.len()),
            held: false,
        })
    }

    fn show(&mut self, context: &mut StageContext) -> Result<(), Fault> {
        let (projector, frame) = self.sequence[self.next];
        let start_ns = now_ns();
        self.driver.show(projector, frame, start_ns).map_err(|e| cycle_fault(&e))?;
        self.waiting.clear();
        self.waiting.extend_from_slice(&context.cell.graph.projectors[projector].cameras);
        let trigger = Trigger {
            cycle: context.cycle(),
            t_ns: now_ns(),
            projector: projector as u32,
            frame: frame as u32,
            camera: Trigger::ALL,
        };
        context.sending(|| self.triggers[projector].send(trigger, &[]))?;
        self.next += 1;
        context.done(Work::Project { projector, frame }, start_ns, &[], Report::default())
    }

    fn answer(&mut self, graph: &Graph, answer: Trigger) -> Result<(), Fault> {
        let shown = self.sequence[self.next - 1];
        let (projector, frame, camera) =
            (answer.projector as usize, answer.frame as usize, answer.camera as usize);
        let place = self.waiting.iter().position(|&c| c == camera).filter(|_| (projector, frame) == shown);
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
        let due = self.driver.due_ns().is_none_or(|due| due <= now_ns());
        if !self.waiting.is_empty() || !due {
            return Ok(false);
        }
        let Some(&(projector, frame)) = self.sequence.get(self.next) else { return Ok(false) };
        self.held = !context.may_start(Work::Project { projector, frame });
        if !self.held {
            self.show(context)?;
        }
        Ok(!self.held)
    }

    fn forget(&mut self) {
        self.next = 0;
        self.held = false;
        self.waiting.clear();
    }

    fn due_ns(&self) -> Option<u64> {
        // With nothing left to show there is nothing to wake up for.
        let to_show = !self.held && self.waiting.is_empty() && self.next < self.sequence.len();
        self.driver.due_ns().filter(|_| to_show)
    }
}
