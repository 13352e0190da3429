//! What many distances have in common.

use serde::Serialize;

/// Percentiles that are reported.
pub const PERCENTS: [f64; 11] = [0.1, 1.0, 2.5, 5.0, 25.0, 50.0, 75.0, 95.0, 97.5, 99.0, 99.9];

/// Bars of the histogram: even, so that zero lies between two.
const BINS: usize = 60;

/// Share of the magnitudes that the histogram's range holds.
const HISTOGRAM_SHARE: f64 = 0.99;

/// Statistics of signed distances.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Statistics {
    /// Number of finite values evaluated.
    pub count: usize,
    /// Arithmetic mean of the signed values, mm.
    pub mean_mm: f64,
    /// Sample standard deviation (n − 1), mm; `None` of a single value.
    pub sd_mm: Option<f64>,
    /// Root of the mean square, mm.
    pub rms_mm: f64,
    /// Mean of the magnitudes, mm.
    pub mean_abs_mm: f64,
    /// The middle value, or the mean of the two middle ones, mm.
    pub median_mm: f64,
    /// Smallest of the signed values, mm.
    pub min_mm: f64,
    /// Largest of the signed values, mm.
    pub max_mm: f64,
    /// See [`PERCENTS`]; linear between the sorted values, the smallest one being 0 %, the largest 100 %.
    pub percentiles: Vec<Percentile>,
    /// How the values spread.
    pub histogram: Histogram,
}

/// A value that a share of all values does not exceed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Percentile {
    /// Share of the values at or below `value_mm`, %.
    pub percent: f64,
    /// Value at this share, mm.
    pub value_mm: f64,
}

/// Counts in bars of equal width, zero in the middle. `counts`, `below` and `above` sum to the number of values.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Histogram {
    /// Lower end of the first bar, mm.
    pub low_mm: f64,
    /// Upper end of the last bar, mm.
    pub high_mm: f64,
    /// Width of a bar, mm.
    pub bin_mm: f64,
    /// Values in each bar.
    pub counts: Vec<u64>,
    /// Values below the first bar.
    pub below: u64,
    /// Values above the last bar.
    pub above: u64,
}

impl Statistics {
    /// Of finite values; `None` without any. Two passes, so that a large mean costs no digits of the deviation.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let (min_mm, max_mm) = (*sorted.first()?, *sorted.last()?);
        let n = values.len() as f64;
        let mean_mm = values.iter().sum::<f64>() / n;
        let about_mean: f64 = values.iter().map(|v| (v - mean_mm) * (v - mean_mm)).sum();
        let percentiles: Vec<Percentile> = PERCENTS
            .map(|percent| Percentile { percent, value_mm: quantile(&sorted, percent / 100.0) })
            .to_vec();
        Some(Self {
            count: values.len(),
            mean_mm,
            sd_mm: (values.len() > 1).then(|| (about_mean / (n - 1.0)).sqrt()),
            rms_mm: (values.iter().map(|v| v * v).sum::<f64>() / n).sqrt(),
            mean_abs_mm: values.iter().map(|v| v.abs()).sum::<f64>() / n,
            median_mm: quantile(&sorted, 0.5),
            min_mm,
            max_mm,
            percentiles,
            histogram: Histogram::of(&sorted),
        })
    }
}

/// Linear interpolation at rank share · (n − 1) of sorted values (Hyndman & Fan 1996, type 7).
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let rank = share * (sorted.len() - 1) as f64;
    let low = (rank as usize).min(sorted.len() - 1);
    let high = (low + 1).min(sorted.len() - 1);
    sorted[low] + (sorted[high] - sorted[low]) * (rank - low as f64)
}

impl Histogram {
    fn of(sorted: &[f64]) -> Self {
        let mut magnitudes: Vec<f64> = sorted.iter().map(|v| v.abs()).collect();
        magnitudes.sort_unstable_by(f64::total_cmp);
        let half = quantile(&magnitudes, HISTOGRAM_SHARE);
        let (mut counts, mut below, mut above) = (vec![0; BINS], 0, 0);
        for value in sorted {
            if *value < -half {
                below += 1;
            } else if *value > half {
                above += 1;
            } else {
                // All values zero: the middle.
                let place = if half > 0.0 { 0.5 + value / (2.0 * half) } else { 0.5 };
                counts[((place * BINS as f64) as usize).min(BINS - 1)] += 1;
            }
        }
        Self { low_mm: -half, high_mm: half, bin_mm: 2.0 * half / BINS as f64, counts, below, above }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_values_by_hand() {
        let s = Statistics::of(&[3.0, -1.0, 2.0, 0.0]).unwrap();
        assert_eq!((s.count, s.mean_mm, s.median_mm, s.min_mm, s.max_mm), (4, 1.0, 1.0, -1.0, 3.0));
        assert!((s.sd_mm.unwrap() - (10.0_f64 / 3.0).sqrt()).abs() < 1e-15);
        assert!((s.rms_mm - 3.5_f64.sqrt()).abs() < 1e-15);
        assert_eq!(s.mean_abs_mm, 1.5);
        // 25 % of the way from rank 0 to rank 3 is three quarters from −1 to 0.
        assert_eq!(s.percentiles[4], Percentile { percent: 25.0, value_mm: -0.25 });
        assert!(Statistics::of(&[]).is_none());
        assert_eq!(Statistics::of(&[0.0]).unwrap().sd_mm, None);
    }

    #[test]
    fn each_value_is_in_one_bar() {
        let values: Vec<f64> = (0..1000).map(|i| f64::from(i) * 0.01 - 4.0).collect();
        let h = Statistics::of(&values).unwrap().histogram;
        assert_eq!(h.counts.iter().sum::<u64>() + h.below + h.above, 1000);
        assert!(h.above > 0 && h.below == 0);
        let zeros = Statistics::of(&[0.0; 5]).unwrap().histogram;
        assert_eq!((zeros.counts.iter().sum::<u64>(), zeros.bin_mm), (5, 0.0));
    }

    #[test]
    fn a_large_mean_does_not_eat_the_scatter() {
        let values: Vec<f64> = (0..1000).map(|i| 1e6 + f64::from(i % 2) * 1e-3).collect();
        assert!((Statistics::of(&values).unwrap().sd_mm.unwrap() - 5.0025e-4).abs() < 1e-8);
    }
}
