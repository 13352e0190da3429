//! What the sequence of a recording holds for each axis.

use super::chain::{self, Chain, Sine};
use super::error::DecodeError;
use super::limits::MAX_SINES;
use super::number::Residues;
use super::roles::{SineKind, SinePlan};
use super::settings::OrderMethod;
use crate::pattern::{Axis, PatternSet};

/// The sequence with the number of each set's first frame.
pub(super) struct Sets<'a> {
    /// All sets in the order of projection.
    pub list: &'a [PatternSet],
    /// Number of each set's first frame.
    pub first_frame: Vec<usize>,
    /// Method of the order.
    pub order: OrderMethod,
    /// Whether all sines say where a pixel is.
    pub fuse: bool,
}

impl Sets<'_> {
    /// Sine sets of an axis with their position, finest first.
    pub fn sines(&self, axis: Axis) -> Result<Vec<(usize, SinePlan)>, DecodeError> {
        let mut found: Vec<(usize, SinePlan)> = Vec::new();
        for (index, set) in self.list.iter().enumerate() {
            if set.axis() == Some(axis)
                && let Some(sine) = sine_plan(index, axis, set)
            {
                found.push((index, sine));
            }
        }
        found.sort_by(|a, b| a.1.period_px.total_cmp(&b.1.period_px));
        if found.len() > MAX_SINES {
            return Err(DecodeError::TooManySines { axis, count: found.len() });
        }
        Ok(found)
    }

    /// The code of an axis: the one with the shortest stripe; of a complementary pair the one that is not inverted.
    /// A code that repeats before the projector ends cannot be used; the reason comes second.
    pub fn code(&self, axis: Axis, extent_px: u32) -> (Option<usize>, Option<DecodeError>) {
        let mut best: Option<(usize, f64, bool)> = None;
        let mut short = None;
        for (index, set) in self.list.iter().enumerate() {
            let PatternSet::Gray { axis: a, bits, stripe_px, shift_px, invert, code, .. } = *set else {
                continue;
            };
            if a != axis || !self.order.takes(code) || shift_px > 0.0 {
                continue;
            }
            let covers_px = stripe_px * f64::from(1_u32 << bits.min(16));
            if covers_px < f64::from(extent_px) {
                short.get_or_insert(DecodeError::CodeTooShort { index, axis, covers_px, extent_px });
            } else if best.is_none_or(|(_, stripe, inverted)| {
                stripe_px < stripe || (stripe_px == stripe && inverted && !invert)
            }) {
                best = Some((index, stripe_px, invert));
            }
        }
        (best.map(|b| b.0), short)
    }

    pub fn stripe_px(&self, index: usize, halved: bool) -> f64 {
        match self.list[index] {
            PatternSet::Gray { stripe_px, .. } if halved => 0.5 * stripe_px,
            PatternSet::Gray { stripe_px, .. } => stripe_px,
            PatternSet::Stair { stair_px, .. } => stair_px,
            _ => 0.0,
        }
    }

    /// The same code, moved by half a stripe.
    pub fn half_moved(&self, index: usize) -> Option<usize> {
        let PatternSet::Gray { axis, bits, stripe_px, code, .. } = self.list[index] else { return None };
        self.list.iter().position(|other| {
            matches!(other, PatternSet::Gray { axis: a, bits: b, stripe_px: s, shift_px, invert, code: c, .. }
                if *a == axis && *b == bits && *s == stripe_px && *c == code && !invert && *shift_px == 0.5 * stripe_px)
        })
    }

    /// The micro set that numbers the fringes of its axis.
    pub fn micro(&self, axis: Axis) -> Option<usize> {
        let is_micro = |set: &PatternSet| matches!(set, PatternSet::Micro { axis: a, .. } if *a == axis);
        self.list.iter().position(is_micro).filter(|_| self.order == OrderMethod::Auto)
    }

    pub fn stair(&self, axis: Axis) -> Option<usize> {
        let wanted = matches!(self.order, OrderMethod::Auto | OrderMethod::Stair);
        let is_stair = |set: &PatternSet| matches!(set, PatternSet::Stair { axis: a, .. } if *a == axis);
        self.list.iter().position(is_stair).filter(|_| wanted)
    }

    /// Refuses an order whose set is not there.
    pub fn demand(
        &self,
        axis: Axis,
        code: Option<usize>,
        shifted: Option<usize>,
        stair: Option<usize>,
    ) -> Result<(), DecodeError> {
        let missing = match self.order {
            OrderMethod::Gray if code.is_none() => "a gray set (code = \"gray\") that covers the projector",
            OrderMethod::Binary if code.is_none() => {
                "a gray set with code = \"binary\" that covers the projector"
            }
            OrderMethod::ShiftedGray if shifted.is_none() => {
                "two gray sets, the second with shift_px = stripe_px / 2"
            }
            OrderMethod::Stair if stair.is_none() => "a stair set beside a sine set",
            _ => return Ok(()),
        };
        Err(DecodeError::OrderSet { order: self.order.name(), axis, missing: missing.into() })
    }

    pub fn complement(&self, index: usize) -> Option<usize> {
        self.list.iter().position(|other| self.list[index].is_inverse_of(other))
    }

    pub fn first_of(&self, name: &str) -> Option<usize> {
        self.list.iter().position(|set| set.name() == name)
    }
}

