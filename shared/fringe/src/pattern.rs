//! Projected patterns and their order: the `sequence` of a recording.
//!
//! Projector coordinates count pixels, 0 is the centre of the first column (axis x) or row (axis y).

mod apart;
mod check;
mod codecs;
mod error;
mod image;
mod level_table;
mod levels;
mod missing;

pub use apart::{are_apart, first_harmonic, periods_apart, stepping};
pub use error::PatternError;
pub use image::level_u8;
pub use level_table::LevelTable;
pub use levels::GreyLevels;
pub use missing::{Remaining, without};

use levels::ALL_LEVELS;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// The direction along which a pattern varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Along projector columns: vertical fringes.
    X,
    /// Along projector rows: horizontal fringes.
    Y,
}

/// The sense in which the phase steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Direction {
    /// Step i shows cos(2πx/p − 2πi/N): the fringes move towards larger x.
    #[default]
    #[serde(rename = "+")]
    Forward,
    /// Step i shows cos(2πx/p + 2πi/N).
    #[serde(rename = "-")]
    Backward,
}

impl Direction {
    /// Sign of the direction, +1 or −1.
    pub fn sign(self) -> f64 {
        match self {
            Self::Forward => 1.0,
            Self::Backward => -1.0,
        }
    }
}

/// How the stripes of a code are numbered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Code {
    /// Reflected binary: neighbours differ in one bit.
    #[default]
    Gray,
    /// Plain binary: the bits are the stripe number.
    Binary,
}

/// What a bit frame is compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Threshold {
    /// The mean of the white and the black frame of the same sequence.
    WhiteBlack,
    /// The background A of the first sine set on the same axis.
    SineMean,
    /// The frame of the complementary set (`invert = true`) with the same axis, bits and stripe.
    Complement,
}

/// A group of frames that belong together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "set", rename_all = "lowercase", deny_unknown_fields)]
pub enum PatternSet {
    /// Phase-stepped sinusoids: A + B cos(2πx/period − 2πi/steps − first_step).
    Sine {
        /// Axis along which the pattern varies.
        axis: Axis,
        /// Projector pixels per 2π.
        period_px: f64,
        /// Number of frames N ≥ 3; 1: a single frame, decoded by its Fourier transform.
        steps: u32,
        /// Phase step of frame 0, rad.
        #[serde(default, skip_serializing_if = "is_zero")]
        first_step_rad: f64,
        /// Sense of the steps.
        #[serde(default, skip_serializing_if = "is_default")]
        direction: Direction,
        /// Phase step of each frame, rad, where the steps are not the even ones 2πi/N: any values that determine a phase.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        shifts_rad: Vec<f64>,
    },
    /// Lines, one a period, that step over the period (line shift, Gühring 2001): frame i lights the columns from i · period/steps
    /// on, `width_px` of them.
    Lines {
        /// Axis along which the pattern varies.
        axis: Axis,
        /// Projector pixels from line to line.
        period_px: f64,
        /// Number of frames: the places of a line within a period.
        steps: u32,
        /// Columns of a line, projector pixels.
        #[serde(default = "one_px", skip_serializing_if = "is_one")]
        width_px: f64,
        /// Sense of the steps.
        #[serde(default, skip_serializing_if = "is_default")]
        direction: Direction,
    },
    /// Micro phase shifting (Gupta and Nayar 2012): three steps of the first period, one frame of each further one. The periods
    /// are nearly alike; together they number the fringes.
    Micro {
        /// Axis along which the pattern varies.
        axis: Axis,
        /// Projector pixels per 2π of each frequency.
        periods_px: Vec<f64>,
        /// Sense of the steps.
        #[serde(default, skip_serializing_if = "is_default")]
        direction: Direction,
        /// Phase step of each frame, rad, where they are not 0, 2π/3, 4π/3 of the first period and 0 of the others.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        shifts_rad: Vec<f64>,
    },
    /// Modulated phase shifting (Chen, Seidel and Lensch 2008): each step of the fringes is multiplied with a carrier across them, which
    /// steps too. What returns with the carrier is direct light; light between surfaces does not.
    Modulated {
        /// Axis along which the fringes vary; the carrier varies along the other one.
        axis: Axis,
        /// Projector pixels per 2π of the fringes.
        period_px: f64,
        /// Steps of the fringes.
        steps: u32,
        /// Projector pixels per 2π of the carrier.
        carrier_px: f64,
        /// Steps of the carrier, shown one after another for each step of the fringes.
        carrier_steps: u32,
        /// Sense of the steps of the fringes.
        #[serde(default, skip_serializing_if = "is_default")]
        direction: Direction,
    },
    /// Stripe number as bits, most significant first.
    Gray {
        /// Axis along which the pattern varies.
        axis: Axis,
        /// Number of bits, each one frame.
        bits: u32,
        /// Projector pixels per stripe: the period of the sines, or half of it for a code without jumps.
        stripe_px: f64,
        /// How far the code is moved towards smaller coordinates. A second set, moved by half a stripe, makes a pair
        /// without jumps (shifted Gray code).
        #[serde(default, skip_serializing_if = "is_zero")]
        shift_px: f64,
        /// Black and white exchanged.
        #[serde(default, skip_serializing_if = "is_default")]
        invert: bool,
        /// Code in which the stripes are numbered.
        #[serde(default, skip_serializing_if = "is_default")]
        code: Code,
        /// What the bits are compared with. When absent: a complementary set if the sequence has one, else white and
        /// black if it has both, else the mean of the sines.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        threshold: Option<Threshold>,
    },
    /// Every pixel at full level.
    White {},
    /// Every pixel at level zero.
    Black {},
    /// Fringe order as a phase, or as a grey level (eq. 2.59–2.61).
    Stair {
        /// Axis along which the pattern varies.
        axis: Axis,
        /// Projector pixels per stair: the period of the sines, or half of it for an order without jumps.
        stair_px: f64,
        /// Number of frames: N ≥ 3 for stairs of the phase, 1 for one frame of rising grey levels.
        steps: u32,
    },
    /// Grey levels. With `levels`: even frames, one a level, for the projector's response. With `axis`: one frame that
    /// runs from black to white over the projector. With neither: 256 even frames.
    Ramp {
        /// Direction of change of a single frame.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        axis: Option<Axis>,
        /// The grey levels of the even frames.
        #[serde(
            default,
            skip_serializing_if = "Option::is_none",
            alias = "steps",
            alias = "frames",
            alias = "count"
        )]
        levels: Option<GreyLevels>,
    },
    /// Pseudo-random stripes in one frame, by which the decoder proves that every frame shows its pattern: no slip, no exchange and no
    /// repetition leaves a coordinate that explains all frames.
    Check {
        /// Axis along which the pattern varies.
        axis: Axis,
        /// Projector pixels per stripe.
        stripe_px: f64,
        /// Which of the pseudo-random patterns.
        #[serde(default, skip_serializing_if = "is_default")]
        seed: u32,
    },
    /// Random dots; cannot be generated, only recorded and ignored.
    Random {
        /// Number of frames of the set.
        #[serde(default = "one")]
        frames: u32,
    },
}

