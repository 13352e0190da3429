//! Statistics over parts: control charts, capability of a process and of a gauge.
//!
//! A series is what one characteristic measured on part after part, in the order of production. Capability: ISO 22514-2
//! (time-dependent model A1 by its normal form; other distributions by their quantiles), control charts: ISO 7870-2, gauges:
//! AIAG MSA 4th edition. Each index carries its confidence interval, because few parts prove little.

mod capability;
mod chart;
mod distributions;
mod gauge;
mod normality;
mod study;
#[cfg(test)]
mod tests;

pub use capability::{Capability, Interval, Limits, OutOfLimits, capability};
pub use chart::{Chart, ChartKind, ChartPoint, ControlLimits, Signal, chart};
pub use gauge::{AnovaLine, GaugeError, Reading, TypeOne, TypeTwo, type_one, type_two};
pub use normality::{Normality, normality};
pub use study::{Series, Study, StudySettings, study};

/// Arithmetic mean; `None` without values.
fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Sample standard deviation (n − 1), in two passes; `None` below two values.
fn sample_sd(values: &[f64]) -> Option<f64> {
    let mean = mean(values).filter(|_| values.len() > 1)?;
    let squares: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    Some((squares / (values.len() - 1) as f64).sqrt())
}
