//! One sine whose order a code gives, as most sequences have it: from the sums to absolute phase in one loop, in single precision.
//!
//! The phase is n quarter turns and a rest of at most half of one, φ = n π/2 + r. n is an integer that single precision holds exactly, and the
//! product is taken in two parts (Cody and Waite), the first of them exact: what is rounded is the sum, once, as a stored phase must be.
//! Only pixels with uncertain bits, or at the edges of the projector, are looked at one by one, as any other chain does.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::arctan::{angle_positive_rad, quarters_and_rest_rad};
use super::block::{Planes, filled, state};
use super::chain::{Chain, Start};
use super::coarse::centre_px;
use super::order::{Kernel, Lanes, Single};
use crate::math::simd::taken;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::ops::Range;

/// 1.5 · 2²³: adding and subtracting it rounds to the nearest integer in plain arithmetic.
const ROUND: f32 = 12_582_912.0;
/// π/2 rounded to twelve bits: its product with up to 4096 quarter turns is exact.
const QUARTER: f32 = 3217.0 / 2048.0;
/// What π/2 is more.
const QUARTER_REST: f32 = (FRAC_PI_2 - 3217.0 / 2048.0) as f32;
/// Pixels that are worked on side by side: a part of a block.
const SIDE: usize = 16;
/// Most fringes that a code may number.
const MOST_FRINGES: f64 = 1000.0;

impl Kernel<'_> {
    /// Whether one sine after one code is all that the axis has; `None` where it has more.
    pub(super) fn single(&self) -> Option<Single> {
        let plan = self.plan;
        let (Some(chain), Some(code), None) = (&plan.chain, &plan.code, &plan.shifted) else { return None };
        let alone = chain.start == Start::Code && chain.stages.len() == 1 && plan.sines.len() == 1;
        let stripe_turns = code.stripe_px / plan.period_px;
        if !alone || plan.fused || stripe_turns * f64::from(1_u32 << code.bits.min(16)) > MOST_FRINGES {
            return None;
        }
        let limits = self.limits(chain, 0);
        let (low_px, high_px) = self.inner_px();
        let scale = TAU / plan.period_px;
        Some(Single {
            stripe_turns: stripe_turns as f32,
            first_turns: (centre_px(code.stripe_px, 0) / plan.period_px) as f32,
            most: limits.most as f32,
            weak: limits.weak as f32,
            linear: limits.linear as f32,
            low_rad: (low_px * scale) as f32,
            high_rad: (high_px * scale) as f32,
        })
    }

    /// Phase and state of the pixels in `range`, whose sums, uncertainty and mask are known.
    #[inline(always)]
    pub(super) fn turn(&self, single: &Single, range: &Range<usize>, lanes: &mut Lanes, out: &mut Planes) {
        let (Some(chain), Some(code)) = (&self.plan.chain, &self.plan.code) else { return };
        self.read_code(code, range, &mut lanes.stripes);
        single.orders(lanes, out);
        let mut from = 0;
        while let Some(i) = lanes.next_look(from, out.state.len()) {
            self.look_at(chain, lanes, i, out);
            from = i + 1;
        }
    }

    /// Uncertain bits and the edges of the projector.
    fn look_at(&self, chain: &Chain, lanes: &mut Lanes, i: usize, out: &mut Planes) {
        let sums = &lanes.sums[0];
        lanes.phase_rad[0][i] = angle_positive_rad(sums.sin[i], sums.cos[i]);
        lanes.coordinate_px[i] = f64::from(out.phase_rad[i]) * self.plan.period_px / TAU;
        lanes.doubt[i] = out.state[i];
        if lanes.stripes.unsure[i] != 0 {
            self.question_bits(chain, lanes, i);
        }
        self.keep_inside(chain, lanes, i, out.sigma_rad[i]);
        out.state[i] = lanes.doubt[i];
    }
}

