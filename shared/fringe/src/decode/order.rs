//! From the sums of a block of pixels to absolute phase: arctangent, code, chain of orders.
//!
//! Work is done in blocks that live on the stack and fit the first-level cache, one short loop per formula, so that each
//! loop vectorises.

// Without branches a loop vectorises. The values of a block live on the stack, once for each parallel job.
#![allow(clippy::needless_bitwise_bool, clippy::large_stack_arrays)]

use super::arctan::angle_positive_rad;
use super::bits::Stripes;
use super::block::{BLOCK, Planes, Tally, state};
use super::chain::{Chain, Stage, Start};
use super::limits::MAX_SINES;
use super::noise_model::NoiseModel;
use super::rasters::Rasters;
use super::roles::AxisPlan;
use super::settings::DecodeSettings;
use super::sums::{BlockSums, Clipping, Sums};
use std::f64::consts::TAU;
use std::ops::Range;

/// 1.5 · 2⁵²: adding and subtracting it rounds to the nearest integer (ties to even) in plain arithmetic.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// Deviation beyond half a stripe, in periods, that blur and footprint may cause; more means that a bit is wrong.
pub(super) const CODE_EDGE_PERIODS: f64 = 0.2;
/// ln of the odds 10⁴ : 1 that make the nearer of two orders certain.
pub(super) const LOG_ODDS: f64 = 9.2;
/// Pixels that are checked at once for the need of a closer look.
const EYES: usize = 16;

/// Everything that a block needs, constant over the image.
pub struct Kernel<'a> {
    /// How the axis is decoded.
    pub plan: &'a AxisPlan,
    /// How the sums of all sine sets are made.
    pub sums: &'a [Sums],
    /// Steps of all sine sets.
    pub steps: &'a [u32],
    /// Their periods, projector pixels.
    pub periods_px: &'a [f64],
    /// The stored frames: bits, white, black.
    pub rasters: &'a Rasters,
    /// Where a sine frame of the axis is clipped.
    pub clipping: &'a Clipping,
    /// Noise of the camera.
    pub noise: NoiseModel,
    /// Limits of modulation, noise and order.
    pub settings: &'a DecodeSettings,
    /// Smallest modulation of a valid pixel, DN.
    pub least_modulation_dn: f32,
    /// The short way, where the axis is one sine after one code.
    pub(super) single: Option<Single>,
}

/// What the short way needs of the plan, see [`super::single`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Single {
    /// Fringes to a stripe of the code.
    pub(super) stripe_turns: f32,
    /// Fringes to the centre of its first stripe.
    pub(super) first_turns: f32,
    /// A larger distance to the fringe leaves the order open, turns.
    pub(super) most: f32,
    /// A larger distance makes the order weak, turns.
    pub(super) weak: f32,
    /// Distance to half a turn that is open, for each rad of phase noise.
    pub(super) linear: f32,
    /// Phases below are looked at, rad.
    pub(super) low_rad: f32,
    /// Phases above are looked at, rad.
    pub(super) high_rad: f32,
}

/// Intermediate values of one block.
pub struct Lanes {
    /// Sums of the sines in use, the finest first.
    pub(super) sums: [BlockSums; MAX_SINES],
    pub(super) clipped: [u8; BLOCK],
    pub(super) phase_rad: [[f64; BLOCK]; MAX_SINES],
    pub(super) least_modulation: [f32; BLOCK],
    pub(super) coordinate_px: [f64; BLOCK],
    pub(super) doubt: [u8; BLOCK],
    /// Which pixels need a closer look.
    pub(super) look: [u8; BLOCK],
    pub(super) stripes: Stripes,
    pub(super) shifted: Stripes,
    /// What all frames of a micro set add to the coordinate, px, and the ratio of its uncertainty to that of three frames.
    pub(super) finer: [(f64, f32); BLOCK],
}

