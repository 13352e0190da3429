//! The profile of a blurred edge, from a table: a window of pixels needs it a thousand times per step of a fit.

use fearless_simd::f32x16;
use fearless_simd::prelude::*;
use fringe::math::{erf, exp};
use std::sync::LazyLock;

/// Beyond this many sigma P counts as ±1: 1 − P(6) = 2·10⁻⁹.
const REACH: f32 = 6.0;
/// Nodes per sigma: a series of third order around the nearest one errs by less than single precision.
const NODES: f32 = 64.0;
/// Node at the reach and all further ones.
const LAST: usize = (REACH * NODES) as usize;
/// Stored nodes: any number of nine bits is one of them.
const STORED: usize = 512;
/// Added to a number below 2²², it leaves the nearest integer in the lowest bits.
const TO_INTEGER: f32 = 1.5 * (1_u32 << 23) as f32;

/// P(t) = erf(t/√2) and its derivative, by Taylor's series around the nearest node: their derivatives are polynomials in t times P′.
///
/// Odd and even by construction: only t ≥ 0 is stored.
pub(crate) struct Profile {
    /// P and P′ at the nodes t = i/64; 1 and 0 from the reach on.
    nodes: [[f32; 2]; STORED],
}

static PROFILE: LazyLock<Profile> = LazyLock::new(|| {
    let mut nodes = [[1.0, 0.0]; STORED];
    for (i, node) in nodes.iter_mut().enumerate().take(LAST) {
        let t = i as f64 / f64::from(NODES);
        let density = std::f64::consts::FRAC_2_PI.sqrt() * exp(-0.5 * t * t);
        *node = [erf(t * std::f64::consts::FRAC_1_SQRT_2) as f32, density as f32];
    }
    Profile { nodes }
});

impl Profile {
    /// The table, made at first use.
    pub fn table() -> &'static Self {
        &PROFILE
    }

    /// The profile P(t) and its derivative P′(t), of sixteen edges side by side.
    #[inline(always)]
    pub fn at<S: Simd>(&self, t: f32x16<S>) -> (f32x16<S>, f32x16<S>) {
        let far = t.abs();
        // What is no number stays none.
        let reached = far.simd_gt(REACH).select(f32x16::splat(t.simd, REACH), far);
        let rounded = reached * NODES + TO_INTEGER;
        let (mut p, mut d) = ([0.0; 16], [0.0; 16]);
        for l in 0..16 {
            [p[l], d[l]] = self.nodes[rounded[l].to_bits() as usize % STORED];
        }
        let [p, d] = [p, d].map(|lanes| f32x16::simd_from(t.simd, lanes));
        let node = (rounded - TO_INTEGER) * (1.0 / NODES);
        let (e, n2) = (reached - node, node * node);
        // Derivatives of P over P′ and over the factorials of the series.
        let (second, third) = (node * -0.5, (n2 - 1.0) * (1.0 / 6.0));
        let fourth = node * (3.0 - n2) * (1.0 / 24.0);
        let value = p + d * e * (1.0 + e * (second + e * third));
        let slope = d * (1.0 + e * (2.0 * second + e * (3.0 * third + e * (4.0 * fourth))));
        (value.copysign(t), slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    /// The profile of one edge.
    fn at(t: f32) -> (f32, f32) {
        dispatch!(Level::new(), simd => {
            let (value, slope) = Profile::table().at(f32x16::splat(simd, t));
            (value[0], slope[0])
        })
    }

    #[test]
    fn the_table_is_the_error_function() {
        for i in -70_000_i32..70_000 {
            let t = i as f32 * 1e-4;
            let ((value, slope), exactly) = (at(t), f64::from(t));
            let exact = erf(exactly * std::f64::consts::FRAC_1_SQRT_2);
            let density = std::f64::consts::FRAC_2_PI.sqrt() * exp(-0.5 * exactly * exactly);
            // The last node stands for all that is beyond it.
            let tail = if t.abs() >= REACH - 0.5 / NODES { 1.4e-8 } else { 0.0 };
            assert!((f64::from(value) - exact).abs() < 1.3e-7 + tail, "P({t}) = {value}, exact {exact}");
            assert!((f64::from(slope) - density).abs() < 1.3e-7 + tail, "P′({t}) = {slope}, exact {density}");
        }
    }

    #[test]
    fn what_is_no_number_stays_none_and_infinity_is_beyond() {
        assert!(at(f32::NAN).0.is_nan());
        assert_eq!(at(f32::NEG_INFINITY), (-1.0, 0.0));
        assert_eq!(at(1e30), (1.0, 0.0));
    }
}
