//! The report of one measured part in every format: HTML and PDF for people, CSV, QIF 3.0 (plan and results) and Q-DAS DFQ
//! for programs. No clock is read: the date is given, so that the same input gives the same bytes.

mod document;
mod qif;
mod tables;
#[cfg(test)]
mod tests;

use crate::formats::Formats;
use files::atomic;
use files::error::FileError;
use metrology::inspection::InspectionResult;

/// What a report of a part says.
#[derive(Debug, Clone, Copy)]
pub struct PartInput<'a> {
    /// What was measured, with its verdicts.
    pub result: &'a InspectionResult,
    /// Identification of the part; `None`: nobody named it.
    pub part: Option<&'a str>,
    /// Guard band in standard uncertainties (ISO 14253-1).
    pub guard_factor: f64,
    /// Date and time of the measurement, UTC (ISO 8601).
    pub date: &'a str,
    /// What it was made with, label by label.
    pub made_with: &'a [(String, String)],
    /// SHA-256 of the plan and the cloud together, hexadecimal.
    pub sha256: &'a str,
}

/// Writes the wanted formats; each file is complete or absent.
///
/// # Errors
/// A place that cannot be written.
pub fn write_part(input: &PartInput<'_>, outputs: &Formats<'_>) -> Result<(), FileError> {
    let document = document::document(input);
    let csv = || tables::csv(input);
    for (path, bytes) in outputs.files(&document, csv, || qif::render(input), || tables::dfq(input)) {
        atomic::write(path, &bytes)?;
    }
    Ok(())
}
