//! `fringecell`: measures parts with cameras and projectors, from patterns to a verdict.
//!
//! This program is every process of a cell: `run` is the supervisor, which starts the program again for each stage. The
//! modules named after stages connect topics to algorithms; what they compute is in `cell`, the algorithms are in `fringe`,
//! shared memory is in `ipc`, drivers are in `devices`, file formats are in `files`.

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
mod part_files;
mod projection;
mod record;
mod run;
mod run_files;
mod run_folder;
mod schedule_chart;
mod schedule_command;
mod software;
mod stage;
mod stage_main;
mod status;
mod supervisor;
mod terminal;
mod trigger;

use anyhow::Result;
use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Exit code for invalid input and for errors of the machine.
const BAD_INPUT: u8 = 2;

/// Multi-view fringe projection measuring cell.
///
/// Exit codes: 0 all cycles are ok and pass, 1 a cycle failed or did not pass, 2 invalid input.
#[derive(Debug, Parser)]
#[command(version = software::VERSION_LINE)]
struct Cli {
    /// Check the arguments and end: for the test of the documentation.
    #[arg(long, hide = true)]
    parse_only: bool,
    /// Replace existing output files of any kind. By default a file is replaced by its own kind only; inputs never are.
    #[arg(long, global = true)]
    force: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Measure a simulated part with a simulated cell and compare the result with the truth.
    Demo(demo::DemoArgs),
    /// Run a cell: a number of cycles, or as a service that inspects parts on request.
    Run(run::RunArgs),
    /// Show the static schedule of a cell, or why it cannot run. Exit code 1: measured times exceed its limits.
    Schedule(schedule_command::ScheduleArgs),
    /// Show the status of a running cell.
    Status(status::StatusArgs),
    /// Inspect a part with a serving cell. Exit codes: 0 the part passes, 1 it does not, 2 the request is refused.
    Trigger(trigger::TriggerArgs),
    /// Restart a stage of a running cell.
    Restart {
        /// Name of the stage, as shown by `status`.
        stage: String,
        /// Name of the cell, if several run.
        #[arg(long, value_name = "NAME")]
        cell: Option<String>,
    },
    /// Stop a running cell.
    Stop {
        /// Name of the cell, if several run.
        #[arg(long, value_name = "NAME")]
        cell: Option<String>,
    },
    /// Run one stage; used by the supervisor.
    #[command(hide = true)]
    Stage(stage::StageArgs),
}

fn main() -> ExitCode {
    let Cli { parse_only, force, command } = Cli::parse();
    if parse_only {
        return ExitCode::SUCCESS;
    }
    if force {
        files::guard::replace_anything();
    }
    log::to_stderr(!matches!(command, Command::Stage(_)));
    let result = execute(&command);
    if let Err(error) = &result {
        terminal::print_error(&format!("error: {error:#}"));
    } else if let Some(error) = terminal::output_error() {
        terminal::print_error(&format!("error: standard output: {error}"));
        return ExitCode::from(BAD_INPUT);
    }
    ExitCode::from(result.unwrap_or(BAD_INPUT))
}

fn execute(command: &Command) -> Result<u8> {
    let text = match command {
        Command::Demo(args) => return demo::demo(args),
        Command::Run(args) => return run::run(args, None),
        Command::Stage(args) => return stage_main::run(args).map(|()| 0),
        Command::Schedule(args) => {
            let (text, kept) = schedule_command::schedule(args)?;
            terminal::print_line(text.trim_end());
            return Ok(u8::from(!kept));
        }
        Command::Status(args) => return status::status(args).map(|()| 0),
        Command::Trigger(args) => return trigger::trigger(args),
        Command::Restart { stage, cell } => client::restart(cell.as_deref(), stage)?,
        Command::Stop { cell } => client::stop(cell.as_deref())?,
    };
    terminal::print_line(text.trim_end());
    Ok(0)
}
