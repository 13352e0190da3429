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
mod feed;
mod fusion;
#[cfg(feature = "opcua")]
mod gateway;
mod gateway_arguments;
mod inspection;
mod json;
mod link;
mod log;
mod matching;
mod monitor;
mod opcua_command;
mod operate;
mod panic_drill;
mod part_files;
mod projection;
mod record;
mod result_formats;
mod retention;
mod run;
mod run_files;
mod run_folder;
mod schedule_chart;
mod schedule_command;
mod schedule_hosts;
mod schedule_json;
mod schedule_memory;
mod schedule_together;
mod software;
mod stage;
mod stage_main;
mod status;
mod supervisor;
mod terminal;
mod trigger_command;

use anyhow::Result;
use clap::{CommandFactory as _, Parser, Subcommand};
use cli::generate;
use std::path::Path;
use std::process::ExitCode;

/// Multi-view fringe projection measuring cell.
///
/// Exit codes: 0 all cycles are ok and pass, 1 a cycle failed or did not pass, 2 invalid input or lost output.
#[derive(Debug, Parser)]
#[command(version = env!("FRINGECELL_VERSION_LINE"), max_term_width = 100)]
struct Cli {
    /// Check the arguments and end: for the test of the documentation.
    #[arg(long, hide = true)]
    parse_only: bool,
    #[command(flatten)]
    global: cli::Global,
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
    /// Show the static schedule of a cell, or why it cannot run. Exit code 1: measured times exceed its limits, or projectors that show together meet.
    Schedule(schedule_command::ScheduleArgs),
    /// Show the status of a running cell.
    Status(status::StatusArgs),
    /// Inspect a part with a serving cell. Exit codes: 0 the part passes, 1 it does not, 2 the request is refused.
    Trigger(trigger_command::TriggerArgs),
    /// Start a job of a serving cell: part after part, until `finish` or for a number of cycles.
    Start(operate::StartArgs),
    /// End the job of a serving cell after its cycle.
    Finish(operate::CellArgs),
    /// End the job of a serving cell and its cycle now.
    Abort(operate::CellArgs),
    /// Halt a serving cell: it takes no jobs until `reset`.
    Halt(operate::CellArgs),
    /// Make a halted cell, or one in error, ready again.
    Reset(operate::CellArgs),
    /// Make a recipe of a serving cell selectable.
    Prepare(operate::RecipeArgs),
    /// Make a recipe of a serving cell not selectable.
    Unprepare(operate::RecipeArgs),
    /// Restart a stage of a running cell.
    Restart(operate::RestartArgs),
    /// Stop a running cell.
    Stop(operate::CellArgs),
    /// Serve a cell to machines: OPC UA for Machine Vision, until Ctrl-C. The cell may start and end meanwhile.
    Opcua(gateway_arguments::GatewayArgs),
    /// Print the completions of a shell: fringecell completions bash > /etc/bash_completion.d/fringecell
    Completions(generate::Completions),
    /// Write the man pages.
    Man(generate::Man),
    /// Run one stage; used by the supervisor.
    #[command(hide = true)]
    Stage(stage::StageArgs),
    /// Serve the live page and the metrics; used by the supervisor.
    #[command(hide = true)]
    Monitor(monitor::MonitorArgs),
}

fn main() -> ExitCode {
    ipc::os::report_file_size_limit();
    ipc::os::raise_open_files();
    if !ipc::os::had_stdout() {
        cli::output::without_stdout();
    }
    let Cli { parse_only, force, command, .. } = match cli::parse() {
        Ok(cli) => cli,
        Err(code) => return ExitCode::from(code),
    };
    if parse_only {
        return ExitCode::SUCCESS;
    }
    if force {
        files::guard::replace_anything();
    }
    log::to_stderr(!matches!(command, Command::Stage(_) | Command::Monitor(_)));
    ExitCode::from(cli::exit_code(execute(&command)))
}

fn execute(command: &Command) -> Result<u8> {
    use supervisor::protocol::Request;
    match command {
        Command::Demo(args) => demo::demo(args),
        Command::Run(args) => run::run(args, None),
        Command::Stage(args) => stage_main::run(args).map(|()| 0),
        Command::Monitor(args) => monitor::run(args).map(|()| 0),
        Command::Schedule(args) => schedule_command::schedule(args),
        Command::Status(args) => status::status(args).map(|()| 0),
        Command::Trigger(args) => trigger_command::trigger(args),
        Command::Start(args) => operate::start(args),
        Command::Finish(args) => operate::send(args, &Request::Finish {}),
        Command::Abort(args) => operate::send(args, &Request::Abort {}),
        Command::Halt(args) => operate::send(args, &Request::Halt {}),
        Command::Reset(args) => operate::send(args, &Request::Reset {}),
        Command::Prepare(args) => operate::prepare(args, true),
        Command::Unprepare(args) => operate::prepare(args, false),
        Command::Restart(args) => operate::restart(args),
        Command::Stop(args) => operate::stop(args),
        Command::Opcua(args) => opcua_command::opcua(args),
        Command::Completions(args) => {
            generate::print_completions(Cli::command(), args.shell);
            Ok(0)
        }
        Command::Man(args) => write_man_pages(&args.out),
    }
}

fn write_man_pages(folder: &Path) -> Result<u8> {
    files::atomic::create_dir(folder)?;
    for (name, page) in generate::man_pages(Cli::command())? {
        files::atomic::write(&folder.join(&name), &page)?;
        terminal::print_line(&folder.join(name).display().to_string());
    }
    Ok(0)
}
