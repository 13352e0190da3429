//! Functions of one argument, with their slopes: what numbers of every kind apply.

use fringe::math;
use std::f64::consts::LN_10;

/// A function of one argument, with its slope.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Function {
    /// Square root, argument 0 or more.
    Sqrt,
    /// e to the power of.
    Exp,
    /// Natural logarithm, argument above 0.
    Ln,
    /// Decimal logarithm, argument above 0.
    Log10,
    /// Sine of an angle in rad.
    Sin,
    /// Cosine of an angle in rad.
    Cos,
    /// Tangent of an angle in rad.
    Tan,
    /// Arc sine in rad, argument −1 … 1.
    Asin,
    /// Arc cosine in rad, argument −1 … 1.
    Acos,
    /// Arc tangent, result in rad.
    Atan,
    /// Absolute value of the argument.
    Abs,
    /// Conversion from radians to degrees.
    Deg,
    /// Conversion from degrees to radians.
    Rad,
}

/// All of them by their names in formulas.
pub(super) const FUNCTIONS: [(&str, Function); 13] = [
    ("sqrt", Function::Sqrt),
    ("exp", Function::Exp),
    ("ln", Function::Ln),
    ("log10", Function::Log10),
    ("sin", Function::Sin),
    ("cos", Function::Cos),
    ("tan", Function::Tan),
    ("asin", Function::Asin),
    ("acos", Function::Acos),
    ("atan", Function::Atan),
    ("abs", Function::Abs),
    ("deg", Function::Deg),
    ("rad", Function::Rad),
];

impl Function {
    /// Value f(x) of the function.
    pub fn value(self, x: f64) -> f64 {
        match self {
            Self::Sqrt => x.sqrt(),
            Self::Exp => math::exp(x),
            Self::Ln => math::ln(x),
            Self::Log10 => math::log10(x),
            Self::Sin => math::sin(x),
            Self::Cos => math::cos(x),
            Self::Tan => math::tan(x),
            Self::Asin => math::asin(x),
            Self::Acos => math::acos(x),
            Self::Atan => math::atan(x),
            Self::Abs => x.abs(),
            Self::Deg => x.to_degrees(),
            Self::Rad => x.to_radians(),
        }
    }

    /// f′(x); not finite where there is none.
    pub fn slope(self, x: f64) -> f64 {
        match self {
            Self::Sqrt => 0.5 / x.sqrt(),
            Self::Exp => math::exp(x),
            Self::Ln => 1.0 / x,
            Self::Log10 => 1.0 / (x * LN_10),
            Self::Sin => math::cos(x),
            Self::Cos => -math::sin(x),
            Self::Tan => {
                let tan = math::tan(x);
                1.0 + tan * tan
            }
            // (1 − x)(1 + x) keeps the digits that 1 − x² loses near ±1.
            Self::Asin => 1.0 / ((1.0 - x) * (1.0 + x)).sqrt(),
            Self::Acos => -1.0 / ((1.0 - x) * (1.0 + x)).sqrt(),
            Self::Atan => 1.0 / (1.0 + x * x),
            Self::Abs if x == 0.0 => f64::NAN,
            Self::Abs => x.signum(),
            Self::Deg => 1.0_f64.to_degrees(),
            Self::Rad => 1.0_f64.to_radians(),
        }
    }
}
