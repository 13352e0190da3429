//! Why a report of an acceptance test is refused.

use files::error::FileError;
use std::path::PathBuf;
use thiserror::Error;

/// Why a report of an acceptance test is not written.
#[derive(Debug, Error)]
pub enum AcceptanceReportError {
    /// A standard changes; a result without the edition proves nothing.
    #[error(
        "rule_set.{key}: is {found:?} although the report names {standard:?}: give the {key} of the rule set that was followed"
    )]
    RuleSet {
        /// "id", "edition" or "wording".
        key: &'static str,
        /// The value in the result.
        found: String,
        /// The standard that the report names.
        standard: String,
    },
    /// The result has no characteristic.
    #[error("characteristics: there is none: a report needs at least one; evaluate the test again")]
    Empty,
    /// NaN, infinity, or out of its range.
    #[error("{key}: value {value} is not allowed: {limit}; evaluate the test again")]
    Number {
        /// Path of the key in the result.
        key: String,
        /// The value in the result.
        value: f64,
        /// The values that are allowed.
        limit: &'static str,
    },
    /// A unit that no format knows.
    #[error(
        "characteristic {symbol:?}: unit {unit:?} is not allowed: lengths are in \"mm\"; convert the values"
    )]
    Unit {
        /// Symbol of the characteristic.
        symbol: String,
        /// The unit in the result.
        unit: String,
    },
    /// A verdict that the numbers do not bear.
    #[error("{place}: {says} although {but}; evaluate the test again")]
    Contradiction {
        /// Path of the key in the result.
        place: String,
        /// The statement of the result.
        says: String,
        /// What speaks against it.
        but: String,
    },
    /// A document needs something that the result does not have.
    #[error("{what}: {found:?} is not allowed: {limit}")]
    Missing {
        /// What the document needs.
        what: &'static str,
        /// What the result has instead.
        found: String,
        /// The values that are allowed, and where they come from.
        limit: &'static str,
    },
    /// The result has no representation in JSON.
    #[error("the result cannot be written as JSON: {0}")]
    Json(String),
    /// A fault of the contents of a file.
    #[error("{}", .path.display())]
    InFile {
        /// Path of the file.
        path: PathBuf,
        /// The fault in its contents.
        source: Box<Self>,
    },
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}

pub(super) type Checked = Result<(), AcceptanceReportError>;
