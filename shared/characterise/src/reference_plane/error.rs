//! Why there is no calibration or no height.

use super::{MOST_DEGREE, MOST_PLANES};
use thiserror::Error;

/// Planes or maps that cannot be used.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum PlaneError {
    /// Not between 1 and 3.
    #[error("degree {degree} must be 1 to {MOST_DEGREE}")]
    Degree {
        /// As asked.
        degree: usize,
    },
    /// Not enough planes.
    #[error(
        "{planes} planes do not tell the {needed} coefficients of each pixel; measure {needed} or more at different heights"
    )]
    Few {
        /// As given.
        planes: usize,
        /// Coefficients.
        needed: usize,
    },
    /// Too many.
    #[error("{planes} planes are more than {MOST_PLANES}; leave some out")]
    Many {
        /// As given.
        planes: usize,
    },
    /// No limit.
    #[error(
        "rejection beyond {sigmas} standard deviations: must be above 0; 6 is usual, inf rejects nothing"
    )]
    Reject {
        /// As given.
        sigmas: f64,
    },
    /// Repeated or not finite.
    #[error(
        "height {z_mm} mm of plane {number} is not finite or stands twice; each plane needs a height of its own"
    )]
    Height {
        /// From 1.
        number: usize,
        /// As given.
        z_mm: f64,
    },
    /// Another size.
    #[error("map {number} is not as large as the reference; use one camera at one resolution")]
    Size {
        /// From 1.
        number: usize,
    },
    /// Other fringes.
    #[error(
        "map {number} has another axis or period ({period_px} px) than the reference ({expected_px} px); project the same fringes"
    )]
    Pattern {
        /// From 1.
        number: usize,
        /// As given.
        period_px: f64,
        /// Of the reference.
        expected_px: f64,
    },
}
