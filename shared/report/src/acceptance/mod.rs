//! The report of an acceptance test in every format, from one master: [`TestReport`].
//!
//! JSON is the master ([`write_master`], [`read_master`]); HTML and PDF say the same in the same words ([`content`]); CSV,
//! QIF 3.0 (ISO 23952), Q-DAS DFQ and DCC (PTB) carry the numbers to other programs. No clock is read and no number drawn: the same
//! master gives the same bytes.

pub(crate) mod blocks;
mod chart;
mod check;
mod check_rules;
mod content;
mod csv;
mod dcc;
mod dfq;
pub(crate) mod drawing;
mod error;
mod groups;
pub(crate) mod html;
mod master;
pub(crate) mod pdf;
pub(crate) mod qif;
mod rig_dcc;
#[cfg(test)]
mod tests;
pub(crate) mod words;
pub(crate) mod xml;

pub(crate) use chart::tone_of;
pub use check::check;
pub use error::AcceptanceReportError;
pub use master::{FORMAT, master_text, read_master, write_master};
pub use rig_dcc::render_rig;

use crate::formats::Formats;
use files::atomic;
use files::hash::sha256_hex;
use metrology::acceptance::TestReport;
use std::path::Path;

/// Where each format goes; `None`: not wanted.
#[derive(Debug, Clone, Copy, Default)]
pub struct Outputs<'a> {
    /// The formats that every report has; the table has one line a position and characteristic.
    pub formats: Formats<'a>,
    /// Test report as digital calibration certificate (DCC 3.1.2).
    pub dcc: Option<&'a Path>,
    /// Who stands in the DCC.
    pub parties: Parties<'a>,
}

/// Who tested for whom; what is not stated says so in the document.
#[derive(Debug, Clone, Copy, Default)]
pub struct Parties<'a> {
    /// Name of the laboratory that tested.
    pub laboratory: Option<&'a str>,
    /// Name of the customer.
    pub customer: Option<&'a str>,
    /// Country of the test by ISO 3166-1, two capital letters.
    pub country: Option<&'a str>,
}

impl<'a> Outputs<'a> {
    /// Each with the option of the command line that names it.
    pub fn flags(&self) -> [(&'static str, Option<&'a Path>); 6] {
        let [html, pdf, csv, qif, dfq] = self.formats.flags();
        [html, pdf, csv, qif, dfq, ("--dcc", self.dcc)]
    }
}

/// Writes the wanted formats; each file is complete or absent, and none is begun before all are made.
///
/// # Errors
/// A report that [`check`] refuses, a master that JSON cannot hold, or a place that cannot be written.
pub fn write_all(report: &TestReport, outputs: &Outputs<'_>) -> Result<(), AcceptanceReportError> {
    check(report)?;
    let sha256 = sha256_hex(master_text(report)?.as_bytes());
    let document = content::document(report, &sha256);
    let qif = || qif::render(report, &sha256);
    let mut files = outputs.formats.files(&document, || csv::render(report), qif, || dfq::render(report));
    if let Some(path) = outputs.dcc {
        files.push((path, dcc::render(report, &outputs.parties, &sha256)?));
    }
    for (path, bytes) in files {
        atomic::write(path, &bytes)?;
    }
    Ok(())
}
