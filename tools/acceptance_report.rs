//! `fringetool report`: every format of an acceptance test's report from its master.

use crate::Outcome;
use crate::report::check_outputs;
use anyhow::{Result, bail};
use metrology::acceptance::TestReport;
use report::Formats;
use report::acceptance::{Outputs, Parties, master_text, read_master, render_rig, write_all, write_master};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Result of an acceptance test (docs/formats.md): the --json file of `vdi2634`; or, for --dcc alone, a rig file.
    result: PathBuf,
    #[command(flatten)]
    files: Files,
    /// Day of the calibration, YYYY-MM-DD: for the DCC of a rig file, which states none.
    #[arg(long, value_name = "DAY", requires = "dcc")]
    date: Option<String>,
    /// Write the checked result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Where the formats go.
#[derive(clap::Args)]
pub struct Files {
    /// Write the report as one HTML file.
    #[arg(long, alias = "report", value_name = "FILE")]
    html: Option<PathBuf>,
    /// Write the report as PDF (A4).
    #[arg(long, value_name = "FILE")]
    pdf: Option<PathBuf>,
    /// Write a table with one line for each position and characteristic (CSV).
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write the results as QIF 3.0 (ISO 23952).
    #[arg(long, value_name = "FILE")]
    qif: Option<PathBuf>,
    /// Write the results in the Q-DAS ASCII transfer format.
    #[arg(long, value_name = "FILE")]
    dfq: Option<PathBuf>,
    /// Write the results as test report in the format of digital calibration certificates (DCC 3.1.2, PTB).
    #[arg(long, value_name = "FILE")]
    dcc: Option<PathBuf>,
    /// Name of the laboratory that tested, for the DCC.
    #[arg(long, value_name = "NAME", requires = "dcc")]
    laboratory: Option<String>,
    /// Name of the customer, for the DCC.
    #[arg(long, value_name = "NAME", requires = "dcc")]
    customer: Option<String>,
    /// Country of the test, for the DCC: two capital letters (ISO 3166-1).
    #[arg(long, value_name = "CC", requires = "dcc")]
    country: Option<String>,
}

impl Files {
    /// The files that the report writer takes.
    pub fn outputs(&self) -> Outputs<'_> {
        Outputs {
            formats: Formats {
                html: self.html.as_deref(),
                pdf: self.pdf.as_deref(),
                csv: self.csv.as_deref(),
                qif: self.qif.as_deref(),
                dfq: self.dfq.as_deref(),
            },
            dcc: self.dcc.as_deref(),
            parties: Parties {
                laboratory: self.laboratory.as_deref(),
                customer: self.customer.as_deref(),
                country: self.country.as_deref(),
            },
        }
    }
}

/// Runs the command. Its exit code reports whether the files were written, not whether the test passed.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = args.files.outputs();
    let mut wanted = outputs.flags().to_vec();
    wanted.push(("--json", args.json.as_deref()));
    check_outputs(&wanted, &[&args.result], None)?;
    if wanted.iter().all(|(_, path)| path.is_none()) {
        bail!(
            "nothing to write: give at least one of --html, --pdf, --csv, --qif, --dfq, --dcc, --json with a file"
        );
    }
    if args.result.extension().is_some_and(|extension| extension == "toml") {
        return rig(args);
    }
    if args.date.is_some() {
        bail!("--date is for the DCC of a rig file; the result of a test states its own day: leave it out");
    }
    let report = read_master(&args.result)?;
    write_all(&report, &outputs)?;
    emit_master(args.json.as_deref(), &report)?;
    for path in wanted.into_iter().filter_map(|(_, path)| path).filter(|path| !cli::is_stdout(path)) {
        println!("{}", path.display());
    }
    Ok(Outcome::Done)
}

/// Writes the calibration of a rig.
fn rig(args: &Args) -> Result<Outcome> {
    let outputs = args.files.outputs();
    let others = outputs.flags().into_iter().chain([("--json", args.json.as_deref())]);
    if let Some((option, _)) = others.into_iter().find(|(option, path)| *option != "--dcc" && path.is_some())
    {
        bail!("{option}: of a rig file only --dcc is written; leave {option} out");
    }
    let day = args.date.as_deref().unwrap_or_default();
    let file = files::rig_file::read_rig(&args.result)?;
    let covariance = file.read_covariance()?;
    let document = render_rig(&file, covariance.as_ref(), day, &outputs.parties)?;
    if let Some(path) = outputs.dcc {
        files::atomic::write(path, &document)?;
        println!("{}", path.display());
    }
    Ok(Outcome::Done)
}

/// Writes the result of an acceptance test to a file, or to standard output for `-`.
pub fn emit_master(file: Option<&Path>, report: &TestReport) -> Result<()> {
    match file {
        Some(file) if cli::is_stdout(file) => cli::output::raw(master_text(report)?.as_bytes()),
        Some(file) => write_master(file, report)?,
        None => {}
    }
    Ok(())
}
