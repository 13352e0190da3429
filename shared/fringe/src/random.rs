//! Counter-based random numbers: every draw is a function of its place, so the order of work does not show.

use crate::math::{erfc, exp, ln};

/// Bins of the quantile table; each spans 1/4096 of probability.
const BINS: usize = 4096;

/// Bins at each end that are computed instead of interpolated: there the quantile is too curved.
const TAIL_BINS: usize = 4;

/// A key, made by mixing in whatever tells one stream of draws from another.
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

/// Quantile of the standard normal distribution for 0 < p < 1.
///
/// Start from Abramowitz & Stegun 26.2.23 (4.5e-4), then two steps of Halley's method.
pub fn normal_quantile(p: f64) -> f64 {
    let tail = p.min(1.0 - p);
    let t = (-2.0 * ln(tail)).sqrt();
    let above = 2.515_517 + t * (0.802_853 + t * 0.010_328);
    let below = 1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308));
    let mut x = t - above / below;
    for _ in 0..2 {
        let error = 0.5 * erfc(x / std::f64::consts::SQRT_2) - tail;
        let density = exp(-0.5 * x * x) / std::f64::consts::TAU.sqrt();
        let newton = error / density;
        // f'' / f' of the survival function is −x.
        x += newton / (1.0 - 0.5 * x * newton);
    }
    if p < 0.5 { -x } else { x }
}

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
        ] {
            assert!((normal_quantile(p) - x).abs() < 1e-12, "{p}: {}", normal_quantile(p));
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
