//! `fringetool`: simulate, decode, reconstruct, import and measure. One module per subcommand: arguments in, report out.

/// Prints text for people, instead of the macro of the standard library, which panics on a full device: see [`cli::output`].
macro_rules! println {
    () => {
        println!("")
    };
    ($($text:tt)*) => {{
        let _ = cli::text(format_args!("{}\n", cli::output::printable(&format!($($text)*))));
    }};
}

/// As `println`, without the end of the line.
macro_rules! print {
    ($($text:tt)*) => {{
        let _ = cli::text(format_args!($($text)*));
    }};
}

/// Prints a note: see [`cli::output`].
macro_rules! eprintln {
    ($($text:tt)*) => {
        cli::note(format_args!("{}\n", cli::output::printable(&format!($($text)*))))
    };
}

mod acceptance_report;
mod allocator;
mod bench;
mod bundled;
mod calibrate;
mod cameras;
mod check_rig;
mod cmm_compare;
mod cmm_plan;
mod compare;
mod convert;
mod correct_rig;
mod decode;
mod doctor;
mod explore;
mod export;
mod expose;
mod filters;
mod fit;
mod flatness;
mod focus;
mod gamma;
mod glob;
mod import;
mod import_rig;
mod live;
mod measure;
mod new_cell;
mod new_plan;
mod numbers;
mod patterns;
mod phase_method;
mod pipeline;
mod place;
mod plan_from_cad;
mod plan_patterns;
mod plan_text;
mod plan_views;
mod preview;
mod progress;
mod reconstruct;
mod reference_plane;
mod register;
mod replay;
mod report;
mod rotation_stage;
mod serve_camera;
mod simulate;
mod simulate_test;
mod software;
mod spc;
mod surface;
mod uncertainty;
mod unwrap;
mod vdi2634;

use anyhow::{Result, bail, ensure};
use clap::{CommandFactory as _, Parser, Subcommand};
use cli::generate;
use std::path::Path;
use std::process::ExitCode;

/// Offline tools of the fringecell measuring cell.
///
/// Exit codes: 0 done, 1 the measurement or test fails its limit, 2 invalid input or lost output.
#[derive(Parser)]
#[command(name = "fringetool", version = env!("FRINGECELL_VERSION_LINE"), max_term_width = 100)]
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

