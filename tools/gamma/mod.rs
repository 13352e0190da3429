//! `fringetool gamma`: the projector's response, its correction, and what the correction brings.

mod fringes;
mod input;
mod levels;
mod sheet;

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use characterise::response::{Roi, waveform};
use files::correction::{PatternCorrection, TableSource, write_correction};
use fringe::pattern::LevelTable;
use input::ResponseFrames;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// A recording with grey levels ({ set = "ramp", levels = 52 }; further fringes with fine steps show the waveform), or
    /// with fringes, white and black.
    recording: Option<PathBuf>,
    /// Images instead of a recording, one for each level: patterns with `*`, in the order of the numbers in the names.
    #[arg(long, value_name = "PATTERN", num_args = 1..)]
    images: Vec<String>,
    /// Projected level of each image, 0 … 255 (or 0 … 1 if none is above 1): 0,5,10,… or 0:255:5. With a recording: of its
    /// frames, where the sequence does not contain the levels.
    #[arg(long, value_name = "LIST", allow_hyphen_values = true)]
    levels: Option<String>,
    /// Projector of the recording; by default the first.
    #[arg(long, value_name = "NAME")]
    projector: Option<String>,
    /// Camera of the recording; by default the first.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Region whose mean is evaluated, px; by default the middle 100 × 100 px (fringes: the whole frame).
    #[arg(long, value_name = "x,y,w,h")]
    roi: Option<Roi>,
    /// Number of steps N of the phase whose error is reported.
    #[arg(long, value_name = "N", default_value_t = 3)]
    steps: u32,
    /// Bit depth of the projector: the table has 2^bits entries.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u8).range(8..=16))]
    bits: u8,
    /// What the table inverts: the measured response, or the polynomial of order 7 (eq. 3.2).
    #[arg(long, value_enum, default_value = "response")]
    table: Inverts,
    /// Exponent P with which the recorded fringes were encoded, as level^(1/P); for recordings without grey levels.
    #[arg(long, value_name = "P", default_value_t = 1.0)]
    encoded_gamma: f64,
    /// Pattern correction to write (TOML, docs/formats.md), for `pattern_correction` of a configuration and for `simulate`.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write a report with response, residuals and harmonics (HTML).
    #[arg(long, alias = "html", value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Inverts {
    Response,
    Polynomial,
}

/// Harmonics and phase error that a response gives.
#[derive(Debug, Clone, Copy, Serialize)]
struct Waveform {
    /// Amplitudes of the 2nd to 5th harmonic relative to the first.
    harmonics: waveform::Harmonics,
    /// Error of the N-step phase.
    phase_error: waveform::PhaseError,
}

impl Waveform {
    fn of(steps: u32, light: impl Fn(f64) -> f64) -> Result<Self> {
        let phase_error = waveform::phase_error(steps, &light).context("--steps")?;
        Ok(Self { harmonics: waveform::harmonics(&light), phase_error })
    }
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let inputs: Vec<&Path> = args.recording.iter().map(PathBuf::as_path).collect();
    let outputs = [
        ("--out", args.out.as_deref()),
        ("--report", args.report.as_deref()),
        ("--json", args.json.as_deref()),
    ];
    check_outputs(&outputs, &inputs, None)?;
    if !(3..=64).contains(&args.steps) {
        bail!("--steps {}: must be 3 to 64", args.steps);
    }
    if !(0.1..=10.0).contains(&args.encoded_gamma) {
        bail!("--encoded-gamma {}: must be 0.1 to 10", args.encoded_gamma);
    }
    let seen = input::gather(args)?;
    if args.out.is_some() && seen.corrected {
        bail!(
            "{}: its patterns were corrected, so the response is not that of the projector; record without pattern_correction, or omit --out to see the residual error of the correction",
            seen.source
        );
    }
    if seen.stack.is_some() {
        let (result, correction) = levels::run(args, &seen)?;
        finish(args, &seen, &result, &correction, &sheet::of_levels(&seen.source, &result))?;
    } else {
        let (result, correction) = fringes::run(args, &seen)?;
        finish(args, &seen, &result, &correction, &sheet::of_fringes(&seen.source, &result))?;
    }
    Ok(Outcome::Done)
}

/// Writes the requested files and prints the result.
fn finish<T: Serialize>(
    args: &Args,
    seen: &ResponseFrames,
    result: &T,
    correction: &PatternCorrection,
    sheet: &report::plot::Sheet,
) -> Result<()> {
    if let Some(path) = &args.out {
        write_correction(path, correction)?;
        println!("{}", path.display());
    }
    if let Some(path) = &args.report {
        report::plot::write_sheet(path, sheet)?;
        println!("{}", path.display());
    }
    if seen.corrected {
        println!(
            "the projected patterns were corrected: the figures are the residual error of the correction"
        );
    }
    emit(args.json.as_deref(), result)
}

fn correction(
    seen: &ResponseFrames,
    source: TableSource,
    gamma: f64,
    coefficients: Option<Vec<f64>>,
    table: LevelTable,
) -> PatternCorrection {
    let mut provenance = toml::Table::new();
    provenance.insert("software".into(), format!("fringetool gamma {}", env!("CARGO_PKG_VERSION")).into());
    provenance.insert("source".into(), seen.source.clone().into());
    if let Some(camera) = &seen.camera {
        provenance.insert("camera".into(), camera.clone().into());
    }
    PatternCorrection {
        projector: seen.projector.clone(),
        source,
        gamma: Some(gamma),
        coefficients,
        table,
        provenance,
    }
}

/// Harmonics as one line.
fn percent(harmonics: &[f64]) -> String {
    harmonics.iter().map(|h| format!("{:.3} %", 100.0 * h)).collect::<Vec<_>>().join(", ")
}
