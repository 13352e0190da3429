//! Which frame belongs to which pattern, proven by what the frames show.
//!
//! A sequence with a `check` set, pseudo-random stripes, leaves no coordinate of the projector that explains a pixel whose frames slipped,
//! were exchanged or came twice. Some pixels are compared with what every coordinate would show: where a frame stays unexplained, each single event is
//! tried, and the one that explains the frames is named. Whether a sequence can prove all of them is known before any frame is
//! taken ([`prove`]).

pub(super) mod event;
mod proof;
mod templates;

pub use event::OrderEvent;
pub use proof::prove;

use super::error::DecodeError;
use crate::frame::FrameView;
use crate::pattern::{Axis, PatternSet};
use serde::Serialize;
use templates::{Arrangement, SUSPECT, Templates, has_check};

/// From this share on a frame does not show its pattern, whatever else it shows.
const FOREIGN: f32 = 0.08;
/// An event must leave so much less unexplained of the worst frame.
const BETTER: f32 = 0.5;
/// An event that leaves a frame open must explain so many times more: a frame less is easier to explain.
const OPEN: f32 = 1.25;
/// Coordinates of the finest period.
const PER_PERIOD: f64 = 32.0;
/// Pixels that are looked at, of each frame; and of these, with which events are tried.
const POSITIONS: usize = 4096;
const SAMPLES: usize = 192;
const TRIED: usize = 48;
/// Fewer pixels with light prove nothing.
const LEAST_LIT: usize = 24;
/// A pixel has light where its frames differ by this share of the full scale.
const LIT: f32 = 0.08;
/// From this share of the full scale on a value may be clipped.
const FULL: f32 = 0.99;

/// What the frames of a sequence proved of their order.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FrameOrder {
    /// The sequence has no check.
    #[default]
    Unchecked,
    /// Too few pixels have light; so many had.
    Dark(usize),
    /// All frames show their patterns: pixels that were compared, and the largest unexplained share of a frame.
    Proven {
        /// Pixels that were compared.
        pixels: usize,
        /// Largest share of a frame's variation that stays unexplained.
        misfit: f32,
    },
}

impl FrameOrder {
    /// What a person must know of it; `camera` is named.
    pub(super) fn warning(self, camera: &str) -> Option<String> {
        match self {
            Self::Dark(pixels) => Some(format!(
                "camera \"{camera}\": the order of the frames is not proven: {pixels} of the pixels that are compared have light, {LEAST_LIT} are \
                 needed"
            )),
            Self::Unchecked | Self::Proven { .. } => None,
        }
    }
}

/// Compares frames with their patterns along one axis.
#[derive(Debug)]
pub(super) struct Identity {
    axis: Axis,
    templates: Templates,
    straight: Arrangement,
    positions: Vec<usize>,
    /// Grey values over the full scale: those of a position after another, one for each row.
    values: Vec<f32>,
}

impl Identity {
    /// Prepares for a sequence; `None` where it has no check, or nothing varies along the axis.
    pub fn new(sequence: &[PatternSet], axis: Axis, extent_px: u32, pixels: usize) -> Option<Self> {
        if !has_check(sequence) {
            return None;
        }
        let templates = Templates::new(sequence, axis, extent_px, PER_PERIOD)?;
        let stride = pixels.div_ceil(POSITIONS).max(1);
        // Odd, so that a width of many divisors does not line the positions up.
        let positions: Vec<usize> = (0..pixels).step_by(stride | 1).collect();
        let straight = templates.arrangement(None);
        let values = vec![0.0; positions.len() * templates.frames.len()];
        Some(Self { axis, templates, straight, positions, values })
    }

    /// Number of frames that must have landed.
    pub fn needed(&self) -> usize {
        self.templates.frames.last().map_or(0, |last| last + 1)
    }

    /// Keeps some grey values of a frame.
    pub fn keep(&mut self, index: usize, frame: &FrameView) {
        let Some(row) = self.templates.frames.iter().position(|kept| *kept == index) else { return };
        let rows = self.templates.frames.len();
        let scale = 1.0 / f32::from(frame.full_scale_dn.max(1));
        for (values, position) in self.values.chunks_exact_mut(rows).zip(&self.positions) {
            values[row] = frame.pixels.get(*position) * scale;
        }
    }

