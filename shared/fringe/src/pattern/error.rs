//! What can be wrong with a pattern set.

use thiserror::Error;

/// What is wrong with a pattern set; the caller adds where it stands.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum PatternError {
    /// Fewer than three steps.
    #[error("steps = {steps}: a phase needs at least 3 steps (and at most 64), or a single frame")]
    Steps {
        /// Number of steps given.
        steps: u32,
    },
    /// A length that is not finite or too small.
    #[error("{key} = {value}: must be a finite number of at least {least} projector pixels")]
    Length {
        /// Key of the value.
        key: &'static str,
        /// Value given for the key.
        value: f64,
        /// Smallest value accepted for the key.
        least: f64,
    },
    /// Too few or too many bits.
    #[error("bits = {bits}: must be 1 to 16")]
    Bits {
        /// Number of bits given.
        bits: u32,
    },
    /// Too few or too many grey levels.
    #[error("levels: {count} grey levels; must be 2 to 1024")]
    Levels {
        /// Number of grey levels given.
        count: usize,
    },
    /// No grey value of 8 bits.
    #[error("levels: {value} is not a grey value; must be 0 to 255")]
    Level {
        /// Grey level given, DN.
        value: f64,
    },
    /// A ramp of both kinds.
    #[error(
        "axis and levels together: a ramp is either one frame along an axis or even frames of several levels"
    )]
    RampKind,
    /// NaN or infinite first step.
    #[error("first_step_rad must be a finite number")]
    FirstStep,
    /// Shifts that do not belong to the steps.
    #[error("shifts_rad has {shifts} numbers for steps = {steps}: one finite number per step is needed")]
    Shifts {
        /// Number of shifts given.
        shifts: usize,
        /// Number of steps given.
        steps: u32,
    },
    /// Shifts that leave background, modulation or phase open.
    #[error(
        "shifts_rad: a phase noise of {gain:.0} times the grey noise, limit {most:.0}: spread the shifts over the circle, at least \
         three of them apart"
    )]
    ShiftsAlike {
        /// √(trace/2) of the covariance of B cos φ and B sin φ per unit noise; infinite when singular.
        gain: f64,
        /// Largest value accepted, in the unit of `value`.
        most: f64,
    },
    /// Neither stairs of phase nor of grey levels.
    #[error("steps = {steps}: stairs need 1 frame (grey levels) or 3 to 64 (phase)")]
    StairSteps {
        /// Number of steps given.
        steps: u32,
    },
    /// A code moved by a stripe or more.
    #[error("shift_px = {shift_px}: must be 0 or more and less than stripe_px = {stripe_px}")]
    CodeShift {
        /// Shift given, projector px.
        shift_px: f64,
        /// Width of a stripe given, projector px.
        stripe_px: f64,
    },
    /// A line as wide as its period, or wider.
    #[error("width_px = {width_px}: a line must be wider than 0 and narrower than period_px = {period_px}")]
    LineWidth {
        /// Width given, projector px.
        width_px: f64,
        /// Period given, projector px.
        period_px: f64,
    },
    /// Too few or too many frequencies.
    #[error("periods_px has {count} numbers: micro phase shifting needs 2 to {most}")]
    MicroPeriods {
        /// Number of periods given.
        count: usize,
        /// Most periods that are taken.
        most: usize,
    },
    /// Shifts that do not belong to the frames.
    #[error(
        "shifts_rad has {shifts} numbers, the micro set {frames} frames: one finite number per frame is needed"
    )]
    MicroShifts {
        /// Number of shifts given.
        shifts: usize,
        /// Frames of the set.
        frames: usize,
    },
    /// Fewer than three steps of a carrier.
    #[error("carrier_steps = {carrier_steps}: a carrier needs at least 3 steps (and at most 64)")]
    CarrierSteps {
        /// Steps of the carrier.
        carrier_steps: u32,
    },
    /// Too many frames of a modulated set.
    #[error("steps = {steps} times carrier_steps = {carrier_steps}: at most 64 frames")]
    ModulatedFrames {
        /// Steps of the fringes.
        steps: u32,
        /// Steps of the carrier.
        carrier_steps: u32,
    },
    /// A missing frame that the sequence does not have.
    #[error("missing: frame {frame} is beyond the sequence, which has {count} frames, 0 to {}", count.saturating_sub(1))]
    MissingBeyond {
        /// Number given, from 0.
        frame: usize,
        /// Frames of the sequence.
        count: usize,
    },
    /// A code that misses a bit which others do not tell.
    #[error(
        "missing: a code without bit {bit} of {bits} numbers nothing; only its last bits or, beside a whole inverse, the whole code may be missing"
    )]
    MissingBit {
        /// Bit that is missing, from 1, the most significant first.
        bit: usize,
        /// Bits of the code.
        bits: u32,
    },
    /// The generator does not support this set.
    #[error("set \"{0}\" can be recorded but not generated")]
    NotGenerated(&'static str),
    /// A table that cannot be one.
    #[error("a level table needs 2 to 65536 values from 0 to 1 that rise and never fall: {0}")]
    LevelTable(String),
}
