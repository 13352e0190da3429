//! What the order of each pixel rests on: threshold, contrast, the chance of a wrong bit and of a wrong order.
//!
//! # Bits
//! A bit is light when I > T. With the contrast c, half the difference between light and dark, D = I − T falls on the wrong side with the
//! chance Q(c/σ_D), Q(z) = erfc(z/√2)/2. The contrast ĉ is measured with noise of its own, so Q(ĉ/σ_D) would overstate small chances
//! many times; but for ĉ normal about c, E Q(ĉ/s) = Q(c/√(s² + σ_c²)), so that s² = σ_D² − σ_c² states the chance without bias:
//!
//! | threshold T | contrast ĉ | σ_D² | σ_c² | u²(T) |
//! |---|---|---|---|---|
//! | (W + K)/2, white and black | half the difference of the means of n light and m dark frames, W and K among them | σ² + u²(T) | σ_L²/4n + σ_K²/4m | (σ_L² + σ_K²)/4 |
//! | mean of N sine steps | mean of abs(I − T) over n light and m dark bits | σ² + u²(T) | (n σ_L² + m σ_K²)/(n + m)² + ((n − m)/(n + m))² u²(T) | σ_A²/N |
//! | (I + Ī)/2, complement | mean of abs(I − Ī)/2 over n bits | u²(T) | u²(T)/n | (σ_L² + σ_K²)/4 |
//!
//! σ² is the variance of the frame's own grey value: σ_L² of a light bit, σ_K² of a dark one, σ_A² between them. A bit that shows an edge of
//! its stripe within the pixel's footprint has less contrast; it selects one of two neighbouring stripes, which the phase settles, and
//! lowers ĉ by its share, to the safe side.
//!
//! # Orders
//! The phase alone is wrong as [`OrderRisk`](super::OrderRisk) states. A bit adds its chance where its change, taken through the
//! chain, leads to another order; of a code without sines every change of a bit is a wrong stripe. What neighbours repair is not counted.

use super::bits::{Stripes, resolve};
use super::block::{BLOCK, CHUNK, Planes, state};
use super::blocks::decode_block;
use super::coarse::centre_px;
use super::noise_line::QUANTISATION_DN2;
use super::order::{Kernel, Lanes, follow_one};
use super::roles::{AxisPlan, CodePlan, Reference};
use super::{DecodeError, Decoder, OrderRisk};
use crate::math::erfc;
use crate::pattern::Axis;
use rayon::prelude::*;

/// What one pixel's order rests on; NaN where it is masked, and where there is no code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Diagnosis {
    /// Grey value between black and white that the bits are compared with, DN; the mean over the bits where each has its own.
    pub threshold_dn: f32,
    /// Its standard uncertainty for one bit, DN.
    pub u_threshold_dn: f32,
    /// Half the difference between light and dark, DN.
    pub contrast_dn: f32,
    /// Expected number of wrong bits.
    pub wrong_bits: f32,
    /// Probability of a wrong order (of a wrong stripe, for a code without sines), bits and phase noise together.
    pub wrong_order: f32,
    /// The part of it that comes from bits.
    pub wrong_order_by_bits: f32,
    /// Projector coordinate from the pixel's own frames, before any neighbour is asked, px.
    pub own_px: f32,
}

impl Diagnosis {
    const NONE: Self = Self {
        threshold_dn: f32::NAN,
        u_threshold_dn: f32::NAN,
        contrast_dn: f32::NAN,
        wrong_bits: f32::NAN,
        wrong_order: f32::NAN,
        wrong_order_by_bits: f32::NAN,
        own_px: f32::NAN,
    };
}

/// Chances below this are not followed through the chain.
const NEGLIGIBLE: f64 = 1e-15;

impl Decoder {
    /// What the order of each pixel along an axis rests on, row by row. For people and tests, not for the hot path: it decodes again.
    ///
    /// # Errors
    /// [`DecodeError::NoSuchAxis`], [`DecodeError::Incomplete`].
    pub fn diagnose(&self, axis: Axis) -> Result<Vec<Diagnosis>, DecodeError> {
        let home = self.complete(axis)?;
        // The order is set before the sines are fused, from the finest one's noise.
        let plan = AxisPlan { fused: false, ..self.plan.axes[home].clone() };
        // By the general way, which leaves behind what a decision rests on.
        let kernel = Kernel { single: None, ..self.kernel(home, &plan) };
        let mut pixels = vec![(Diagnosis::NONE, f32::NAN); self.pixels];
        pixels.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, pixels)| {
            let (mut lanes, mut scratch) = (Lanes::new(), Scratch::new());
            for (index, block) in pixels.chunks_mut(BLOCK).enumerate() {
                let start = chunk * CHUNK + index * BLOCK;
                let range = start..start + block.len();
                decode_block(&kernel, self.level, &range, &mut lanes, &mut scratch.planes(block.len()));
                for (i, pixel) in block.iter_mut().enumerate() {
                    if scratch.state[i] != state::INVALID {
                        *pixel = (kernel.diagnosis(&lanes, start, i), scratch.sigma[i]);
                    }
                }
            }
        });
        if let Some(risk) = self.order_risk(axis)? {
            add_phase_noise(&risk, &mut pixels);
        }
        Ok(pixels.into_iter().map(|(pixel, _)| pixel).collect())
    }
}

