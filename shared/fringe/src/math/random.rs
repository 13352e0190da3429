//! Counter-based random numbers: every draw is a function of its place, so the order of work does not show.

use crate::math::ln;

/// Bins of the quantile table; each spans 1/4096 of probability.
const BINS: usize = 4096;

/// Bins at each end that are computed instead of interpolated: there the quantile is too curved.
const TAIL_BINS: usize = 4;

/// A key, made by mixing in what separates one stream of draws from another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Key(u64);

impl Key {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        Self(mix(seed ^ 0x6a09_e667_f3bc_c909))
    }

    /// A stream of its own for each value.
    #[must_use]
    pub fn with(self, value: u64) -> Self {
        Self(mix(self.0 ^ mix(value.wrapping_add(0x9e37_79b9_7f4a_7c15))))
    }

    /// Draw number `counter`, 64 even bits (Steele et al., splitmix64, 2014).
    #[inline]
    pub fn bits(self, counter: u64) -> u64 {
        mix(self.0.wrapping_add(counter.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// Draw number `counter`, uniform in [−1, 1).
    pub fn symmetric(self, counter: u64) -> f64 {
        (self.bits(counter) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Draw number `counter`, uniform in (0, 1): neither end occurs, so that every quantile of it is finite.
    pub fn open(self, counter: u64) -> f64 {
        open_interval(self.bits(counter))
    }
}

/// Even bits to the open interval (0, 1). With 53 bits the largest of them would round to 1.
fn open_interval(bits: u64) -> f64 {
    ((bits >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
}

#[inline]
fn mix(value: u64) -> u64 {
    let mut z = value;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Standard normal draws by inversion: linear between tabulated quantiles, computed in the tails.
#[derive(Debug, Clone, PartialEq)]
pub struct Normal {
    /// Quantile at the start of each bin, and its rise over the bin.
    table: Vec<[f32; 2]>,
}

impl Default for Normal {
    fn default() -> Self {
        let at = |bin: usize| normal_quantile(bin.max(1) as f64 / BINS as f64);
        let table = (0..BINS)
            .map(|bin| {
                let next = if bin + 1 == BINS { at(bin) } else { at(bin + 1) };
                [at(bin) as f32, (next - at(bin)) as f32]
            })
            .collect();
        Self { table }
    }
}

impl Normal {
    /// A standard normal value from 64 even bits.
    #[inline]
    pub fn draw(&self, bits: u64) -> f32 {
        let bin = (bits >> 52) as usize;
        if !(TAIL_BINS..BINS - TAIL_BINS).contains(&bin) {
            return normal_quantile(open_interval(bits)) as f32;
        }
        let [start, rise] = self.table[bin];
        let fraction = ((bits >> 28) & 0xff_ffff) as f32 / 16_777_216.0;
        start + rise * fraction
    }
}

/// Quantile of the standard normal distribution for 0 < p < 1, to rounding: M. J. Wichura, algorithm AS 241 (PPND16),
/// Applied Statistics 37, 477, 1988.
pub fn normal_quantile(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        return q * polynomial(&CENTRE[0], r) / polynomial(&CENTRE[1], r);
    }
    let r = (-ln(p.min(1.0 - p))).sqrt();
    let (table, from) = if r <= 5.0 { (&TAIL, 1.6) } else { (&FAR_TAIL, 5.0) };
    let x = polynomial(&table[0], r - from) / polynomial(&table[1], r - from);
    if q < 0.0 { -x } else { x }
}

/// Horner's scheme, lowest power first.
fn polynomial(coefficients: &[f64; 8], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Numerator and denominator for |p − 1/2| ≤ 0.425.
#[expect(clippy::excessive_precision, clippy::unreadable_literal, reason = "digits as published")]
const CENTRE: [[f64; 8]; 2] = [
    [
        3.3871328727963666080e0,
        1.3314166789178437745e+2,
        1.9715909503065514427e+3,
        1.3731693765509461125e+4,
        4.5921953931549871457e+4,
        6.7265770927008700853e+4,
        3.3430575583588128105e+4,
        2.5090809287301226727e+3,
    ],
    [
        1.0,
        4.2313330701600911252e+1,
        6.8718700749205790830e+2,
        5.3941960214247511077e+3,
        2.1213794301586595867e+4,
        3.9307895800092710610e+4,
        2.8729085735721942674e+4,
        5.2264952788528545610e+3,
    ],
];

/// The same for √(−ln tail) from 1.6 to 5.
#[expect(clippy::excessive_precision, clippy::unreadable_literal, reason = "digits as published")]
const TAIL: [[f64; 8]; 2] = [
    [
        1.42343711074968357734e0,
        4.63033784615654529590e0,
        5.76949722146069140550e0,
        3.64784832476320460504e0,
        1.27045825245236838258e0,
        2.41780725177450611770e-1,
        2.27238449892691845833e-2,
        7.74545014278341407640e-4,
    ],
    [
        1.0,
        2.05319162663775882187e0,
        1.67638483018380384940e0,
        6.89767334985100004550e-1,
        1.48103976427480074590e-1,
        1.51986665636164571966e-2,
        5.47593808499534494600e-4,
        1.05075007164441684324e-9,
    ],
];

/// The same beyond 5.
#[expect(clippy::excessive_precision, clippy::unreadable_literal, reason = "digits as published")]
const FAR_TAIL: [[f64; 8]; 2] = [
    [
        6.65790464350110377720e0,
        5.46378491116411436990e0,
        1.78482653991729133580e0,
        2.96560571828504891230e-1,
        2.65321895265761230930e-2,
        1.24266094738807843860e-3,
        2.71155556874348757815e-5,
        2.01033439929228813265e-7,
    ],
    [
        1.0,
        5.99832206555887937690e-1,
        1.36929880922735805310e-1,
        1.48753612908506148525e-2,
        7.86869131145613259100e-4,
        1.84631831751005468180e-5,
        1.42151175831644588870e-7,
        2.04426310338993978564e-15,
    ],
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_agree_with_published_values() {
        // NIST/SEMATECH e-Handbook 1.3.6.7.1 and R's qnorm.
        for (p, x) in [
            (0.5, 0.0),
            (0.975, 1.959_963_984_540_054),
            (0.001, -3.090_232_306_167_813),
            (1e-9, -5.997_807_015_007_686),
            (1e-100, -21.273_453_560_965_32),
        ] {
            assert!((normal_quantile(p) - x).abs() < 1e-14 * (1.0 + x.abs()), "{p}: {}", normal_quantile(p));
        }
        // The inverse of the distribution function everywhere, most of all where the three pieces meet.
        for i in 1..4000 {
            let p = 0.5 * crate::math::pow(f64::from(i) / 4000.0, 8.0);
            let back = 0.5 * crate::math::erfc(-normal_quantile(p) / std::f64::consts::SQRT_2);
            assert!((back / p - 1.0).abs() < 1e-13, "{p}: {back}");
        }
    }

    #[test]
    fn the_open_interval_has_no_ends() {
        for bits in [0, u64::MAX] {
            let p = open_interval(bits);
            assert!(p > 0.0 && p < 1.0 && normal_quantile(p).abs() < 9.0, "{p}");
            assert!(Normal::default().draw(bits).is_finite());
        }
    }

    #[test]
    fn draws_have_the_moments_of_the_normal_distribution() {
        let normal = Normal::default();
        let key = Key::new(7).with(3);
        let n = 1_000_000_u64;
        let mut power = [0.0_f64; 5];
        let mut beyond = 0_u32;
        for i in 0..n {
            let x = f64::from(normal.draw(key.bits(i)));
            beyond += u32::from(x.abs() > 3.090_232_306);
            for (k, sum) in power.iter_mut().enumerate() {
                *sum += x.powi(k as i32);
            }
        }
        let [_, m1, m2, m3, m4] = power.map(|s| s / n as f64);
        // Five standard errors: 1, √2, √15, √96 over √n.
        let unit = 5.0 / (n as f64).sqrt();
        assert!(m1.abs() < unit, "mean {m1}");
        assert!((m2 - 1.0).abs() < 1.42 * unit, "variance {m2}");
        assert!(m3.abs() < 3.9 * unit, "third moment {m3}");
        assert!((m4 - 3.0).abs() < 9.8 * unit, "fourth moment {m4}");
        assert!((f64::from(beyond) - 2000.0).abs() < 5.0 * 2000_f64.sqrt(), "tails {beyond}");
    }

    #[test]
    fn neighbouring_counters_and_keys_are_uncorrelated() {
        let normal = Normal::default();
        let n = 200_000;
        let product = |a: Key, b: Key, lag: u64| {
            (0..n).map(|i| f64::from(normal.draw(a.bits(i)) * normal.draw(b.bits(i + lag)))).sum::<f64>()
                / n as f64
        };
        let key = Key::new(1);
        let limit = 5.0 / (n as f64).sqrt();
        assert!(product(key, key, 1).abs() < limit);
        assert!(product(key, key, 1124).abs() < limit);
        assert!(product(key.with(0), key.with(1), 0).abs() < limit);
        assert!(product(Key::new(1), Key::new(2), 0).abs() < limit);
    }
}
