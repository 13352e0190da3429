//! Uncertainty of a range.
//!
//! A range is the difference of two extremes, so its scatter is that of the tails. For an exponential tail of scale β
//! the spacings of the order statistics are independent, x(j) − x(j+1) ~ β/j (Rényi 1953). Hence β from the spacings
//! of the largest |residuals|, and the variance of the j-th largest is β² Σ 1/i², i ≥ j.

/// Share of the points taken as the tail, and the limits of their number.
const TAIL_SHARE: usize = 100;
const TAIL_LEAST: usize = 10;
const TAIL_MOST: usize = 1000;

/// Standard uncertainty of max − min over the points used.
///
/// `deviations` are those of all points, the `rejected` ones of largest size were left out. `effect` is how many
/// points carry the information of one (variance with correlated noise over that of independent noise).
pub(super) fn u_range_mm(deviations: &[f64], rejected: usize, effect: f64) -> f64 {
    let mut sizes: Vec<f64> = deviations.iter().map(|d| d.abs()).collect();
    let kept = sizes.len().saturating_sub(rejected);
    let tail = (kept / TAIL_SHARE).clamp(TAIL_LEAST, TAIL_MOST).min(kept.saturating_sub(1));
    if tail == 0 {
        return 0.0;
    }
    // The largest ones alone are needed in order.
    let last = rejected + tail;
    sizes.select_nth_unstable_by(last, |a, b| b.total_cmp(a));
    sizes[..=last].sort_unstable_by(|a, b| b.total_cmp(a));
    // Normalised spacings between ranks rejected + 1 … rejected + tail + 1: their mean is β.
    let spacings = sizes[rejected..=rejected + tail].windows(2).enumerate();
    let beta = spacings.map(|(i, w)| (w[0] - w[1]) * (rejected + i + 1) as f64).sum::<f64>() / tail as f64;
    // With nothing rejected both extremes scatter on their own; with rejection both sit at the same cut c, and the
    // range is 2 c.
    let variance = if rejected == 0 {
        2.0 * inverse_squares_from(1.0)
    } else {
        4.0 * inverse_squares_from((rejected as f64 / effect.max(1.0) + 1.0).max(1.0))
    };
    beta * variance.sqrt()
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

    /// Stated uncertainty beside the scatter of 300 ranges of Gaussian noise. A Gaussian tail is lighter than the
    /// exponential one at its end, so the statement errs on the safe side, by at most a third.
    #[test]
    fn the_uncertainty_meets_the_scatter_of_ranges() {
        for (count, rejected) in [(2000, 0), (2000, 20), (10_000, 50)] {
            let (mut ranges, mut stated) = (Vec::new(), 0.0);
            for seed in 0..300 {
                let mut noise = Noise(seed);
                let values: Vec<f64> = (0..count).map(|_| noise.normal()).collect();
                let mut kept = values.clone();
                kept.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
                kept.truncate(count - rejected);
                let high = kept.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let low = kept.iter().copied().fold(f64::INFINITY, f64::min);
                ranges.push(high - low);
                stated += u_range_mm(&values, rejected, 1.0).powi(2) / 300.0;
            }
            let mean = ranges.iter().sum::<f64>() / 300.0;
            let scatter = (ranges.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / 299.0).sqrt();
            let ratio = scatter / stated.sqrt();
            assert!((0.75..1.12).contains(&ratio), "{count} points, {rejected} rejected: {ratio}");
        }
    }
}