impl Lanes {
    /// Zeros; made once per parallel job.
    pub fn new() -> Self {
        Self {
            sums: [const { BlockSums::ZERO }; MAX_SINES],
            clipped: [0; BLOCK],
            phase_rad: [[0.0; BLOCK]; MAX_SINES],
            least_modulation: [0.0; BLOCK],
            coordinate_px: [0.0; BLOCK],
            doubt: [0; BLOCK],
            look: [0; BLOCK],
            stripes: Stripes::new(),
            shifted: Stripes::new(),
            finer: [(0.0, 1.0); BLOCK],
        }
    }

    /// The next of so many pixels that needs a closer look, from one on; most groups have none and are passed over at once.
    #[inline(always)]
    pub(super) fn next_look(&self, mut from: usize, count: usize) -> Option<usize> {
        while from < count {
            let end = (from - from % EYES + EYES).min(count);
            let group = &self.look[from..end];
            if group.iter().fold(0, |any, look| any | look) != 0
                && let Some(first) = group.iter().position(|look| *look != 0)
            {
                return Some(from + first);
            }
            from = end;
        }
        None
    }
}

impl Kernel<'_> {
    /// Decodes the pixels in `range` (at most [`BLOCK`]) with the chain of the plan.
    #[inline(always)]
    pub fn block(&self, range: &Range<usize>, lanes: &mut Lanes, out: &mut Planes) -> Tally {
        let Some(chain) = &self.plan.chain else { return self.code_block(range, lanes, out) };
        let count = range.len();
        let tally = self.light(range, lanes, out);
        if !out.state.contains(&state::SURE) {
            out.phase_rad.fill(f32::NAN);
            out.sigma_rad.fill(f32::NAN);
            return tally;
        }
        if let Some(single) = &self.single {
            self.turn(single, range, lanes, out);
            return tally;
        }
        lanes.doubt.fill(state::SURE);
        for (phases, sums) in lanes.phase_rad.iter_mut().zip(&lanes.sums).take(self.plan.sines.len()) {
            for ((phase, c), s) in phases[..count].iter_mut().zip(&sums.cos).zip(&sums.sin) {
                *phase = angle_positive_rad(*s, *c);
            }
        }
        self.coarse(range, lanes);
        for (index, stage) in chain.stages.iter().enumerate() {
            let limits = self.limits(chain, index);
            follow(stage, &limits, lanes, out.sigma_rad, count);
        }
        self.look_closer(chain, lanes, out);
        if self.plan.fused && self.plan.micro.is_some() {
            lanes.refine(out);
        } else if self.plan.fused {
            self.fuse(range, lanes, out);
        }
        self.write(lanes, out);
        tally
    }

    /// Uncertain bits and the edges of the projector, which few pixels have.
    #[inline(always)]
    fn look_closer(&self, chain: &Chain, lanes: &mut Lanes, out: &Planes) {
        let (low, high) = self.inner_px();
        let pixels = lanes.coordinate_px.iter().zip(&*out.state);
        for (look, (x, state)) in lanes.look.iter_mut().zip(pixels) {
            *look = u8::from((*x < low) | (*x > high)) & *state;
        }
        if self.plan.code.is_some() {
            let unsure = lanes.stripes.unsure.iter().zip(&lanes.shifted.unsure);
            for (look, ((unsure, shifted), state)) in lanes.look.iter_mut().zip(unsure.zip(&*out.state)) {
                *look |= u8::from(*unsure | *shifted != 0) & *state;
            }
        }
        let mut from = 0;
        while let Some(i) = lanes.next_look(from, out.state.len()) {
            if self.plan.code.is_some() && lanes.stripes.unsure[i] | lanes.shifted.unsure[i] != 0 {
                self.question_bits(chain, lanes, i);
            }
            self.keep_inside(chain, lanes, i, out.sigma_rad[i]);
            from = i + 1;
        }
    }

    /// Sums, modulation and uncertainty; marks what is masked.
    #[inline(always)]
    fn light(&self, range: &Range<usize>, lanes: &mut Lanes, out: &mut Planes) -> Tally {
        for (j, slot) in self.plan.sines.iter().enumerate().rev() {
            let sums = &mut lanes.sums[j];
            self.sums[*slot].block(self.rasters, range, sums);
            let (cos, sin) = (&sums.cos[..range.len()], &sums.sin[..range.len()]);
            let scale = 2.0 / self.steps[*slot] as f32;
            for ((b, c), s) in out.modulation.iter_mut().zip(cos).zip(sin) {
                *b = scale * (c * c + s * s).sqrt();
            }
            if self.plan.sines.len() == 1 {
                continue;
            }
            if j + 1 == self.plan.sines.len() {
                lanes.least_modulation.fill(f32::INFINITY);
            }
            for (least, b) in lanes.least_modulation.iter_mut().zip(&*out.modulation) {
                *least = if *b < *least { *b } else { *least };
            }
        }
        // The finest sine came last: its modulation stays.
        let finest = self.plan.sines[0];
        let steps = self.steps[finest] as f32;
        let (read, gain) = (
            self.noise.read_variance_dn2 as f32 * 2.0 / steps,
            self.noise.gain_dn as f32 * 2.0 / (steps * steps),
        );
        let sums = &lanes.sums[0];
        for ((sigma, b), sum) in out.sigma_rad.iter_mut().zip(&*out.modulation).zip(&sums.sum) {
            *sigma = (read + gain * sum).sqrt() / *b;
        }
        let frames = (self.rasters, &self.noise);
        self.sums[finest].other_noise(frames, range, steps, sums, out.sigma_rad);
        self.clipping.block(self.rasters, range, &mut lanes.clipped);
        let recovered = if self.settings.use_clipped { self.use_clipped(range, lanes, out) } else { 0 };
        Tally { recovered, ..self.mask(lanes, out) }
    }

    #[inline(always)]
    fn mask(&self, lanes: &Lanes, out: &mut Planes) -> Tally {
        let (mut saturated, mut dark, mut noisy) = (0_u32, 0_u32, 0_u32);
        let (least, most) = (self.least_modulation_dn, self.settings.max_sigma_rad as f32);
        // Of one sine the least modulation is its own.
        let own = self.plan.sines.len() == 1;
        let modulation = if own { &*out.modulation } else { &lanes.least_modulation[..] };
        let pixels = lanes.clipped.iter().zip(modulation).zip(&*out.sigma_rad);
        for (state, ((clipped, b), sigma)) in out.state.iter_mut().zip(pixels) {
            let is_clipped = *clipped != 0;
            let is_dark = !is_clipped & ((*b < least) | (*b <= 0.0));
            let is_noisy = !is_clipped & !is_dark & (*sigma > most);
            saturated += u32::from(is_clipped);
            dark += u32::from(is_dark);
            noisy += u32::from(is_noisy);
            *state = u8::from(!(is_clipped | is_dark | is_noisy));
        }
        Tally { saturated: saturated as usize, recovered: 0, dark: dark as usize, noisy: noisy as usize }
    }

    /// When the step to a stage leaves the order open.
    pub(super) fn limits(&self, chain: &Chain, index: usize) -> Limits {
        let stage = &chain.stages[index];
        let noise = stage.noise_turns_per_rad;
        match (index, chain.start) {
            (0, Start::Centre | Start::Residues) => {
                Limits { most: 0.5, weak: 0.5, linear: 0.0, quadratic: 0.0 }
            }
            (0, Start::Code) => Limits {
                most: 0.5 * self.stripe_px() / stage.period_px + CODE_EDGE_PERIODS,
                weak: 0.5 - self.settings.edge_tolerance,
                linear: self.settings.certainty_sigmas * noise,
                quadratic: 0.0,
            },
            _ => Limits {
                most: 0.5,
                weak: 0.5 - self.settings.edge_tolerance,
                linear: 0.0,
                quadratic: noise * noise * LOG_ODDS,
            },
        }
    }

    /// A coordinate beyond the projector is an alias of one inside where a period covers the projector; at its very edge,
    /// where both could be meant, the order is open.
    #[cold]
    #[inline(never)]
    pub(super) fn keep_inside(&self, chain: &Chain, lanes: &mut Lanes, i: usize, sigma_rad: f32) {
        let (low, high) = (-0.5, self.plan.extent_px - 0.5);
        let x = lanes.coordinate_px[i];
        let slack_px = self.slack_px(sigma_rad);
        if x >= low + slack_px && x <= high - slack_px {
            return;
        }
        let near = x >= low - slack_px && x <= high + slack_px;
        let alias = (chain.start == Start::Centre).then(|| {
            let turn_px = chain.stages[0].period_px;
            let c = if x < 0.5 * high { x + turn_px } else { x - turn_px };
            chain.stages.iter().fold(c, |c, stage| follow_one(stage, lanes, i, c))
        });
        let alias = alias.filter(|x| *x >= low - slack_px && *x <= high + slack_px);
        match (near, alias) {
            (true, None) => {}
            (false, Some(alias)) => lanes.coordinate_px[i] = alias,
            _ => lanes.doubt[i] = state::OPEN,
        }
    }

    /// Coordinates between which no noise reaches the edges of the projector.
    pub(super) fn inner_px(&self) -> (f64, f64) {
        let slack_px = self.slack_px(self.settings.max_sigma_rad as f32);
        (slack_px - 0.5, self.plan.extent_px - 0.5 - slack_px)
    }

    /// How far noise and half a column may carry a coordinate beyond the projector.
    fn slack_px(&self, sigma_rad: f32) -> f64 {
        0.5 + self.settings.certainty_sigmas * f64::from(sigma_rad) * self.plan.period_px / TAU
    }

    #[inline(always)]
    fn write(&self, lanes: &Lanes, out: &mut Planes) {
        let scale = TAU / self.plan.period_px;
        for ((phase, x), (state, doubt)) in
            out.phase_rad.iter_mut().zip(&lanes.coordinate_px).zip(out.state.iter_mut().zip(&lanes.doubt))
        {
            let usable = *state != state::INVALID;
            *phase = if usable { (x * scale) as f32 } else { f32::NAN };
            *state = if usable { *doubt } else { state::INVALID };
        }
        for (sigma, state) in out.sigma_rad.iter_mut().zip(&*out.state) {
            *sigma = if *state == state::INVALID { f32::NAN } else { *sigma };
        }
    }
}

