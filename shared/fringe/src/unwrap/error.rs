//! Why nothing can be unwrapped.

use crate::frame::MAX_PIXELS;
use thiserror::Error;

/// Input or settings that cannot be used. A map without a valid pixel is no error: its result has no component.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum UnwrapError {
    /// No pixel, or too many.
    #[error(
        "a wrapped phase of {width_px} × {height_px} px cannot be unwrapped; it must have 1 to {MAX_PIXELS} pixels"
    )]
    Size {
        /// Columns of the map, px.
        width_px: u32,
        /// Rows of the map, px.
        height_px: u32,
    },
    /// A plane of another size.
    #[error(
        "the plane {plane} has {length} values, width × height is {expected}; all planes must be of one size"
    )]
    Plane {
        /// Name of the plane.
        plane: &'static str,
        /// Number of its values.
        length: usize,
        /// What it should have.
        expected: usize,
    },
    /// Needs what was not given.
    #[error("the quality is to be the modulation, which is not known; choose another quality map")]
    Modulation,
    /// The tolerance is out of range.
    #[error("tolerance = {value} must lie between 0 and 1, without these")]
    Tolerance {
        /// Tolerance that was given.
        value: f64,
    },
    /// The number of iterations is out of range.
    #[error("max_iterations = {value} must be 1 to 10000")]
    Iterations {
        /// Number of iterations given.
        value: u32,
    },
}
