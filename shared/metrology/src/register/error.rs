//! Why there is no alignment.

use crate::reference::CloudError;
use thiserror::Error;

/// Why there is no alignment.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum RegisterError {
    /// The cloud cannot be aligned at all.
    #[error(transparent)]
    Cloud(#[from] CloudError),
    /// The clouds do not lie on each other.
    #[error(
        "only {matched} points match the reference, at least {needed} are needed: the clouds do not overlap; give a start, let it be searched, or raise the reach"
    )]
    Few {
        /// Points with a match.
        matched: usize,
        /// Fewest points that are needed.
        needed: usize,
    },
    /// Less matches than must.
    #[error(
        "only {share_percent:.1} % of the points match the reference, at least {least_percent:.1} % are needed: are the clouds of the same part? give a better start"
    )]
    Overlap {
        /// Share that matches, %.
        share_percent: f64,
        /// Smallest share of matches accepted, %.
        least_percent: f64,
    },
    /// Nothing fixes the pose.
    #[error("the surfaces fix no direction at all; is the reference a surface?")]
    Free,
}
