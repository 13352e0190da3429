//! `fringetool cmm-compare`: measured features against those of a coordinate measuring machine, as in the thesis' tables
//! 4.5, 4.6 and 5.2.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use files::cmm::{COVERAGE_FACTOR, CmmValue};
use metrology::uncertainty::{self, Uncertain};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Result of `fringetool measure --json` or of a cycle (`result.json`).
    result: PathBuf,
    /// Results of the machine: CSV with the columns name, value, unit and u (standard) or U (k = 2).
    cmm: PathBuf,
    /// Write the comparison as a table to this file (CSV).
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The keys of a result that are read; others are ignored.
#[derive(Deserialize)]
struct Measured {
    features: Vec<Feature>,
}

#[derive(Deserialize)]
struct Feature {
    name: String,
    value: Option<f64>,
    unit: String,
    u: Option<f64>,
}

/// A line of the table; uncertainties are expanded ones, k = 2.
#[derive(Serialize)]
struct Line {
    name: String,
    unit: String,
    cmm: f64,
    #[serde(rename = "U_cmm")]
    u_cmm: f64,
    measured: f64,
    #[serde(rename = "U_measured")]
    u_measured: f64,
    deviation: f64,
    #[serde(rename = "U_deviation")]
    u_deviation: f64,
    #[serde(rename = "E_n")]
    e_n: f64,
}

/// Comparison of all features.
#[derive(Serialize)]
struct Comparison {
    coverage_factor: f64,
    lines: Vec<Line>,
    /// |E_n| ≤ 1 for all lines.
    agrees: bool,
    /// Features that have no counterpart on the other side, or no value.
    not_compared: Vec<String>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [("--csv", args.csv.as_deref()), ("--json", args.json.as_deref())];
    check_outputs(&outputs, &[&args.result, &args.cmm], None)?;
    let measured: Measured = files::result::read_json(&args.result)?;
    let reference = files::cmm::read_values(&args.cmm)?;
    let comparison = compare(args, &measured, &reference)?;
    if let Some(path) = &args.csv {
        write(path, &comparison)?;
    }
    emit(args.json.as_deref(), &comparison)?;
    print(&comparison);
    Ok(if comparison.agrees { Outcome::Done } else { Outcome::LimitFailed })
}

fn compare(args: &Args, measured: &Measured, reference: &[CmmValue]) -> Result<Comparison> {
    let (mut lines, mut not_compared) = (Vec::new(), Vec::new());
    for cmm in reference {
        let Some(feature) = measured.features.iter().find(|f| f.name == cmm.name) else {
            not_compared.push(format!("{}: not in the result", cmm.name));
            continue;
        };
        if feature.unit != cmm.unit {
            bail!(
                "{}: {} is in {}, but in {} in {}; write both in one unit",
                args.cmm.display(),
                cmm.name,
                cmm.unit,
                feature.unit,
                args.result.display()
            );
        }
        match (feature.value, feature.u) {
            (Some(value), Some(u)) => {
                lines.push(
                    line(cmm, value, u)
                        .with_context(|| format!("{}: {}", args.result.display(), cmm.name))?,
                );
            }
            _ => not_compared.push(format!("{}: not measured", cmm.name)),
        }
    }
    let missing = measured.features.iter().filter(|f| reference.iter().all(|cmm| cmm.name != f.name));
    not_compared.extend(missing.map(|f| format!("{}: not in the table of the machine", f.name)));
    if lines.is_empty() {
        let known: Vec<&str> = measured.features.iter().map(|f| f.name.as_str()).collect();
        bail!(
            "{}: no line names a measured feature of {}; measured: {}",
            args.cmm.display(),
            args.result.display(),
            known.join(", ")
        );
    }
    let agrees = lines.iter().all(|line| line.e_n.abs() <= 1.0);
    Ok(Comparison { coverage_factor: COVERAGE_FACTOR, lines, agrees, not_compared })
}

/// Deviation and normalised error of a feature with standard uncertainty `u`.
fn line(cmm: &CmmValue, value: f64, u: f64) -> Result<Line> {
    let measured = Uncertain { value, expanded_uncertainty: COVERAGE_FACTOR * u };
    let reference = Uncertain { value: cmm.value, expanded_uncertainty: cmm.expanded_uncertainty };
    let found = uncertainty::compare(measured, reference)?;
    Ok(Line {
        name: cmm.name.clone(),
        unit: cmm.unit.clone(),
        cmm: cmm.value,
        u_cmm: cmm.expanded_uncertainty,
        measured: value,
        u_measured: measured.expanded_uncertainty,
        deviation: found.deviation,
        u_deviation: found.deviation_expanded_uncertainty,
        e_n: found.normalised_error,
    })
}

fn print(comparison: &Comparison) {
    let wide = comparison.lines.iter().map(|l| l.name.chars().count()).max().unwrap_or(0).max(7);
    println!(
        "{:wide$}  {:<19}  {:<19}  {:<20}  E_n   (± expanded, k = 2)",
        "feature", "machine", "measured", "deviation"
    );
    for line in &comparison.lines {
        let Line { name, unit, cmm, u_cmm, measured, u_measured, deviation, u_deviation, e_n } = line;
        println!(
            "{name:wide$}  {cmm:>9.4} ± {u_cmm:<7.4}  {measured:>9.4} ± {u_measured:<7.4}  {deviation:>+9.4} ± {u_deviation:<7.4} {unit:<3}  \
             {e_n:>+6.3}{}",
            if e_n.abs() > 1.0 { "  disagrees" } else { "" }
        );
    }
    for line in &comparison.not_compared {
        println!("not compared: {line}");
    }
}

fn write(path: &std::path::Path, comparison: &Comparison) -> Result<()> {
    let header =
        ["name", "unit", "cmm", "U_cmm", "measured", "U_measured", "deviation", "U_deviation", "E_n"];
    let row = |line: &Line| {
        let numbers = [
            line.cmm,
            line.u_cmm,
            line.measured,
            line.u_measured,
            line.deviation,
            line.u_deviation,
            line.e_n,
        ];
        let mut row = vec![line.name.clone(), line.unit.clone()];
        row.extend(numbers.map(|v| format!("{v:.5}")));
        row
    };
    Ok(files::cmm::write_table(path, &header, &comparison.lines.iter().map(row).collect::<Vec<_>>())?)
}
