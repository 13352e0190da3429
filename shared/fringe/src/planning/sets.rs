//! The sets of a candidate, and its chance of a wrong order.

use super::Requirements;
use super::pattern::contrast;
use crate::decode::chain::{Sine, widest_of};
use crate::decode::number::Residues;
use crate::decode::{OrderMethod, OrderRisk};
use crate::math::erfc;
use crate::pattern::{Code, PatternSet};
use std::f64::consts::SQRT_2;

/// Largest useful number of steps for a contrast: beyond, a sine adds no significant noise.
const MOST_WORTH: f64 = 1e6;

/// Bits of a code of a thousand stripes: the chance of a wrong one is a matter of powers of ten.
const BITS: f64 = 10.0;

/// Orders that are tried.
pub const ORDERS: [OrderMethod; 5] = [
    OrderMethod::Gray,
    OrderMethod::ShiftedGray,
    OrderMethod::Hierarchical,
    OrderMethod::Heterodyne,
    OrderMethod::NumberTheoretical,
];

fn gray(wanted: &Requirements, stripe_px: f64, shift_px: f64) -> PatternSet {
    let stripes = f64::from(wanted.extent_px) / stripe_px;
    let bits = (1..=16).find(|bits| f64::from(1_u32 << bits) >= stripes + 1.0).unwrap_or(16);
    let (axis, invert, code, threshold) = (wanted.axis, false, Code::Gray, None);
    PatternSet::Gray { axis, bits, stripe_px, shift_px, invert, code, threshold }
}

/// The sets and the periods of the sines, finest first; `None` where this order cannot number the projector with this period.
pub(super) fn sequence(
    wanted: &Requirements,
    order: OrderMethod,
    period_px: f64,
    steps: u32,
) -> Option<(Vec<PatternSet>, Vec<f64>)> {
    let levels = [PatternSet::White {}, PatternSet::Black {}];
    let sines = |periods: &[f64]| {
        periods.iter().map(|p| PatternSet::sine(wanted.axis, *p, steps)).collect::<Vec<_>>()
    };
    let with_code = |codes: &[PatternSet]| [&sines(&[period_px]), codes, &levels].concat();
    let whole = |shift_px| gray(wanted, period_px, shift_px);
    let periods = match order {
        OrderMethod::Gray => {
            return Some((with_code(&[gray(wanted, 0.5 * period_px, 0.0)]), vec![period_px]));
        }
        OrderMethod::ShiftedGray => {
            return Some((with_code(&[whole(0.0), whole(0.5 * period_px)]), vec![period_px]));
        }
        OrderMethod::Hierarchical => hierarchy(period_px, f64::from(wanted.extent_px)),
        OrderMethod::Heterodyne => beats(period_px, f64::from(wanted.extent_px))?,
        OrderMethod::NumberTheoretical => coprime(period_px, wanted.extent_px)?,
        OrderMethod::Auto | OrderMethod::Binary | OrderMethod::Stair => return None,
    };
    Some((sines(&periods), periods))
}

/// Equal ratios of at most 8 up to the projector.
fn hierarchy(period_px: f64, extent_px: f64) -> Vec<f64> {
    let mut periods = vec![period_px];
    while periods[periods.len() - 1] * 8.0 < extent_px {
        periods.push(periods[periods.len() - 1] * 8.0);
    }
    periods.push(extent_px);
    periods
}

/// Three periods p < q < r whose beat of beats covers the projector with the least loss: 1/p − 2/q + 1/r, q and r whole or half pixels.
fn beats(period_px: f64, extent_px: f64) -> Option<Vec<f64>> {
    let step = 0.5;
    let mut best: Option<(f64, Vec<f64>)> = None;
    for i in 1..=24 {
        let q = period_px + step * f64::from(i);
        for j in 1..=24 {
            let r = q + step * f64::from(j);
            let beat = 1.0 / (1.0 / period_px - 2.0 / q + 1.0 / r);
            // The widest way from beat to beat to period: the larger of the two ratios is the weaker step.
            let middle = 1.0 / (1.0 / period_px - 1.0 / q);
            let weak = (beat / middle).max(middle / period_px);
            if beat >= extent_px * 1.001 && best.as_ref().is_none_or(|b| weak < b.0) {
                best = Some((weak, vec![period_px, q, r]));
            }
        }
    }
    best.map(|b| b.1)
}

/// The second whole period that covers the projector with the shortest length.
fn coprime(period_px: f64, extent_px: u32) -> Option<Vec<f64>> {
    let p = period_px.round() as u32;
    let gcd = |mut a: u32, mut b: u32| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let covers = |q: &u32| u64::from(p) * u64::from(*q) / u64::from(gcd(p, *q)) >= u64::from(extent_px);
    (f64::from(p) == period_px).then_some(())?;
    (p + 1..=8 * p).find(covers).map(|q| vec![period_px, f64::from(q)])
}

/// Chance of a wrong order at a phase noise of the finest sine. Longer periods keep more contrast, which is worth as much as more steps.
pub(super) fn wrong_order(
    wanted: &Requirements,
    order: OrderMethod,
    periods_px: &[f64],
    steps: u32,
    sigma_rad: f64,
) -> Option<f64> {
    let worth = |period_px: &f64| {
        let left = contrast(wanted.blur_px, *period_px, 1) / contrast(wanted.blur_px, periods_px[0], 1);
        (f64::from(steps) * left * left).round().min(MOST_WORTH) as u32
    };
    let list: Vec<(f64, u32)> = periods_px.iter().map(|p| (*p, worth(p))).collect();
    let sines: Vec<Sine> =
        list.iter().map(|(period_px, steps)| Sine { period_px: *period_px, steps: *steps }).collect();
    let extent_px = f64::from(wanted.extent_px);
    if order == OrderMethod::NumberTheoretical {
        return Residues::new(&list, wanted.extent_px).ok().map(|residues| residues.wrong_order(sigma_rad));
    }
    let by_code = matches!(order, OrderMethod::Gray | OrderMethod::ShiftedGray);
    let stripe_px = 0.5 * periods_px[0];
    let most_phases = if order == OrderMethod::Hierarchical { 1 } else { 4 };
    let chain = widest_of(&sines, by_code.then_some(stripe_px), extent_px, most_phases)?;
    let by_phase = OrderRisk { chain: &chain, stripe_px, residues: None, micro: None }.probability(sigma_rad);
    Some(if by_code { (by_phase + by_bits(wanted, order)).min(1.0) } else { by_phase })
}

/// Chance that any bit is read wrongly against the mean of white and black, whose noise adds half as much again; most bits are of
/// another order, so all of them count.
fn by_bits(wanted: &Requirements, order: OrderMethod) -> f64 {
    let sigma_dn = wanted.brightness().grey_noise_dn() * 1.5_f64.sqrt();
    let wrong = 0.5 * erfc(wanted.modulation_dn / (sigma_dn * SQRT_2));
    let codes = if order == OrderMethod::ShiftedGray { 2.0 } else { 1.0 };
    codes * BITS * wrong
}