/// Adds the chance that phase noise alone has.
fn add_phase_noise(risk: &OrderRisk, pixels: &mut [(Diagnosis, f32)]) {
    let chances = risk.probabilities(pixels.iter().map(|(_, sigma)| *sigma));
    for ((pixel, _), by_phase) in pixels.iter_mut().zip(chances) {
        let by_bits = f64::from(pixel.wrong_order_by_bits);
        pixel.wrong_order = (by_bits + by_phase - by_bits * by_phase) as f32;
    }
}

/// Output planes that are discarded.
struct Scratch {
    phase: [f32; BLOCK],
    sigma: [f32; BLOCK],
    modulation: [f32; BLOCK],
    state: [u8; BLOCK],
}

impl Scratch {
    fn new() -> Self {
        Self { phase: [0.0; BLOCK], sigma: [0.0; BLOCK], modulation: [0.0; BLOCK], state: [0; BLOCK] }
    }

    fn planes(&mut self, count: usize) -> Planes<'_> {
        Planes {
            phase_rad: &mut self.phase[..count],
            sigma_rad: &mut self.sigma[..count],
            modulation: &mut self.modulation[..count],
            state: &mut self.state[..count],
        }
    }
}

/// Chances of one pixel's bits.
struct Bits {
    threshold_dn: f64,
    u_threshold_dn: f64,
    contrast_dn: f64,
    /// Of a light and of a dark bit.
    wrong: [f64; 2],
}

/// Sums over the light and the dark frames of a pixel.
#[derive(Default)]
struct Groups {
    count: [f64; 2],
    sum_dn: [f64; 2],
}

impl Groups {
    fn add(&mut self, dark: bool, value_dn: f64) {
        self.count[usize::from(dark)] += 1.0;
        self.sum_dn[usize::from(dark)] += value_dn;
    }

    fn mean_dn(&self, group: usize) -> f64 {
        self.sum_dn[group] / self.count[group].max(1.0)
    }
}

