//! The inspection process: measures the features of the plan on the fused cloud and judges them.

use crate::judgement::judge;
use crate::schedule::Work;
use crate::stage::{Fault, Inbox, Link, Report, Worker, lost};
use anyhow::Result;
use fringe::inspection::Plan;
use ipc::IpcError;
use ipc::header::{Cloud, Outcome};
use ipc::os::now_ns;
use ipc::payload;
use ipc::port::{Publisher, Received};

/// State of the inspection.
pub struct Inspection {
    plan: Option<Plan>,
    fused: Inbox<Cloud>,
    results: Publisher<Outcome>,
}

impl Inspection {
    /// Opens the ports.
    pub fn new(link: &Link) -> Result<Self> {
        Ok(Self {
            plan: link.cell.plan.clone(),
            fused: link.inbox("cloud/fused")?,
            results: link.publisher("result")?,
        })
    }

    fn run(&mut self, link: &mut Link, message: &Received<Cloud>) -> Result<(), Fault> {
        let start_ns = now_ns();
        let points = payload::points(message.header(), message.payload()).map_err(|e| lost(&e))?;
        let judgement = judge(self.plan.as_ref(), points);
        let text = serde_json::to_string(&judgement).map_err(|e| lost(&e))?;
        let header = Outcome {
            cycle: link.cycle(),
            t_last_frame_ns: message.header().t_ns,
            t_ns: now_ns(),
            text_bytes: text.len() as u32,
        };
        self.results.send(header, text.as_bytes())?;
        let report = Report { count: judgement.features.len(), text: String::new() };
        link.done(Work::Inspect, start_ns, text.as_bytes(), &report)
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
        if !link.may(Work::Inspect) {
            return Ok(false);
        }
        match self.fused.take(link)? {
            Some(message) => self.run(link, &message).map(|()| true),
            None => Ok(false),
        }
    }

    fn forget(&mut self) {}
}
