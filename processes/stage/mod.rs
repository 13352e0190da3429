//! What all stages have in common: start, connect, work through cycles, leave.
//!
//! A stage sleeps on its bell. Woken, it reads commands first, then lets its worker take what lies in its inboxes until
//! nothing is left to do.

mod args;
mod fault;
mod gate;
mod link;
mod text;
mod worker;

pub use args::{StageArgs, short_hashes};
pub use fault::{Fault, lost};
pub use link::{Inbox, Link, Report};
pub use text::Text;
pub use worker::Worker;

use anyhow::Result;
use ipc::header::{Command, Control};
use ipc::os;
use std::time::Duration;

/// How long a stage sleeps when nobody rings. Nothing depends on it: it only bounds how long a lost bell could hide.
const SLEEP: Duration = Duration::from_millis(500);

/// Works through cycles until the supervisor ends the stage.
pub fn serve(link: &mut Link, worker: &mut dyn Worker) -> Result<()> {
    let _span = tracing::info_span!("stage", pid = std::process::id()).entered();
    link.ready(0)?;
    loop {
        while let Some(message) = link.control.receive()? {
            let Control { cycle, recipe, .. } = *message.header();
            let command = message.header().command()?;
            drop(message);
            match command {
                Command::Shutdown => return Ok(()),
                Command::Connect => {
                    worker.connect()?;
                    link.populate()?;
                    link.ready(cycle)?;
                }
                Command::Abort => {
                    if link.gate.end(cycle) {
                        worker.forget();
                    }
                }
                begin if begin != link.begins() => {} // for the other half
                Command::Start | Command::Evaluate => {
                    link.gate.start(cycle);
                    link.recipe = recipe as usize;
                    link.idle_from_now();
                    let begun = worker.begin(link);
                    settle(link, worker, begun.map(|()| true))?;
                }
            }
        }
        let progress = match link.gate.current() {
            Some(cycle) => {
                let _span = tracing::trace_span!("step", cycle).entered();
                let stepped = worker.step(link);
                settle(link, worker, stepped)?
            }
            None => false,
        };
        if !progress {
            let until_due = worker.due_ns().map(|due| Duration::from_nanos(due.saturating_sub(os::now_ns())));
            link.sleep(until_due.unwrap_or(SLEEP).min(SLEEP))?;
        }
    }
}

/// A lost cycle is reported and forgotten, anything worse ends the stage.
fn settle(link: &mut Link, worker: &mut dyn Worker, result: Result<bool, Fault>) -> Result<bool> {
    match result {
        Ok(progress) => Ok(progress),
        Err(Fault::Fatal(error)) => Err(error),
        Err(Fault::Cycle(reason)) => {
            link.failed(link.cycle(), &reason)?;
            worker.forget();
            Ok(true)
        }
    }
}
