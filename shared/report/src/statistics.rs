//! The few statistics of the report, each by the definition that its footnote prints.

/// Median: the middle value, or the mean of the two middle ones; `None` without values.
pub fn median_ns(samples: &[u64]) -> Option<u64> {
    let sorted = sorted(samples);
    let upper = *sorted.get(sorted.len() / 2)?;
    if sorted.len() % 2 == 1 {
        return Some(upper);
    }
    let lower = sorted[sorted.len() / 2 - 1];
    Some(lower + (upper - lower) / 2)
}

/// 99th percentile by nearest rank: the smallest sample that at least 99 % of the samples do not exceed.
///
/// Below 100 samples it is the largest one.
pub fn percentile_99_ns(samples: &[u64]) -> Option<u64> {
    let sorted = sorted(samples);
    let rank = (sorted.len() * 99).div_ceil(100);
    sorted.get(rank.checked_sub(1)?).copied()
}

fn sorted(samples: &[u64]) -> Vec<u64> {
    let mut sorted = samples.to_vec();
    sorted.sort_unstable();
    sorted
}

/// What a set of deviations has in common.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Summary {
    /// Number of finite values.
    pub count: usize,
    /// Values that are NaN or infinite; they enter nothing else.
    pub not_finite: usize,
    /// Arithmetic mean; `None` without values.
    pub mean: Option<f64>,
    /// Sample standard deviation (n − 1); `None` below two values.
    pub sd: Option<f64>,
    /// 95th percentile of the magnitudes by nearest rank.
    pub magnitude_95: Option<f64>,
    /// 99th percentile of the magnitudes by nearest rank.
    pub magnitude_99: Option<f64>,
    /// Smallest value; `None` without values.
    pub min: Option<f64>,
    /// Largest value; `None` without values.
    pub max: Option<f64>,
}

/// Sums values in their order (two passes, so that a large mean costs no digits of the deviation).
pub fn summary(values: impl Iterator<Item = f64>) -> Summary {
    let all: Vec<f64> = values.collect();
    let finite: Vec<f64> = all.iter().copied().filter(|v| v.is_finite()).collect();
    let n = finite.len();
    let mean = (n > 0).then(|| finite.iter().sum::<f64>() / n as f64);
    let sd = mean.filter(|_| n > 1).map(|mean| {
        let squares: f64 = finite.iter().map(|v| (v - mean) * (v - mean)).sum();
        (squares / (n - 1) as f64).sqrt()
    });
    let mut magnitudes: Vec<f64> = finite.iter().map(|v| v.abs()).collect();
    magnitudes.sort_unstable_by(f64::total_cmp);
    Summary {
        count: n,
        not_finite: all.len() - n,
        mean,
        sd,
        magnitude_95: percentile(&magnitudes, 95),
        magnitude_99: percentile(&magnitudes, 99),
        min: finite.iter().copied().min_by(f64::total_cmp),
        max: finite.iter().copied().max_by(f64::total_cmp),
    }
}

/// Nearest-rank percentile of sorted values.
fn percentile(sorted: &[f64], percent: usize) -> Option<f64> {
    let rank = (sorted.len() * percent).div_ceil(100);
    sorted.get(rank.checked_sub(1)?).copied()
}

/// The range of the finite values without the outermost thousandth at each side; `None` without finite values.
///
/// Single wrong fringe orders would otherwise take the whole colour bar for themselves.
pub fn inner_range(values: impl Iterator<Item = f32>) -> Option<(f64, f64)> {
    let mut finite: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    let cut = finite.len() / 1000;
    let last = finite.len().checked_sub(1 + cut)?;
    let low = *finite.select_nth_unstable_by(cut, f32::total_cmp).1;
    let high = *finite.select_nth_unstable_by(last, f32::total_cmp).1;
    Some((f64::from(low), f64::from(high)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_statistics_of_few_samples() {
        assert_eq!((median_ns(&[]), percentile_99_ns(&[])), (None, None));
        assert_eq!((median_ns(&[7]), percentile_99_ns(&[7])), (Some(7), Some(7)));
        assert_eq!(median_ns(&[9, 1, 4, 2]), Some(3));
        assert_eq!(median_ns(&[u64::MAX, u64::MAX - 2]), Some(u64::MAX - 1));
        let hundred: Vec<u64> = (1..=100).rev().collect();
        assert_eq!(percentile_99_ns(&hundred), Some(99));
        assert_eq!(percentile_99_ns(&hundred[..50]), Some(100));
    }

    #[test]
    fn a_summary_knows_what_it_cannot_tell() {
        assert_eq!(summary([].into_iter()), Summary::default());
        let one = summary([0.5, f64::NAN].into_iter());
        assert_eq!((one.count, one.not_finite, one.mean, one.sd), (1, 1, Some(0.5), None));
        let four = summary([1.0, 2.0, 3.0, 4.0].into_iter());
        assert!((four.sd.unwrap() - (5.0_f64 / 3.0).sqrt()).abs() < 1e-15);
        assert_eq!((four.min, four.max, four.magnitude_95), (Some(1.0), Some(4.0), Some(4.0)));
    }

    #[test]
    fn a_single_outlier_does_not_widen_the_inner_range() {
        let values = (0..5000).map(|i| if i == 77 { 1e9 } else { (i % 100) as f32 });
        assert_eq!(inner_range(values), Some((0.0, 99.0)));
        assert_eq!(inner_range([f32::NAN].into_iter()), None);
        assert_eq!(inner_range([3.0].into_iter()), Some((3.0, 3.0)));
    }
}