/// Limits of |c − x| / P in a step.
pub(super) struct Limits {
    /// A larger distance leaves the order open.
    pub(super) most: f64,
    /// A larger distance makes the order weak.
    pub(super) weak: f64,
    /// Distance to 1/2 that is open, per rad and per rad² of phase noise.
    pub(super) linear: f64,
    pub(super) quadratic: f64,
}

/// The nearest rule for a block: x = x_w + m P, m = round((c − x_w) / P).
#[inline(always)]
fn follow(stage: &Stage, limits: &Limits, lanes: &mut Lanes, sigma_rad: &[f32], count: usize) {
    let (period, inverse) = (stage.period_px, 1.0 / stage.period_px);
    let mut wrapped = [0.0; BLOCK];
    for (j, a) in &stage.terms {
        let weight = f64::from(*a) * period / TAU;
        for (x, phase) in wrapped[..count].iter_mut().zip(&lanes.phase_rad[*j]) {
            *x += weight * phase;
        }
    }
    let pixels = wrapped[..count].iter().zip(sigma_rad);
    for ((c, doubt), (x, sigma)) in lanes.coordinate_px.iter_mut().zip(&mut lanes.doubt).zip(pixels) {
        let m = ((*c - x) * inverse + ROUND) - ROUND;
        let fine = x + m * period;
        let deviation = (*c - fine).abs() * inverse;
        let sigma = f64::from(*sigma);
        let left = limits.linear * sigma + limits.quadratic * sigma * sigma;
        let open = (deviation > limits.most) | (deviation + left > 0.5 && left > 0.0);
        let level = if open { state::OPEN } else { state::SURE + u8::from(deviation > limits.weak) };
        *doubt = if level > *doubt { level } else { *doubt };
        *c = fine;
    }
}

/// The same for one pixel.
pub(super) fn follow_one(stage: &Stage, lanes: &Lanes, i: usize, c: f64) -> f64 {
    let mut x = 0.0;
    for (j, a) in &stage.terms {
        x += f64::from(*a) * stage.period_px / TAU * lanes.phase_rad[*j][i];
    }
    x + (((c - x) / stage.period_px + ROUND) - ROUND) * stage.period_px
}
