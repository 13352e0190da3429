//! Statistics over parts, as a page for people and as Q-DAS for other programs.

mod dfq;
mod html;

use files::atomic;
use files::error::FileError;
use metrology::spc::Study;
use std::path::Path;

/// Content of the page.
#[derive(Debug, Clone, Copy)]
pub struct SpcInput<'a> {
    /// The evaluation of each feature.
    pub studies: &'a [Study],
    /// Where the values come from.
    pub sources: &'a str,
    /// Number of parts evaluated.
    pub parts: usize,
    /// Parts without a result.
    pub parts_not_ok: usize,
    /// Probability of the intervals.
    pub confidence: f64,
    /// Ppk that is asked for, if any.
    pub least_ppk: Option<f64>,
    /// Date of the evaluation, ISO 8601.
    pub date: &'a str,
    /// Name and version of the program.
    pub software: &'a str,
}

/// Content of the Q-DAS file.
#[derive(Debug, Clone, Copy)]
pub struct DfqInput<'a> {
    /// The series with their limits.
    pub studies: &'a [Study],
    /// Where the values come from.
    pub remark: &'a str,
}

/// Writes the page; the file is complete or absent.
///
/// # Errors
/// The file cannot be written.
pub fn write_spc(path: &Path, input: &SpcInput<'_>) -> Result<(), FileError> {
    atomic::write(path, html::render(input).as_bytes())
}

/// Writes all values in the Q-DAS transfer format; the file is complete or absent.
///
/// # Errors
/// The file cannot be written.
pub fn write_dfq(path: &Path, input: &DfqInput<'_>) -> Result<(), FileError> {
    atomic::write(path, dfq::render(input).as_bytes())
}
