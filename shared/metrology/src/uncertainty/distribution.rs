//! Distributions of type B evaluations (GUM 4.3, Supplement 1 section 6.4).

use serde::Serialize;
use std::f64::consts::TAU;

use fringe::math::random::{Key, normal_quantile};
use fringe::math::{cos, pow, sin};

/// What an input quantity is taken to be distributed like, about its estimate.
///
/// The *value* of a quantity is what the source states: an (expanded) uncertainty for the normal distribution, the
/// half-width of the base for all others. Value over [`divisor`](Self::divisor) is the standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "shape", rename_all = "kebab-case")]
pub enum Distribution {
    /// Normal, or Student's t where the degrees of freedom are finite; the value is U = k·u.
    Normal {
        /// k of the stated value, 1 for a standard uncertainty.
        coverage_factor: f64,
    },
    /// Every value within the half-width is as likely as any other.
    Rectangular,
    /// Sum of two equal rectangular ones.
    Triangular,
    /// Arcsine: a quantity that swings like a sine, such as a controlled temperature.
    UShaped,
    /// Sum of two different rectangular ones.
    Trapezoidal {
        /// Width of the top over width of the base, 0 (triangle) … 1 (rectangle).
        top_ratio: f64,
    },
    /// Rectangular with limits that are themselves known only within a rectangle (Supplement 1, 6.4.3).
    CurvilinearTrapezoidal {
        /// Half-width of what is known of a limit, over the half-width: 0 … 1.
        limit_ratio: f64,
    },
}

impl Distribution {
    /// What the stated value is divided by to give the standard uncertainty (thesis tables: Div).
    pub fn divisor(self) -> f64 {
        match self {
            Self::Normal { coverage_factor } => coverage_factor,
            Self::Rectangular => 3.0_f64.sqrt(),
            Self::Triangular => 6.0_f64.sqrt(),
            Self::UShaped => 2.0_f64.sqrt(),
            Self::Trapezoidal { top_ratio } => (6.0 / (1.0 + top_ratio * top_ratio)).sqrt(),
            Self::CurvilinearTrapezoidal { limit_ratio } => (9.0 / (3.0 + limit_ratio * limit_ratio)).sqrt(),
        }
    }

    /// As it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal { .. } => "normal",
            Self::Rectangular => "rectangular",
            Self::Triangular => "triangular",
            Self::UShaped => "U-shaped",
            Self::Trapezoidal { .. } => "trapezoidal",
            Self::CurvilinearTrapezoidal { .. } => "curvilinear trapezoidal",
        }
    }

    /// Deviation from the estimate at one trial, in units of the standard uncertainty's [`divisor`](Self::divisor)
    /// times itself: multiply it by value (all but normal) or by value / k (normal).
    ///
    /// Finite `dof` turn the normal distribution into Student's t (Supplement 1, 6.4.9), whose standard deviation is
    /// √(ν/(ν − 2)) times larger; the other shapes do not depend on them.
    pub(super) fn draw(self, key: Key, trial: u64, dof: f64) -> f64 {
        let counter = trial.wrapping_mul(2);
        let (first, second) = (|| key.symmetric(counter), || key.symmetric(counter.wrapping_add(1)));
        match self {
            Self::Normal { .. } if dof.is_finite() => student(key, counter, dof),
            Self::Normal { .. } => normal_quantile(key.open(counter)),
            Self::Rectangular => first(),
            Self::Triangular => 0.5 * (first() + second()),
            Self::UShaped => sin(0.5 * TAU * first()),
            Self::Trapezoidal { top_ratio } => {
                0.5 * ((1.0 + top_ratio) * first() + (1.0 - top_ratio) * second())
            }
            Self::CurvilinearTrapezoidal { limit_ratio } => (1.0 + limit_ratio * first()) * second(),
        }
    }
}

/// Student's t with any ν > 0 from two even numbers, exactly and without rejection (R. W. Bailey, Polar generation of
/// random variates with the t-distribution, Math. Comp. 62, 779, 1994: the form like Box and Muller's).
fn student(key: Key, counter: u64, dof: f64) -> f64 {
    let radius = (dof * (pow(key.open(counter), -2.0 / dof) - 1.0)).sqrt();
    radius * cos(TAU * key.open(counter.wrapping_add(1)))
}
