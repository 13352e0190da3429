//! What each frame is for, and what each axis is made of.

use super::chain::Chain;
use crate::pattern::{Axis, Code, Direction};

/// What a landing frame is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Nothing.
    Ignored,
    /// Step of a sine set (index into [`Plan::sines`]).
    Sine {
        /// Which.
        slot: usize,
        /// Frame in the set.
        step: usize,
    },
    /// Kept as it is until the axis is finished (index of the stored raster).
    Stored(usize),
}

/// A sine set that is decoded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SinePlan {
    /// Axis.
    pub axis: Axis,
    /// Projector pixels per 2π.
    pub period_px: f64,
    /// Number of steps N.
    pub steps: u32,
    /// Phase step of frame 0, rad.
    pub first_step_rad: f64,
    /// Sense of the steps.
    pub direction: Direction,
}

/// What the bits are compared with, as stored rasters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// (white, black).
    WhiteBlack(usize, usize),
    /// Background of this sine.
    SineMean(usize),
    /// First raster of the complementary set.
    Complement(usize),
}

/// A code that is decoded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CodePlan {
    /// First stored raster; the others follow.
    pub first: usize,
    /// Number of bits.
    pub bits: usize,
    /// Projector pixels per stripe.
    pub stripe_px: f64,
    /// Black and white exchanged.
    pub invert: bool,
    /// Numbering.
    pub code: Code,
    /// Threshold.
    pub reference: Reference,
}

/// The white and the black frame among the stored rasters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Levels {
    /// Raster of the white frame.
    pub white: usize,
    /// Raster of the black frame.
    pub black: usize,
}

/// How one axis is decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisPlan {
    /// Axis.
    pub axis: Axis,
    /// Projector pixels along the axis.
    pub extent_px: f64,
    /// Period of the result: finest sine, or the stripe where there is no sine.
    pub period_px: f64,
    /// White and black, where the sequence has both: they tell the pixel's footprint.
    pub levels: Option<Levels>,
    /// Sines in use (indices into [`Plan::sines`]); the first one is the finest. The chain counts in this list.
    pub sines: Vec<usize>,
    /// Code, if it is used.
    pub code: Option<CodePlan>,
    /// Way to the finest coordinate; none for a code without sines.
    pub chain: Option<Chain>,
    /// Frames that must have landed.
    pub needed: usize,
    /// Sets that the axis does not use, for its report.
    pub ignored: Vec<String>,
}

/// The whole sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// One role per frame.
    pub roles: Vec<Role>,
    /// Sine sets in use.
    pub sines: Vec<SinePlan>,
    /// Number of stored rasters.
    pub stored: usize,
    /// Axes, x before y.
    pub axes: Vec<AxisPlan>,
}
