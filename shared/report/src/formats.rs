//! Where each format of a report goes.

use crate::acceptance::blocks::Document;
use crate::acceptance::{html, pdf};
use std::path::Path;

/// Where the formats go that every report has; `None`: not wanted.
#[derive(Debug, Clone, Copy, Default)]
pub struct Formats<'a> {
    /// Report as one HTML file.
    pub html: Option<&'a Path>,
    /// The same as PDF, A4.
    pub pdf: Option<&'a Path>,
    /// A table for spreadsheets.
    pub csv: Option<&'a Path>,
    /// Results as QIF 3.0 (ISO 23952).
    pub qif: Option<&'a Path>,
    /// Q-DAS ASCII transfer format.
    pub dfq: Option<&'a Path>,
}

impl<'a> Formats<'a> {
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

    /// The bytes of each wanted file, not written yet; a format that is not wanted is not made.
    pub(crate) fn files(
        &self,
        document: &Document<'_>,
        csv: impl FnOnce() -> String,
        qif: impl FnOnce() -> Vec<u8>,
        dfq: impl FnOnce() -> String,
    ) -> Vec<(&'a Path, Vec<u8>)> {
        let made = [
            self.html.map(|path| (path, html::render(document).into_bytes())),
            self.pdf.map(|path| (path, pdf::render(document))),
            self.csv.map(|path| (path, csv().into_bytes())),
            self.qif.map(|path| (path, qif())),
            self.dfq.map(|path| (path, dfq().into_bytes())),
        ];
        made.into_iter().flatten().collect()
    }
}
