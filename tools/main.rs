//! `fringetool`: simulate, decode, reconstruct, import and measure. One module per subcommand: arguments in, report out.

mod acceptance_report;
mod bench;
mod calibrate;
mod check_rig;
mod cmm_compare;
mod cmm_plan;
mod compare;
mod decode;
mod export;
mod filters;
mod fit;
mod flatness;
mod focus;
mod gamma;
mod glob;
mod import;
mod import_rig;
mod measure;
mod numbers;
mod phase_method;
mod pipeline;
mod plan_patterns;
mod progress;
mod reconstruct;
mod reference_plane;
mod register;
mod replay;
mod report;
mod rotation_stage;
mod simulate;
mod simulate_test;
mod surface;
mod uncertainty;
mod unwrap;
mod vdi2634;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

#[derive(Parser)]
#[command(
    name = "fringetool",
    version,
    about = "Offline tools of the fringecell measuring cell",
    max_term_width = 100
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Write a recording of the digital twin, and its truth apart.
    Simulate(simulate::Args),
    /// Decode a recording: phase, modulation and fringe order as images.
    Decode(decode::Args),
    /// Unwrap a wrapped phase by its neighbours: branch cuts, quality, reliability, least squares.
    Unwrap(unwrap::Args),
    /// Turn a recording into a point cloud.
    Reconstruct(reconstruct::Args),
    /// Height from the phase difference to a reference plane: calibrate with planes, measure.
    ReferencePlane(reference_plane::Args),
    /// Find the axis of a rotation stage; bring views at known angles together.
    RotationStage(rotation_stage::Args),
    /// Fit a sphere, plane, cylinder, cone, circle, line or torus to the points of a cloud.
    Fit(fit::Args),
    /// Flatness of a surface from one or more repeats: numbers by their definitions, maps and histograms.
    Flatness(flatness::Args),
    /// Hold a cloud against a cloud or a CAD mesh: signed deviations, M3C2, report.
    Compare(compare::Args),
    /// Bring clouds onto a reference (point-to-plane ICP), with its uncertainty.
    Register(register::Args),
    /// Evaluate an inspection plan on a cloud: features, uncertainties, verdict.
    Measure(measure::Args),
    /// Evaluate an acceptance test following VDI/VDE 2634 or ISO 10360-13 from its plan.
    #[command(name = "vdi2634")]
    Vdi2634(vdi2634::Args),
    /// Simulate a whole acceptance test on the digital twin: recordings and plan.
    SimulateTest(simulate_test::Args),
    /// Say where a coordinate measuring machine probes spheres, planes, cylinders or a whole part, as CSV.
    CmmPlan(cmm_plan::Args),
    /// Hold measured features against a machine's: deviations, expanded uncertainties, normalised errors.
    CmmCompare(cmm_compare::Args),
    /// Turn other people's image files and OpenCV calibration into a recording and a rig file.
    Import(import::Args),
    /// Turn an OpenCV calibration (YAML or XML) into a rig file.
    ImportRig(import_rig::Args),
    /// Write the pairs of a rig file in OpenCV's keys (YAML or XML).
    Export(export::Args),
    /// Characterise all cameras and projectors from pictures of a target, in one adjustment.
    Calibrate(calibrate::Args),
    /// Tell a knocked or warm camera from a healthy rig, on any object lit with both fringe directions.
    CheckRig(check_rig::Args),
    /// Measure a projector's response from grey levels and write the pattern correction.
    Gamma(gamma::Args),
    /// Find best focus and depth of focus from pictures of a projected checkerboard.
    Focus(focus::Args),
    /// Evaluate a measurement uncertainty budget by the GUM, and by Monte Carlo.
    Uncertainty(uncertainty::Args),
    /// Propose period, steps and code for a projector, a noise and a wanted uncertainty.
    PlanPatterns(plan_patterns::Args),
    /// Write the report of an acceptance test (HTML, PDF, CSV, QIF, DFQ) from its result.
    Report(acceptance_report::Args),
    /// Run a cycle record again and compare every output with it.
    Replay(replay::Args),
    /// Measure accuracy on the twin, or speed on this machine.
    Bench(bench::Args),
}

/// How a command ended that did not break.
pub enum Outcome {
    /// Exit code 0.
    Done,
    /// Exit code 1: the measurement or test fails its limit.
    LimitFailed,
}

fn main() -> ExitCode {
    ipc::os::restore_sigpipe();
    let result = match Cli::parse().command {
        Command::Simulate(args) => simulate::run(&args),
        Command::Decode(args) => decode::run(&args),
        Command::Unwrap(args) => unwrap::run(&args),
        Command::Reconstruct(args) => reconstruct::run(&args),
        Command::ReferencePlane(args) => reference_plane::run(&args),
        Command::RotationStage(args) => rotation_stage::run(&args),
        Command::Fit(args) => fit::run(&args),
        Command::Flatness(args) => flatness::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Register(args) => register::run(&args),
        Command::Measure(args) => measure::run(&args),
        Command::Vdi2634(args) => vdi2634::run(&args),
        Command::SimulateTest(args) => simulate_test::run(&args),
        Command::CmmPlan(args) => cmm_plan::run(&args),
        Command::CmmCompare(args) => cmm_compare::run(&args),
        Command::Import(args) => import::run(&args),
        Command::ImportRig(args) => import_rig::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::CheckRig(args) => check_rig::run(&args),
        Command::Gamma(args) => gamma::run(&args),
        Command::Focus(args) => focus::run(&args),
        Command::Uncertainty(args) => uncertainty::run(&args),
        Command::PlanPatterns(args) => plan_patterns::run(&args),
        Command::Report(args) => acceptance_report::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Bench(args) => bench::run(&args),
    };
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::LimitFailed) => ExitCode::from(1),
        Err(error) => {
            // The one place where an error is printed: the whole chain on one line.
            eprintln!("fringetool: {error:#}");
            ExitCode::from(2)
        }
    }
}
