//! The report of one measured part in every format: HTML and PDF for people, CSV, QIF 3.0 (plan and results) and Q-DAS DFQ
//! for programs. No clock is read: the date is given, so that the same input gives the same bytes.

mod document;
mod qif;
mod tables;
#[cfg(test)]
mod tests;

use crate::acceptance::{html, pdf};
use files::atomic;
use files::error::FileError;
use metrology::inspection::InspectionResult;
use std::path::Path;

/// What a report of a part says.
#[derive(Debug, Clone, Copy)]
pub struct PartInput<'a> {
    /// What was measured, with its verdicts.
    pub result: &'a InspectionResult,
    /// Guard band in standard uncertainties (ISO 14253-1).
    pub guard_factor: f64,
    /// Date and time of the measurement, UTC (ISO 8601).
    pub date: &'a str,
    /// What it was made with, label by label.
    pub made_with: &'a [(String, String)],
    /// SHA-256 of the plan and the cloud together, hexadecimal.
    pub sha256: &'a str,
}

/// Where each format goes; `None`: not wanted.
#[derive(Debug, Clone, Copy, Default)]
pub struct PartOutputs<'a> {
    /// Report as one HTML file.
    pub html: Option<&'a Path>,
    /// The same as PDF, A4.
    pub pdf: Option<&'a Path>,
    /// One line a feature.
    pub csv: Option<&'a Path>,
    /// Plan and results as QIF 3.0 (ISO 23952).
    pub qif: Option<&'a Path>,
    /// Q-DAS ASCII transfer format.
    pub dfq: Option<&'a Path>,
}

impl<'a> PartOutputs<'a> {
    /// Each with the option of the command line that names it.
    pub fn flags(&self) -> [(&'static str, Option<&'a Path>); 5] {
        [
            ("--html", self.html),
            ("--pdf", self.pdf),
            ("--csv", self.csv),
            ("--qif", self.qif),
            ("--dfq", self.dfq),
        ]
    }
}

/// Writes the wanted formats; each file is complete or absent.
///
/// # Errors
/// A place that cannot be written.
pub fn write_part(input: &PartInput<'_>, outputs: &PartOutputs<'_>) -> Result<(), FileError> {
    let document = document::document(input);
    let mut files: Vec<(&Path, Vec<u8>)> = Vec::new();
    if let Some(path) = outputs.html {
        files.push((path, html::render(&document).into_bytes()));
    }
    if let Some(path) = outputs.pdf {
        files.push((path, pdf::render(&document)));
    }
    if let Some(path) = outputs.csv {
        files.push((path, tables::csv(input).into_bytes()));
    }
    if let Some(path) = outputs.qif {
        files.push((path, qif::render(input)));
    }
    if let Some(path) = outputs.dfq {
        files.push((path, tables::dfq(input).into_bytes()));
    }
    for (path, bytes) in files {
        atomic::write(path, &bytes)?;
    }
    Ok(())
}
