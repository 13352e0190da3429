//! Why a test cannot be evaluated.

use thiserror::Error;

use super::result::Violation;
use crate::fit::FitError;

/// Why a test cannot be evaluated.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum AcceptanceError {
    /// A file of another format or version.
    #[error("format = \"{found}\", this program reads \"{reads}\"")]
    Format {
        /// The format as written.
        found: String,
        /// The format that this program reads.
        reads: &'static str,
    },
    /// A rule set without name or edition.
    #[error("id, standard and edition must not be empty: a report names the rules that it follows")]
    Nameless,
    /// A number out of range.
    #[error("{place}: {key} = {value}, must be {limits}")]
    Value {
        /// Table with its name.
        place: String,
        /// Key of the number in the file.
        key: &'static str,
        /// The value as written.
        value: f64,
        /// What it must be.
        limits: &'static str,
    },
    /// A statistic of another artefact.
    #[error("characteristic \"{symbol}\": its statistic cannot be taken on a {kind}")]
    Statistic {
        /// Symbol of the characteristic.
        symbol: String,
        /// Kind of the artefact.
        kind: &'static str,
    },
    /// A name used twice.
    #[error("{what} \"{name}\" occurs twice; names must be unique")]
    Twice {
        /// What is named, for example "position".
        what: &'static str,
        /// The name that occurs twice.
        name: String,
    },
    /// A name that is not there.
    #[error("{place}: {key} names \"{name}\", which does not exist; known: {known}")]
    Unknown {
        /// Table with its name.
        place: String,
        /// Key of the reference in the file.
        key: &'static str,
        /// The name as written.
        name: String,
        /// All names that exist, as a list.
        known: String,
    },
    /// Something that must be there is not, or the reverse.
    #[error("{place}: {message}")]
    Plan {
        /// Table with its name.
        place: String,
        /// What is wrong, and the remedy.
        message: String,
    },
    /// The plan breaks rules and does not say that it may.
    #[error("{}", refusal(.0))]
    Rules(Vec<Violation>),
    /// An element was not found in its points.
    #[error("{place}: {message}")]
    NotFound {
        /// Name of position and view.
        place: String,
        /// What was looked for, what was there.
        message: String,
    },
    /// An element was found but not fitted.
    #[error("{place}")]
    Fit {
        /// Name of position and view.
        place: String,
        /// The error of the fit.
        source: FitError,
    },
}

impl AcceptanceError {
    /// The table, such as `artefact "ball"`, and the key of it where the fault lies; both may be empty.
    pub fn place(&self) -> (&str, &str) {
        match self {
            Self::Value { place, key, .. } | Self::Unknown { place, key, .. } => (place, key),
            Self::Plan { place, .. } | Self::NotFound { place, .. } | Self::Fit { place, .. } => (place, ""),
            Self::Format { .. } => ("format", ""),
            Self::Twice { what, .. } => (what, ""),
            Self::Nameless | Self::Statistic { .. } | Self::Rules(_) => ("", ""),
        }
    }
}

fn refusal(violations: &[Violation]) -> String {
    let list: Vec<&str> = violations.iter().map(|v| v.text.as_str()).collect();
    format!(
        "the plan breaks {} of its rules: {}; correct it, or set allow_reduced = true for a reduced test",
        list.len(),
        list.join("; ")
    )
}
