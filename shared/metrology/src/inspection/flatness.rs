//! Uncertainty of a range.
//!
//! A range is the difference of two extremes, so its scatter is that of the tails. Where xᵖ has an exponential tail of scale
//! β, the spacings of its order statistics are independent, y(j) − y(j+1) ~ β/j (Rényi 1953). Hence β from the spacings
//! of the largest |residuals|, and the variance of the j-th largest is β² Σ 1/i², i ≥ j, over the square of p xᵖ⁻¹. With
//! p = 2 that is the tail of Gaussian noise, with p = 1 a heavier one; the residuals themselves say by their likelihood
//! which of the two they have.
//!
//! A few points may be none of that noise: those of a crease, of a rim. The largest then lies beyond what the tail lets expect, and differs from cloud to cloud by
//! about as much.

use crate::fit::{PlaneFit, Residuals};
use fringe::math;
use std::f64::consts::FRAC_1_SQRT_2;

/// The largest is no noise's where it lies beyond what the tail lets expect by so many standard deviations of a largest one.
const STRANGE: f64 = 2.5;

/// Share of the points taken as the tail, and the limits of their number.
const TAIL_SHARE: usize = 50;
const TAIL_LEAST: usize = 20;
const TAIL_MOST: usize = 40;

/// Share of the points by which the tail's kind is told, and the most of them.
const KIND_SHARE: usize = 10;
const KIND_MOST: usize = 10_000;

/// Standard uncertainties of what the points used of a fit span.
pub(super) struct OfUsed {
    /// Of max − min, mm.
    pub range_mm: f64,
    /// Of one extreme, mm.
    pub extreme_mm: f64,
    /// Points left out: none of the extremes is then the noise's own.
    pub rejected: usize,
}

impl OfUsed {
    /// From the residuals of all points. `effect` is how many points carry the information of one (variance with correlated noise over that
    /// of independent noise).
    pub fn new(residuals: &Residuals, effect: f64) -> Self {
        let rejected = residuals.used.iter().filter(|used| !**used).count();
        let range_mm = u_range_mm(&residuals.deviation_mm, rejected, effect);
        // Each extreme scatters by itself, or both sit at the same cut.
        let of_one = if rejected == 0 { FRAC_1_SQRT_2 } else { 0.5 };
        Self { range_mm, extreme_mm: of_one * range_mm, rejected }
    }
}

/// How many points of a plane carry the information of one: how much correlation widens its place against that of independent points.
pub(super) fn effect_of(fit: &PlaneFit) -> f64 {
    let independent = fit.form.form_sigma_mm * fit.form.form_sigma_mm / fit.form.points.max(1) as f64;
    if independent > 0.0 { fit.u_centroid_mm * fit.u_centroid_mm / independent } else { 1.0 }
}

/// Standard uncertainty of max − min over the points used.
///
/// `deviations` are those of all points, the `rejected` ones of largest size were left out; `effect` as in [`OfUsed::new`].
pub(super) fn u_range_mm(deviations: &[f64], rejected: usize, effect: f64) -> f64 {
    u_range(deviations, rejected, effect, false)
}

/// The same of means over unequal numbers of points: the fewest scatter most, so that their tail is always the heavier one.
pub(super) fn u_range_of_means_mm(means: &[f64]) -> f64 {
    u_range(means, 0, 1.0, true)
}

fn u_range(deviations: &[f64], rejected: usize, effect: f64, heavy_tail: bool) -> f64 {
    let mut sizes: Vec<f64> = deviations.iter().map(|d| d.abs()).collect();
    let kept = sizes.len().saturating_sub(rejected);
    let tail = (kept / TAIL_SHARE).clamp(TAIL_LEAST, TAIL_MOST).min(kept.saturating_sub(1));
    if tail == 0 {
        return 0.0;
    }
    // How heavy the tail of means is, is known.
    let wide = if heavy_tail { tail } else { (kept / KIND_SHARE).min(KIND_MOST).max(tail) };
    // The largest ones alone are needed in order.
    let last = rejected + wide;
    sizes.select_nth_unstable_by(last, |a, b| b.total_cmp(a));
    sizes[..=last].sort_unstable_by(|a, b| b.total_cmp(a));
    let largest = &sizes[rejected..=last];
    let likelihood = |squared: bool| Tail::new(squared, largest, rejected).likelihood(largest);
    let squared = !heavy_tail && likelihood(true) >= likelihood(false);
    let found = Tail::new(squared, &largest[..=tail], rejected);
    // With nothing rejected both extremes scatter on their own; with rejection both sit at the same cut c, and the
    // range is 2 c.
    let variance = if rejected == 0 {
        2.0 * inverse_squares_from(1.0)
    } else {
        4.0 * inverse_squares_from((rejected as f64 / effect.max(1.0) + 1.0).max(1.0))
    };
    let of_noise = found.scale_at(largest[0]) * variance.sqrt();
    // What was cut off ends the range: nothing is beyond it.
    if rejected == 0 { math::hypot(of_noise, found.beyond(&largest[..=tail])) } else { of_noise }
}

/// An exponential tail of the residuals or of their squares.
struct Tail {
    squared: bool,
    /// Mean of the normalised spacings.
    mean: f64,
    /// Number of the spacings.
    count: f64,
}

impl Tail {
    /// From the largest residuals in falling order, with the number of larger ones that were left out.
    fn new(squared: bool, largest: &[f64], rejected: usize) -> Self {
        let count = (largest.len() - 1) as f64;
        let raised = |x: f64| if squared { x * x } else { x };
        let spacings = largest.windows(2).enumerate();
        let sum: f64 = spacings.map(|(i, w)| (raised(w[0]) - raised(w[1])) * (rejected + i + 1) as f64).sum();
        Self { squared, mean: sum / count, count }
    }

