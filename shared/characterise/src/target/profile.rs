//! The profile of a blurred edge, from a table: a window of pixels needs it a thousand times per step of a fit.

use fearless_simd::f64x8;
use fearless_simd::prelude::*;
use fringe::math::{erf, exp};
use std::sync::LazyLock;

/// Beyond this many sigma P counts as ±1: 1 − P(6) = 2·10⁻⁹.
const REACH: f64 = 6.0;
/// Nodes per sigma: a series of fourth order around the nearest one errs by less than 10⁻¹¹.
const NODES: f64 = 64.0;
/// Node at the reach and all further ones.
const LAST: usize = (REACH * NODES) as usize;
/// Stored nodes: any number of nine bits is one of them.
const STORED: usize = 512;
/// Added to a number below 2⁵¹, it leaves the nearest integer in the lowest bits.
const TO_INTEGER: f64 = 1.5 * (1_u64 << 52) as f64;

/// P(t) = erf(t/√2) and its derivative, by Taylor's series around the nearest node: their derivatives are polynomials in t times P′.
///
/// Odd and even by construction: only t ≥ 0 is stored.
pub(crate) struct Profile {
    /// P and P′ at the nodes t = i/64; 1 and 0 from the reach on.
    nodes: [[f64; 2]; STORED],
}

static PROFILE: LazyLock<Profile> = LazyLock::new(|| {
    let mut nodes = [[1.0, 0.0]; STORED];
    for (i, node) in nodes.iter_mut().enumerate().take(LAST) {
        let t = i as f64 / NODES;
        *node = [
            erf(t * std::f64::consts::FRAC_1_SQRT_2),
            std::f64::consts::FRAC_2_PI.sqrt() * exp(-0.5 * t * t),
        ];
    }
    Profile { nodes }
});

impl Profile {
    /// The table, made at first use.
    pub fn table() -> &'static Self {
        &PROFILE
    }

    /// The profile P(t) and its derivative P′(t), of eight edges side by side.
    #[inline(always)]
    pub fn at<S: Simd>(&self, t: f64x8<S>) -> (f64x8<S>, f64x8<S>) {
        let far = t.abs();
        // What is no number stays none.
        let reached = far.simd_gt(REACH).select(f64x8::splat(t.simd, REACH), far);
        let rounded = reached * NODES + TO_INTEGER;
        let (mut p, mut d) = ([0.0; 8], [0.0; 8]);
        for l in 0..8 {
            [p[l], d[l]] = self.nodes[rounded[l].to_bits() as usize % STORED];
        }
        let [p, d] = [p, d].map(|lanes| f64x8::simd_from(t.simd, lanes));
        let node = (rounded - TO_INTEGER) * (1.0 / NODES);
        let (e, n2) = (reached - node, node * node);
        // Derivatives of P over P′ and over the factorials of the series.
        let (second, third) = (node * -0.5, (n2 - 1.0) * (1.0 / 6.0));
        let (fourth, fifth) = (node * (3.0 - n2) * (1.0 / 24.0), (n2 * (n2 - 6.0) + 3.0) * (1.0 / 120.0));
        let value = p + d * e * (1.0 + e * (second + e * (third + e * fourth)));
        let slope =
            d * (1.0 + e * (2.0 * second + e * (3.0 * third + e * (4.0 * fourth + e * (5.0 * fifth)))));
        (value.copysign(t), slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    /// The profile of one edge.
    fn at(t: f64) -> (f64, f64) {
        dispatch!(Level::new(), simd => {
            let (value, slope) = Profile::table().at(f64x8::splat(simd, t));
            (value[0], slope[0])
        })
    }

    #[test]
    fn the_table_is_the_error_function() {
        for i in -70_000..70_000 {
            let t = f64::from(i) * 1e-4;
            let (value, slope) = at(t);
            let exact = erf(t * std::f64::consts::FRAC_1_SQRT_2);
            let density = std::f64::consts::FRAC_2_PI.sqrt() * exp(-0.5 * t * t);
            // The last node stands for all that is beyond it.
            let tail = if t.abs() >= REACH - 0.5 / NODES { 1.4e-8 } else { 0.0 };
            assert!((value - exact).abs() < 1e-11 + tail, "P({t}) = {value}, exact {exact}");
            assert!((slope - density).abs() < 1e-9 + tail, "P′({t}) = {slope}, exact {density}");
        }
    }

    #[test]
    fn what_is_no_number_stays_none_and_infinity_is_beyond() {
        assert!(at(f64::NAN).0.is_nan());
        assert_eq!(at(f64::NEG_INFINITY), (-1.0, 0.0));
        assert_eq!(at(1e300), (1.0, 0.0));
    }
}
