//! Why a response cannot be told.

use thiserror::Error;

/// Why a response cannot be told; the message ends with the likely remedy.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ResponseError {
    /// A region that is not in the picture.
    #[error("region {roi} does not lie in the frame of {width_px} × {height_px} px; correct --roi")]
    RoiOutside {
        /// As `x,y,width,height`.
        roi: String,
        /// Columns.
        width_px: u32,
        /// Rows.
        height_px: u32,
    },
    /// A region that would fill the memory.
    #[error("the region has {pixels} pixels, limit {limit}; a smaller --roi averages well enough")]
    RoiLarge {
        /// As given.
        pixels: u64,
        /// Largest accepted.
        limit: u64,
    },
    /// Frames of unequal size or depth.
    #[error(
        "frame {number} has {found}, the first one {expected}; all must be from one camera with one setting"
    )]
    Unequal {
        /// Which frame, from 0.
        number: usize,
        /// Its size.
        found: String,
        /// The first one's.
        expected: String,
    },
    /// Too many saturated pixels.
    #[error(
        "{saturated} of {pixels} pixels of the region saturate (most at level {level:.3}); lower exposure or gain, or name \
         another --roi"
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
        /// Different levels.
        found: usize,
        /// Fewest accepted.
        needed: usize,
    },
    /// A picture that does not answer.
    #[error(
        "the region changes by {range_dn:.2} DN from darkest to brightest level, at least {least_dn:.1} DN needed; is the \
         projector's light in the region (--roi), are the levels the right ones?"
    )]
    Flat {
        /// Range of the means.
        range_dn: f64,
        /// Smallest accepted.
        least_dn: f64,
    },
    /// A response that falls.
    #[error(
        "the response is not monotonic: {here_dn:.2} DN at level {here:.4} but {there_dn:.2} DN at level {there:.4}; are frames \
         and levels in the same order?"
    )]
    NotMonotonic {
        /// The lower level.
        here: f64,
        /// Its mean.
        here_dn: f64,
        /// The higher level.
        there: f64,
        /// Its mean.
        there_dn: f64,
    },
    /// A curve that does not determine what is asked.
    #[error("the grey levels do not determine {what}; record more levels between black and white")]
    Undetermined {
        /// What was to be found.
        what: &'static str,
    },
    /// Steps that make no phase.
    #[error("{steps} phase steps: must be 3 to 64")]
    Steps {
        /// As asked.
        steps: u32,
    },
    /// Fringes without contrast.
    #[error(
        "{found} pixels are lit and not saturated, at least {needed} needed; name a --roi with fringes in it"
    )]
    NoFringes {
        /// Pixels with contrast.
        found: usize,
        /// Fewest accepted.
        needed: usize,
    },
}
