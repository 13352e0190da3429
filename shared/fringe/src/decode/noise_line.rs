//! The straight line of noise variance against background, robust against what is no noise.

use crate::math::statistics::median;

/// Bins over the background.
pub(super) const BINS: usize = 16;
/// Variance of the rounding to whole DN.
pub const QUANTISATION_DN2: f64 = 1.0 / 12.0;

/// A residual variance at a background level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub background_dn: f64,
    pub variance_dn2: f64,
    pub freedom: f64,
}

/// A bin of samples by their background.
#[derive(Debug, Clone, Copy, Default)]
pub struct Bin {
    /// Mean background of its samples, DN.
    pub background_dn: f64,
    /// Mean variance of their residuals, DN².
    pub variance_dn2: f64,
    /// Degrees of freedom in all.
    pub freedom: f64,
}

/// Where samples of a variance are cut off, relative to their mean.
struct Cut {
    /// Median of all samples, relative to their mean.
    median: f64,
    /// Samples above this are cut off, relative to their mean.
    limit: f64,
    /// Mean of those below it.
    mean_below: f64,
}

impl Cut {
    /// Of χ²/ν. One degree of freedom comes from neighbouring pixels, where edges and texture make a long tail: the cut is at
    /// 2.5 standard deviations, and the mean below it is 1 − 2c φ(c)/(2Φ(c) − 1). Otherwise the median is (1 − 2/9ν)³ and the cut the
    /// 99.995 % quantile (both after Wilson and Hilferty), so that noise alone loses nothing that matters.
    fn of(freedom: f64) -> Self {
        if freedom < 1.5 {
            return Self { median: 0.454_936, limit: 6.25, mean_below: 0.911_256 };
        }
        let cube = |x: f64| x * x * x;
        let spread = 2.0 / (9.0 * freedom);
        Self { median: cube(1.0 - spread), limit: cube(1.0 - spread + 3.9 * spread.sqrt()), mean_below: 1.0 }
    }
}

/// Mean of the variances of a bin without the samples that no noise makes: edges that moved, glints, wrong light.
///
/// The scale comes from the model or, without one, from the median of the samples; see [`Cut`].
pub fn robust_mean(samples: &[Sample], model: Option<(f64, f64)>, scratch: &mut Vec<f64>) -> Bin {
    scratch.clear();
    scratch.extend(samples.iter().map(|s| s.variance_dn2 / Cut::of(s.freedom).median));
    let Some(median) = median(scratch) else { return Bin::default() };
    let mut bin = Bin::default();
    for s in samples {
        let scale = model.map_or(median, |(read, gain)| read + gain * s.background_dn);
        let cut = Cut::of(s.freedom);
        if s.variance_dn2 <= scale * cut.limit {
            bin.background_dn += s.freedom * s.background_dn;
            bin.variance_dn2 += s.freedom * s.variance_dn2 / cut.mean_below;
            bin.freedom += s.freedom;
        }
    }
    if bin.freedom > 0.0 {
        bin.background_dn /= bin.freedom;
        bin.variance_dn2 /= bin.freedom;
    }
    bin
}

/// Weighted straight line with read² ≥ 1/12 DN² and gain ≥ 0; the weights are ν / 2 σ⁴, first of the data, then of the fit.
pub fn line(bins: &[Bin; BINS]) -> (f64, f64) {
    let mut fitted = (0.0, 0.0);
    for round in 0..3 {
        let (mut w, mut wx, mut wy, mut wxx, mut wxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for bin in bins.iter().filter(|b| b.freedom > 0.0) {
            let model = if round == 0 { bin.variance_dn2 } else { fitted.0 + fitted.1 * bin.background_dn };
            let sigma2 = model.max(QUANTISATION_DN2);
            let weight = bin.freedom / (sigma2 * sigma2);
            w += weight;
            wx += weight * bin.background_dn;
            wy += weight * bin.variance_dn2;
            wxx += weight * bin.background_dn * bin.background_dn;
            wxy += weight * bin.background_dn * bin.variance_dn2;
        }
        let determinant = w * wxx - wx * wx;
        let mut gain = if determinant > 1e-12 * w * wxx { (w * wxy - wx * wy) / determinant } else { 0.0 };
        gain = gain.max(0.0);
        let mut read = (wy - gain * wx) / w.max(f64::MIN_POSITIVE);
        if read < QUANTISATION_DN2 {
            read = QUANTISATION_DN2;
            gain = ((wxy - read * wx) / wxx.max(f64::MIN_POSITIVE)).max(0.0);
        }
        fitted = (read, gain);
    }
    fitted
}
