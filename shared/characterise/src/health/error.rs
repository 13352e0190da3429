//! Why a pair cannot be judged.

use fringe::geometry::camera::CameraError;
use thiserror::Error;

/// Why a pair cannot be judged.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum HealthError {
    /// A setting outside its range.
    #[error("{key} = {value} is outside {limits}")]
    Setting {
        /// Which.
        key: &'static str,
        /// As given.
        value: f64,
        /// What is allowed.
        limits: &'static str,
    },
    /// A map that does not belong to the others.
    #[error("the phase maps of the {side} view do not belong together: {what}")]
    Maps {
        /// "left" or "right".
        side: &'static str,
        /// In what they differ.
        what: String,
    },
    /// A camera that cannot be.
    #[error("{side} view: {source}")]
    Camera {
        /// "left" or "right".
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
        /// Matches.
        found: usize,
        /// Needed.
        needed: usize,
    },
    /// The matches do not fix the drift.
    #[error("the matches lie so close together that they tell no drift apart; use a larger object")]
    Degenerate,
    /// A covariance of other parameters.
    #[error(
        "the covariance names the parameter \"{0}\", which is unknown here; calibrate again with this version"
    )]
    Parameter(String),
    /// A covariance of another size.
    #[error("the covariance has {found} entries, but its parameters ask for {needed}")]
    Covariance {
        /// As given.
        found: usize,
        /// Needed.
        needed: usize,
    },
}
