//! The main loop of every stage: start, connect, work through cycles, end.
//!
//! A stage sleeps until it is notified. Then it handles commands first and lets its worker process messages until nothing is
//! left to do.

mod args;
mod context;
mod cycle_filter;
mod fault;
mod inbox;
mod text_buffer;
mod worker;

pub use args::{StageArgs, check_files, short_hashes};
pub use context::{Report, StageContext, populated};
pub use fault::{Fault, cycle_fault};
pub use inbox::Inbox;
pub use text_buffer::TextBuffer;
pub use worker::Worker;

use crate::panic_drill::panic_if_requested;
use anyhow::Result;
use ipc::header::{Command, Control};
use ipc::os;
use std::time::Duration;

/// Longest sleep of a stage without a notification. It only limits the effect of a lost notification.
const SLEEP: Duration = Duration::from_millis(500);

/// Works through cycles until the supervisor ends the stage.
pub fn serve(context: &mut StageContext, worker: &mut dyn Worker) -> Result<()> {
    let _span = tracing::info_span!("stage", pid = std::process::id()).entered();
    context.ready(0)?;
    loop {
        while let Some(message) = context.control.receive()? {
            let Control { cycle, recipe, .. } = *message.header();
            let command = message.header().command()?;
            drop(message);
            match command {
                Command::Shutdown => return Ok(()),
                Command::Connect => {
                    worker.connect()?;
                    context.use_large_pages();
                    context.ready(cycle)?;
                }
                Command::Populate => {
                    context.populate()?;
                    context.ready(cycle)?;
                }
                Command::Abort => {
                    if context.cycles.end(cycle) {
                        worker.forget();
                    }
                }
                other if other != context.start_command() => {} // for the other half of the cycle
                Command::Start | Command::Evaluate => {
                    panic_if_requested(context.name());
                    context.cycles.start(cycle);
                    context.recipe = recipe as usize;
                    context.reset_counters();
                    let begun = worker.begin(context);
                    settle(context, worker, begun.map(|()| true))?;
                }
            }
        }
        let progress = if let Some(cycle) = context.cycles.current() {
            let _span = tracing::trace_span!("step", cycle).entered();
            let stepped = worker.step(context);
            settle(context, worker, stepped)?
        } else {
            let idled = worker.idle(context);
            settle(context, worker, idled.map(|()| false))?
        };
        if !progress {
            let until_due = worker.due_ns().map(|due| Duration::from_nanos(due.saturating_sub(os::now_ns())));
            context.sleep(until_due.unwrap_or(SLEEP).min(SLEEP))?;
        }
    }
}

/// Reports a failed cycle and drops it; any other error ends the stage.
fn settle(context: &mut StageContext, worker: &mut dyn Worker, result: Result<bool, Fault>) -> Result<bool> {
    match result {
        Ok(progress) => Ok(progress),
        Err(Fault::Fatal(error)) => Err(error),
        Err(Fault::Cycle(reason)) => {
            context.failed(context.cycle(), &reason)?;
            worker.forget();
            Ok(true)
        }
    }
}
