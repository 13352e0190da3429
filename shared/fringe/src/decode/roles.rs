//! What each frame is for, and what each axis is made of.

use super::chain::Chain;
use super::micro::Micro;
use super::number::Residues;
use crate::pattern::{Axis, Code};

/// What a landing frame is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The decoder does not use the frame.
    Ignored,
    /// Step of a sine set (index into [`Plan::sines`]).
    Sine {
        /// Index of the set in [`Plan::sines`].
        slot: usize,
        /// Frame in the set.
        step: usize,
    },
    /// Kept as it is until the axis is finished (index of the stored raster).
    Stored(usize),
}

/// A sine set that is decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct SinePlan {
    /// Position in the sequence.
    pub index: usize,
    /// Projector axis of the set.
    pub axis: Axis,
    /// Projector pixels per 2π.
    pub period_px: f64,
    /// Number of steps N.
    pub steps: u32,
    /// Stored raster of the first step; the others follow.
    pub first: usize,
    /// Phase step δ of each frame, rad.
    pub shifts_rad: Vec<f64>,
    /// Whether the steps are 2π/N.
    pub even: bool,
    /// What the frames show.
    pub kind: SineKind,
}

/// What the frames of a set with a phase show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SineKind {
    /// A sine, one frame for each step.
    Plain,
    /// Lines: a sine and its harmonics.
    Lines,
    /// A sine times a carrier of so many steps, shown one after another for each step.
    Carried(u32),
}

impl SinePlan {
    /// Stored rasters of the set.
    pub fn rasters(&self) -> std::ops::Range<usize> {
        let frames = match self.kind {
            SineKind::Carried(carrier_steps) => self.steps * carrier_steps,
            SineKind::Plain | SineKind::Lines => self.steps,
        };
        self.first..self.first + frames as usize
    }
}

/// What the bits are compared with, as stored rasters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// Rasters of the white and of the black frame.
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
    /// Number of bits, one raster each.
    pub bits: usize,
    /// Projector pixels per stripe.
    pub stripe_px: f64,
    /// How far the code is moved towards smaller coordinates, projector pixels.
    pub shift_px: f64,
    /// Black and white exchanged.
    pub invert: bool,
    /// Numbering of the stripes.
    pub code: Code,
    /// What the bits are compared with.
    pub reference: Reference,
}

/// Stairs that are decoded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StairPlan {
    /// Projector pixels per stair.
    pub stair_px: f64,
    /// Number of stairs over the projector.
    pub stairs: f64,
    /// Frames that the stairs are read from.
    pub source: StairSource,
}

/// Phase or grey level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StairSource {
    /// A set of steps, summed like a sine (index into [`Plan::sines`]).
    Phase(usize),
    /// One raster between black and white.
    Grey(usize, Levels),
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
    /// Projector axis that is decoded.
    pub axis: Axis,
    /// Projector pixels along the axis.
    pub extent_px: f64,
    /// Period of the result: finest sine, or the stripe where there is no sine.
    pub period_px: f64,
    /// White and black, where the sequence has both: they give the pixel's footprint.
    pub levels: Option<Levels>,
    /// Sines in use (indices into [`Plan::sines`]); the first one is the finest. The chain counts in this list.
    pub sines: Vec<usize>,
    /// Code, if it is used.
    pub code: Option<CodePlan>,
    /// The same code moved by half a stripe: both together number half stripes.
    pub shifted: Option<CodePlan>,
    /// Stairs, if they are used.
    pub stair: Option<StairPlan>,
    /// Residues by coprime periods, if they are used.
    pub residues: Option<Residues>,
    /// Further frequencies of a micro set, if they number the fringes.
    pub micro: Option<Micro>,
    /// Whether all sines make the result.
    pub fused: bool,
    /// Way to the finest coordinate; none for a code without sines.
    pub chain: Option<Chain>,
    /// Frames that must have landed.
    pub needed: usize,
    /// Sets that the axis does not use, for its report.
    pub ignored: Vec<String>,
}

impl AxisPlan {
    /// A plan without any set.
    pub fn empty(axis: Axis, extent_px: f64) -> Self {
        Self {
            axis,
            extent_px,
            period_px: 0.0,
            levels: None,
            sines: Vec::new(),
            code: None,
            shifted: None,
            stair: None,
            residues: None,
            micro: None,
            fused: false,
            chain: None,
            needed: 0,
            ignored: Vec::new(),
        }
    }
}

/// The role of every frame and the plan of every axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// One role per frame.
    pub roles: Vec<Role>,
    /// Sine sets in use.
    pub sines: Vec<SinePlan>,
    /// Number of stored rasters.
    pub stored: usize,
    /// Set and step of each stored raster, from 0; (0, 0) where it is a step of a sine.
    pub homes: Vec<(usize, usize)>,
    /// Axes, x before y.
    pub axes: Vec<AxisPlan>,
}
