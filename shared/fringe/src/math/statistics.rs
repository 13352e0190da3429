//! Order statistics that single wrong values do not move.

use std::cmp::Ordering;

/// Standard deviation of normally distributed values over the median of their magnitudes.
pub const SIGMA_OF_MEDIAN: f64 = 1.4826;

/// The median, of an even number of values the upper of the two in the middle, so that it is a value that occurred; `None` of
/// no values. Changes the order of `values`.
pub fn median<T: Ordered>(values: &mut [T]) -> Option<T> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, T::order).1)
}

/// Numbers with a total order.
pub trait Ordered: Copy {
    /// The order of two numbers.
    fn order(&self, other: &Self) -> Ordering;
}

impl Ordered for f64 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Ordered for f32 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Ordered for usize {
    fn order(&self, other: &Self) -> Ordering {
        self.cmp(other)
    }
}

/// Standard deviation of deviations from zero, from the median of their magnitudes; `None` of no values. Leaves the
/// magnitudes in `deviations`.
pub fn sigma_by_median(deviations: &mut [f64]) -> Option<f64> {
    for deviation in deviations.iter_mut() {
        *deviation = deviation.abs();
    }
    median(deviations).map(|median| SIGMA_OF_MEDIAN * median)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::{Key, Normal};

    #[test]
    fn the_median_is_a_value_that_occurred() {
        assert_eq!(median::<f64>(&mut []), None);
        assert_eq!(median(&mut [2.0_f32, f32::NAN, -1.0]), Some(2.0));
        assert_eq!(median(&mut [3.0]), Some(3.0));
        assert_eq!(median(&mut [4.0, 1.0, 9.0, 2.0]), Some(4.0));
        assert_eq!(median(&mut [5.0, -1.0, f64::INFINITY]), Some(5.0));
        assert_eq!(sigma_by_median(&mut []), None);
        assert_eq!(sigma_by_median(&mut [-2.0, 1.0, 100.0]), Some(2.0 * SIGMA_OF_MEDIAN));
    }

    /// Against the scatter of draws, a tenth of them replaced by wrong values.
    #[test]
    fn sigma_is_that_of_normal_draws() {
        let (normal, key) = (Normal::default(), Key::new(5));
        let mut draws: Vec<f64> = (0..100_000).map(|i| 0.3 * f64::from(normal.draw(key.bits(i)))).collect();
        // The standard error of the estimate is 1.17/√n of it.
        assert!((sigma_by_median(&mut draws.clone()).unwrap() / 0.3 - 1.0).abs() < 5.0 * 1.17 / 316.0);
        draws[..10_000].fill(1e6);
        let disturbed = sigma_by_median(&mut draws).unwrap() / 0.3;
        assert!((1.0..1.2).contains(&disturbed), "{disturbed}");
    }
}
