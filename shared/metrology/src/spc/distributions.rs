//! Distributions of statistics: F, χ² and the binomial share, through the incomplete beta and gamma functions.
//!
//! Own code for the reason that `uncertainty::student` states: the same bits on every machine.

use crate::uncertainty::student::fraction;
use fringe::math::{exp, lgamma, ln, log1p};

/// P(F > value) for `of` and `over` degrees of freedom (Abramowitz & Stegun 26.6.2).
pub fn f_tail(value: f64, of: f64, over: f64) -> f64 {
    if value <= 0.0 {
        return 1.0;
    }
    incomplete_beta(over / (over + of * value), 0.5 * over, 0.5 * of)
}

/// Quantile of χ² with `dof` > 0 degrees of freedom, 0 < p < 1.
pub fn chi_square_quantile(p: f64, dof: f64) -> f64 {
    let mut high = dof.max(1.0);
    while incomplete_gamma(0.5 * dof, 0.5 * high) < p && high < 1e12 {
        high *= 2.0;
    }
    bisect(0.0, high, |x| incomplete_gamma(0.5 * dof, 0.5 * x) < p)
}

/// Limits of the share of which `found` of `of` are an example, each missed with probability `alpha`/2 (Clopper and Pearson).
pub fn share_interval(found: usize, of: usize, alpha: f64) -> [f64; 2] {
    let (k, n) = (found as f64, of as f64);
    let low =
        if found == 0 { 0.0 } else { bisect(0.0, 1.0, |p| incomplete_beta(p, k, n - k + 1.0) < 0.5 * alpha) };
    let high = if found == of {
        1.0
    } else {
        bisect(0.0, 1.0, |p| 1.0 - incomplete_beta(p, k + 1.0, n - k) > 0.5 * alpha)
    };
    [low, high]
}

/// Where a condition that holds below a place ends.
fn bisect(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    // Halving ends when the ends are neighbours.
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if holds(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Regularised incomplete beta function I_x(a, b) (Abramowitz & Stegun 26.5.8).
fn incomplete_beta(x: f64, a: f64, b: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return if x <= 0.0 { 0.0 } else { 1.0 };
    }
    let front = exp(lgamma(a + b) - lgamma(a) - lgamma(b) + a * ln(x) + b * log1p(-x));
    // The fraction converges fast on the near side of the mean only.
    if x < (a + 1.0) / (a + b + 2.0) {
        front * fraction(x, a, b) / a
    } else {
        1.0 - front * fraction(1.0 - x, b, a) / b
    }
}

/// Regularised incomplete gamma function P(a, x) (Abramowitz & Stegun 6.5.29 and 6.5.31).
fn incomplete_gamma(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let front = exp(a * ln(x) - x - lgamma(a));
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for n in 1..100_000 {
            term *= x / (a + f64::from(n));
            sum += term;
            if term < sum * f64::EPSILON {
                break;
            }
        }
        return front * sum;
    }
    // Continued fraction by Lentz's method.
    let mut b = x + 1.0 - a;
    let mut c = 1e300;
    let mut d = 1.0 / b;
    let mut h = d;
    for n in 1..100_000 {
        let n = f64::from(n);
        let numerator = -n * (n - a);
        b += 2.0;
        d = 1.0 / (numerator * d + b);
        c = b + numerator / c;
        let step = d * c;
        h *= step;
        if (step - 1.0).abs() < 4.0 * f64::EPSILON {
            break;
        }
    }
    1.0 - front * h
}
