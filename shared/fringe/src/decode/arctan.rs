//! The arctangent of the phase: plain products and sums, so that a loop over it vectorises on any machine and gives the
//! same bits on all of them.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Coefficients of t, t³, … t¹⁹ of the Chebyshev expansion
/// arctan t = 2 Σ (−1)ᵏ rᵏ′ T₍ₖ′₎(t) / k′, k′ = 2k + 1, r = √2 − 1, cut after ten terms.
/// The rest is below 2 r²¹/21/(1 − r²) = 1.1e-9 rad on [0, 1]. A test derives them anew.
const ARCTAN: [f64; 10] = [
    0.999_999_977_895_215_1,
    -0.333_331_643_906_834_1,
    0.199_961_555_153_964_55,
    -0.142_449_726_804_442_3,
    0.108_682_612_991_576_24,
    -0.081_889_498_892_033_01,
    0.054_646_418_482_445_83,
    -0.028_141_838_627_749_872,
    0.009_392_884_308_299_324,
    -0.001_472_577_957_008_285,
];

/// Polar angle of (c, s) in [0, 2π), error below 2e-9 rad; 0 for the zero vector. Finite input only.
#[inline]
pub fn angle_positive_rad(s: f64, c: f64) -> f64 {
    let (abs_s, abs_c) = (s.abs(), c.abs());
    let steep = abs_s > abs_c;
    let (short, long) = if steep { (abs_c, abs_s) } else { (abs_s, abs_c) };
    let ratio = short / if long > 0.0 { long } else { 1.0 };
    let square = ratio * ratio;
    let mut sum = ARCTAN[9];
    sum = sum * square + ARCTAN[8];
    sum = sum * square + ARCTAN[7];
    sum = sum * square + ARCTAN[6];
    sum = sum * square + ARCTAN[5];
    sum = sum * square + ARCTAN[4];
    sum = sum * square + ARCTAN[3];
    sum = sum * square + ARCTAN[2];
    sum = sum * square + ARCTAN[1];
    sum = sum * square + ARCTAN[0];
    let octant = sum * ratio;
    let quadrant = if steep { FRAC_PI_2 - octant } else { octant };
    let half = if c < 0.0 { PI - quadrant } else { quadrant };
    let turn = if s < 0.0 { TAU - half } else { half };
    if turn < TAU { turn } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Monomial coefficients of the truncated Chebyshev series, in plain integer recurrences.
    fn derived() -> [f64; 10] {
        let mut chebyshev = vec![vec![1.0_f64], vec![0.0, 1.0]];
        for n in 2..20 {
            let mut next = vec![0.0; n + 1];
            for (power, value) in chebyshev[n - 1].iter().enumerate() {
                next[power + 1] += 2.0 * value;
            }
            for (power, value) in chebyshev[n - 2].iter().enumerate() {
                next[power] -= value;
            }
            chebyshev.push(next);
        }
        let r = 2.0_f64.sqrt() - 1.0;
        let mut out = [0.0; 10];
        for k in 0..10 {
            let odd = 2 * k + 1;
            let sign = if k % 2 == 0 { 2.0 } else { -2.0 };
            let weight = sign * r.powi(odd as i32) / odd as f64;
            for (j, value) in out.iter_mut().enumerate() {
                if let Some(c) = chebyshev[odd].get(2 * j + 1) {
                    *value += weight * c;
                }
            }
        }
        out
    }

    #[test]
    fn the_coefficients_are_those_of_the_chebyshev_series() {
        for (written, derived) in ARCTAN.iter().zip(derived()) {
            assert!((written - derived).abs() < 1e-12, "{written:?} should be {derived:?}");
        }
    }

    #[test]
    fn it_agrees_with_the_library_on_millions_of_directions() {
        let mut worst = 0.0_f64;
        for i in 0..4_000_000_u32 {
            let angle = f64::from(i) * (TAU / 4_000_000.0);
            let radius = 1.0 + f64::from(i % 977) * 250.0;
            let (s, c) = (crate::math::sin(angle) * radius, crate::math::cos(angle) * radius);
            let exact = crate::math::wrap_positive_rad(crate::math::atan2(s, c));
            let error = crate::math::wrap_rad(angle_positive_rad(s, c) - exact).abs();
            worst = worst.max(error);
        }
        assert!(worst < 2e-9, "{worst}");
    }

    #[test]
    fn the_axes_are_exact_and_the_range_is_half_open() {
        assert_eq!(angle_positive_rad(0.0, 0.0), 0.0);
        assert_eq!(angle_positive_rad(0.0, 3.0), 0.0);
        assert_eq!(angle_positive_rad(-0.0, 3.0), 0.0);
        assert_eq!(angle_positive_rad(3.0, 0.0), FRAC_PI_2);
        assert_eq!(angle_positive_rad(0.0, -3.0), PI);
        assert_eq!(angle_positive_rad(-3.0, 0.0), 3.0 * FRAC_PI_2);
        assert_eq!(angle_positive_rad(-1e-30, 1.0), 0.0);
        assert!(angle_positive_rad(-1e-9, 1.0) < TAU);
    }
}
