//! `fringetool uncertainty`: a measurement uncertainty budget by the GUM, and by Monte Carlo on request.

mod table;

use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result};
use files::budget::BudgetFile;
use metrology::uncertainty::{
    Comparison, Evaluation, MonteCarloResult, Uncertain, Validation, compare, validate,
};
use report::uncertainty::{UncertaintyInput, write_uncertainty};
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Budget file (TOML, fringecell-budget/1).
    budget: PathBuf,
    /// Also propagate the distributions (GUM Supplement 1) and compare.
    #[arg(long)]
    monte_carlo: bool,
    /// Seed instead of that of the budget.
    #[arg(long, value_name = "N", requires = "monte_carlo")]
    seed: Option<u64>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a report as one HTML file.
    #[arg(long, alias = "html", value_name = "FILE")]
    report: Option<PathBuf>,
}

/// The result as written to JSON.
#[derive(Serialize)]
struct Output<'a> {
    format: &'static str,
    software_version: &'static str,
    budget_sha256: &'a str,
    name: &'a str,
    remark: &'a str,
    symbol: &'a str,
    unit: &'a str,
    model: Option<&'a str>,
    evaluation: &'a Evaluation,
    monte_carlo: Option<&'a MonteCarloResult>,
    validation: Option<Validation>,
    comparison: Option<&'a Comparison>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [("--json", args.json.as_deref()), ("--report", args.report.as_deref())];
    check_outputs(&outputs, &[&args.budget], None)?;
    let file = BudgetFile::read(&args.budget)?;
    let place = || args.budget.display().to_string();
    let evaluation = file.budget.evaluate().with_context(place)?;
    let monte_carlo = if args.monte_carlo { Some(trials(args, &file).with_context(place)?) } else { None };
    let validation = monte_carlo.as_ref().map(|m| validate(&evaluation, m, file.monte_carlo.digits));
    let comparison = comparison(&file, &evaluation).with_context(place)?;
    print!("{}", table::text(&file, &evaluation, monte_carlo.as_ref().zip(validation), comparison.as_ref()));
    let output = Output {
        format: "fringecell-uncertainty/1",
        software_version: env!("CARGO_PKG_VERSION"),
        budget_sha256: &file.sha256,
        name: &file.name,
        remark: &file.remark,
        symbol: &file.symbol,
        unit: &file.unit,
        model: file.model.as_deref(),
        evaluation: &evaluation,
        monte_carlo: monte_carlo.as_ref(),
        validation,
        comparison: comparison.as_ref(),
    };
    if let Some(path) = &args.report {
        let input = UncertaintyInput {
            file: &file,
            evaluation: &evaluation,
            monte_carlo: monte_carlo.as_ref().zip(validation),
            comparison,
            date: files::clock::rfc3339_now(),
            software_version: crate::software::FRINGETOOL.line(),
        };
        write_uncertainty(path, &input)?;
    }
    emit(args.json.as_deref(), &output)?;
    let agrees = comparison.is_none_or(|c| c.agrees);
    let stable = monte_carlo.is_none_or(|m| m.converged != Some(false));
    Ok(if agrees && stable { Outcome::Done } else { Outcome::LimitFailed })
}

fn trials(args: &Args, file: &BudgetFile) -> Result<MonteCarloResult> {
    let mut settings = file.monte_carlo;
    settings.seed = args.seed.unwrap_or(settings.seed);
    let mut progress = Progress::new(100, "Monte Carlo");
    let mut shown = 0;
    let mut observe = |done: u64, expected: u64| {
        let percent = 100 * done / expected.max(1);
        for _ in shown..percent {
            progress.step();
        }
        shown = shown.max(percent);
    };
    Ok(file.budget.monte_carlo(&settings, &mut observe)?)
}

fn comparison(file: &BudgetFile, evaluation: &Evaluation) -> Result<Option<Comparison>> {
    let Some(reference) = &file.reference else { return Ok(None) };
    let (value, expanded_uncertainty) = (reference.value, reference.expanded_uncertainty);
    Ok(Some(compare(evaluation.result(), Uncertain { value, expanded_uncertainty })?))
}