#[derive(Subcommand)]
enum Command {
    /// Simulate a recording with the digital twin; the true values go to a separate file.
    Simulate(simulate::Args),
    /// Decode a recording into images of phase, modulation and fringe order.
    Decode(decode::Args),
    /// Explore a folder of frames: which patterns they show, and the recording that it could be.
    Explore(explore::Args),
    /// Unwrap a wrapped phase spatially: branch cuts, quality, reliability, least squares.
    Unwrap(unwrap::Args),
    /// Reconstruct a point cloud from a recording.
    Reconstruct(reconstruct::Args),
    /// Measure heights by the phase difference to a reference plane: calibrate with planes, measure.
    ReferencePlane(reference_plane::Args),
    /// Calibrate the axis of a rotation stage, and merge views taken at known angles.
    RotationStage(rotation_stage::Args),
    /// Fit a sphere, plane, cylinder, cone, circle, line or torus to the points of a cloud.
    Fit(fit::Args),
    /// Evaluate the flatness of a surface from one or more repeats: values, maps and histograms.
    Flatness(flatness::Args),
    /// Compare two clouds, or a cloud with a CAD mesh: signed deviations, M3C2, report.
    Compare(compare::Args),
    /// Convert a cloud: E57 or PLY, thinned, or a mesh of triangles (PLY, STL) with its deviation from the points
    Convert(convert::Args),
    /// Register clouds to a reference from any pose (search, point-to-plane ICP), with the covariance of the transform.
    Register(register::Args),
    /// Draft an inspection plan from a cloud: the planes, spheres, cylinders and cones that it shows.
    NewPlan(new_plan::Args),
    /// Draft an inspection plan from CAD (STEP): its planes, cylinders, cones, spheres and tori, with general tolerances.
    PlanFromCad(plan_from_cad::Args),
    /// Evaluate an inspection plan on a cloud: features, uncertainties, verdict.
    Measure(measure::Args),
    /// Evaluate the parts of a cell: control charts, capability, and studies of the gauge.
    Spc(spc::Args),
    /// Find the part of an inspection plan in a first cloud and write its placement into the plan.
    Place(place::Args),
    /// Evaluate an acceptance test following VDI/VDE 2634 or ISO 10360-13 from its plan.
    #[command(name = "vdi2634")]
    Vdi2634(vdi2634::Args),
    /// Simulate a whole acceptance test on the digital twin: recordings and plan.
    SimulateTest(simulate_test::Args),
    /// Plan the probing points of a coordinate measuring machine on spheres, planes, cylinders or a whole part (CSV).
    CmmPlan(cmm_plan::Args),
    /// Compare measured features with those of a coordinate measuring machine: deviations, normalised errors.
    CmmCompare(cmm_compare::Args),
    /// List the GenICam cameras on the network and, in a program built with Aravis, on USB: address, serial number, name, model.
    Cameras(cameras::Args),
    /// Check whether this computer and its cameras are ready for a cell; each fault has the command that mends it.
    Doctor(doctor::Args),
    /// Find the cameras on the network and write the configuration of a cell, with comments.
    NewCell(new_cell::Args),
    /// Find the exposure time of each camera from what it sees of the patterns.
    Expose(expose::Args),
    /// Show the live picture of a camera: in the terminal, as a file, in a browser.
    Preview(preview::Args),
    /// Serve the cameras of a digital twin as GigE Vision cameras, for tests without hardware.
    ServeCamera(serve_camera::Args),
    /// Import image files of another system and an OpenCV calibration as a recording and a rig file.
    Import(import::Args),
    /// Convert a calibration of OpenCV, ROS, Kalibr, mrcal or MATLAB into a rig file.
    ImportRig(import_rig::Args),
    /// Export a rig file for OpenCV, ROS or Kalibr.
    Export(export::Args),
    /// Calibrate all cameras and projectors from images of a target, in one adjustment.
    Calibrate(calibrate::Args),
    /// Detect camera drift, on any object lit with fringes in both directions.
    CheckRig(check_rig::Args),
    /// Correct a rig of which one view has drifted, from fringes on any object.
    CorrectRig(correct_rig::Args),
    /// Measure a projector's response from grey levels and write the pattern correction.
    Gamma(gamma::Args),
    /// Find best focus and depth of focus from images of a projected checkerboard.
    Focus(focus::Args),
    /// Evaluate a measurement uncertainty budget by the GUM and by Monte Carlo (GUM Supplement 1).
    Uncertainty(uncertainty::Args),
    /// Propose period, steps and code from the projector, the noise and the wanted uncertainty.
    PlanPatterns(plan_patterns::Args),
    /// Plan views from CAD: which pairs see which part of the surface, expected uncertainties, further pairs.
    PlanViews(plan_views::Args),
    /// Write the images that the projectors of a cell show, with a list of what each of them is.
    Patterns(patterns::Args),
    /// Write the report of an acceptance test (HTML, PDF, CSV, QIF, DFQ, DCC) from its result, or the DCC of a calibrated rig.
    Report(acceptance_report::Args),
    /// Run a cycle record again and compare every output with it.
    Replay(replay::Args),
    /// Measure accuracy on the twin, or speed on this machine.
    Bench(bench::Args),
    /// Print the completions of a shell: fringetool completions bash > /etc/bash_completion.d/fringetool
    Completions(generate::Completions),
    /// Write the man pages.
    Man(generate::Man),
}

/// How a command ended that did not break.
pub enum Outcome {
    /// The command did its work: exit code 0.
    Done,
    /// Exit code 1: the measurement or test fails its limit.
    LimitFailed,
}

fn main() -> ExitCode {
    ipc::os::report_file_size_limit();
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
    let code = start_threads().and_then(|()| execute(&command)).map(|outcome| match outcome {
        Outcome::Done => 0,
        Outcome::LimitFailed => cli::LIMIT_FAILED,
    });
    ExitCode::from(cli::exit_code(code))
}

