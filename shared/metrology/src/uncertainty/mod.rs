//! Measurement uncertainty: the budget of the GUM (JCGM 100:2008) and, beside it, the propagation of distributions by
//! Monte Carlo (Supplement 1, JCGM 101:2008).
//!
//! # The flow
//! [`Quantity`] (what is known of an input: readings, or a distribution with its width) → [`Model`] (how the
//! measurand depends on the inputs) → [`Budget::evaluate`] (sensitivities, combined and expanded uncertainty) and
//! [`Budget::monte_carlo`] (the distribution of the measurand itself) → [`validate`] (does the first agree with the
//! second?) → [`normalised_error`] (does the result agree with another laboratory's?).
//!
//! # Conventions
//! u is a standard uncertainty, U = k·u an expanded one, ν degrees of freedom; an infinite ν is `f64::INFINITY`.
//! Sample standard deviations divide by n − 1. Units are text: nothing checks dimensions, so an angle model takes
//! radians and a temperature coefficient 1/K.
//!
//! # Where it goes beyond thesis chapter 4
//! * The thesis expands every budget with k = 2. Here k follows from ν_eff (eq. 4.9) and the coverage probability,
//!   unless the budget fixes k; then the result reports what that k covers at ν_eff.
//! * Equation 4.8 leaves out the divisor √3 that its tables use; here every row shows its divisor.
//! * Sensitivities come from the model by automatic differentiation, exact to rounding, not by finite differences.

mod budget;
mod comparison;
mod correlation;
mod distribution;
mod dof;
mod error;
mod evaluate;
mod expression;
mod function;
mod interval;
mod model;
pub mod models;
mod monte_carlo;
mod number;
mod sampler;
pub(crate) mod student;
#[cfg(test)]
mod tests;
mod type_a;

pub use budget::{Budget, Correlation, Evaluation, Method, Quantity, Row, Uncertain};
pub use comparison::{Comparison, compare, normalised_error};
pub use distribution::Distribution;
pub use dof::{dof_of_judgement, effective_dof};
pub use error::UncertaintyError;
pub use expression::{Expression, ExpressionError, same_unit};
pub use function::Function;
pub use interval::{Interval, IntervalKind, probabilistically_symmetric, shortest};
pub use model::Model;
pub use monte_carlo::{
    Histogram, MonteCarloResult, MonteCarloSettings, Validation, numerical_tolerance, validate,
};
pub use number::{Dual, Number};
pub use student::{coverage_factor, coverage_probability, density};
pub use type_a::{TypeA, observed_correlation};
