//! What makes a budget impossible.

use thiserror::Error;

use super::expression::ExpressionError;

/// Why there is no uncertainty.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum UncertaintyError {
    /// The budget has no input quantity.
    #[error("the budget has no input quantity; give at least one")]
    Empty,
    /// A number that cannot be meant.
    #[error("{place}: {key} {value} is not allowed: {limit}")]
    Value {
        /// Which part of the budget.
        place: String,
        /// Which of its numbers.
        key: &'static str,
        /// Value given in the budget.
        value: f64,
        /// Limit of the value.
        limit: &'static str,
    },
    /// Too few readings for a standard deviation.
    #[error("{place}: {found} readings, at least {least} are needed")]
    Readings {
        /// Quantity that the value belongs to.
        place: String,
        /// Number of observations given.
        found: usize,
        /// Smallest number of observations.
        least: usize,
    },
    /// A coefficient and what it must fit.
    #[error("correlation of \"{first}\" and \"{second}\": {problem}")]
    Correlation {
        /// Symbol of the first quantity.
        first: String,
        /// Symbol of the second quantity.
        second: String,
        /// What is wrong, with the remedy.
        problem: String,
    },
    /// Coefficients that contradict each other.
    #[error(
        "the correlation coefficients contradict each other at \"{quantity}\": with them the matrix is not positive \
         semidefinite (a combination has variance {variance:.3e}); make them smaller, or estimate all of them from the \
         same readings"
    )]
    NotPositiveSemidefinite {
        /// Where the factorisation breaks.
        quantity: String,
        /// Variance by the model, which is negative.
        variance: f64,
    },
    /// A model that does not fit the quantities.
    #[error("the model takes {expected} quantities, the budget has {found}")]
    Arity {
        /// Number of quantities in the model.
        expected: usize,
        /// Number of quantities in the budget.
        found: usize,
    },
    /// The text of the model.
    #[error("model: {0}")]
    Expression(#[from] ExpressionError),
    /// The model has no value at the estimates.
    #[error("the model gives {value} at the estimates; check their values and units")]
    ModelValue {
        /// Value of the model.
        value: f64,
    },
    /// The model has no slope at the estimates.
    #[error(
        "the model has no derivative by \"{quantity}\" at the estimates (it gives {value}); change the model or the estimate"
    )]
    Derivative {
        /// Symbol of the input quantity.
        quantity: String,
        /// Value of the derivative.
        value: f64,
    },
    /// The model breaks at some draws.
    #[error(
        "the model gives no finite value at {count} of {trials} draws; the distributions reach where it is not defined"
    )]
    Draws {
        /// Draws without a value.
        count: u64,
        /// Draws up to there.
        trials: u64,
    },
    /// A quantity that cannot be drawn as the Supplement demands.
    #[error("Monte Carlo: \"{quantity}\": {problem}")]
    NotDrawable {
        /// Symbol of the quantity.
        quantity: String,
        /// Why, with the remedy.
        problem: String,
    },
}