/// Most threads: more than the machine has cores slow it down, and each needs memory.
const MAX_THREADS: usize = 512;

/// Starts the threads of the kernels, as many as RAYON_NUM_THREADS states or as there are cores; fewer where the system has no more.
fn start_threads() -> Result<()> {
    let wanted = match std::env::var("RAYON_NUM_THREADS") {
        Ok(text) => match text.trim().parse::<usize>() {
            Ok(count) if count <= MAX_THREADS => count,
            _ => bail!("RAYON_NUM_THREADS={text:?}: 0 (as many as cores) to {MAX_THREADS} are possible"),
        },
        Err(_) => 0,
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut count = if wanted == 0 { cores.min(MAX_THREADS) } else { wanted };
    // The global pool can be built only once, so another one shows whether the system has the threads. The results do not depend
    // on their number.
    while let Err(error) = rayon::ThreadPoolBuilder::new().num_threads(count).build() {
        ensure!(count > 1, "the system has no thread for this program: {error}");
        count /= 2;
    }
    Ok(rayon::ThreadPoolBuilder::new().num_threads(count).build_global()?)
}

fn execute(command: &Command) -> Result<Outcome> {
    match command {
        Command::Simulate(args) => simulate::run(args),
        Command::Decode(args) => decode::run(args),
        Command::Explore(args) => explore::run(args),
        Command::Unwrap(args) => unwrap::run(args),
        Command::Reconstruct(args) => reconstruct::run(args),
        Command::ReferencePlane(args) => reference_plane::run(args),
        Command::RotationStage(args) => rotation_stage::run(args),
        Command::Fit(args) => fit::run(args),
        Command::Flatness(args) => flatness::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Convert(args) => convert::run(args),
        Command::Register(args) => register::run(args),
        Command::NewPlan(args) => new_plan::run(args),
        Command::PlanFromCad(args) => plan_from_cad::run(args),
        Command::Measure(args) => measure::run(args),
        Command::Spc(args) => spc::run(args),
        Command::Place(args) => place::run(args),
        Command::Vdi2634(args) => vdi2634::run(args),
        Command::SimulateTest(args) => simulate_test::run(args),
        Command::CmmPlan(args) => cmm_plan::run(args),
        Command::CmmCompare(args) => cmm_compare::run(args),
        Command::Cameras(args) => cameras::run(args),
        Command::Doctor(args) => doctor::run(args),
        Command::NewCell(args) => new_cell::run(args),
        Command::Expose(args) => expose::run(args),
        Command::Preview(args) => preview::run(args),
        Command::ServeCamera(args) => serve_camera::run(args),
        Command::Import(args) => import::run(args),
        Command::ImportRig(args) => import_rig::run(args),
        Command::Export(args) => export::run(args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::CheckRig(args) => check_rig::run(args),
        Command::CorrectRig(args) => correct_rig::run(args),
        Command::Gamma(args) => gamma::run(args),
        Command::Focus(args) => focus::run(args),
        Command::Uncertainty(args) => uncertainty::run(args),
        Command::PlanPatterns(args) => plan_patterns::run(args),
        Command::PlanViews(args) => plan_views::run(args),
        Command::Patterns(args) => patterns::run(args),
        Command::Report(args) => acceptance_report::run(args),
        Command::Replay(args) => replay::run(args),
        Command::Bench(args) => bench::run(args),
        Command::Completions(args) => {
            generate::print_completions(Cli::command(), args.shell);
            Ok(Outcome::Done)
        }
        Command::Man(args) => write_man_pages(&args.out),
    }
}

fn write_man_pages(folder: &Path) -> Result<Outcome> {
    files::atomic::create_dir(folder)?;
    for (name, page) in generate::man_pages(Cli::command())? {
        files::atomic::write(&folder.join(&name), &page)?;
        println!("{}", folder.join(name).display());
    }
    Ok(Outcome::Done)
}
