//! Levenberg–Marquardt for models of a few parameters, as the response of a projector or the contrast over focus.

use nalgebra::{SMatrix, SVector};

/// Damping of the first step, relative to the diagonal of the normal matrix.
const FIRST_DAMPING: f64 = 1e-3;

/// With this damping a step no longer changes any parameter: the sum of squares cannot be lowered.
const MOST_DAMPING: f64 = 1e12;

/// Where the sum of squares is least.
pub(crate) struct Minimum<const P: usize> {
    pub parameters: SVector<f64, P>,
    /// Sum of squares there.
    pub sum: f64,
    /// (JᵀJ)⁻¹ where the last step started.
    pub inverse: SMatrix<f64, P, P>,
}

/// Minimises a sum of squares from a start; `None` where the parameters are not determined or `most_rounds` do not suffice.
///
/// `sum` is the sum of squares at some parameters, `None` where these are not allowed; `linearise` gives JᵀJ and
/// Jᵀ(measured − modelled); `settled` decides from the last step whether the minimum is reached.
pub(crate) fn minimise<const P: usize>(
    start: SVector<f64, P>,
    most_rounds: usize,
    sum: impl Fn(&SVector<f64, P>) -> Option<f64>,
    linearise: impl Fn(&SVector<f64, P>) -> (SMatrix<f64, P, P>, SVector<f64, P>),
    settled: impl Fn(&SVector<f64, P>) -> bool,
) -> Option<Minimum<P>> {
    let mut parameters = start;
    let mut least = sum(&parameters)?;
    let mut damping = FIRST_DAMPING;
    for _ in 0..most_rounds {
        let (matrix, right) = linearise(&parameters);
        let mut last = None;
        while last.is_none() && damping < MOST_DAMPING {
            let damped = matrix + SMatrix::from_diagonal(&(matrix.diagonal() * damping));
            let step = damped.try_inverse()? * right;
            let next = parameters + step;
            if let Some(lower) = sum(&next).filter(|sum| *sum < least) {
                (parameters, least, last) = (next, lower, Some(step));
                damping *= 0.1;
            } else {
                damping *= 10.0;
            }
        }
        if last.is_none_or(|step| settled(&step)) {
            return Some(Minimum { parameters, sum: least, inverse: matrix.try_inverse()? });
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::math::exp;
    use nalgebra::{Matrix2, Vector2};

    /// y = a e^(−bx) at ten places, from far away, with b > 0 only.
    fn decay(start: [f64; 2], weight: f64) -> Option<Minimum<2>> {
        let places = || (0..10).map(|i| 0.3 * f64::from(i));
        let measured = |x: f64| 2.5 * exp(-0.7 * x);
        let residual = |p: &Vector2<f64>, x: f64| weight * (measured(x) - p[0] * exp(-p[1] * x));
        minimise(
            Vector2::from(start),
            60,
            |p| (p[1] > 0.0).then(|| places().map(|x| residual(p, x) * residual(p, x)).sum()),
            |p| {
                places().fold((Matrix2::zeros(), Vector2::zeros()), |(matrix, right), x| {
                    let slope = Vector2::new(exp(-p[1] * x), -p[0] * x * exp(-p[1] * x)) * weight;
                    (matrix + slope * slope.transpose(), right + slope * residual(p, x))
                })
            },
            |step| step.norm() < 1e-12,
        )
    }

    #[test]
    fn an_exact_curve_is_found() {
        let found = decay([0.1, 5.0], 1.0).unwrap();
        assert!((found.parameters - Vector2::new(2.5, 0.7)).norm() < 1e-9, "{}", found.parameters);
        assert!(found.sum < 1e-18);
    }

    #[test]
    fn what_nothing_determines_or_is_not_allowed_has_no_minimum() {
        assert!(decay([1.0, 1.0], 0.0).is_none());
        assert!(decay([1.0, -1.0], 1.0).is_none());
    }
}
