//! Why a report is not written.

use super::raster::PictureError;
use files::error::FileError;
use thiserror::Error;

/// Why a report is not written.
#[derive(Debug, Error)]
pub enum ReportError {
    /// The verdict contradicts the table.
    #[error(
        "the verdict is PASS although feature {feature:?} is not PASS: give the verdict that follows from the features"
    )]
    Contradiction {
        /// A feature that failed or is indeterminate.
        feature: String,
    },
    /// A picture cannot be made.
    #[error("{what}")]
    Picture {
        /// Caption of the picture.
        what: String,
        /// Why it cannot be drawn.
        source: PictureError,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
}
