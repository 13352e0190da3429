//! The arctangent of the phase: plain products and sums, so that a loop over it vectorises on any machine and gives the
//! same bits on all of them.

use std::f64::consts::{FRAC_PI_2, TAU};

/// Coefficients of t, t³, … t¹⁷ of the Chebyshev expansion
/// arctan t = 2 Σ (−1)ᵏ rᵏ′ T₍ₖ′₎(t) / k′, k′ = 2k + 1, r = √2 − 1, cut after nine terms.
/// The rest is below 2 r¹⁹/19/(1 − r²) = 7e-9 rad on [0, 1]. A test derives them anew.
const ARCTAN: [f32; 9] = [
    0.999_999_9,
    -0.333_325_24,
    0.199_848_85,
    -0.141_548_07,
    0.104_775_39,
    -0.071_943_84,
    0.039_345_413,
    -0.014_152_348,
    0.002_398_139,
];

/// Polar angle of (c, s) in [0, 2π), error below 1.5e-7 rad; 0 for c = s = +0. Finite input only.
///
/// The octant is found in single precision, four lanes at a time even on the plainest 64-bit processor; the whole
/// quarter turns are added in double precision, because 2π itself has only 2.4e-7 in single.
#[inline(always)]
pub fn angle_positive_rad(s: f32, c: f32) -> f64 {
    let (quarters, part) = quarters_and_rest_rad(s, c);
    let angle = f64::from(quarters) * FRAC_PI_2 + f64::from(part);
    if angle < TAU { angle } else { 0.0 }
}

/// The same angle as 0 to 4 whole quarter turns and what is left, −π/4 to π/4 rad, each exact to the rounding of single precision.
#[inline(always)]
pub fn quarters_and_rest_rad(s: f32, c: f32) -> (f32, f32) {
    let (abs_s, abs_c) = (s.abs(), c.abs());
    let short = if abs_s < abs_c { abs_s } else { abs_c };
    let long = if abs_s > abs_c { abs_s } else { abs_c };
    let ratio = short / if long > f32::MIN_POSITIVE { long } else { f32::MIN_POSITIVE };
    let square = ratio * ratio;
    let mut sum = ARCTAN[8];
    sum = sum * square + ARCTAN[7];
    sum = sum * square + ARCTAN[6];
    sum = sum * square + ARCTAN[5];
    sum = sum * square + ARCTAN[4];
    sum = sum * square + ARCTAN[3];
    sum = sum * square + ARCTAN[2];
    sum = sum * square + ARCTAN[1];
    sum = sum * square + ARCTAN[0];
    let octant = sum * ratio;
    // Reflections at the diagonal, the s axis and the c axis each turn the sign of the octant; with u = 1 on the flat
    // side of the diagonal and 0 on the steep one, the whole quarter turns are 2 − sign s · (1 + sign c · u).
    let flat = if abs_s > abs_c { 0.0_f32 } else { 1.0 };
    let (sign_s, sign_c) = (1.0_f32.copysign(s), 1.0_f32.copysign(c));
    let quarters = 2.0 - sign_s * (1.0 + sign_c * flat);
    (quarters, octant * (sign_s * sign_c) * (2.0 * flat - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Monomial coefficients of the truncated Chebyshev series, in plain integer recurrences.
    fn derived() -> [f64; 9] {
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
        let mut out = [0.0; 9];
        for k in 0..9 {
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
            assert_eq!(*written, derived as f32);
        }
    }

    #[test]
    fn it_agrees_with_the_library_on_millions_of_directions() {
        let mut worst = 0.0_f64;
        for i in 0..4_000_000_u32 {
            let angle = f64::from(i) * (TAU / 4_000_000.0);
            let radius = 1.0 + f64::from(i % 977) * 250.0;
            let (s, c) =
                ((crate::math::sin(angle) * radius) as f32, (crate::math::cos(angle) * radius) as f32);
            let exact = crate::math::wrap_positive_rad(crate::math::atan2(f64::from(s), f64::from(c)));
            let error = crate::math::wrap_rad(angle_positive_rad(s, c) - exact).abs();
            worst = worst.max(error);
        }
        assert!(worst < 1.5e-7, "{worst}");
    }

    #[test]
    fn the_axes_are_exact_and_the_range_is_half_open() {
        assert_eq!(angle_positive_rad(0.0, 0.0), 0.0);
        assert_eq!(angle_positive_rad(0.0, 3.0), 0.0);
        assert_eq!(angle_positive_rad(-0.0, 3.0), 0.0);
        assert_eq!(angle_positive_rad(3.0, 0.0), FRAC_PI_2);
        assert_eq!(angle_positive_rad(0.0, -3.0), std::f64::consts::PI);
        assert_eq!(angle_positive_rad(-3.0, 0.0), 3.0 * FRAC_PI_2);
        assert_eq!(angle_positive_rad(-1e-30, 1.0), 0.0);
        assert!((5.0..TAU).contains(&angle_positive_rad(-1e-9, 1.0)));
    }
}