    /// Logarithm of the likelihood of the residuals that it was made of, up to what is the same for both tails.
    fn likelihood(&self, largest: &[f64]) -> f64 {
        let above = &largest[..largest.len() - 1];
        let stretch: f64 = if self.squared { above.iter().map(|x| math::ln(2.0 * x)).sum() } else { 0.0 };
        stretch - self.count * math::ln(self.mean)
    }

    /// Scale of the tail; its square is unbiased: the mean of n exponentials has the square (n + 1)/n of its own.
    fn scale(&self) -> f64 {
        self.mean * (self.count / (self.count + 1.0)).sqrt()
    }

    /// How far the largest residual lies beyond what this tail of all of them lets expect; 0 where chance explains it.
    fn beyond(&self, largest: &[f64]) -> f64 {
        let raised = |x: f64| if self.squared { x * x } else { x };
        let lowest = raised(largest[largest.len() - 1]);
        let expected = lowest + self.mean * (1..largest.len()).map(|i| 1.0 / i as f64).sum::<f64>();
        let chance = STRANGE * self.mean * inverse_squares_from(1.0).sqrt();
        if raised(largest[0]) <= expected + chance {
            return 0.0;
        }
        largest[0] - if self.squared { expected.sqrt() } else { expected }
    }

    /// Scale of the residuals themselves at one of them.
    fn scale_at(&self, residual: f64) -> f64 {
        match self.squared {
            false => self.scale(),
            true if residual > 0.0 => self.scale() / (2.0 * residual),
            true => 0.0,
        }
    }
}

/// Σ 1/i² over i = start, start + 1, …: ten terms, then Euler–Maclaurin.
fn inverse_squares_from(start: f64) -> f64 {
    let direct: f64 = (0..10).map(|i| start + f64::from(i)).map(|x| 1.0 / (x * x)).sum();
    let x = start + 10.0;
    direct + 1.0 / x + 1.0 / (2.0 * x * x) + 1.0 / (6.0 * x * x * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::tests::Noise;

    #[test]
    fn the_series_ends_where_euler_found_it() {
        assert!((inverse_squares_from(1.0) - std::f64::consts::PI.powi(2) / 6.0).abs() < 1e-6);
        let brute: f64 = (7..2_000_000).map(|i| 1.0 / (f64::from(i) * f64::from(i))).sum();
        assert!((inverse_squares_from(7.0) - brute).abs() < 1e-6);
    }

    /// Noise whose size is exponential, on both sides.
    fn laplace(noise: &mut Noise) -> f64 {
        let size = -math::ln(1.0 - noise.uniform());
        if noise.uniform() < 0.5 { -size } else { size }
    }

    /// Stated uncertainty beside the scatter of 1000 ranges, known to 3 %, of light and of heavy tails.
    #[test]
    fn the_uncertainty_meets_the_scatter_of_ranges() {
        type Draw = fn(&mut Noise) -> f64;
        let trials: u64 = 1000;
        let kinds: [(&str, Draw); 2] = [("gaussian", Noise::normal), ("laplace", laplace)];
        for ((name, draw), (count, rejected)) in kinds
            .into_iter()
            .flat_map(|kind| [(300, 0), (2000, 0), (2000, 20), (10_000, 50)].map(|c| (kind, c)))
        {
            let (mut ranges, mut stated) = (Vec::new(), 0.0);
            for seed in 0..trials {
                let mut noise = Noise(seed);
                let values: Vec<f64> = (0..count).map(|_| draw(&mut noise)).collect();
                let mut kept = values.clone();
                kept.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
                kept.truncate(count - rejected);
                let high = kept.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let low = kept.iter().copied().fold(f64::INFINITY, f64::min);
                ranges.push(high - low);
                stated += u_range_mm(&values, rejected, 1.0).powi(2) / trials as f64;
            }
            let mean = ranges.iter().sum::<f64>() / trials as f64;
            let squares: f64 = ranges.iter().map(|r| (r - mean).powi(2)).sum();
            let ratio = (squares / (trials - 1) as f64).sqrt() / stated.sqrt();
            assert!((0.85..1.12).contains(&ratio), "{name}, {count} points, {rejected} rejected: {ratio}");
        }
    }

    /// Few points with more noise make the ends of a range, and hardly change its tail.
    #[test]
    fn ends_that_are_not_of_the_noise_are_uncertain_by_what_they_stick_out() {
        for (few, noisier) in [(3, 3.0), (10, 3.0), (3, 6.0), (10, 6.0)] {
            let (mut ranges, mut stated, mut without) = (Vec::new(), 0.0, 0.0);
            let trials: u64 = 400;
            for seed in 0..trials {
                let mut noise = Noise(seed);
                let mut values: Vec<f64> = (0..5000).map(|_| noise.normal()).collect();
                without += u_range_mm(&values, 0, 1.0).powi(2) / trials as f64;
                values.iter_mut().take(few).for_each(|value| *value *= noisier);
                let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let low = values.iter().copied().fold(f64::INFINITY, f64::min);
                ranges.push(high - low);
                stated += u_range_mm(&values, 0, 1.0).powi(2) / trials as f64;
            }
            let mean = ranges.iter().sum::<f64>() / trials as f64;
            let squares: f64 = ranges.iter().map(|r| (r - mean).powi(2)).sum();
            let scatter = (squares / (trials - 1) as f64).sqrt();
            let (ratio, before) = (scatter / stated.sqrt(), scatter / without.sqrt());
            assert!((0.5..1.4).contains(&ratio), "{few} points, {noisier} times: {ratio}, {before}");
        }
    }
}
