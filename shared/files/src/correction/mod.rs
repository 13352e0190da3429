//! Pattern corrections: what has to be drawn so that the projector's light is proportional to the pattern.
//!
//! ```toml
//! format = "fringecell-pattern-correction/1"
//! projector = "proj1"        # optional; absent: any
//! source = "response"        # where the table comes from: response | inverse-polynomial | fringes
//! gamma = 2.2                # of the projector before correction, for people
//! coefficients = [a0, …, a7] # optional, eq. 3.2, for people
//! table = [0.0, …, 1.0]      # entry i of n: level to draw (0 … 1) where i / (n − 1) is wanted; linear in between
//! [provenance]
//! ```

#[cfg(test)]
mod tests;

use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::hash::sha256_hex;
use crate::rig_file::quoted;
use fringe::pattern::LevelTable;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::Path;

/// Value of `format` in a pattern correction.
pub const CORRECTION_FORMAT: &str = "fringecell-pattern-correction/1";

/// How a table was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TableSource {
    /// The measured response, inverted.
    Response,
    /// The polynomial of order 7 in the measured light (eq. 3.2).
    InversePolynomial,
    /// The exponent that fringes show.
    Fringes,
}

impl TableSource {
    /// As in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Response => "response",
            Self::InversePolynomial => "inverse-polynomial",
            Self::Fringes => "fringes",
        }
    }
}

/// A correction of the projected grey levels.
#[derive(Debug, Clone, PartialEq)]
pub struct PatternCorrection {
    /// Whose; `None`: any projector's.
    pub projector: Option<String>,
    /// How the table was made.
    pub source: TableSource,
    /// Exponent of the projector without correction.
    pub gamma: Option<f64>,
    /// a₀ … a₇ of eq. 3.2.
    pub coefficients: Option<Vec<f64>>,
    /// Drawn level for each wanted level.
    pub table: LevelTable,
    /// From what, by which software.
    pub provenance: toml::Table,
}

impl PatternCorrection {
    /// SHA-256 of the correction as [`write_correction`] writes it, however its file was formatted.
    pub fn sha256(&self) -> String {
        sha256_hex(text(self).as_bytes())
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    #[serde(rename = "format")]
    _format: String,
    projector: Option<String>,
    source: TableSource,
    gamma: Option<f64>,
    coefficients: Option<Vec<f64>>,
    table: Vec<f64>,
    #[serde(default)]
    provenance: toml::Table,
}

/// Reads a pattern correction.
///
/// # Errors
/// Absent, not of this format, unknown keys, a table that falls or leaves 0 … 1.
pub fn read_correction(path: &Path) -> Result<PatternCorrection, FileError> {
    let document = Document::read(path)?;
    let raw: Raw = document.parse(CORRECTION_FORMAT)?;
    let table = LevelTable::new(raw.table).map_err(|error| {
        let remedy = "make the file again with `fringetool gamma`";
        document.fault("table", Problem::Unsupported(error.to_string()), remedy)
    })?;
    Ok(PatternCorrection {
        projector: raw.projector,
        source: raw.source,
        gamma: raw.gamma,
        coefficients: raw.coefficients,
        table,
        provenance: raw.provenance,
    })
}

/// Writes a pattern correction; numbers come back as the same bits.
///
/// # Errors
/// A folder that is absent or cannot be written.
pub fn write_correction(path: &Path, correction: &PatternCorrection) -> Result<(), FileError> {
    crate::atomic::write(path, text(correction).as_bytes())
}

/// Key of a recording's provenance: projectors whose patterns were corrected.
const CORRECTED: &str = "pattern_corrected";

/// Notes in a recording's provenance which projectors draw corrected patterns.
pub fn note<'a>(provenance: &mut toml::Table, projectors: impl Iterator<Item = &'a str>) {
    let names: Vec<toml::Value> = projectors.map(Into::into).collect();
    if !names.is_empty() {
        provenance.insert(CORRECTED.into(), names.into());
    }
}

/// Whether a recording notes that a projector drew corrected patterns.
pub fn is_noted(provenance: &toml::Table, projector: &str) -> bool {
    let names = provenance.get(CORRECTED).and_then(toml::Value::as_array);
    names.is_some_and(|names| names.iter().any(|name| name.as_str() == Some(projector)))
}

fn text(correction: &PatternCorrection) -> String {
    let mut out = format!("format = \"{CORRECTION_FORMAT}\"\n");
    if let Some(projector) = &correction.projector {
        let _ = writeln!(out, "projector = {}", quoted(projector));
    }
    let _ = writeln!(out, "source = \"{}\"", correction.source.name());
    if let Some(gamma) = correction.gamma {
        let _ = writeln!(out, "gamma = {gamma:?}");
    }
    let numbers = |values: &[f64]| values.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(", ");
    if let Some(coefficients) = &correction.coefficients {
        let _ = writeln!(out, "coefficients = [{}]", numbers(coefficients));
    }
    out.push_str("table = [\n");
    for row in correction.table.values().chunks(6) {
        let _ = writeln!(out, "  {},", numbers(row));
    }
    out.push_str("]\n");
    if !correction.provenance.is_empty() {
        let mut holder = toml::Table::new();
        holder.insert("provenance".into(), toml::Value::Table(correction.provenance.clone()));
        let _ = write!(out, "\n{holder}");
    }
    out
}
