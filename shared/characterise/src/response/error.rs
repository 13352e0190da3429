//! Errors of the response evaluation.

use thiserror::Error;

/// Why a response cannot be determined; the message ends with the likely remedy.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ResponseError {
    /// A region that is not in the image.
    #[error("region {roi} is not within the frame of {width_px} × {height_px} px; correct --roi")]
    RoiOutside {
        /// The region as `x,y,width,height`.
        roi: String,
        /// Columns of the frame, px.
        width_px: u32,
        /// Rows of the frame, px.
        height_px: u32,
    },
    /// A region that would fill the memory.
    #[error("the region has {pixels} pixels, limit {limit}; choose a smaller --roi")]
    RoiLarge {
        /// Number of pixels of the region.
        pixels: u64,
        /// Largest number of pixels accepted.
        limit: u64,
    },
    /// Frames of unequal size or depth.
    #[error(
        "frame {number} has {found}, the first one {expected}; all must be from one camera with one setting"
    )]
    Unequal {
        /// Which frame, from 0.
        number: usize,
        /// Size of the frame found.
        found: String,
        /// Size of the first frame.
        expected: String,
    },
    /// Too many saturated pixels.
    #[error(
        "{saturated} of {pixels} pixels of the region saturate (most at level {level:.3}); lower exposure or gain, or choose another --roi"
    )]
    Saturated {
        /// Pixels at full scale in some frame.
        saturated: usize,
        /// Pixels of the region.
        pixels: usize,
        /// The level with most of them, 0 … 1.
        level: f64,
    },
    /// Too few levels for the polynomial.
    #[error(
        "{found} different grey levels, at least {needed} needed for a polynomial of order 7 with a residual; record more"
    )]
    TooFewLevels {
        /// Number of different levels.
        found: usize,
        /// Fewest grey levels that are accepted.
        needed: usize,
    },
    /// A image that does not answer.
    #[error(
        "the region changes by {range_dn:.2} DN from darkest to brightest level, at least {least_dn:.1} DN needed; check that the region (--roi) is lit by the projector and that the levels are right"
    )]
    Flat {
        /// Range of the means.
        range_dn: f64,
        /// Smallest range accepted, DN.
        least_dn: f64,
    },
    /// A response that falls.
    #[error(
        "the response is not monotonic: {here_dn:.2} DN at level {here:.4} but {there_dn:.2} DN at level {there:.4}; are frames \
         and levels in the same order?"
    )]
    NotMonotonic {
        /// Lower of both levels.
        here: f64,
        /// Mean grey value at the lower level, DN.
        here_dn: f64,
        /// Higher of both levels.
        there: f64,
        /// Mean grey value at the higher level, DN.
        there_dn: f64,
    },
    /// A curve that does not determine the requested quantity.
    #[error("the grey levels do not determine {what}; record more levels between black and white")]
    Undetermined {
        /// What was to be found.
        what: &'static str,
    },
    /// Steps that make no phase.
    #[error("{steps} phase steps: must be 3 to 64")]
    Steps {
        /// Number of steps requested.
        steps: u32,
    },
    /// Too few pixels have contrast.
    #[error(
        "{found} pixels are lit and not saturated, at least {needed} needed; choose a --roi with fringes"
    )]
    NoFringes {
        /// Number of pixels with contrast.
        found: usize,
        /// Fewest pixels that are accepted.
        needed: usize,
    },
}
