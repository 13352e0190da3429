//! `fringecell`: measures parts with cameras and projectors, from patterns to a verdict.
//!
//! This binary is all processes of a cell: `run` is the supervisor, which starts itself again as each stage. The modules
//! named after stages hold their wiring; mathematics is in `fringe`, shared memory in `ipc`, files in `rig`.

#[cfg(feature = "count-allocations")]
mod allocations;
mod capture;
mod client;
mod control;
mod decode;
mod demo;
mod fusion;
mod inspection;
mod log;
mod matching;
mod output;
mod plan_picture;
mod plan_table;
mod print;
mod projection;
mod record;
mod run;
mod stage;
mod stages;
mod status;
mod supervisor;
mod trigger;

// What the processes compute lies in the library, where `fringetool replay` finds it too.
use flow::{cycle_number, drivers, graph, judgement, kernels, outputs, schedule};

use anyhow::Result;
use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// The input cannot be used.
const BAD_INPUT: u8 = 2;

/// Multi-view fringe projection metrology cell.
///
/// Exits with 0 when all cycles are ok and pass, 1 when the measurement fails, 2 on bad input.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Measure a simulated part with a simulated cell and compare with the truth.
    Demo(demo::DemoArgs),
    /// Run a cell.
    Run(run::RunArgs),
    /// Print the static schedule of a cell, or why it cannot run. Exits with 1 when measured times do not keep its limits.
    Schedule(plan_table::ScheduleArgs),
    /// Say how a running cell is.
    Status(status::StatusArgs),
    /// Have a cell that serves inspect a part. Exits with 0 when it passes, 1 when not, 2 when the request is refused.
    Trigger(trigger::TriggerArgs),
    /// Restart a stage of a running cell.
    Restart {
        /// Name of the stage, as in `status`.
        stage: String,
        /// Which cell, if several run.
        #[arg(long, value_name = "NAME")]
        cell: Option<String>,
    },
    /// Stop a running cell.
    Stop {
        /// Which cell, if several run.
        #[arg(long, value_name = "NAME")]
        cell: Option<String>,
    },
    /// A process of a running cell; the supervisor starts these.
    #[command(hide = true)]
    Stage(stage::StageArgs),
}

fn main() -> ExitCode {
    let command = Cli::parse().command;
    log::to_stderr(!matches!(command, Command::Stage(_)));
    match execute(&command) {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn execute(command: &Command) -> Result<u8> {
    let text = match command {
        Command::Demo(args) => return demo::demo(args),
        Command::Run(args) => return run::run(args, None),
        Command::Stage(args) => return stages::run(args).map(|()| 0),
        Command::Schedule(args) => {
            let (text, kept) = plan_table::schedule(args)?;
            print::say(text.trim_end());
            return Ok(u8::from(!kept));
        }
        Command::Status(args) => return status::status(args).map(|()| 0),
        Command::Trigger(args) => return trigger::trigger(args),
        Command::Restart { stage, cell } => client::restart(cell.as_deref(), stage)?,
        Command::Stop { cell } => client::stop(cell.as_deref())?,
    };
    print::say(text.trim_end());
    Ok(0)
}
