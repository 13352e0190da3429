//! `fringecell stage`: from the kind of a stage to its worker.

use crate::graph::{self, Cell, Options};
use crate::schedule::{Half, Kind};
use crate::stage::{Link, StageArgs, Worker, serve, short_hashes};
use crate::{capture, decode, fusion, inspection, matching, projection, record};
use anyhow::{Context, Result, bail, ensure};
use ipc::os;

/// Runs a stage until the supervisor ends it.
pub fn run(args: &StageArgs) -> Result<()> {
    os::ignore_interrupts();
    os::keep_freed_memory();
    ensure!(os::die_with_parent(args.parent)?, "the supervisor {} is gone", args.parent);
    let options = Options {
        cell: Some(args.cell.clone()),
        watch: args.watch,
        record: args.record.is_some(),
        kept: args.kept,
    };
    let cell = graph::load(&args.config, &options)?;
    check_files(&cell, args)?;
    pin(&cell, args)?;
    claim(&cell, args.kind);
    work_along()?;
    let mut link = Link::join(args, cell)?;
    let ended = worker(args, &link).and_then(|mut worker| serve(&mut link, worker.as_mut()));
    if let Err(error) = &ended {
        // The last words of a stage, for the outcome of the cycle; if they cannot be said, the exit code speaks.
        let _ = link.failed(0, &format!("{error:#}"));
    }
    ended
}

/// A stage that read something else than its supervisor would mix two cells in one result.
fn check_files(cell: &Cell, args: &StageArgs) -> Result<()> {
    let files = cell.config.read_files();
    // A list of another length comes with another configuration, which stands first in it.
    let changed =
        files.iter().zip(short_hashes(&files)).zip(&args.files).find(|((_, now), then)| now != *then);
    match changed {
        None => Ok(()),
        Some((((name, _), _), _)) => {
            bail!("{name} was changed while the cell runs; stop the cell and start it again")
        }
    }
}

fn pin(cell: &Cell, args: &StageArgs) -> Result<()> {
    let stage = cell.schedule.stages.iter().find(|s| s.name == args.name);
    match stage {
        Some(stage) if cell.config.schedule.pin => os::pin(&[stage.core]).with_context(|| {
            format!("schedule.pin: core {} cannot be used; does the machine have so many?", stage.core)
        }),
        _ => Ok(()),
    }
}

/// What makes times steadier, where the system permits it; the supervisor has said so where it does not.
fn claim(cell: &Cell, kind: Kind) {
    if let Some(priority) = cell.config.schedule.realtime_priority {
        // A camera waits for nobody: where cycles overlap, the acquisition of the next goes before the evaluation of the last.
        let behind = cell.schedule.in_flight > 1 && kind.half() == Half::Evaluation;
        let _refused = os::realtime((priority - u32::from(behind)).max(1));
    }
    // Half a permission is worse than none: what is mapped later would fail.
    if cell.config.schedule.lock_memory && os::may_lock_memory(cell.schedule.memory_bytes()).unwrap_or(false)
    {
        let _refused = os::lock_memory();
    }
}

/// Makes this thread one of the pool that runs the parallel kernels. Otherwise it would hand them work through a queue that
/// allocates now and then, and sleep meanwhile. After pinning: the other threads inherit it.
fn work_along() -> Result<()> {
    rayon::ThreadPoolBuilder::new().use_current_thread().build_global().context("starting the threads")?;
    // The first time that a thread takes work from another it enrols in what guards that, on the heap: now rather than in
    // some cycle.
    rayon::broadcast(|_| drop(crossbeam::epoch::pin()));
    Ok(())
}

fn worker(args: &StageArgs, link: &Link) -> Result<Box<dyn Worker>> {
    Ok(match args.kind {
        Kind::Projection => Box::new(projection::Projection::new(link)?),
        Kind::Capture => Box::new(capture::Capture::new(link)?),
        Kind::Decode => Box::new(decode::Decode::new(link)?),
        Kind::Matching => Box::new(matching::Matching::new(link)?),
        Kind::Fusion => Box::new(fusion::Fusion::new(link)?),
        Kind::Inspection => Box::new(inspection::Inspection::new(link)?),
        Kind::Record => Box::new(record::Record::new(args, link)?),
    })
}
