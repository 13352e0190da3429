//! Capability (within subgroups) and performance (all values) of a process against its limits.

use super::chart::Chart;
use super::distributions::{chi_square_quantile, share_interval};
use super::{mean, sample_sd};
use fringe::math::random::normal_quantile;
use serde::Serialize;

/// Limits of a characteristic in its unit; at least one is present.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Limits {
    /// Smallest value that conforms.
    pub lower: Option<f64>,
    /// Largest value that conforms.
    pub upper: Option<f64>,
}

/// A value with its confidence interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// Point estimate of the value.
    pub value: f64,
    /// Lower limit of the interval.
    pub low: f64,
    /// Upper limit of the interval.
    pub high: f64,
}

/// Values that do not conform.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OutOfLimits {
    /// Values below the lower limit.
    pub below: usize,
    /// Values above the upper limit.
    pub above: usize,
    /// Share of all values, with its interval (Clopper and Pearson); no distribution is assumed.
    pub share: Interval,
}

/// Indices of a process, ISO 22514-2 with spread 6σ.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Capability {
    /// Number of values used.
    pub count: usize,
    /// Mean of all values.
    pub mean: f64,
    /// Sample standard deviation of all values.
    pub sd: f64,
    /// Probability that each interval holds the true value.
    pub confidence: f64,
    /// Tolerance over 6 σ within subgroups; absent with one limit.
    pub cp: Option<Interval>,
    /// Distance of the mean from the nearer limit over 3 σ within subgroups.
    pub cpk: Option<Interval>,
    /// Tolerance over 6 standard deviations of all values; absent with one limit.
    pub pp: Option<Interval>,
    /// Distance of the mean from the nearer limit over 3 standard deviations of all values.
    pub ppk: Option<Interval>,
    /// What was seen outside of the limits.
    pub outside: OutOfLimits,
}

/// Indices of a series; `None` below two values or without a limit. Indices are absent when nothing scatters.
/// `confidence` lies between 0 and 1.
pub fn capability(
    values: &[f64],
    chart: Option<&Chart>,
    limits: Limits,
    confidence: f64,
) -> Option<Capability> {
    let (mean, sd) = (mean(values)?, sample_sd(values)?);
    if limits.lower.is_none() && limits.upper.is_none() {
        return None;
    }
    let alpha = 1.0 - confidence;
    let index = |sigma: f64, dof: f64| {
        let spread = spread(limits, sigma).map(|value| spread_interval(value, dof, alpha));
        let near = near(limits, mean, sigma).map(|value| near_interval(value, values.len(), dof, alpha));
        (spread, near)
    };
    let (pp, ppk) = index(sd, (values.len() - 1) as f64);
    let (cp, cpk) = chart.map_or((None, None), |chart| index(chart.sigma_within, chart.dof_within));
    let outside = outside(values, limits, alpha);
    Some(Capability { count: values.len(), mean, sd, confidence, cp, cpk, pp, ppk, outside })
}

/// Width of the tolerance over six σ.
fn spread(limits: Limits, sigma: f64) -> Option<f64> {
    Some((limits.upper? - limits.lower?) / (6.0 * sigma)).filter(|value| value.is_finite())
}

/// Distance of the nearer limit from the mean over three σ.
fn near(limits: Limits, mean: f64, sigma: f64) -> Option<f64> {
    let above = limits.upper.map(|upper| (upper - mean) / (3.0 * sigma));
    let below = limits.lower.map(|lower| (mean - lower) / (3.0 * sigma));
    let near = above.unwrap_or(f64::INFINITY).min(below.unwrap_or(f64::INFINITY));
    Some(near).filter(|value| value.is_finite())
}

/// The index goes with 1/σ, and σ² with χ².
fn spread_interval(value: f64, dof: f64, alpha: f64) -> Interval {
    let factor = |p: f64| (chi_square_quantile(p, dof) / dof).sqrt();
    Interval { value, low: value * factor(0.5 * alpha), high: value * factor(1.0 - 0.5 * alpha) }
}

/// Normal approximation with the scatter of mean and σ (A. F. Bissell, Applied Statistics 39, 331, 1990).
fn near_interval(value: f64, count: usize, dof: f64, alpha: f64) -> Interval {
    let variance = 1.0 / (9.0 * count as f64) + value * value / (2.0 * dof);
    let reach = normal_quantile(1.0 - 0.5 * alpha) * variance.sqrt();
    Interval { value, low: value - reach, high: value + reach }
}

fn outside(values: &[f64], limits: Limits, alpha: f64) -> OutOfLimits {
    let below = values.iter().filter(|v| limits.lower.is_some_and(|limit| **v < limit)).count();
    let above = values.iter().filter(|v| limits.upper.is_some_and(|limit| **v > limit)).count();
    let [low, high] = share_interval(below + above, values.len(), alpha);
    let value = (below + above) as f64 / values.len() as f64;
    OutOfLimits { below, above, share: Interval { value, low, high } }
}
