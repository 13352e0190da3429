//! Formulas as text: `L / (1 + alpha * (t - 20))`.
//!
//! # Language
//! Numbers, names of quantities, `pi`, `+ - * / ^` with the usual precedence (`^` binds to the right and before a sign:
//! `-x^2` is −(x²)), parentheses, and functions: `sqrt exp ln log10 sin cos tan asin acos atan abs` of one argument,
//! `deg` (rad to °) and `rad` (° to rad), `atan2(y, x)`, and the models of [`super::models`]: `distance(x1, y1, z1, x2,
//! y2, z2)`, `direction_cosine(…)` and `plane_angle(…)` of six coordinates, `length_at_20(L, alpha, t)`. Angles in rad.
//!
//! Own code rather than a library: available libraries call the system's mathematics, whose bits differ between
//! machines, and evaluate plain numbers only, so that derivatives would need finite differences.

mod function;
mod parse;
#[cfg(test)]
mod tests;
mod token;
mod units;

use thiserror::Error;

use super::function::Function;
use super::models;
use super::number::Number;
use function::Builtin;
pub use units::same_unit;

/// Longest formula: thousands of terms are a program, not a formula.
const MAX_LENGTH: usize = 4096;

/// Deepest nesting of parentheses, calls, signs and powers.
const MAX_DEPTH: usize = 64;

/// One step of a formula in postfix order; operands lie on a stack.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Constant(f64),
    /// By its place in the budget.
    Quantity(usize),
    Negate,
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Apply(Function),
    Call(Builtin),
}

/// A formula whose names are resolved.
#[derive(Debug, Clone, PartialEq)]
pub struct Expression {
    text: String,
    /// Well-formed by construction: every step finds its operands, one result is left.
    steps: Vec<Step>,
    arity: usize,
}

/// What is wrong with a formula; columns count from 1.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ExpressionError {
    /// The formula contains no characters but blanks.
    #[error("the formula is empty")]
    Empty,
    /// Longer or deeper than formulas are.
    #[error("the formula is too {what}: {found}, limit {limit}")]
    TooLarge {
        /// Which limit is exceeded: `long` or `deep`.
        what: &'static str,
        /// Length or depth of the formula.
        found: usize,
        /// Largest length or depth accepted.
        limit: usize,
    },
    /// A character that is not part of the formula language.
    #[error("column {column}: \"{sign}\" is not understood here")]
    Sign {
        /// Column in the formula, from 1.
        column: usize,
        /// Character that no formula contains.
        sign: char,
    },
    /// Something else should stand there.
    #[error("column {column}: {expected} expected, {found} found")]
    Expected {
        /// Column in the formula, from 1.
        column: usize,
        /// What should stand there.
        expected: &'static str,
        /// Text found at the column.
        found: String,
    },
    /// A name without meaning.
    #[error("column {column}: unknown variable \"{name}\"; known: {known}")]
    UnknownName {
        /// Column in the formula, from 1.
        column: usize,
        /// Name as written in the formula.
        name: String,
        /// All quantities of the budget, for the message.
        known: String,
    },
    /// A function without meaning.
    #[error("column {column}: unknown function \"{name}\"; known: {known}")]
    UnknownFunction {
        /// Column in the formula, from 1.
        column: usize,
        /// Name as written in the formula.
        name: String,
        /// All known functions, for the message.
        known: String,
    },
    /// Too few or too many arguments.
    #[error("column {column}: {name} takes {expected} arguments, {found} are given")]
    Arguments {
        /// Column in the formula, from 1.
        column: usize,
        /// Name of the function.
        name: String,
        /// Number of arguments that the function takes.
        expected: usize,
        /// Number of arguments given.
        found: usize,
    },
    /// A quantity that nothing can call.
    #[error("quantity \"{name}\": {problem}")]
    QuantityName {
        /// Symbol as written in the budget.
        name: String,
        /// Why the symbol is invalid.
        problem: &'static str,
    },
}

impl Expression {
    /// Reads a formula of quantities with these names.
    ///
    /// # Errors
    /// See [`ExpressionError`].
    pub fn parse(text: &str, names: &[&str]) -> Result<Self, ExpressionError> {
        for name in names {
            check_name(name)?;
        }
        let steps = parse::parse(text, names)?;
        Ok(Self { text: text.to_owned(), steps, arity: names.len() })
    }

    /// The formula as written.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Number of quantities that the formula may contain.
    pub fn arity(&self) -> usize {
        self.arity
    }

    /// Whether the formula mentions a quantity.
    pub fn mentions(&self, quantity: usize) -> bool {
        self.steps.contains(&Step::Quantity(quantity))
    }

    /// Value for values of the quantities, in their order; NaN where the formula is not defined.
    pub fn evaluate<T: Number>(&self, values: &[T], stack: &mut Vec<T>) -> T {
        stack.clear();
        for step in &self.steps {
            let result = match *step {
                Step::Constant(value) => T::constant(value),
                Step::Quantity(index) => values.get(index).copied().unwrap_or_else(|| T::constant(f64::NAN)),
                Step::Negate => -pop(stack),
                Step::Apply(function) => pop(stack).apply(function),
                Step::Call(builtin) => call(builtin, stack),
                Step::Add | Step::Subtract | Step::Multiply | Step::Divide | Step::Power => {
                    let second = pop(stack);
                    binary(*step, pop(stack), second)
                }
            };
            stack.push(result);
        }
        pop(stack)
    }
}

/// The topmost operand. The stack cannot be empty, because [`parse`](Expression::parse) gives steps in postfix order.
fn pop<T: Number>(stack: &mut Vec<T>) -> T {
    stack.pop().unwrap_or_else(|| T::constant(f64::NAN))
}

fn binary<T: Number>(step: Step, a: T, b: T) -> T {
    match step {
        Step::Add => a + b,
        Step::Subtract => a - b,
        Step::Multiply => a * b,
        Step::Divide => a / b,
        _ => a.power(b),
    }
}

fn call<T: Number>(builtin: Builtin, stack: &mut Vec<T>) -> T {
    let mut arguments = [T::constant(f64::NAN); Builtin::MAX_ARITY];
    let arity = builtin.arity();
    for place in (0..arity).rev() {
        arguments[place] = pop(stack);
    }
    let [a, b, c, x, y, z] = arguments;
    match builtin {
        Builtin::Atan2 => a.atan2(b),
        Builtin::Distance => models::distance([a, b, c], [x, y, z]),
        Builtin::DirectionCosine => models::direction_cosine([a, b, c], [x, y, z]),
        Builtin::PlaneAngle => models::plane_angle([a, b, c], [x, y, z]),
        Builtin::LengthAt20 => models::length_at_20(a, b, c),
    }
}

/// A name that a formula can hold, and that means nothing else.
fn check_name(name: &str) -> Result<(), ExpressionError> {
    let refuse = |problem| Err(ExpressionError::QuantityName { name: name.to_owned(), problem });
    let mut signs = name.chars();
    if !signs.next().is_some_and(token::begins_name) || !signs.all(token::continues_name) {
        return refuse("a formula takes names of letters, digits and _, which begin with a letter");
    }
    if name == parse::PI || function::known(name) {
        return refuse("the name means something else in formulas; choose another");
    }
    Ok(())
}
