//! The inspection process: measures and evaluates the features of the plan on the fused cloud.

use crate::stage::{Fault, Inbox, Report, StageContext, TextBuffer, Worker, cycle_fault};
use anyhow::Result;
use cell::schedule::Work;
use ipc::IpcError;
use ipc::header::{Cloud, Outcome};
use ipc::os::now_ns;
use ipc::payload;
use ipc::port::{Publisher, Received};
use metrology::inspection::{Plan, evaluate};

/// State of the inspection.
pub struct Inspection {
    /// Inspection plan of each recipe; `None`: the recipe inspects nothing.
    plans: Vec<Option<Plan>>,
    fused: Inbox<Cloud>,
    results: Publisher<Outcome>,
    text: TextBuffer,
}

impl Inspection {
    /// Opens the ports of the stage.
    pub fn new(context: &StageContext) -> Result<Self> {
        Ok(Self {
            plans: context.cell.config.recipes.iter().map(|recipe| recipe.plan.clone()).collect(),
            fused: Inbox::subscribe(context, "cloud/fused")?,
            results: context.publisher("result")?,
            text: TextBuffer::new(),
        })
    }

    fn run(&mut self, context: &mut StageContext, message: &Received<Cloud>) -> Result<(), Fault> {
        let start_ns = now_ns();
        let points = payload::points(message.header(), message.payload()).map_err(|e| cycle_fault(&e))?;
        let plan = self.plans.get(context.recipe).ok_or_else(|| {
            Fault::Cycle(format!(
                "recipe {} is not among the {} of the cell",
                context.recipe,
                self.plans.len()
            ))
        })?;
        let result = plan.as_ref().map(|plan| evaluate(plan, points));
        let text = self.text.json(&result)?;
        let header = Outcome {
            cycle: context.cycle(),
            t_last_frame_ns: message.header().t_ns,
            t_ns: now_ns(),
            text_bytes: text.len() as u32,
        };
        context.sending(|| self.results.send(header, text.as_bytes()))?;
        let report = Report { count: result.map_or(0, |result| result.features.len()), text: "" };
        context.done(Work::Inspect, start_ns, text.as_bytes(), report)
    }
}

impl Worker for Inspection {
    fn connect(&mut self) -> Result<(), IpcError> {
        self.fused.connect()
    }

    fn begin(&mut self, _context: &mut StageContext) -> Result<(), Fault> {
        Ok(())
    }

    fn step(&mut self, context: &mut StageContext) -> Result<bool, Fault> {
        if !context.may_start(Work::Inspect) {
            return Ok(false);
        }
        match self.fused.take(context)? {
            Some(_) if self.fused.take(context)?.is_some() => {
                Err(Fault::Cycle("the fused cloud came twice".into()))
            }
            Some(message) => {
                self.fused.check_not_overtaken(context)?;
                self.run(context, &message).map(|()| true)
            }
            None => Ok(false),
        }
    }

    fn forget(&mut self) {}
}