/// The steps of a set that has a phase; of a micro set those of its first frequency.
fn sine_plan(index: usize, axis: Axis, set: &PatternSet) -> Option<SinePlan> {
    let (period_px, steps, even, kind) = match set {
        PatternSet::Sine { period_px, steps, shifts_rad, .. } => {
            (*period_px, *steps, shifts_rad.is_empty(), SineKind::Plain)
        }
        PatternSet::Lines { period_px, steps, .. } => (*period_px, *steps, true, SineKind::Lines),
        PatternSet::Micro { periods_px, shifts_rad, .. } => {
            (*periods_px.first()?, 3, shifts_rad.is_empty(), SineKind::Plain)
        }
        PatternSet::Modulated { period_px, steps, carrier_steps, .. } => {
            (*period_px, *steps, true, SineKind::Carried(*carrier_steps))
        }
        _ => return None,
    };
    let every = if let SineKind::Carried(carrier_steps) = kind { carrier_steps as usize } else { 1 };
    let shifts_rad = (0..steps as usize).map(|step| set.step_rad(step * every)).collect();
    Some(SinePlan { index, axis, period_px, steps, first: 0, shifts_rad, even, kind })
}

/// The table of the residues by all periods.
pub(super) fn residues(
    sines: &[(usize, SinePlan)],
    axis: Axis,
    extent_px: u32,
) -> Result<Residues, DecodeError> {
    let list: Vec<(f64, u32)> = sines.iter().map(|(_, s)| (s.period_px, s.steps)).collect();
    let order = OrderMethod::NumberTheoretical.name();
    Residues::new(&list, extent_px).map_err(|error| DecodeError::OrderSet {
        order,
        axis,
        missing: error.to_string(),
    })
}

pub(super) fn choose_chain(
    order: OrderMethod,
    sines: &[(usize, SinePlan)],
    stripe_px: Option<f64>,
    axis: Axis,
    extent_px: u32,
) -> Result<Chain, DecodeError> {
    let list: Vec<Sine> =
        sines.iter().map(|(_, s)| Sine { period_px: s.period_px, steps: s.steps }).collect();
    // A code that was asked for begins the chain even where a sine covers the projector.
    let by_code = matches!(
        order,
        OrderMethod::Gray | OrderMethod::Binary | OrderMethod::ShiftedGray | OrderMethod::Stair
    );
    let reach_px = if by_code { f64::INFINITY } else { f64::from(extent_px) };
    let most_phases = if order == OrderMethod::Hierarchical { 1 } else { chain::MOST_PHASES };
    chain::widest_of(&list, stripe_px, reach_px, most_phases).ok_or_else(|| {
        let reach_px = chain::longest_px(&list);
        let code = match stripe_px {
            Some(stripe_px) => format!("the gray set's stripe of {stripe_px} px is longer than a period"),
            None => "there is no gray set".to_owned(),
        };
        let missing = format!("{code}, and the longest period or beat of the sine sets is {reach_px:.1} px");
        DecodeError::NoAbsoluteOrder { axis, extent_px, finest_px: list[0].period_px, missing }
    })
}

/// Axis and finest period of a set with a phase.
fn fringes(set: &PatternSet) -> Option<(Axis, f64)> {
    let axis = set.axis()?;
    sine_plan(0, axis, set).map(|sine| (axis, sine.period_px))
}

/// Two sets that would decode the same thing leave open which one counts. White and black may be repeated.
pub(super) fn refuse_duplicates(sequence: &[PatternSet]) -> Result<(), DecodeError> {
    let same = |a: &PatternSet, b: &PatternSet| match (a, b) {
        (
            PatternSet::Gray { axis: a, bits: b, stripe_px: s, shift_px: h, invert: i, code: c, .. },
            PatternSet::Gray {
                axis: oa, bits: ob, stripe_px: os, shift_px: oh, invert: oi, code: oc, ..
            },
        ) => a == oa && b == ob && s == os && h == oh && c == oc && i == oi,
        _ => fringes(a).is_some_and(|found| fringes(b) == Some(found)),
    };
    for (second, set) in sequence.iter().enumerate() {
        if let (Some(first), Some(axis)) =
            (sequence[..second].iter().position(|other| same(other, set)), set.axis())
        {
            return Err(DecodeError::Duplicate { first, second, name: set.name(), axis });
        }
    }
    Ok(())
}
