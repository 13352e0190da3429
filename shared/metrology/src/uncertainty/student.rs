//! Student's t distribution: coverage factors at any ν > 0, whole or not.
//!
//! Own code: available statistics libraries call the system's logarithm and exponential (bits differ between machines)
//! and its inverse incomplete beta function does not end for some arguments (statrs issue 435).

use fringe::math::random::normal_quantile;
use fringe::math::{erfc, exp, lgamma, ln, log1p};
use std::f64::consts::{PI, SQRT_2};

/// From here on the expansion in 1/ν is exact to rounding, while the gamma functions begin to lose digits.
const LARGE_DOF: f64 = 1000.0;

/// From here on the continued fraction takes too long, while two terms of the expansion are exact to 1e-13.
const VAST_DOF: f64 = 1e6;

/// Coverage factor k = t_p(ν): the interval ± k·u holds the probability p (GUM G.3). Infinite ν gives the normal
/// distribution's. `0 < p < 1`, `dof` at least 0.1.
pub fn coverage_factor(probability: f64, dof: f64) -> f64 {
    let z = normal_quantile(0.5 * (1.0 + probability));
    if dof.is_infinite() {
        return z;
    }
    if dof >= LARGE_DOF {
        return expansion(z, dof);
    }
    let outside = |k: f64| tail(k, dof);
    let wanted = 1.0 - probability;
    let mut high = 1.0;
    while outside(high) > wanted && high < 1e150 {
        high *= 2.0;
    }
    let mut low = 0.0;
    // Halving ends when the ends are neighbours: at most some 60 steps for numbers of one magnitude.
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if outside(middle) > wanted { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Probability that ± k·u holds at ν degrees of freedom: the inverse of [`coverage_factor`].
pub fn coverage_probability(factor: f64, dof: f64) -> f64 {
    if dof < VAST_DOF {
        return 1.0 - tail(factor, dof);
    }
    // z from t for large ν (Abramowitz & Stegun 26.7.8 to first order).
    let z = factor - factor * (factor * factor + 1.0) / (4.0 * dof);
    1.0 - erfc(z / SQRT_2)
}

/// Probability density of t; of the normal distribution for infinite ν.
pub fn density(t: f64, dof: f64) -> f64 {
    if dof.is_infinite() {
        return exp(-0.5 * t * t) / (2.0 * PI).sqrt();
    }
    exp(gamma_ratio(0.5 * dof) - 0.5 * ln(dof) - 0.5 * (dof + 1.0) * log1p(t * t / dof))
}

/// Quantile of t from that of the normal distribution for large ν (Abramowitz & Stegun 26.7.5).
fn expansion(z: f64, dof: f64) -> f64 {
    let z2 = z * z;
    let g1 = z * (z2 + 1.0) / 4.0;
    let g2 = z * ((5.0 * z2 + 16.0) * z2 + 3.0) / 96.0;
    let g3 = z * (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) / 384.0;
    let g4 = z * ((((79.0 * z2 + 776.0) * z2 + 1482.0) * z2 - 1920.0) * z2 - 945.0) / 92_160.0;
    z + (g1 + (g2 + (g3 + g4 / dof) / dof) / dof) / dof
}

/// P(|t| > k) = I_x(a, ½) with a = ν/2, x = ν / (ν + k²), regularised incomplete beta function (Abramowitz & Stegun
/// 26.7.1).
fn tail(k: f64, dof: f64) -> f64 {
    if k <= 0.0 {
        return 1.0;
    }
    let (a, square) = (0.5 * dof, k * k);
    // Each of x and y = 1 − x is computed by itself, because the smaller one cannot be seen in the larger one.
    let (x, y) = (dof / (dof + square), square / (dof + square));
    let front = exp(gamma_ratio(a) - a * log1p(square / dof) + 0.5 * ln(y));
    // The fraction converges fast on the near side of the mean only.
    if x < (a + 1.0) / (a + 2.5) {
        front * fraction(x, a, 0.5) / a
    } else {
        1.0 - front * fraction(y, 0.5, a) / 0.5
    }
}

/// ln(Γ(a + ½) / (Γ(a) Γ(½))).
fn gamma_ratio(a: f64) -> f64 {
    let half = 0.5 * ln(PI);
    if a < 50.0 {
        return lgamma(a + 0.5) - lgamma(a) - half;
    }
    // Asymptotic, because the logarithms are large and nearly equal (Tricomi and Erdélyi, 1951).
    let inverse = 1.0 / (a * a);
    let series = -1.0 / 8.0 + inverse * (1.0 / 192.0 + inverse * (-1.0 / 640.0 + inverse * 17.0 / 14_336.0));
    0.5 * ln(a) + series / a - half
}

/// Continued fraction of the incomplete beta function (Abramowitz & Stegun 26.5.8) by Lentz's method.
pub(crate) fn fraction(x: f64, a: f64, b: f64) -> f64 {
    const TINY: f64 = 1e-300;
    let guard = |v: f64| if v.abs() < TINY { TINY } else { v };
    let mut c = 1.0;
    let mut d = 1.0 / guard(1.0 - (a + b) * x / (a + 1.0));
    let mut h = d;
    for m in 1..=10_000 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        d = 1.0 / guard(1.0 + even * d);
        c = guard(1.0 + even / c);
        h *= d * c;
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        d = 1.0 / guard(1.0 + odd * d);
        c = guard(1.0 + odd / c);
        let step = d * c;
        h *= step;
        if (step - 1.0).abs() < 4.0 * f64::EPSILON {
            break;
        }
    }
    h
}
