//! Why a sequence or a frame cannot be decoded.

use super::dirt::finding::Finding;
use super::identity::event::OrderEvent;
use crate::pattern::{Axis, PatternError, Threshold};
use thiserror::Error;

/// A refusal; nothing has been changed by the call that returns it.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum DecodeError {
    /// A set has an impossible number.
    #[error("set {} (\"{name}\") of the sequence", .index + 1)]
    Pattern {
        /// Position in the sequence, from 0.
        index: usize,
        /// As in the recording.
        name: &'static str,
        /// What is wrong with it.
        source: PatternError,
    },
    /// A setting is out of its range.
    #[error("decode setting {key} = {value}: must be {least} to {most}")]
    Setting {
        /// Key of the setting, as in the configuration.
        key: &'static str,
        /// The value that was given.
        value: f64,
        /// Smallest value that is allowed.
        least: f64,
        /// Largest value that is allowed.
        most: f64,
    },
    /// The sine frames do not follow the sequence.
    #[error(
        "the sine frames along axis {axis:?} do not follow the sequence: {:.0} % of their modulation is unexplained, limit \
         15 %; are frames out of order, is the number of steps right, did part or light change in between?",
        residual * 100.0
    )]
    Disorder {
        /// Axis of the set.
        axis: Axis,
        /// Standard deviation of the residuals over the modulation.
        residual: f64,
    },
    /// A frame is wrong, and the others do not determine the phase without it.
    #[error("{} {}: {steps} steps do not determine the phase without it; record the set again, or project more steps", finding.place(), finding.fault)]
    WrongFrame {
        /// The frame and what is wrong with it.
        finding: Box<Finding>,
        /// Frames of the set.
        steps: u32,
    },
    /// A frame of the code is wrong, and what is left does not say what it should show.
    #[error("{} (code along axis {axis:?}) {}: nothing else in the sequence says what it should show; record again", finding.place(), finding.fault)]
    WrongCode {
        /// Projector axis of the code.
        axis: Axis,
        /// The frame and what is wrong with it.
        finding: Box<Finding>,
    },
    /// Code and phase give different coordinates.
    #[error(
        "code and phase along axis {axis:?} contradict each other: {jumps} order jumps at {wraps} wraps, {unresolved} of {lit} \
         lit pixels without order, limit {:.0} % of either; are the code's frames in order, are stripe_px, code, invert, \
         direction and first_step_rad right? (decode.max_contradiction raises the limit)",
        limit * 100.0
    )]
    Contradiction {
        /// Projector axis of the code and the phase.
        axis: Axis,
        /// Places where the absolute phase jumps by whole periods.
        jumps: usize,
        /// Places where the wrapped phase passes 2π.
        wraps: usize,
        /// Pixels whose order stays open.
        unresolved: usize,
        /// These and the valid ones.
        lit: usize,
        /// The setting `max_contradiction`, a fraction.
        limit: f64,
    },
    /// The check of the sequence found frames that do not show their patterns.
    #[error(
        "the frames are not in the order of the sequence (check along axis {axis:?}): {event}; record again, and look for lost triggers"
    )]
    Order {
        /// Projector axis that showed it.
        axis: Axis,
        /// What happened to the order.
        event: OrderEvent,
    },
    /// The check of the sequence cannot show every slip and exchange.
    #[error(
        "the check cannot prove the order of the frames: nobody would see along axis {axis:?} that {event}; add {{ set = \"check\", axis = \"{}\", stripe_px = 8.0 }} to the sequence, \
         or a check with other stripes or another seed",
        match axis { Axis::X => "x", Axis::Y => "y" }
    )]
    OrderNotProven {
        /// Projector axis whose coordinates would be wrong.
        axis: Axis,
        /// What would stay unseen.
        event: OrderEvent,
    },
    /// Two frames of different steps are the same.
    #[error(
        "set {} of the sequence (axis {axis:?}): the frames of its steps {first} and {second} are the same, bit by bit, but noise never repeats: one is a copy of the other; \
         copy the frames from the camera anew, or record again",
        set + 1
    )]
    CopiedStep {
        /// Position of the set in the sequence, from 0.
        set: usize,
        /// Projector axis of the set.
        axis: Axis,
        /// The step of one of them, from 1.
        first: usize,
        /// The step of the other, from 1.
        second: usize,
    },
    /// White and black frames are exchanged.
    #[error(
        "the white frame is darker than the black one (axis {axis:?}): exchanged in the sequence or among the files?"
    )]
    WhiteBelowBlack {
        /// Axis that they belong to.
        axis: Axis,
    },
    /// The raster is empty or too large.
    #[error(
        "frames of {width_px} x {height_px} pixels: must be 1 to {} pixels in all",
        crate::frame::MAX_PIXELS
    )]
    Size {
        /// Columns of the camera, px.
        width_px: u32,
        /// Rows of the camera, px.
        height_px: u32,
    },
    /// The grey scale is empty.
    #[error("full_scale_dn = 0: must be at least 1 (255 for 8 bits, 4095 for 12 bits)")]
    FullScale,
    /// The projector has no size.
    #[error("the projector has no pixels along axis {axis:?}: check width_px and height_px of the projector")]
    Extent {
        /// Axis of the sets.
        axis: Axis,
    },
    /// No set of the sequence gives a projector coordinate.
    #[error("the sequence has neither a sine nor a gray set: there is nothing to decode")]
    NothingToDecode,
    /// Two sets say the same.
    #[error(
        "sets {first} and {second} of the sequence are the same ({name}, axis {axis:?}): remove one of them"
    )]
    Duplicate {
        /// Position of the first.
        first: usize,
        /// Position of the second.
        second: usize,
        /// As in the recording.
        name: &'static str,
        /// Projector axis of both sets.
        axis: Axis,
    },
    /// A sequence beyond any projector's memory.
    #[error("the sequence has {count} frames: at most {} are decoded", super::limits::MAX_FRAMES)]
    TooManyFrames {
        /// Frames up to the set that went too far.
        count: usize,
    },
    /// More sine sets than the decoder can hold on one axis.
    #[error("{count} sine sets on axis {axis:?}: at most {} are decoded", super::limits::MAX_SINES)]
    TooManySines {
        /// Axis of the sets.
        axis: Axis,
        /// Number of sine sets on the axis.
        count: usize,
    },
    /// A code set without anything to compare its bits with.
    #[error(
        "gray set {} on axis {axis:?} has no threshold ({wanted:?}): the sequence lacks {missing}; add it or set `threshold`",
        .index + 1
    )]
    MissingThreshold {
        /// Position in the sequence.
        index: usize,
        /// Axis of the set.
        axis: Axis,
        /// What the set asks for.
        wanted: Option<Threshold>,
        /// What is not there.
        missing: &'static str,
    },
    /// The code repeats before the projector ends.
    #[error(
        "gray set {} on axis {axis:?} numbers {covers_px} projector pixels of {extent_px}: its stripes would repeat; more bits or longer stripes are needed",
        .index + 1
    )]
    CodeTooShort {
        /// Position in the sequence.
        index: usize,
        /// Axis of the set.
        axis: Axis,
        /// Projector pixels that the code numbers: 2^bits · stripe_px.
        covers_px: f64,
        /// Projector pixels along the axis.
        extent_px: u32,
    },
    /// The sines on an axis cannot be numbered.
    #[error(
        "axis {axis:?}: no absolute fringe order over {extent_px} projector pixels: {missing}; add a gray set with stripe_px of at most {finest_px} or sine sets whose beat covers the projector (`fringetool unwrap` gives the relative phase)"
    )]
    NoAbsoluteOrder {
        /// Axis of the sets.
        axis: Axis,
        /// Projector pixels along the axis.
        extent_px: u32,
        /// Finest fringe period, projector pixels.
        finest_px: f64,
        /// What was found instead.
        missing: String,
    },
    /// An order that was asked for without its sets.
    #[error(
        "order {order} along axis {axis:?}: the sequence lacks {missing}; add it, or choose another order"
    )]
    OrderSet {
        /// As on the command line.
        order: &'static str,
        /// Axis of the sets.
        axis: Axis,
        /// What is not there.
        missing: String,
    },
    /// A wrapped phase for a set that is not decoded, or of another size.
    #[error(
        "set {} takes no wrapped phase of {pixels} pixels: it is no sine set in use, or the size differs",
        .index + 1
    )]
    Replace {
        /// Position in the sequence.
        index: usize,
        /// Pixels of the given map.
        pixels: usize,
    },
    /// A frame out of turn.
    #[error("frame {got} landed where frame {expected} of {count} was due")]
    FrameOrder {
        /// The next frame of the sequence; equal to `count` when all have landed.
        expected: usize,
        /// The frame that landed.
        got: usize,
        /// Frames of the sequence.
        count: usize,
    },
    /// A frame of another size.
    #[error(
        "frame {index} is {width_px} x {height_px} with {pixels} values, but the camera has {want_width_px} x {want_height_px}"
    )]
    FrameSize {
        /// Frame number in the sequence, from 0.
        index: usize,
        /// Columns of the frame, px.
        width_px: u32,
        /// Rows of the frame, px.
        height_px: u32,
        /// Values that came with it.
        pixels: usize,
        /// Columns of the decoder.
        want_width_px: u32,
        /// Rows of the decoder.
        want_height_px: u32,
    },
    /// A frame of another grey scale.
    #[error("frame {index} has full scale {got_dn} DN, but the sequence began with {want_dn} DN")]
    FrameFullScale {
        /// Frame number in the sequence, from 0.
        index: usize,
        /// Full scale of the frame.
        got_dn: u16,
        /// Full scale of the decoder.
        want_dn: u16,
    },
    /// A grey value that the sensor cannot give.
    #[error(
        "frame {index}, pixel {pixel}: {value_dn} DN exceeds full scale {full_scale_dn} DN; is the bit depth right, and are the values in the low bits?"
    )]
    AboveFullScale {
        /// Frame number in the sequence, from 0.
        index: usize,
        /// Row · width + column.
        pixel: usize,
        /// Grey value of the pixel, DN.
        value_dn: u16,
        /// Full scale of the frame, DN.
        full_scale_dn: u16,
    },
    /// `finish` before the axis is complete.
    #[error("axis {axis:?} is not complete: {landed} frames have landed, {needed} are needed")]
    Incomplete {
        /// Projector axis that was asked for.
        axis: Axis,
        /// Frames of the axis that have landed.
        landed: usize,
        /// Frames that the axis needs.
        needed: usize,
    },
    /// The sequence has no set along this axis.
    #[error("the sequence has no sine or gray set on axis {axis:?}")]
    NoSuchAxis {
        /// Projector axis that was asked for.
        axis: Axis,
    },
    /// The output planes do not fit.
    #[error("the output planes do not fit the decoder: use a phase map made from `Decoder::info`")]
    Output,
}
