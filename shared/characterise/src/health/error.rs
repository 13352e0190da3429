//! Errors of the check of a pair.

use fringe::geometry::camera::CameraError;
use thiserror::Error;

/// Why a pair cannot be checked.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum HealthError {
    /// A setting outside its range.
    #[error("{key} = {value} is outside {limits}")]
    Setting {
        /// Name of the setting.
        key: &'static str,
        /// Value given for the setting.
        value: f64,
        /// Interval allowed for the setting.
        limits: &'static str,
    },
    /// A map that does not belong to the others.
    #[error("the phase maps of the {side} view do not belong together: {what}")]
    Maps {
        /// View of the pair: "left" or "right".
        side: &'static str,
        /// In what they differ.
        what: String,
    },
    /// A camera that cannot be.
    #[error("{side} view: {source}")]
    Camera {
        /// View of the pair: "left" or "right".
        side: &'static str,
        /// What is wrong with it.
        source: CameraError,
    },
    /// Too few places that both views see.
    #[error(
        "{found} places match, at least {needed} are needed: put an object with large smooth faces where both views \
         see it lit, and record both fringe directions"
    )]
    TooFew {
        /// Number of matches found.
        found: usize,
        /// Fewest matches that are needed.
        needed: usize,
    },
    /// The matches do not fix the drift.
    #[error("the matches are so close together that they determine no drift; use a larger object")]
    Degenerate,
    /// A covariance of other parameters.
    #[error(
        "the covariance names the parameter \"{0}\", which is unknown here; calibrate again with this version"
    )]
    Parameter(String),
    /// A covariance of another size.
    #[error("the covariance has {found} entries, its parameters need {needed}")]
    Covariance {
        /// Number of entries given.
        found: usize,
        /// Number of entries needed.
        needed: usize,
    },
}
