//! The result of a cycle in the formats that other programs and people read, beside its JSON.

use crate::software::FRINGECELL;
use anyhow::{Context as _, Result};
use cell::Cell;
use devices::LoadedCell;
use files::config::ResultFormat;
use files::hash::sha256_hex;
use files::result::CycleResult;
use metrology::inspection::{InspectionResult, Plan};
use metrology::verdict::Verdict;
use report::Formats;
use report::part::{PartInput, write_part};
use std::path::{Path, PathBuf};

/// Path of a format beside the JSON of a result.
pub fn beside(json: &Path, format: ResultFormat) -> PathBuf {
    json.with_extension(format.name())
}

/// The plan of the recipe that a result was made with.
pub fn plan_of<'a>(cell: &'a Cell, result: &CycleResult) -> Option<&'a Plan> {
    let name = result.recipe.as_ref()?;
    cell.config.recipes.iter().find(|recipe| recipe.name == *name)?.plan.as_ref()
}

/// Writes the formats of the configuration beside the JSON of a result. A cycle that is not ok, or has no plan, has no features and none
/// of these files: its JSON has its outcome.
///
/// # Errors
/// A file that cannot be written.
pub fn write(json: &Path, cell: &LoadedCell, result: &CycleResult) -> Result<()> {
    let formats = &cell.file.formats;
    let Some(plan) = plan_of(cell, result).filter(|_| result.is_ok() && !formats.is_empty()) else {
        return Ok(());
    };
    let text = std::fs::read(json).with_context(|| json.display().to_string())?;
    let inspection = InspectionResult {
        plan: plan.name.clone(),
        verdict: result.verdict.unwrap_or(Verdict::Indeterminate),
        alignment: result.alignment.clone(),
        alignment_failure: result.alignment_failure.clone(),
        elements: result.elements.clone(),
        constructed: result.constructed.clone(),
        features: result.features.clone(),
    };
    let input = PartInput {
        result: &inspection,
        part: result.part.as_deref(),
        guard_factor: plan.settings.guard_factor,
        date: &result.date,
        made_with: &made_with(cell, result),
        sha256: &sha256_hex(&text),
    };
    let path = |format: ResultFormat| formats.contains(&format).then(|| beside(json, format));
    let [html, pdf, csv, qif, dfq] = ResultFormat::ALL.map(path);
    let outputs = Formats {
        html: html.as_deref(),
        pdf: pdf.as_deref(),
        csv: csv.as_deref(),
        qif: qif.as_deref(),
        dfq: dfq.as_deref(),
    };
    Ok(write_part(&input, &outputs)?)
}

fn made_with(cell: &LoadedCell, result: &CycleResult) -> Vec<(String, String)> {
    let pair = |label: &str, text: String| (label.to_owned(), text);
    let mut all = vec![
        pair("Cell", format!("{}, cycle {}", cell.name, result.number)),
        pair("Configuration", format!("SHA-256 {}", result.config_sha256)),
        pair("Rig", format!("SHA-256 {}", result.rig_sha256)),
    ];
    all.extend(result.plan_sha256.iter().map(|hash| pair("Plan", format!("SHA-256 {hash}"))));
    let shares = result.calibration_shares_sha256.iter();
    all.extend(shares.map(|hash| pair("Shares of the calibration", format!("SHA-256 {hash}"))));
    all.extend(result.recipe.iter().map(|recipe| pair("Recipe", recipe.clone())));
    all.push(pair("Software", FRINGECELL.line()));
    all.push(pair("Date", result.date.clone()));
    all.extend(result.warnings.iter().map(|warning| pair("Warning", warning.clone())));
    all
}
