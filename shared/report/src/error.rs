//! Why a report is not written.

use super::raster::PictureError;
use files::error::FileError;
use thiserror::Error;

/// Why a report is not written.
#[derive(Debug, Error)]
pub enum ReportError {
    /// The banner says more than the table.
    #[error(
        "the report would say PASS although feature {feature:?} is not PASS: give the verdict that follows from the features"
    )]
    Contradiction {
        /// A feature that failed or is indeterminate.
        feature: String,
    },
    /// A picture cannot be made.
    #[error("{what}")]
    Picture {
        /// Which one.
        what: String,
        /// Why.
        source: PictureError,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
}