impl Single {
    /// The nearest rule, as [`super::order`] has it: m = round(c / p − φ / 2π).
    #[inline(always)]
    fn orders(&self, lanes: &mut Lanes, out: &mut Planes) {
        let count = out.state.len();
        for first in (0..count).step_by(SIDE) {
            let group = self.group(lanes, first);
            let width = SIDE.min(count - first);
            let states = filled(out.state, first, width, state::INVALID);
            let sigma = filled(out.sigma_rad, first, width, 0.0);
            let decided = group.decided(self, &states, &sigma);
            lanes.look[first..first + SIDE].copy_from_slice(&decided.look);
            if width == SIDE {
                out.state[first..first + SIDE].copy_from_slice(&decided.states);
                out.phase_rad[first..first + SIDE].copy_from_slice(&decided.phase_rad);
                out.sigma_rad[first..first + SIDE].copy_from_slice(&decided.sigma_rad);
            } else {
                out.state[first..].copy_from_slice(&decided.states[..width]);
                out.phase_rad[first..].copy_from_slice(&decided.phase_rad[..width]);
                out.sigma_rad[first..].copy_from_slice(&decided.sigma_rad[..width]);
            }
        }
    }

    /// Phases of the pixels of a block from one on, whatever they are worth.
    #[inline(always)]
    fn group(&self, lanes: &Lanes, first: usize) -> Group {
        let sums = &lanes.sums[0];
        let (sin, cos): ([f32; SIDE], [f32; SIDE]) = (taken(&sums.sin, first), taken(&sums.cos, first));
        let numbers: [u16; SIDE] = taken(&lanes.stripes.number, first);
        let unsure: [u16; SIDE] = taken(&lanes.stripes.unsure, first);
        let mut out = Group { phase_rad: [0.0; SIDE], deviation: [0.0; SIDE], unsure };
        for l in 0..SIDE {
            let (quarters, rest) = quarters_and_rest_rad(sin[l], cos[l]);
            let coarse = f32::from(numbers[l]) * self.stripe_turns + self.first_turns;
            let away = (coarse - 0.25 * quarters) - rest * (1.0 / TAU) as f32;
            let order = (away + ROUND) - ROUND;
            let quarters = 4.0 * order + quarters;
            out.deviation[l] = (away - order).abs();
            out.phase_rad[l] = quarters * QUARTER + (quarters * QUARTER_REST + rest);
        }
        out
    }
}

/// Pixels side by side.
struct Group {
    phase_rad: [f32; SIDE],
    /// Distance to the nearest fringe, turns.
    deviation: [f32; SIDE],
    /// Bits of the code that are uncertain.
    unsure: [u16; SIDE],
}

/// What becomes of them.
struct Decided {
    look: [u8; SIDE],
    states: [u8; SIDE],
    phase_rad: [f32; SIDE],
    sigma_rad: [f32; SIDE],
}

impl Group {
    /// States and planes, for the mask and the uncertainty that are known.
    #[inline(always)]
    fn decided(&self, limits: &Single, states: &[u8; SIDE], sigma_rad: &[f32; SIDE]) -> Decided {
        // As wide as what is compared, which vectors are best at.
        let (mut levels, mut looks, mut usable) = ([0_u32; SIDE], [0_u32; SIDE], [0_u32; SIDE]);
        for l in 0..SIDE {
            let (deviation, left) = (self.deviation[l], limits.linear * sigma_rad[l]);
            let open = (deviation > limits.most) | ((deviation + left > 0.5) & (left > 0.0));
            let weak = u32::from(state::SURE) + u32::from(deviation > limits.weak);
            levels[l] = if open { u32::from(state::OPEN) } else { weak };
            let phase_rad = self.phase_rad[l];
            looks[l] = u32::from((phase_rad < limits.low_rad) | (phase_rad > limits.high_rad));
        }
        for l in 0..SIDE {
            usable[l] = u32::from(states[l]);
            looks[l] = (looks[l] | u32::from(self.unsure[l] != 0)) * usable[l];
            levels[l] *= usable[l];
        }
        let mut out = Decided {
            look: [0; SIDE],
            states: [0; SIDE],
            phase_rad: [f32::NAN; SIDE],
            sigma_rad: [f32::NAN; SIDE],
        };
        for l in 0..SIDE {
            out.phase_rad[l] = if usable[l] != 0 { self.phase_rad[l] } else { f32::NAN };
            out.sigma_rad[l] = if usable[l] != 0 { sigma_rad[l] } else { f32::NAN };
        }
        for l in 0..SIDE {
            (out.look[l], out.states[l]) = (looks[l] as u8, levels[l] as u8);
        }
        out
    }
}
