//! What is done with the frames of the sine sets besides the decoder's own least squares.

use fringe::decode::{DecodeError, Decoder, SineSet};
use fringe::frame::{Frame, FrameView};
use fringe::wrapped::harmonics::PhaseHarmonics;
use fringe::wrapped::windowed::{WindowedSettings, filter};
use fringe::wrapped::{Method, Stack, WrapError, Wrapped};
use std::collections::BTreeMap;
use thiserror::Error;

/// Sets with fewer periods over the projector keep the plain phase of their steps: one frame of them has no carrier, and the
/// error of a harmonic does not average out over the part. Such sets only number the fringes of finer ones.
const LEAST_PERIODS: f64 = 4.0;

/// Where the wrapped phase comes from.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PhaseMethod {
    /// None: the decoder's own running sums.
    pub method: Option<Method>,
    /// Whether the error of a harmonic is estimated from the phase and removed.
    pub remove_harmonics: bool,
    /// Standard deviation of the window of the windowed Fourier filter, px; none: not filtered.
    pub window_px: Option<f64>,
}

/// Why a method gives no phase.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum PhaseMethodError {
    /// The window has an impossible size.
    #[error("--windowed-filter {0}: must be 1 to 32 pixels")]
    Window(f64),
    /// Frames or steps that the method does not take.
    #[error("sine set {}", .set + 1)]
    Wrap {
        /// Position in the sequence, from 0.
        set: usize,
        /// The fault that the method found.
        source: WrapError,
    },
    /// Steps of unequal size.
    #[error(
        "sine set {}: --remove-harmonics needs even steps: with shifts_rad the error of a harmonic has no order",
        .set + 1
    )]
    UnevenSteps {
        /// Position in the sequence, from 0.
        set: usize,
    },
    /// Frames that are no plain sines.
    #[error(
        "set {set}: lines, micro and modulated sets have a decoding of their own; leave out --phase-method, --remove-harmonics and \
         --windowed-filter"
    )]
    Codec {
        /// Position in the sequence, from 0.
        set: usize,
    },
    /// Too few pixels for the estimate of harmonics.
    #[error("sine set {set}: --remove-harmonics: too few lit pixels to estimate the error")]
    FewPixels {
        /// Position in the sequence, from 0.
        set: usize,
    },
    /// The decoder does not take the method's phase.
    #[error(transparent)]
    Decode(#[from] DecodeError),
}

/// The frames of the sine sets, kept until the last one has landed; empty where the decoder's own sums are enough.
#[derive(Debug, Default)]
pub(super) struct SineFrames {
    sets: Vec<SineSet>,
    frames: BTreeMap<usize, Frame>,
}

impl SineFrames {
    /// Adds a frame, if it belongs to a sine set that the method needs.
    pub(super) fn add(&mut self, number: usize, frame: &FrameView<'_>) {
        let of = |set: &SineSet| (set.first_frame..set.first_frame + set.shifts_rad.len()).contains(&number);
        if self.sets.iter().any(of) {
            self.frames.insert(number, Frame::from(*frame));
        }
    }
}

impl PhaseMethod {
    /// An empty collection for the frames that the method needs.
    pub(super) fn sine_frames(&self, decoder: &Decoder) -> SineFrames {
        let mut sets = decoder.sine_sets();
        if *self == Self::default() {
            // One frame has no steps: its phase is that of its Fourier transform.
            sets.retain(|set| set.shifts_rad.len() == 1);
        }
        SineFrames { sets, frames: BTreeMap::new() }
    }

    /// Puts the method's phases in the place of the decoder's.
    pub(super) fn apply(&self, decoder: &mut Decoder, frames: &SineFrames) -> Result<(), PhaseMethodError> {
        if let Some(px) = self.window_px.filter(|px| !(1.0..=32.0).contains(px)) {
            return Err(PhaseMethodError::Window(px));
        }
        for set in &frames.sets {
            let map = self.wrap(decoder, frames, set)?;
            decoder.replace(set.index, &map)?;
        }
        Ok(())
    }

    fn wrap(
        &self,
        decoder: &mut Decoder,
        frames: &SineFrames,
        set: &SineSet,
    ) -> Result<Wrapped, PhaseMethodError> {
        let refused = |source| PhaseMethodError::Wrap { set: set.index, source };
        if !set.plain {
            return Err(PhaseMethodError::Codec { set: set.index });
        }
        let numbers = set.first_frame..set.first_frame + set.shifts_rad.len();
        let views: Vec<_> = numbers.filter_map(|n| frames.frames.get(&n)).map(Frame::view).collect();
        let stack = Stack::new(&views, &set.shifts_rad).map_err(refused)?;
        let many = set.periods >= LEAST_PERIODS;
        let by_fringes = |method: &Method| many || !matches!(method, Method::FourierRows | Method::Fourier);
        let usual = if set.shifts_rad.len() == 1 { Method::Fourier } else { Method::LeastSquares };
        let method = self.method.filter(by_fringes).unwrap_or(usual);
        let mut map = stack.wrap(method, &decoder.limits(set.axis)?).map_err(refused)?;
        if self.remove_harmonics && many {
            if !set.even {
                return Err(PhaseMethodError::UnevenSteps { set: set.index });
            }
            let found = PhaseHarmonics::find(&map, set.shifts_rad.len() as u32);
            found.ok_or(PhaseMethodError::FewPixels { set: set.index })?.remove(&mut map);
        }
        Ok(match self.window_px {
            Some(window_px) => filter(&map, &WindowedSettings { window_px, ..WindowedSettings::default() }),
            None => map,
        })
    }
}
