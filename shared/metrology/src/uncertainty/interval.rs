//! Coverage intervals from sorted values of the measurand (Supplement 1, 7.7).

use serde::{Deserialize, Serialize};

/// The two intervals of the Supplement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IntervalKind {
    /// As much probability below as above.
    #[default]
    ProbabilisticallySymmetric,
    /// The shortest of all that hold the probability.
    Shortest,
}

/// Ends of a coverage interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// Lower end y_low of the interval.
    pub low: f64,
    /// Upper end y_high of the interval.
    pub high: f64,
}

impl IntervalKind {
    /// The interval of ascending values; `None` without values.
    pub fn of(self, sorted: &[f64], probability: f64) -> Option<Interval> {
        match self {
            Self::ProbabilisticallySymmetric => probabilistically_symmetric(sorted, probability),
            Self::Shortest => shortest(sorted, probability),
        }
    }
}

/// q = pM, rounded to a whole number, below M so that an interval of q + 1 values exists.
fn span(count: usize, probability: f64) -> usize {
    ((probability * count as f64 + 0.5).floor() as usize).min(count.saturating_sub(1))
}

/// [y_(r), y_(r+q)] with r in the middle (7.7.2).
pub fn probabilistically_symmetric(sorted: &[f64], probability: f64) -> Option<Interval> {
    let q = span(sorted.len(), probability);
    // The Supplement counts from 1: r = (M − q)/2, or (M − q + 1)/2 where that is not whole.
    let r = (sorted.len() - q).div_ceil(2).max(1) - 1;
    Some(Interval { low: *sorted.get(r)?, high: *sorted.get(r + q)? })
}

/// [y_(r), y_(r+q)] with r such that it is shortest, the lowest of equals (7.7.4).
pub fn shortest(sorted: &[f64], probability: f64) -> Option<Interval> {
    let q = span(sorted.len(), probability);
    let ends = sorted.iter().zip(sorted.get(q..)?);
    let (low, high) = ends.min_by(|(a, b), (c, d)| (*b - *a).total_cmp(&(*d - *c)))?;
    Some(Interval { low: *low, high: *high })
}
