//! Best focus and depth of focus from images of a projected checkerboard (thesis section 3.2).
//!
//! A checkerboard's strongest component lies on the diagonal, at one half of a cycle per square along both axes. Defocus
//! damps it by the modulation transfer at that frequency, so the maximum of the 2D Fourier transform over a stack of
//! images measures the focus. Here ([`carrier`]) the maximum is sought in a Hann window without the mean, refined between
//! the bins of the transform, and divided by the mean grey value, so that neither the light's fall with distance nor the
//! pitch in pixels enters. Over the position ([`curve`]) a blur that grows in proportion to the distance from focus makes
//! a Gaussian, which is fitted; the depth of focus is the range in which it stays above a stated fraction of its maximum.

pub mod carrier;
pub mod curve;
#[cfg(test)]
mod tests;

use crate::response::ResponseError;
use thiserror::Error;

/// Why a focus cannot be determined; the message ends with the likely remedy.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum FocusError {
    /// A region that does not fit.
    #[error(transparent)]
    Region(#[from] ResponseError),
    /// A region too small for a frequency.
    #[error(
        "region {roi} is smaller than {least} × {least} px or larger than {most} pixels; choose another --roi"
    )]
    RegionSize {
        /// The region as `x,y,width,height`.
        roi: String,
        /// Smallest side allowed, px.
        least: u32,
        /// Largest number of pixels allowed.
        most: u64,
    },
    /// No image shows a projected checkerboard.
    #[error(
        "no image shows a periodic pattern in region {roi} (strongest component {contrast:.5} of the mean, {ratio:.1} times the \
         median; at least {least_contrast} and {least_ratio} times needed); is the checkerboard in the region?"
    )]
    NoPattern {
        /// The region as `x,y,width,height`.
        roi: String,
        /// Of the best image.
        contrast: f64,
        /// Of the best image.
        ratio: f64,
        /// Smallest contrast that is accepted.
        least_contrast: f64,
        /// Smallest ratio of peak to median accepted.
        least_ratio: f64,
    },
    /// Light beyond the sensor's range.
    #[error("{saturated} of {pixels} pixels of the region saturate; lower exposure or gain")]
    Saturated {
        /// Pixels at full scale.
        saturated: usize,
        /// Pixels of the region.
        pixels: usize,
    },
    /// Fewer different positions than the curve needs.
    #[error("{found} different positions, at least {needed} needed for a curve; record more images")]
    TooFewPositions {
        /// Number of different positions given.
        found: usize,
        /// Fewest positions that are accepted.
        needed: usize,
    },
    /// A fraction that cannot be one.
    #[error("fraction {0}: must be above 0 and below 1")]
    Fraction(f64),
}
