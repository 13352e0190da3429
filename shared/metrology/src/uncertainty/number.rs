//! Numbers that models calculate with: plain ones, and ones that carry a derivative.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::function::Function;
use fringe::math;

/// What a measurement model needs of a number.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// A number without uncertainty.
    fn constant(value: f64) -> Self;
    /// self to the power of `exponent`.
    #[must_use]
    fn power(self, exponent: Self) -> Self;
    /// A function of one argument.
    #[must_use]
    fn apply(self, function: Function) -> Self;
    /// Angle of the point (x, y) = (`x`, self) from the x axis, rad.
    #[must_use]
    fn atan2(self, x: Self) -> Self;
}

impl Number for f64 {
    fn constant(value: f64) -> Self {
        value
    }

    fn power(self, exponent: Self) -> Self {
        math::pow(self, exponent)
    }

    fn apply(self, function: Function) -> Self {
        function.value(self)
    }

    fn atan2(self, x: Self) -> Self {
        math::atan2(self, x)
    }
}

/// A value and its derivative by one input: forward automatic differentiation, exact to rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual {
    /// Value f of the expression.
    pub value: f64,
    /// Derivative ∂f/∂x by the chosen quantity.
    pub derivative: f64,
}

impl Dual {
    /// Chain rule; what does not depend on the input keeps derivative 0 even where the slope is infinite.
    fn chain(self, value: f64, slope: f64) -> Self {
        Self { value, derivative: times(slope, self.derivative) }
    }
}

/// slope · derivative, 0 where the derivative is 0.
fn times(slope: f64, derivative: f64) -> f64 {
    if derivative == 0.0 { 0.0 } else { slope * derivative }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, derivative: self.derivative + other.derivative }
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, derivative: self.derivative - other.derivative }
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let derivative = times(other.value, self.derivative) + times(self.value, other.derivative);
        Self { value: self.value * other.value, derivative }
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        let derivative =
            times(1.0 / other.value, self.derivative) - times(value / other.value, other.derivative);
        Self { value, derivative }
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, derivative: -self.derivative }
    }
}

impl Number for Dual {
    fn constant(value: f64) -> Self {
        Self { value, derivative: 0.0 }
    }

    fn power(self, exponent: Self) -> Self {
        let (x, e) = (self.value, exponent.value);
        let value = math::pow(x, e);
        let by_base = times(e * math::pow(x, e - 1.0), self.derivative);
        let by_exponent = times(value * math::ln(x), exponent.derivative);
        Self { value, derivative: by_base + by_exponent }
    }

    fn apply(self, function: Function) -> Self {
        self.chain(function.value(self.value), function.slope(self.value))
    }

    fn atan2(self, x: Self) -> Self {
        let (a, b) = (self.value, x.value);
        let square = a * a + b * b;
        let derivative = times(b / square, self.derivative) - times(a / square, x.derivative);
        Self { value: math::atan2(a, b), derivative }
    }
}