impl Kernel<'_> {
    fn diagnosis(&self, lanes: &Lanes, start: usize, i: usize) -> Diagnosis {
        let mut found =
            Diagnosis { own_px: lanes.coordinate_px[i] as f32, wrong_order_by_bits: 0.0, ..Diagnosis::NONE };
        let Some(code) = &self.plan.code else {
            found.wrong_order = 0.0;
            return found;
        };
        let bits = self.bits(code, &lanes.stripes, start + i, i);
        let (mut expected, mut right) = (0.0, 1.0);
        let second = self.plan.shifted.as_ref().map(|shifted| (shifted, &lanes.shifted, &lanes.stripes));
        for (code, stripes, other) in [(code, &lanes.stripes, &lanes.shifted)].into_iter().chain(second) {
            for bit in 0..code.bits {
                let wrong = bits.wrong[usize::from(is_dark(code, stripes, i, bit))];
                expected += wrong;
                if wrong > NEGLIGIBLE && self.matters(code, (stripes, other), lanes, i, bit) {
                    right *= 1.0 - wrong;
                }
            }
        }
        found.threshold_dn = bits.threshold_dn as f32;
        found.u_threshold_dn = bits.u_threshold_dn as f32;
        found.contrast_dn = bits.contrast_dn as f32;
        found.wrong_bits = expected as f32;
        found.wrong_order_by_bits = (1.0 - right) as f32;
        found.wrong_order = found.wrong_order_by_bits;
        found
    }

    /// Whether the other value of one bit leads to another order.
    fn matters(
        &self,
        code: &CodePlan,
        (own, other): (&Stripes, &Stripes),
        lanes: &Lanes,
        i: usize,
        bit: usize,
    ) -> bool {
        let Some(chain) = &self.plan.chain else { return true };
        let rest = if self.plan.shifted.is_some() { u32::from(other.number[i]) } else { 0 };
        let number = u32::from(resolve(own.seen[i] ^ (1 << bit), code.code)) + rest;
        let start = centre_px(self.stripe_px(), number);
        let x = chain.stages.iter().fold(start, |c, stage| follow_one(stage, lanes, i, c));
        (x - lanes.coordinate_px[i]).abs() > 0.5 * self.plan.period_px
    }

    fn variance_dn2(&self, level_dn: f64) -> f64 {
        (self.noise.read_variance_dn2 + self.noise.gain_dn * level_dn.max(0.0)).max(QUANTISATION_DN2)
    }

    fn value_dn(&self, raster: usize, at: usize) -> f64 {
        f64::from(self.rasters.value(raster, at))
    }

    /// The table of the module; `at` counts in the image, `i` in the block.
    fn bits(&self, code: &CodePlan, stripes: &Stripes, at: usize, i: usize) -> Bits {
        let mut groups = Groups::default();
        for bit in 0..code.bits {
            // The last frame is the least significant bit.
            let value_dn = self.value_dn(code.first + code.bits - 1 - bit, at);
            groups.add(is_dark(code, stripes, i, bit), value_dn);
        }
        let bits = code.bits as f64;
        match code.reference {
            Reference::WhiteBlack(white, black) => {
                let threshold_dn = 0.5 * (self.value_dn(white, at) + self.value_dn(black, at));
                groups.add(false, self.value_dn(white, at));
                groups.add(true, self.value_dn(black, at));
                let contrast_dn = 0.5 * (groups.mean_dn(0) - groups.mean_dn(1));
                let [light, dark] = self.levels_dn2(threshold_dn, contrast_dn);
                let threshold = 0.25 * (light + dark);
                let own = 0.25 * (light / groups.count[0] + dark / groups.count[1]);
                bit_errors(
                    [threshold_dn, contrast_dn],
                    threshold,
                    [light + threshold - own, dark + threshold - own],
                )
            }
            Reference::SineMean(slot) => {
                let steps = f64::from(self.steps[slot]);
                let threshold_dn = f64::from(self.sums[slot].sum_at(self.rasters, at)) / steps;
                let over = groups.sum_dn[0] - groups.count[0] * threshold_dn;
                let contrast_dn = (over + groups.count[1] * threshold_dn - groups.sum_dn[1]) / bits;
                let [light, dark] = self.levels_dn2(threshold_dn, contrast_dn);
                let threshold = self.variance_dn2(threshold_dn) / steps;
                let excess = (groups.count[0] - groups.count[1]) / bits;
                let own = (groups.count[0] * light + groups.count[1] * dark) / (bits * bits)
                    + excess * excess * threshold;
                bit_errors(
                    [threshold_dn, contrast_dn],
                    threshold,
                    [light + threshold - own, dark + threshold - own],
                )
            }
            Reference::Complement(first) => {
                let (mut sum, mut apart) = (0.0, 0.0);
                for bit in 0..code.bits {
                    let (a, b) = (self.value_dn(code.first + bit, at), self.value_dn(first + bit, at));
                    sum += 0.5 * (a + b);
                    apart += 0.5 * (a - b).abs();
                }
                let [light, dark] = self.levels_dn2(sum / bits, apart / bits);
                let threshold = 0.25 * (light + dark);
                bit_errors([sum / bits, apart / bits], threshold, [threshold * (1.0 - 1.0 / bits); 2])
            }
        }
    }

    /// Variances of a light and of a dark grey value.
    fn levels_dn2(&self, threshold_dn: f64, contrast_dn: f64) -> [f64; 2] {
        [self.variance_dn2(threshold_dn + contrast_dn), self.variance_dn2(threshold_dn - contrast_dn)]
    }
}

/// Whether a bit (0 the least significant) was seen dark.
fn is_dark(code: &CodePlan, stripes: &Stripes, i: usize, bit: usize) -> bool {
    u16::from(code.invert) ^ ((stripes.seen[i] >> bit) & 1) == 0
}

/// Chances from threshold and contrast, the variance of the threshold, and s² of a light and of a dark bit.
fn bit_errors([threshold_dn, contrast_dn]: [f64; 2], threshold_dn2: f64, spread_dn2: [f64; 2]) -> Bits {
    let chance = |variance: f64| 0.5 * erfc(contrast_dn / (2.0 * variance.max(QUANTISATION_DN2)).sqrt());
    Bits { threshold_dn, u_threshold_dn: threshold_dn2.sqrt(), contrast_dn, wrong: spread_dn2.map(chance) }
}
