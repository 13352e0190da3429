//! How probable a wrong fringe order is, from the noise of the phase alone.
//!
//! A step of the chain takes m = round((c − x)/P); with the noise t of (c − x)/P it is wrong with the chance
//! P(|t| > ½) = erfc(1 / (2√2 σ_t)). From a code, c − x is besides evenly spread over ± half a stripe. Steps share phases, so their
//! failures come together: from the sum of all the largest joint chance of each with an earlier one is taken off (Hunter's bound, exact for
//! two steps). What neighbours repair later is not
//! counted: this is the rate of a pixel on its own.

use super::chain::{Chain, Stage, Start};
use super::micro::Micro;
use super::number::Residues;
use super::{DecodeError, Decoder};
use crate::math::{erfc, exp};
use crate::pattern::Axis;
use std::collections::BTreeMap;
use std::f64::consts::{PI, SQRT_2};

/// The chance of a wrong order as a function of the noise of the finest phase.
#[derive(Debug, Clone, Copy)]
pub struct OrderRisk<'a> {
    /// The chain of orders.
    pub chain: &'a Chain,
    /// Stripe of the code or stairs at its start, projector pixels.
    pub stripe_px: f64,
    /// Residues, where they are its start.
    pub residues: Option<&'a Residues>,
    /// Further frequencies of a micro set, where they are its start.
    pub micro: Option<&'a Micro>,
}

impl OrderRisk<'_> {
    /// Probability that the order of a pixel is wrong.
    pub fn probability(&self, sigma_rad: f64) -> f64 {
        if sigma_rad.is_nan() || sigma_rad <= 0.0 {
            return 0.0;
        }
        let mut sum = 0.0;
        for (index, stage) in self.chain.stages.iter().enumerate() {
            let turns = stage.noise_turns_per_rad * sigma_rad;
            let wrong = match (index, self.chain.start) {
                (0, Start::Centre) => 0.0,
                (0, Start::Residues) => {
                    let by_residues = self.residues.map_or(0.0, |r| r.wrong_order(sigma_rad));
                    by_residues + self.micro.map_or(0.0, |micro| micro.wrong_order(sigma_rad))
                }
                (0, Start::Code) => spread(0.5 * self.stripe_px / stage.period_px, turns),
                _ => erfc(0.5 / (turns * SQRT_2)),
            };
            let earlier = self.chain.stages[..index].iter();
            let joint = earlier.map(|other| together(stage, other, sigma_rad)).fold(0.0, f64::max);
            sum += wrong - joint.min(wrong);
        }
        sum.min(1.0)
    }

    /// The probability of each pixel, from its σ in rad; 0 where that is NaN. Pixels whose σ agrees to 1/128 share one evaluation.
    pub fn probabilities(&self, sigma_rad: impl Iterator<Item = f32> + Clone) -> Vec<f64> {
        let key = |sigma: f32| sigma.to_bits() >> 16;
        let mut alike: BTreeMap<u32, f64> = BTreeMap::new();
        for sigma in sigma_rad.clone().filter(|sigma| !sigma.is_nan()) {
            alike.entry(key(sigma)).or_insert(0.0);
        }
        for (bits, chance) in &mut alike {
            *chance = self.probability(f64::from(f32::from_bits((bits << 16) | 0x8000)));
        }
        sigma_rad.map(|sigma| alike.get(&key(sigma)).copied().unwrap_or(0.0)).collect()
    }
}

/// Steps of the integral over one of two normal variables, and its reach beyond the limit in standard deviations.
const STEPS: usize = 200;
const REACH: f64 = 8.0;

/// P(|t| > ½ and |t'| > ½) for two steps of the chain between sines: jointly normal, correlated by the phases they share.
fn together(one: &Stage, other: &Stage, sigma_rad: f64) -> f64 {
    let (a, b) = (one.noise_turns_per_rad * sigma_rad, other.noise_turns_per_rad * sigma_rad);
    let shared: f64 =
        one.parts_turns_per_rad.iter().zip(&other.parts_turns_per_rad).map(|(p, q)| p * q).sum();
    let rho = shared * sigma_rad * sigma_rad / (a * b);
    if !rho.is_finite() {
        return 0.0;
    }
    let rest = (1.0 - rho * rho).max(1e-12).sqrt();
    let (from, limit) = (0.5 / a, 0.5 / b);
    let beyond = |z: f64| 0.5 * erfc(z / SQRT_2);
    // Simpson's rule over u > ½/a; the other tail mirrors it.
    let value = |k: usize| {
        let u = from + REACH * k as f64 / STEPS as f64;
        let density = exp(-0.5 * u * u) / (2.0 * PI).sqrt();
        density * (beyond((limit - rho * u) / rest) + beyond((limit + rho * u) / rest))
    };
    let weight = |k: usize| match k {
        0 | STEPS => 1.0,
        k if k % 2 == 1 => 4.0,
        _ => 2.0,
    };
    let sum: f64 = (0..=STEPS).map(|k| weight(k) * value(k)).sum();
    2.0 * sum * REACH / (3.0 * STEPS as f64)
}

/// P(|u + t| > ½) for u even over ± `half` and t normal with standard deviation `turns`.
fn spread(half: f64, turns: f64) -> f64 {
    if half * 1e6 < turns {
        return erfc(0.5 / (turns * SQRT_2));
    }
    // The integral of Q: G(z) = z Q(z) − φ(z), for both sides.
    let integral = |z: f64| z * 0.5 * erfc(z / SQRT_2) - exp(-0.5 * z * z) / (2.0 * PI).sqrt();
    let (near, far) = ((0.5 - half) / turns, (0.5 + half) / turns);
    (turns / half * (integral(far) - integral(near))).clamp(0.0, 1.0)
}

impl Decoder {
    /// The chance of a wrong order along an axis, as a function of the phase noise; `None` for a code without sines, which has no order.
    ///
    /// # Errors
    /// [`DecodeError::NoSuchAxis`].
    pub fn order_risk(&self, axis: Axis) -> Result<Option<OrderRisk<'_>>, DecodeError> {
        let plan = self.plan.axes.iter().find(|a| a.axis == axis).ok_or(DecodeError::NoSuchAxis { axis })?;
        let halved = if plan.shifted.is_some() { 0.5 } else { 1.0 };
        let stair_px = plan.stair.map_or(0.0, |stair| stair.stair_px);
        let stripe_px = plan.code.map_or(stair_px, |code| halved * code.stripe_px);
        let (residues, micro) = (plan.residues.as_ref(), plan.micro.as_ref());
        Ok(plan.chain.as_ref().map(|chain| OrderRisk { chain, stripe_px, residues, micro }))
    }
}
