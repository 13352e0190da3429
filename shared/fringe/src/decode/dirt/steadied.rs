//! Frames as they were without the changes of the light between them.

use super::columns::Column;
use crate::decode::limits::MAX_STEPS;
use crate::decode::spectrum::{SIDE, Side};

/// What takes the changes of the light out of frames whose values are parts of a pixel's mean level.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::decode) struct Steadied {
    /// A frame counts times this …
    factors: Column,
    /// … and less this.
    added: Column,
    /// How much of the changes may be left over, as a part of the level, standard deviation.
    pub left: f64,
}

/// A quarter of a change may be left over: neither kind of change is the whole truth, for the light of the room falls from another side than the projector's.
const LEFT_OVER: f64 = 0.25;

impl Steadied {
    /// Of a light that is the same in all frames.
    pub const NOTHING: Self = Self { factors: [1.0; MAX_STEPS], added: [0.0; MAX_STEPS], left: 0.0 };

    /// Of a light that adds to the frames, which have these levels, their mean 1; `deviation` is theirs.
    pub fn of_added(levels: &Column, deviation: f64) -> Self {
        Self { added: levels.map(|level| level - 1.0), left: LEFT_OVER * deviation, ..Self::NOTHING }
    }

    /// Of a light that scales the frames by these factors.
    pub fn of_scaled(factors: &Column, deviation: f64) -> Self {
        Self { factors: factors.map(|factor| 1.0 / factor), left: LEFT_OVER * deviation, ..Self::NOTHING }
    }

    /// Takes what scales the frames out of grey values of some pixels.
    #[inline(always)]
    pub fn unscale(&self, frames: &mut [Side]) {
        for (values, factor) in frames.iter_mut().zip(&self.factors) {
            for value in values {
                *value *= factor;
            }
        }
    }

    /// The frames of some pixels, written into a place for them.
    #[inline(always)]
    pub fn steady<'a>(&self, frames: &[Side], place: &'a mut [Side; MAX_STEPS]) -> &'a [Side] {
        let changes = self.factors.iter().zip(&self.added);
        for ((steady, values), (factor, added)) in place.iter_mut().zip(frames).zip(changes) {
            for l in 0..SIDE {
                steady[l] = values[l] * factor - added;
            }
        }
        &place[..frames.len()]
    }
}
