//! The master: JSON with its format first.

use super::error::AcceptanceReportError;
use files::atomic;
use files::document::read_text;
use files::error::{FileError, Problem};
use metrology::acceptance::TestReport;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What the key `format` states.
pub const FORMAT: &str = "fringecell-acceptance/1";

#[derive(Serialize)]
struct Master<'a> {
    format: &'static str,
    #[serde(flatten)]
    report: &'a TestReport,
}

#[derive(Deserialize)]
struct Head {
    #[serde(default)]
    format: serde_json::Value,
}

/// The master as text, ending in a line feed.
///
/// # Errors
/// Numbers that are not finite: JSON would hold `null` instead.
pub fn master_text(report: &TestReport) -> Result<String, AcceptanceReportError> {
    super::check(report)?;
    // Text keys and finite numbers always serialise; the library's signature does not know it.
    let text = serde_json::to_string_pretty(&Master { format: FORMAT, report })
        .map_err(|error| AcceptanceReportError::Json(error.to_string()))?;
    Ok(text + "\n")
}

/// Writes the master; the file is complete or absent.
///
/// # Errors
/// A report that [`super::check`] refuses, or a place that cannot be written.
pub fn write_master(path: &Path, report: &TestReport) -> Result<(), AcceptanceReportError> {
    Ok(atomic::write(path, master_text(report)?.as_bytes())?)
}

/// Reads a master and checks it.
///
/// # Errors
/// Absent, not JSON, another format, other keys, or a report that [`super::check`] refuses.
pub fn read_master(path: &Path) -> Result<TestReport, AcceptanceReportError> {
    let text = read_text(path)?;
    let head: Head = serde_json::from_str(&text).map_err(|error| syntax(path, &error))?;
    if head.format.as_str() != Some(FORMAT) {
        let found = head.format.as_str().unwrap_or_default().escape_debug().to_string();
        let problem = Problem::Format { found, expected: FORMAT.to_owned() };
        return Err(FileError::new(path, problem, "name the --json file of fringetool vdi2634")
            .at("format")
            .into());
    }
    let report = serde_json::from_str(&text).map_err(|error| syntax(path, &error))?;
    super::check(&report)
        .map_err(|error| AcceptanceReportError::InFile { path: path.to_owned(), source: Box::new(error) })?;
    Ok(report)
}

fn syntax(path: &Path, error: &serde_json::Error) -> FileError {
    let mut fault = FileError::new(path, Problem::Syntax(error.to_string().replace('\n', " ")), "");
    fault.line = Some(error.line()).filter(|line| *line > 0);
    fault
}
