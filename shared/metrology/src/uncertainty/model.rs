//! How the measurand depends on the input quantities.

use super::expression::Expression;
use super::number::{Dual, Number};

/// A measurement model Y = f(X₁, …, X_n).
#[derive(Debug, Clone, PartialEq)]
pub enum Model {
    /// Y = Σ c_i X_i with these sensitivities.
    Linear(Vec<f64>),
    /// A formula given as text.
    Expression(Expression),
}

impl Model {
    /// Number of quantities that it takes.
    pub fn arity(&self) -> usize {
        match self {
            Self::Linear(coefficients) => coefficients.len(),
            Self::Expression(expression) => expression.arity(),
        }
    }

    /// Value for values of the quantities, in their order; `stack` is scratch, so that a million calls do not allocate.
    pub fn value(&self, values: &[f64], stack: &mut Vec<f64>) -> f64 {
        match self {
            Self::Linear(coefficients) => coefficients.iter().zip(values).map(|(c, x)| c * x).sum(),
            Self::Expression(expression) => expression.evaluate(values, stack),
        }
    }

    /// Sensitivities c_i = ∂f/∂x_i at the estimates: exact to rounding, by automatic differentiation.
    pub fn sensitivities(&self, estimates: &[f64]) -> Vec<f64> {
        let expression = match self {
            Self::Linear(coefficients) => return coefficients.clone(),
            Self::Expression(expression) => expression,
        };
        let mut inputs: Vec<Dual> = estimates.iter().map(|x| Dual::constant(*x)).collect();
        let mut stack = Vec::new();
        (0..inputs.len())
            .map(|i| {
                inputs[i].derivative = 1.0;
                let result = expression.evaluate(&inputs, &mut stack);
                inputs[i].derivative = 0.0;
                result.derivative
            })
            .collect()
    }
}
