//! What all stages have in common: start, connect, work through cycles, leave.
//!
//! A stage sleeps on its bell. Woken, it reads commands first, then lets its worker take what lies in its inboxes until
//! nothing is left to do.

mod gate;
mod link;

pub use link::{Inbox, Link, Report};

use crate::graph::{self, Cell, Options};
use crate::supervisor::schedule::Kind;
use crate::{capture, decode, fusion, inspection, matching, projection, record};
use anyhow::{Context, Result, ensure};
use ipc::IpcError;
use ipc::header::Command;
use ipc::os;
use std::path::PathBuf;
use std::time::Duration;

/// How long a stage sleeps when nobody rings. Nothing depends on it: it only bounds how long a lost bell could hide.
const SLEEP: Duration = Duration::from_millis(500);

/// Arguments of the hidden subcommand `stage`, written by the supervisor.
#[derive(Debug, Clone, clap::Args)]
pub struct StageArgs {
    /// What to be.
    pub kind: Kind,
    /// Name in the schedule.
    pub name: String,
    /// Cell to join.
    #[arg(long)]
    pub cell: String,
    /// Configuration.
    #[arg(long)]
    pub config: PathBuf,
    /// Its hash: a stage must not run another configuration than its supervisor.
    #[arg(long)]
    pub config_sha256: String,
    /// Hash of the rig file.
    #[arg(long)]
    pub rig_sha256: String,
    /// Process of the supervisor.
    #[arg(long)]
    pub parent: u32,
    /// Whether the supervisor watches frames and phases.
    #[arg(long)]
    pub watch: bool,
    /// Where the recording goes, if one is written.
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// Whether several cycles are recorded, each in a folder of its own.
    #[arg(long)]
    pub record_many: bool,
}

/// Why a stage cannot go on.
#[derive(Debug)]
pub enum Fault {
    /// This cycle is lost, the stage is well.
    Cycle(String),
    /// The stage has to end.
    Fatal(anyhow::Error),
}

impl From<IpcError> for Fault {
    fn from(error: IpcError) -> Self {
        match error {
            IpcError::Full { .. } | IpcError::NotReached { .. } | IpcError::Message { .. } => {
                Self::Cycle(chain(&error))
            }
            _ => Self::Fatal(error.into()),
        }
    }
}

/// An error with all its sources in one line.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(inner) = source {
        let said = inner.to_string();
        if !text.contains(&said) {
            text.push_str(": ");
            text.push_str(&said);
        }
        source = inner.source();
    }
    text
}

/// The cycle is lost because of an error.
pub fn lost(error: &dyn std::error::Error) -> Fault {
    Fault::Cycle(chain(error))
}

/// The work of one kind of stage.
pub trait Worker {
    /// Connects the inboxes to senders that came since.
    fn connect(&self) -> Result<(), IpcError>;

    /// A cycle starts; whatever an older one left is forgotten.
    fn begin(&mut self, link: &mut Link) -> Result<(), Fault>;

    /// Takes one message or does one activation; `false` when there is nothing to do.
    fn step(&mut self, link: &mut Link) -> Result<bool, Fault>;

    /// A cycle was aborted.
    fn forget(&mut self);

    /// When to be called although nobody rings (monotonic clock, ns).
    fn due_ns(&self) -> Option<u64> {
        None
    }
}

/// Runs a stage until the supervisor ends it.
pub fn run(args: &StageArgs) -> Result<()> {
    os::ignore_interrupts();
    ensure!(os::die_with_parent(args.parent)?, "the supervisor {} is gone", args.parent);
    let options = Options { cell: Some(args.cell.clone()), watch: args.watch, record: args.record.is_some() };
    let cell = graph::load(&args.config, &options)?;
    ensure!(
        cell.config.sha256 == args.config_sha256 && cell.config.rig_sha256 == args.rig_sha256,
        "{} or its rig file was changed while the cell runs; stop the cell and start it again",
        args.config.display()
    );
    pin(&cell, args)?;
    let mut link = Link::join(args, cell)?;
    let ended = worker(args, &link).and_then(|mut worker| serve(&mut link, worker.as_mut()));
    if let Err(error) = &ended {
        // The last words of a stage, for the outcome of the cycle; if they cannot be said, the exit code speaks.
        let _ = link.failed(0, &format!("{error:#}"));
    }
    ended
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

fn serve(link: &mut Link, worker: &mut dyn Worker) -> Result<()> {
    link.ready(0)?;
    loop {
        while let Some(message) = link.control.receive()? {
            let (command, cycle) = (message.header().command()?, message.header().cycle);
            drop(message);
            match command {
                Command::Shutdown => return Ok(()),
                Command::Connect => {
                    worker.connect()?;
                    link.ready(cycle)?;
                }
                Command::Abort => {
                    link.gate.end(cycle);
                    worker.forget();
                }
                Command::Start => {
                    link.gate.start(cycle);
                    link.idle_from_now();
                    let begun = worker.begin(link);
                    settle(link, worker, begun.map(|()| true))?;
                }
            }
        }
        let progress = match link.gate.current() {
            Some(_) => {
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
