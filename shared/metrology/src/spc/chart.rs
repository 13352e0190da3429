//! Control charts: X̄ and s for subgroups, single values and moving ranges without (ISO 7870-2).

use super::mean;
use super::sample_sd;
use fringe::math::{exp, lgamma};
use serde::Serialize;
use std::f64::consts::FRAC_2_SQRT_PI;

/// Which pair of charts is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChartKind {
    /// Mean and standard deviation of subgroups.
    MeanAndDeviation,
    /// Single values and the range of two that follow each other.
    Individuals,
}

/// Centre and control limits of one chart, in the unit of the characteristic.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ControlLimits {
    /// Lower control limit of the chart.
    pub lower: f64,
    /// Centre line of the chart.
    pub centre: f64,
    /// Upper control limit of the chart.
    pub upper: f64,
}

/// One point of both charts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ChartPoint {
    /// Index of the first value of the subgroup in the series, from 0.
    pub first: usize,
    /// Mean of the subgroup, or the value.
    pub location: f64,
    /// Standard deviation of the subgroup, or the moving range; absent for the first single value.
    pub spread: Option<f64>,
}

/// Why a point does not look like chance (rules 1 to 4 of L. S. Nelson, 1984).
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Signal {
    /// Index of the point in the chart, from 0.
    pub point: usize,
    /// What was seen there.
    pub reason: String,
}

/// Both charts of a series.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chart {
    /// Which pair of charts.
    pub kind: ChartKind,
    /// Values of a subgroup; 1 for single values.
    pub subgroup: usize,
    /// Standard deviation within subgroups, free of bias for normal values.
    pub sigma_within: f64,
    /// Degrees of freedom of `sigma_within`.
    pub dof_within: f64,
    /// Limits of the means or single values.
    pub location: ControlLimits,
    /// Limits of the standard deviations or moving ranges.
    pub spread: ControlLimits,
    /// All points in their order.
    pub points: Vec<ChartPoint>,
    /// Points that do not look like chance.
    pub signals: Vec<Signal>,
}

/// Mean of the range of two normal values over their standard deviation, 2/√π.
const D2_OF_TWO: f64 = FRAC_2_SQRT_PI;

/// Standard deviation of that ratio, √(2 − 4/π).
const D3_OF_TWO: f64 = 0.852_502_465_041_252;

/// Expected sample standard deviation of n normal values over their true one.
pub(super) fn c4(n: usize) -> f64 {
    let n = n as f64;
    (2.0 / (n - 1.0)).sqrt() * exp(lgamma(0.5 * n) - lgamma(0.5 * (n - 1.0)))
}

/// Charts of a series in subgroups of a size; a last subgroup that is not full is left out. `None` below two subgroups.
pub fn chart(values: &[f64], subgroup: usize) -> Option<Chart> {
    let mut chart = if subgroup > 1 { subgroups(values, subgroup)? } else { individuals(values)? };
    chart.signals = signals(&chart);
    Some(chart)
}

fn subgroups(values: &[f64], size: usize) -> Option<Chart> {
    let groups = values.chunks_exact(size);
    let points: Vec<ChartPoint> = groups
        .enumerate()
        .map(|(i, group)| {
            let location = mean(group).unwrap_or(f64::NAN);
            ChartPoint { first: i * size, location, spread: sample_sd(group) }
        })
        .collect();
    if points.len() < 2 {
        return None;
    }
    let centre = mean(&points.iter().map(|p| p.location).collect::<Vec<_>>())?;
    let s = mean(&points.iter().filter_map(|p| p.spread).collect::<Vec<_>>())?;
    let c4 = c4(size);
    let (sigma, three) = (s / c4, 3.0 / (size as f64).sqrt());
    let width = 3.0 * (1.0 - c4 * c4).sqrt() / c4;
    let variance = 1.0 - c4 * c4;
    Some(Chart {
        kind: ChartKind::MeanAndDeviation,
        subgroup: size,
        sigma_within: sigma,
        // As many as give the mean of k standard deviations its relative scatter √((1 − c4²)/k)/c4.
        dof_within: points.len() as f64 * c4 * c4 / (2.0 * variance),
        location: ControlLimits { lower: centre - three * sigma, centre, upper: centre + three * sigma },
        spread: ControlLimits { lower: (s * (1.0 - width)).max(0.0), centre: s, upper: s * (1.0 + width) },
        points,
        signals: Vec::new(),
    })
}

fn individuals(values: &[f64]) -> Option<Chart> {
    let centre = mean(values).filter(|_| values.len() > 1)?;
    let moving: Vec<f64> = values.windows(2).map(|two| (two[1] - two[0]).abs()).collect();
    let range = mean(&moving)?;
    let sigma = range / D2_OF_TWO;
    let point = |(i, &value): (usize, &f64)| ChartPoint {
        first: i,
        location: value,
        spread: (i > 0).then(|| moving[i - 1]),
    };
    Some(Chart {
        kind: ChartKind::Individuals,
        subgroup: 1,
        sigma_within: sigma,
        // Neighbouring ranges share a value: 0.605 (n − 1) + 0.1 nearly (D. J. Wheeler, Advanced Topics in SPC, 1995).
        dof_within: 0.605 * moving.len() as f64 + 0.1,
        location: ControlLimits { lower: centre - 3.0 * sigma, centre, upper: centre + 3.0 * sigma },
        spread: ControlLimits {
            lower: 0.0,
            centre: range,
            upper: range * (1.0 + 3.0 * D3_OF_TWO / D2_OF_TWO),
        },
        points: values.iter().enumerate().map(point).collect(),
        signals: Vec::new(),
    })
}

/// Points outside of the limits, nine on one side, six that rise or fall, fourteen that alternate.
fn signals(chart: &Chart) -> Vec<Signal> {
    let location: Vec<f64> = chart.points.iter().map(|point| point.location).collect();
    let limits = &chart.location;
    let mut signals = Vec::new();
    let mut add = |point: usize, reason: String| signals.push(Signal { point, reason });
    for (i, point) in chart.points.iter().enumerate() {
        if point.location < limits.lower || point.location > limits.upper {
            add(i, "outside of the control limits".into());
        }
        if point.spread.is_some_and(|s| s < chart.spread.lower || s > chart.spread.upper) {
            let what = if chart.subgroup > 1 { "standard deviation" } else { "moving range" };
            add(i, format!("{what} outside of its control limits"));
        }
    }
    let side: Vec<i8> = location.iter().map(|v| sign(v - limits.centre)).collect();
    runs(&side, 9, 1, |i| add(i, "nine points on one side of the centre line".into()));
    let steps: Vec<i8> = location.windows(2).map(|two| sign(two[1] - two[0])).collect();
    runs(&steps, 5, 1, |i| add(i + 1, "six points that rise or fall".into()));
    runs(&steps, 13, -1, |i| add(i + 1, "fourteen points that alternate".into()));
    signals.sort_by_key(|signal| signal.point);
    signals
}

fn sign(value: f64) -> i8 {
    if value > 0.0 { 1 } else { -i8::from(value != 0.0) }
}

/// Reports the end of each run in which a sign is `factor` times the one before, once its length is reached.
fn runs(signs: &[i8], length: usize, factor: i8, mut found: impl FnMut(usize)) {
    let mut run = 0;
    for (i, &sign) in signs.iter().enumerate() {
        let goes_on = i > 0 && sign != 0 && sign == factor * signs[i - 1];
        run = if goes_on { run + 1 } else { usize::from(sign != 0) };
        if run == length {
            found(i);
        }
    }
}
