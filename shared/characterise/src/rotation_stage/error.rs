//! Why there is no axis.

use thiserror::Error;

/// Views that do not determine the axis.
#[derive(Debug, Error, Clone, Copy, PartialEq, Eq)]
pub enum StageError {
    /// Not enough of them.
    #[error("{views} views do not determine the axis; {needed} or more at different angles are needed")]
    Few {
        /// Number of views given.
        views: usize,
        /// Fewest views that are needed.
        needed: usize,
    },
    /// The equations leave it open.
    #[error(
        "the views do not determine the axis: {why}; record views at three or more angles spread over the turn, the object beside the axis"
    )]
    Open {
        /// What is wrong with them.
        why: &'static str,
    },
    /// NaN or infinite input.
    #[error("an angle, a place or a size is not finite, or a size is not above 0")]
    Number,
}
