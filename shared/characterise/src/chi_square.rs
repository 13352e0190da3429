//! The χ² distribution in closed form: its degrees of freedom are few here.

use fringe::math;

/// Probability that a χ² of `freedom` degrees exceeds `value`.
///
/// Even: e^(−x/2) Σ (x/2)^j / j!; odd: erfc(√(x/2)) and the same sum over half-integers (Abramowitz & Stegun 26.4.4, 26.4.5).
pub(crate) fn tail(value: f64, freedom: usize) -> f64 {
    let half = 0.5 * value.max(0.0);
    let (mut term, start, mut sum) = if freedom.is_multiple_of(2) {
        (1.0, 0, 0.0)
    } else {
        // The first half-integer term is (x/2)^(1/2) / Γ(3/2).
        (half.sqrt() * std::f64::consts::FRAC_2_SQRT_PI, 1, 0.0)
    };
    let mut order = start;
    while order < freedom {
        sum += term;
        term *= half / (0.5 * order as f64 + 1.0);
        order += 2;
    }
    let exponential = math::exp(-half) * sum;
    if freedom.is_multiple_of(2) { exponential } else { math::erfc(half.sqrt()) + exponential }
}

/// The value that a χ² exceeds with the given probability, by bisection.
pub(crate) fn limit(probability: f64, freedom: usize) -> f64 {
    let (mut low, mut high) = (0.0, 1000.0 + freedom as f64);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if tail(middle, freedom) > probability { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From the usual tables.
    #[test]
    fn limits_are_those_of_the_tables() {
        for (freedom, probability, expected) in [
            (1, 0.05, 3.841_459),
            (2, 0.05, 5.991_465),
            (3, 0.01, 11.344_867),
            (5, 0.001, 20.515_006),
            (6, 0.001, 22.457_744),
            (6, 0.95, 1.635_383),
        ] {
            let found = limit(probability, freedom);
            assert!((found - expected).abs() < 1e-5, "{freedom} {probability}: {found}");
        }
    }
}
