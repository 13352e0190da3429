//! The profile of a blurred edge, from a table: a window of pixels needs it a thousand times per step of a fit.

use fringe::math::{erf, exp};
use std::sync::LazyLock;

/// Beyond this many sigma P is ±1 to eight digits: 1 − P(6) = 2·10⁻⁹.
const REACH: f64 = 6.0;
/// Nodes per sigma: cubic pieces then err by h⁴/384·max|P⁗| < 2·10⁻¹⁰.
const NODES: f64 = 64.0;
const INTERVALS: usize = (REACH * NODES) as usize;

/// P(t) = erf(t/√2) and its derivative, by cubic Hermite pieces.
///
/// Odd and even by construction: only t ≥ 0 is stored.
pub(crate) struct Profile {
    /// P and P′ at the nodes t = i/64, i = 0 … 384.
    nodes: [[f64; 2]; INTERVALS + 1],
}

static PROFILE: LazyLock<Profile> = LazyLock::new(|| {
    let mut nodes = [[0.0; 2]; INTERVALS + 1];
    for (i, node) in nodes.iter_mut().enumerate() {
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

    /// The profile P(t) and its derivative P′(t).
    pub fn at(&self, t: f64) -> (f64, f64) {
        if t.abs() >= REACH {
            return (t.signum(), 0.0);
        }
        let place = t.abs() * NODES;
        // A NaN lands at 0 and stays one through `part`.
        let index = place as usize;
        let ([p0, d0], [p1, d1]) = (self.nodes[index], self.nodes[index + 1]);
        let part = place - index as f64;
        let (rest, from) = (1.0 - part, index as f64 / NODES);
        // P″ = −t·P′.
        let (s0, s1) = (-from * d0, -(from + 1.0 / NODES) * d1);
        let (low, high) = (rest * rest * (1.0 + 2.0 * part), part * part * (3.0 - 2.0 * part));
        let (rising, falling) = (part * rest * rest / NODES, part * part * rest / NODES);
        let value = p0 * low + p1 * high + d0 * rising - d1 * falling;
        let slope = d0 * low + d1 * high + s0 * rising - s1 * falling;
        (value.copysign(t), slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_the_error_function() {
        for i in -70_000..70_000 {
            let t = f64::from(i) * 1e-4;
            let (value, slope) = Profile::table().at(t);
            let exact = erf(t * std::f64::consts::FRAC_1_SQRT_2);
            let density = std::f64::consts::FRAC_2_PI.sqrt() * exp(-0.5 * t * t);
            let tail = if t.abs() >= REACH { 1.3e-8 } else { 0.0 };
            assert!((value - exact).abs() < 3e-10 + tail, "P({t}) = {value}, exact {exact}");
            assert!((slope - density).abs() < 1e-9 + tail, "P′({t}) = {slope}, exact {density}");
        }
    }

    #[test]
    fn what_is_no_number_stays_none_and_infinity_is_beyond() {
        let table = Profile::table();
        assert!(table.at(f64::NAN).0.is_nan());
        assert_eq!(table.at(f64::NEG_INFINITY), (-1.0, 0.0));
        assert_eq!(table.at(1e300), (1.0, 0.0));
    }
}