    /// What the kept values prove.
    ///
    /// # Errors
    /// [`DecodeError::Order`] names what happened to the order.
    pub fn verify(&self) -> Result<FrameOrder, DecodeError> {
        let lit = self.lit();
        if lit.len() < LEAST_LIT {
            return Ok(FrameOrder::Dark(lit.len()));
        }
        let pixels: Vec<&[f32]> = lit.iter().copied().step_by(lit.len().div_ceil(SAMPLES)).collect();
        let straight = misfits(&self.templates, &self.straight, &pixels);
        let worst = straight.iter().flatten().copied().fold(0.0, f32::max);
        if worst < SUSPECT {
            return Ok(FrameOrder::Proven { pixels: pixels.len(), misfit: worst });
        }
        let few: Vec<&[f32]> = pixels.iter().copied().step_by(pixels.len().div_ceil(TRIED)).collect();
        let event = self.best_event(&few).or_else(|| {
            let place = straight.iter().position(|misfit| *misfit == Some(worst))?;
            (worst >= FOREIGN).then(|| OrderEvent::Foreign(self.templates.frames[place]))
        });
        match event {
            Some(event) => Err(DecodeError::Order { axis: self.axis, event }),
            None => Ok(FrameOrder::Proven { pixels: pixels.len(), misfit: worst }),
        }
    }

    /// The values of the pixels with light, none of them clipped.
    fn lit(&self) -> Vec<&[f32]> {
        let range = |values: &[f32]| {
            let least = values.iter().copied().fold(f32::INFINITY, f32::min);
            (least, values.iter().copied().fold(0.0, f32::max))
        };
        let pixels = self.values.chunks_exact(self.templates.frames.len().max(1));
        let lit = pixels.filter(|values| {
            let (least, most) = range(values);
            most - least >= LIT && most < FULL
        });
        lit.collect()
    }

    /// The event that explains the frames best, if it explains what stayed unexplained.
    fn best_event(&self, pixels: &[&[f32]]) -> Option<OrderEvent> {
        let straight = misfits(&self.templates, &self.straight, pixels);
        let worst = |misfits: &[Option<f32>]| misfits.iter().flatten().copied().fold(0.0, f32::max);
        let foreign = self.templates.frames.iter().map(|frame| OrderEvent::Foreign(*frame));
        let mut best: Option<(f32, OrderEvent)> = None;
        for event in OrderEvent::all(self.needed()).chain(foreign) {
            let after = misfits(&self.templates, &self.templates.arrangement(Some(event)), pixels);
            // A frame that the event leaves open neither gains nor loses.
            let gain: f32 = straight.iter().zip(&after).filter_map(|(a, b)| Some((*a)? - (*b)?)).sum();
            let explains = worst(&after) <= BETTER * worst(&straight);
            let open = after.iter().zip(&straight).any(|(after, before)| after.is_none() && before.is_some());
            let weight = if open { gain / OPEN } else { gain };
            if explains && best.is_none_or(|(most, _)| weight > most) {
                best = Some((weight, event));
            }
        }
        best.filter(|(gain, _)| *gain > 0.0).map(|(_, event)| event)
    }
}

/// Mean over the pixels of what each row leaves unexplained.
fn misfits(templates: &Templates, arrangement: &Arrangement, pixels: &[&[f32]]) -> Vec<Option<f32>> {
    let mut sums = vec![(0.0_f32, 0_u32); templates.frames.len()];
    for values in pixels {
        let explained = templates.explain(arrangement, values);
        for (sum, misfit) in sums.iter_mut().zip(explained.misfit) {
            if let Some(misfit) = misfit {
                *sum = (sum.0 + misfit, sum.1 + 1);
            }
        }
    }
    sums.into_iter().map(|(sum, count)| (count > 0).then(|| sum / count as f32)).collect()
}