fn one() -> u32 {
    1
}

fn one_px() -> f64 {
    1.0
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde's signature
fn is_one(value: &f64) -> bool {
    *value == 1.0
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde's signature
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl PatternSet {
    /// Fringes in even steps from zero.
    pub const fn sine(axis: Axis, period_px: f64, steps: u32) -> Self {
        Self::Sine {
            axis,
            period_px,
            steps,
            first_step_rad: 0.0,
            direction: Direction::Forward,
            shifts_rad: Vec::new(),
        }
    }

    /// A Gray code as most projects write it: stripes from the first column on, not inverted.
    pub const fn gray(axis: Axis, bits: u32, stripe_px: f64) -> Self {
        let (shift_px, invert, code, threshold) = (0.0, false, Code::Gray, None);
        Self::Gray { axis, bits, stripe_px, shift_px, invert, code, threshold }
    }

    /// Name as in the recording.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Sine { .. } => "sine",
            Self::Lines { .. } => "lines",
            Self::Micro { .. } => "micro",
            Self::Modulated { .. } => "modulated",
            Self::Gray { .. } => "gray",
            Self::White {} => "white",
            Self::Black {} => "black",
            Self::Stair { .. } => "stair",
            Self::Ramp { .. } => "ramp",
            Self::Check { .. } => "check",
            Self::Random { .. } => "random",
        }
    }

    /// Number of frames of the set.
    pub fn frames(&self) -> usize {
        (match self {
            Self::Sine { steps, .. } | Self::Stair { steps, .. } | Self::Lines { steps, .. } => *steps,
            Self::Micro { periods_px, .. } => return periods_px.len() + 2,
            Self::Modulated { steps, carrier_steps, .. } => steps.saturating_mul(*carrier_steps),
            Self::Gray { bits, .. } => *bits,
            Self::White {} | Self::Black {} | Self::Check { .. } | Self::Ramp { axis: Some(_), .. } => 1,
            Self::Ramp { levels, .. } => return levels.as_ref().unwrap_or(&ALL_LEVELS).count(),
            Self::Random { frames } => *frames,
        }) as usize
    }

    /// The axis along which it varies, if it does.
    pub fn axis(&self) -> Option<Axis> {
        match self {
            Self::Sine { axis, .. }
            | Self::Lines { axis, .. }
            | Self::Micro { axis, .. }
            | Self::Modulated { axis, .. }
            | Self::Gray { axis, .. }
            | Self::Check { axis, .. }
            | Self::Stair { axis, .. } => Some(*axis),
            Self::Ramp { axis, .. } => *axis,
            Self::White {} | Self::Black {} | Self::Random { .. } => None,
        }
    }

    /// Phase step δ of one frame, rad: frame i shows cos(φ − δᵢ), lines this beside their harmonics. Zero for sets without phase.
    pub fn step_rad(&self, step: usize) -> f64 {
        match self {
            Self::Sine { steps, first_step_rad, direction, shifts_rad, .. } => {
                let even_rad = || TAU * step as f64 / f64::from(*steps);
                direction.sign() * (shifts_rad.get(step).copied().unwrap_or_else(even_rad) + first_step_rad)
            }
            Self::Stair { steps, .. } => TAU * step as f64 / f64::from(*steps),
            Self::Lines { .. } | Self::Micro { .. } | Self::Modulated { .. } => self.codec_step_rad(step),
            _ => 0.0,
        }
    }

    /// Levels 0 … 1 of the frames of a set that shows grey levels over the whole projector.
    pub fn grey_levels(&self) -> Option<Vec<f64>> {
        let Self::Ramp { axis: None, levels } = self else { return None };
        let levels = levels.as_ref().unwrap_or(&ALL_LEVELS);
        Some((0..levels.count()).map(|frame| levels.level(frame)).collect())
    }
}

/// Finds set and step of a frame number that runs through the sets in order.
pub fn locate(sequence: &[PatternSet], frame: usize) -> Option<(usize, usize)> {
    let mut first = 0;
    for (index, set) in sequence.iter().enumerate() {
        if frame < first + set.frames() {
            return Some((index, frame - first));
        }
        first += set.frames();
    }
    None
}

/// Number of frames of a sequence.
pub fn frame_count(sequence: &[PatternSet]) -> usize {
    sequence.iter().map(PatternSet::frames).sum()
}

#[cfg(test)]
mod tests;
