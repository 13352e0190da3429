//! What decoded orders rest on, summed up over a map.

use fringe::decode::Diagnosis;
use fringe::math::statistics::median;
use fringe::phase::PhaseMap;

/// Numbers of errors to be expected among the valid pixels of a map, before neighbours repair them.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
#[allow(clippy::struct_field_names, reason = "keys of the machine-readable result")]
pub struct Expected {
    /// Wrong orders, from phase noise and bits together.
    pub wrong_orders_expected: f64,
    /// The part of them that comes from bits.
    pub wrong_orders_by_bits: f64,
    /// Wrong bits, most of which change no order; absent without a code.
    pub wrong_bits_expected: Option<f64>,
}

impl Expected {
    /// The expected errors of one phase map.
    pub(super) fn of(map: &PhaseMap, diagnosis: &[Diagnosis]) -> Self {
        let valid = || diagnosis.iter().zip(&map.valid).filter(|(_, valid)| **valid == 1).map(|(d, _)| d);
        let sum = |part: fn(&Diagnosis) -> f32| valid().map(|d| f64::from(part(d))).sum::<f64>();
        let coded = valid().any(|d| !d.wrong_bits.is_nan());
        Self {
            wrong_orders_expected: sum(|d| d.wrong_order),
            wrong_orders_by_bits: sum(|d| d.wrong_order_by_bits),
            wrong_bits_expected: coded.then(|| sum(|d| d.wrong_bits)),
        }
    }

    /// Of two maps together.
    pub(super) fn and(self, other: Self) -> Self {
        let bits = self.wrong_bits_expected.zip(other.wrong_bits_expected);
        Self {
            wrong_orders_expected: self.wrong_orders_expected + other.wrong_orders_expected,
            wrong_orders_by_bits: self.wrong_orders_by_bits + other.wrong_orders_by_bits,
            wrong_bits_expected: bits.map(|(a, b)| a + b),
        }
    }
}

/// Between black and white, medians over the valid pixels.
#[derive(Debug, Clone, Copy, serde::Serialize)]
#[allow(clippy::struct_field_names, reason = "keys of the machine-readable result")]
pub struct Threshold {
    /// What the bits are compared with, DN.
    pub threshold_median_dn: f32,
    /// Its standard uncertainty for one bit, DN.
    pub u_threshold_median_dn: f32,
    /// Half the difference between white and black, DN.
    pub contrast_median_dn: f32,
}

impl Threshold {
    pub(super) fn of(map: &PhaseMap, diagnosis: &[Diagnosis]) -> Option<Self> {
        let of = |part: fn(&Diagnosis) -> f32| median_valid(map, diagnosis.iter().map(part));
        Some(Self {
            threshold_median_dn: of(|d| d.threshold_dn)?,
            u_threshold_median_dn: of(|d| d.u_threshold_dn)?,
            contrast_median_dn: of(|d| d.contrast_dn)?,
        })
    }
}

/// Median over the valid pixels of a map that have a value.
pub fn median_valid(map: &PhaseMap, values: impl Iterator<Item = f32>) -> Option<f32> {
    let kept = values.zip(&map.valid).filter(|(value, valid)| **valid == 1 && !value.is_nan());
    let mut kept: Vec<f32> = kept.map(|(value, _)| value).collect();
    median(&mut kept)
}
