//! The coarse coordinate that the order of the first sine is counted from: code, two codes, stairs or residues.

use super::bits::{Certainty, Stripes, resolve};
use super::block::{Planes, Tally, state};
use super::chain::Chain;
use super::order::{CODE_EDGE_PERIODS, Kernel, Lanes, follow_one};
use super::rasters::Rasters;
use super::roles::{CodePlan, Reference, StairPlan, StairSource};
use super::sums::BlockSums;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// More uncertain bits than this are not tried in all combinations.
const MOST_UNSURE_BITS: u32 = 4;
/// Uncertain bits of a code without sines may leave so many stripes open on either side.
pub(super) const MOST_STRIPES_APART: u16 = 7;
/// Residues this near to the border between two tuples of orders need a neighbour that confirms them.
const RESIDUES_WEAK: f64 = 0.9;

/// Sines agree within so many standard deviations …
const FUSED_SIGMAS: f64 = 6.0;
/// … and this fraction of the finest period, for what is not noise (gamma, pixels of the projector).
const FUSED_PERIODS: f64 = 0.02;

impl Kernel<'_> {
    /// Length of what the code or the stairs number, projector pixels.
    pub(super) fn stripe_px(&self) -> f64 {
        let halved = if self.plan.shifted.is_some() { 0.5 } else { 1.0 };
        let stair_px = self.plan.stair.map_or(0.0, |stair| stair.stair_px);
        self.plan.code.map_or(stair_px, |code| halved * code.stripe_px)
    }

    /// Fills the coordinates of a block.
    #[inline(always)]
    pub(super) fn coarse(&self, range: &Range<usize>, lanes: &mut Lanes) {
        let count = range.len();
        if let Some(code) = &self.plan.code {
            self.read_code(code, range, &mut lanes.stripes);
            let stripe_px = self.stripe_px();
            for (c, number) in lanes.coordinate_px[..count].iter_mut().zip(&lanes.stripes.number) {
                *c = centre_px(stripe_px, u32::from(*number));
            }
            if let Some(shifted) = &self.plan.shifted {
                // ⌊2x/s⌋ = ⌊x/s⌋ + ⌊x/s + ½⌋ (Hermite): an edge of either code moves the sum by one half stripe.
                self.read_code(shifted, range, &mut lanes.shifted);
                for (c, number) in lanes.coordinate_px[..count].iter_mut().zip(&lanes.shifted.number) {
                    *c += f64::from(*number) * stripe_px;
                }
            }
        } else if let Some(stair) = &self.plan.stair {
            self.read_stair(stair, range, lanes);
        } else if let Some(micro) = &self.plan.micro {
            self.read_micro(micro, range, lanes);
        } else if let Some(residues) = &self.plan.residues {
            for i in 0..count {
                let (c, border) = residues.resolve(|j| lanes.phase_rad[j][i]);
                lanes.coordinate_px[i] = c;
                let level = if border > 1.0 { state::OPEN } else { state::WEAK };
                lanes.doubt[i] = if border > RESIDUES_WEAK { level } else { state::SURE };
            }
        } else {
            lanes.coordinate_px.fill(0.5 * (self.plan.extent_px - 1.0));
        }
    }

    /// Number of the stair: from its phase −π + 2π(n + ½)/stairs, or from its level between black and white (eq. 2.60, 2.61).
    #[inline(never)]
    fn read_stair(&self, stair: &StairPlan, range: &Range<usize>, lanes: &mut Lanes) {
        let last = stair.stairs - 1.0;
        match stair.source {
            StairSource::Phase(slot) => {
                let mut sums = BlockSums::ZERO;
                self.sums[slot].block(self.rasters, range, &mut sums);
                for i in 0..range.len() {
                    let turns = (super::arctan::angle_positive_rad(sums.sin[i], sums.cos[i]) + PI) / TAU;
                    let number = ((turns - turns.floor()) * stair.stairs).floor().clamp(0.0, last);
                    lanes.coordinate_px[i] = centre_px(stair.stair_px, number as u32);
                }
            }
            StairSource::Grey(raster, levels) => {
                let value = |one, other, at| Rasters::pair(self.rasters, one, other, at);
                for (i, at) in range.clone().enumerate() {
                    let (grey, black) = value(raster, levels.black, at);
                    let (white, _) = value(levels.white, levels.black, at);
                    let span = f64::from(white) - f64::from(black);
                    let level = (f64::from(grey) - f64::from(black)) / span.max(1.0);
                    let number = (level * last).round().clamp(0.0, last);
                    lanes.coordinate_px[i] = centre_px(stair.stair_px, number as u32);
                    // A dark pixel has no level; its neighbours may know.
                    lanes.doubt[i] = if span > last { lanes.doubt[i] } else { state::OPEN };
                }
            }
        }
    }

    /// The inverse-variance mean of all sines, each at the order of the finest one; σ follows.
    ///
    /// Where a set disagrees beyond its noise, an order is wrong: the neighbours shall correct the finest phase, not a mean with it.
    /// Var xⱼ = (pⱼ/2π)² · 2σ²/(Nⱼ Bⱼ²) and Bⱼ² = (2/Nⱼ)²(c² + s²) give the weights (c² + s²)/(Nⱼ pⱼ²).
    pub(super) fn fuse(&self, range: &Range<usize>, lanes: &mut Lanes, out: &mut Planes) {
        for i in 0..range.len() {
            let x0 = lanes.coordinate_px[i];
            let sigma_px = f64::from(out.sigma_rad[i]) * self.plan.period_px / TAU;
            let (mut w, mut wx, mut finest, mut agree) = (0.0, 0.0, 1.0, true);
            for (j, slot) in self.plan.sines.iter().enumerate() {
                let (sums, p) = (&lanes.sums[j], self.periods_px[*slot]);
                let (c, s) = (f64::from(sums.cos[i]), f64::from(sums.sin[i]));
                let weight = (c * c + s * s) / (f64::from(self.steps[*slot]) * p * p);
                let wrapped = lanes.phase_rad[j][i] * p / TAU;
                let x = wrapped + ((x0 - wrapped) / p).round() * p;
                finest = if j == 0 { weight } else { finest };
                let apart_px = sigma_px * (1.0 + finest / weight).sqrt();
                agree &= (x - x0).abs() <= FUSED_SIGMAS * apart_px + FUSED_PERIODS * self.plan.period_px;
                w += weight;
                wx += weight * (x - x0);
            }
            if w > 0.0 && agree {
                lanes.coordinate_px[i] = x0 + wx / w;
                out.sigma_rad[i] *= (finest / w).sqrt() as f32;
            }
        }
    }

    #[inline(always)]
    pub(super) fn read_code(&self, code: &CodePlan, range: &Range<usize>, stripes: &mut Stripes) {
        if let Reference::SineMean(slot) = code.reference {
            return self.read_against_mean(code, slot, range, stripes);
        }
        let certain = Certainty::new(code, 1, &self.noise, self.settings.certainty_sigmas);
        stripes.read(self.rasters, code, range, None, &certain);
    }

    /// The same where the mean of a sine is the threshold.
    #[inline(always)]
    fn read_against_mean(&self, code: &CodePlan, slot: usize, range: &Range<usize>, stripes: &mut Stripes) {
        let (mut sums, steps) = (BlockSums::ZERO, self.steps[slot]);
        self.sums[slot].block(self.rasters, range, &mut sums);
        let certain = Certainty::new(code, steps, &self.noise, self.settings.certainty_sigmas);
        let mean = Some((&sums.sum[..range.len()], steps));
        stripes.read(self.rasters, code, range, mean, &certain);
    }

    /// Tries the other values of the uncertain bits: where one of them leads to another order that the phase does not
    /// exclude, the order is open.
    #[inline(never)]
    pub(super) fn question_bits(&self, chain: &Chain, lanes: &mut Lanes, i: usize) {
        let (Some(code), Some(first)) = (&self.plan.code, chain.stages.first()) else { return };
        // Of two codes the one with uncertain bits is asked; both at once only happens in the dark.
        let (asked, other) = if lanes.stripes.unsure[i] != 0 {
            (&lanes.stripes, &lanes.shifted)
        } else {
            (&lanes.shifted, &lanes.stripes)
        };
        let (seen, unsure) = (asked.seen[i], asked.unsure[i]);
        let rest = if self.plan.shifted.is_some() { u32::from(other.number[i]) } else { 0 };
        let stripe_px = self.stripe_px();
        if unsure.count_ones() > MOST_UNSURE_BITS || (rest > 0 && other.unsure[i] != 0) {
            lanes.doubt[i] = state::OPEN;
            return;
        }
        let most_px = (0.5 * stripe_px + CODE_EDGE_PERIODS * first.period_px).min(0.5 * first.period_px);
        let mut flips = unsure;
        while flips != 0 {
            let c = centre_px(stripe_px, u32::from(resolve(seen ^ flips, code.code)) + rest);
            let x = follow_one(first, lanes, i, c);
            let other = chain.stages[1..].iter().fold(x, |x, stage| follow_one(stage, lanes, i, x));
            let inside = other > -1.0 && other < self.plan.extent_px;
            if inside
                && (c - x).abs() <= most_px
                && (other - lanes.coordinate_px[i]).abs() > 0.5 * self.plan.period_px
            {
                lanes.doubt[i] = state::OPEN;
                return;
            }
            flips = (flips - 1) & unsure;
        }
    }

    /// A code without sines: centre of the stripe, uniform within it.
    #[inline(never)]
    pub(super) fn code_block(&self, range: &Range<usize>, lanes: &mut Lanes, out: &mut Planes) -> Tally {
        let mut tally = Tally::default();
        let Some(code) = &self.plan.code else { return tally };
        self.coarse(range, lanes);
        let stripe_px = self.stripe_px();
        let (scale, sigma) = (TAU / stripe_px, (TAU / 12.0_f64.sqrt()) as f32);
        for i in 0..range.len() {
            let x = lanes.coordinate_px[i];
            let contrast = lanes.stripes.contrast[i];
            let lit = contrast >= self.least_modulation_dn && contrast > 0.0;
            let apart = stripes_apart(code, &lanes.stripes, i).max(stripes_apart(code, &lanes.shifted, i));
            let settled = self.plan.shifted.is_none() || apart <= 1;
            let known = lit && x < self.plan.extent_px + 0.5 * stripe_px && settled;
            tally.dark += usize::from(!lit);
            tally.noisy += usize::from(lit && !known);
            out.modulation[i] = contrast.max(0.0);
            // Bits that the noise could have turned leave an interval of several stripes: its neighbours' edges narrow it down.
            let level = if apart <= 1 { state::SURE } else { state::OPEN };
            out.state[i] = if known { level } else { state::INVALID };
            out.phase_rad[i] = if known { (x * scale) as f32 } else { f32::NAN };
            out.sigma_rad[i] = if known { sigma } else { f32::NAN };
        }
        tally
    }
}

/// Centre of a stripe. Stripe k begins half a column before coordinate k s, where column k s begins.
#[inline(always)]
pub(super) fn centre_px(stripe_px: f64, number: u32) -> f64 {
    f64::from(number) * stripe_px + (0.5 * stripe_px - 0.5)
}

/// How many stripes away the stripe may be, over all values of the uncertain bits.
fn stripes_apart(code: &CodePlan, stripes: &Stripes, i: usize) -> u16 {
    let unsure = stripes.unsure[i];
    if unsure.count_ones() > MOST_UNSURE_BITS {
        return u16::MAX;
    }
    let (mut flips, mut most) = (unsure, 0);
    while flips != 0 {
        most = most.max(resolve(stripes.seen[i] ^ flips, code.code).abs_diff(stripes.number[i]));
        flips = (flips - 1) & unsure;
    }
    most
}
