//! `fringecell stage`: the process of a stage.

use crate::stage::{StageArgs, StageContext, Worker, check_files, serve};
use crate::{capture, decode, fusion, inspection, link, matching, projection, record};
use anyhow::{Context, Result, ensure};
use cell::schedule::{Half, Kind};
use cell::{Cell, Options};
use ipc::os;

/// Exit code of a process that panicked, as Rust chooses it.
const PANIC_CODE: i32 = 101;

/// Runs a stage until the supervisor ends it.
pub fn run(args: &StageArgs) -> Result<()> {
    end_at_panic();
    os::ignore_interrupts();
    os::keep_freed_memory();
    ensure!(os::die_with_parent(args.parent)?, "the supervisor (pid {}) has ended", args.parent);
    let options = Options {
        cell: Some(args.cell.clone()),
        watch: args.watch,
        record: args.record.is_some(),
        retention: args.retention,
        host: args.host.clone(),
    };
    let cell = devices::load(&args.config, &options)?;
    check_files(&cell, &args.files)?;
    pin(&cell, args)?;
    claim(&cell, args.kind);
    build_thread_pool()?;
    let mut context = StageContext::join(args, cell)?;
    let ended = worker(args, &context).and_then(|mut worker| serve(&mut context, worker.as_mut()));
    if let Err(error) = &ended {
        // The reason for the outcome of the cycle; if it cannot be sent, the supervisor sees the exit code.
        let _ = context.failed(0, &format!("{error:#}"));
    }
    ended
}

/// Makes a panic of any thread end this process at once, as a kill does: a stage that unwinds would close its ports one by one,
/// and cycles would fail by messages without a receiver before the supervisor knows why.
fn end_at_panic() {
    let print = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        print(panic);
        std::process::exit(PANIC_CODE);
    }));
}

fn pin(cell: &Cell, args: &StageArgs) -> Result<()> {
    let stage = cell.schedule.stages.iter().find(|s| s.name == args.name);
    match stage {
        // The link to other hosts has no core of its own.
        Some(stage) if cell.config.schedule.pin && stage.kind != Kind::Link => os::pin(&[stage.core])
            .with_context(|| {
                format!(
                    "schedule.pin: core {} cannot be used; check that the machine has this core",
                    stage.core
                )
            }),
        _ => Ok(()),
    }
}

/// Sets real-time priority and locks memory where the system permits it; the supervisor reports where it does not.
fn claim(cell: &Cell, kind: Kind) {
    if let Some(priority) = cell.config.schedule.realtime_priority {
        // Cameras do not wait: the acquisition has priority over the evaluation.
        let lower = kind.half() == Half::Evaluation;
        let _refused = os::realtime((priority - u32::from(lower)).max(1));
    }
    // With a limit below the need, later mappings would fail.
    if cell.config.schedule.lock_memory && os::may_lock_memory(cell.schedule.memory_bytes()).unwrap_or(false)
    {
        let _refused = os::lock_memory();
    }
}

/// Makes this thread part of the pool of the parallel kernels; otherwise it would pass work through a queue that allocates,
/// and sleep. Call it after pinning: the other threads inherit the cores.
fn build_thread_pool() -> Result<()> {
    rayon::ThreadPoolBuilder::new()
        .use_current_thread()
        .build_global()
        .context("starting the threads of the parallel kernels")?;
    // A thread allocates when it first steals work: do so now rather than in a cycle.
    rayon::broadcast(|_| drop(crossbeam::epoch::pin()));
    Ok(())
}

fn worker(args: &StageArgs, context: &StageContext) -> Result<Box<dyn Worker>> {
    Ok(match args.kind {
        Kind::Projection => Box::new(projection::Projection::new(context)?),
        Kind::Capture => Box::new(capture::Capture::new(args, context)?),
        Kind::Decode => Box::new(decode::Decode::new(context)?),
        Kind::Matching => Box::new(matching::Matching::new(context)?),
        Kind::Fusion => Box::new(fusion::Fusion::new(context)?),
        Kind::Inspection => Box::new(inspection::Inspection::new(context)?),
        Kind::Record => Box::new(record::Record::new(args, context)?),
        Kind::Link if context.cell.graph.leads() => Box::new(link::Receive::new(context)?),
        Kind::Link => Box::new(link::Deliver::new(context)?),
    })
}
