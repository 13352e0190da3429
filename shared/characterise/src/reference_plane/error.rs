//! Why there is no calibration or no height.

use super::{MOST_DEGREE, MOST_PLANES};
use thiserror::Error;

/// Planes or maps that cannot be used.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum PlaneError {
    /// Not between 1 and 3.
    #[error("degree {degree} must be 1 to {MOST_DEGREE}")]
    Degree {
        /// Degree that was requested.
        degree: usize,
    },
    /// Fewer planes than coefficients.
    #[error(
        "{planes} planes do not determine the {needed} coefficients of each pixel; measure {needed} or more at different heights"
    )]
    Few {
        /// Number of planes given.
        planes: usize,
        /// Number of coefficients of each pixel.
        needed: usize,
    },
    /// More planes than allowed.
    #[error("{planes} planes are more than {MOST_PLANES}; leave some out")]
    Many {
        /// Number of planes given.
        planes: usize,
    },
    /// A rejection limit that is not positive.
    #[error(
        "rejection beyond {sigmas} standard deviations: must be above 0; 6 is usual, inf rejects nothing"
    )]
    Reject {
        /// Limit given, standard deviations.
        sigmas: f64,
    },
    /// Repeated or not finite.
    #[error(
        "height {z_mm} mm of plane {number} is not finite or occurs twice; each plane needs its own height"
    )]
    Height {
        /// Number of the plane, from 1.
        number: usize,
        /// Height that was given, mm.
        z_mm: f64,
    },
    /// A phase map with another size than the reference.
    #[error("map {number} has another size than the reference; use one camera at one resolution")]
    Size {
        /// Number of the map, from 1.
        number: usize,
    },
    /// A phase map with another period than the reference.
    #[error(
        "map {number} has another axis or period ({period_px} px) than the reference ({expected_px} px); project the same fringes"
    )]
    Pattern {
        /// Number of the map, from 1.
        number: usize,
        /// Period of the map, px.
        period_px: f64,
        /// Period of the reference, px.
        expected_px: f64,
    },
}
