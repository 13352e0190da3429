//! Whether a series may come from one normal distribution.

use super::{mean, sample_sd};
use fringe::math::{erfc, exp, ln};
use serde::Serialize;
use std::f64::consts::SQRT_2;

/// Fewest values that the test says anything about.
const FEWEST: usize = 8;

/// Result of the test of Anderson and Darling with mean and standard deviation estimated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Normality {
    /// A²: weighted distance of the empirical distribution from the normal one.
    pub a_squared: f64,
    /// Probability of a greater A² where the distribution is normal.
    pub p: f64,
}

/// Tests a series; `None` below eight values or when all are equal. P from A²(1 + 0.75/n + 2.25/n²) (R. B. D'Agostino and
/// M. A. Stephens, Goodness-of-Fit Techniques, 1986, table 4.9).
pub fn normality(values: &[f64]) -> Option<Normality> {
    let n = values.len();
    let (mean, sd) = (mean(values)?, sample_sd(values).filter(|sd| *sd > 0.0 && n >= FEWEST)?);
    let mut sorted: Vec<f64> = values.iter().map(|v| (v - mean) / sd).collect();
    sorted.sort_by(f64::total_cmp);
    // Logarithm of the probability below z; both tails keep their digits.
    let below = |z: f64| ln((0.5 * erfc(-z / SQRT_2)).max(f64::MIN_POSITIVE));
    let terms = (0..n).map(|i| (2 * i + 1) as f64 * (below(sorted[i]) + below(-sorted[n - 1 - i])));
    let count = n as f64;
    let a_squared = -count - terms.sum::<f64>() / count;
    let a = a_squared * (1.0 + 0.75 / count + 2.25 / (count * count));
    let p = if a < 0.2 {
        1.0 - exp(-13.436 + 101.14 * a - 223.73 * a * a)
    } else if a < 0.34 {
        1.0 - exp(-8.318 + 42.796 * a - 59.938 * a * a)
    } else if a < 0.6 {
        exp(0.9177 - 4.279 * a - 1.38 * a * a)
    } else {
        exp(1.2937 - 5.709 * a + 0.0186 * a * a)
    };
    // The last formula turns upwards far outside of its range.
    Some(Normality { a_squared, p: if a > 13.0 { 0.0 } else { p.clamp(0.0, 1.0) } })
}
