//! The inspection process: measures the features of the plan on the fused cloud and judges them.

use crate::stage::{Fault, Inbox, Link, Report, TextBuffer, Worker, lost};
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
    pub fn new(link: &Link) -> Result<Self> {
        Ok(Self {
            plans: link.cell.config.recipes.iter().map(|recipe| recipe.plan.clone()).collect(),
            fused: link.inbox("cloud/fused")?,
            results: link.publisher("result")?,
            text: TextBuffer::new(),
        })
    }

    fn run(&mut self, link: &mut Link, message: &Received<Cloud>) -> Result<(), Fault> {
        let start_ns = now_ns();
        let points = payload::points(message.header(), message.payload()).map_err(|e| lost(&e))?;
        let plan = self.plans.get(link.recipe).ok_or_else(|| {
            Fault::Cycle(format!("recipe {} is not among the {} of the cell", link.recipe, self.plans.len()))
        })?;
        let result = plan.as_ref().map(|plan| evaluate(plan, points));
        let text = self.text.json(&result)?;
        let header = Outcome {
            cycle: link.cycle(),
            t_last_frame_ns: message.header().t_ns,
            t_ns: now_ns(),
            text_bytes: text.len() as u32,
        };
        link.sending(|| self.results.send(header, text.as_bytes()))?;
        let report = Report { count: result.map_or(0, |result| result.features.len()), text: "" };
        link.done(Work::Inspect, start_ns, text.as_bytes(), report)
    }
}

impl Worker for Inspection {
    fn connect(&self) -> Result<(), IpcError> {
        self.fused.connect()
    }

    fn begin(&mut self, _link: &mut Link) -> Result<(), Fault> {
        Ok(())
    }

    fn step(&mut self, link: &mut Link) -> Result<bool, Fault> {
        if !link.may_start(Work::Inspect) {
            return Ok(false);
        }
        match self.fused.take(link)? {
            Some(_) if self.fused.take(link)?.is_some() => {
                Err(Fault::Cycle("the fused cloud came twice".into()))
            }
            Some(message) => {
                self.fused.check_not_overtaken(link)?;
                self.run(link, &message).map(|()| true)
            }
            None => Ok(false),
        }
    }

    fn forget(&mut self) {}
}
