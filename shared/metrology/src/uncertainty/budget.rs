//! A budget and its evaluation: the tables of thesis chapter 4 as data.

use serde::Serialize;

use super::distribution::Distribution;
use super::model::Model;

/// How an uncertainty was found (GUM 2.3.2, 2.3.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Method {
    /// By statistics of readings.
    A,
    /// Type B: from other information than repeated observations.
    B,
}

/// An input quantity X_i.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// Symbol of the quantity in the model.
    pub name: String,
    /// What it is and where its uncertainty comes from.
    pub source: String,
    /// Unit of estimate and value.
    pub unit: String,
    /// Estimate x_i of the quantity.
    pub estimate: f64,
    /// Type of evaluation, A or B.
    pub method: Method,
    /// Shape about the estimate.
    pub distribution: Distribution,
    /// What the source states: (expanded) uncertainty or half-width, see [`Distribution`].
    pub value: f64,
    /// ν_i, infinite where the standard uncertainty is taken as exactly known.
    pub dof: f64,
    /// Readings of a type A evaluation; empty otherwise.
    pub readings: Vec<f64>,
}

impl Quantity {
    /// u(x_i) = value / divisor.
    pub fn standard_uncertainty(&self) -> f64 {
        self.value / self.distribution.divisor()
    }
}

/// A correlation coefficient r(x_i, x_j).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlation {
    /// Index i of the first quantity.
    pub first: usize,
    /// Index j of the second quantity.
    pub second: usize,
    /// Correlation coefficient r(x_i, x_j), −1 … 1.
    pub coefficient: f64,
}

/// All that a result's uncertainty follows from.
#[derive(Debug, Clone, PartialEq)]
pub struct Budget {
    /// Input quantities X₁, …, X_n.
    pub quantities: Vec<Quantity>,
    /// Model f of the measurement.
    pub model: Model,
    /// Pairs that are not independent.
    pub correlations: Vec<Correlation>,
    /// p of the expanded uncertainty and of the Monte Carlo interval, 0.5 … 0.9999.
    pub coverage_probability: f64,
    /// k, where it is fixed; otherwise t_p(ν_eff).
    pub coverage_factor: Option<f64>,
    /// Whether ν_eff is cut to a whole number before t is taken (one of the two choices of GUM G.6.4).
    pub truncate_dof: bool,
}

/// One line of the budget table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Symbol of the quantity in the model.
    pub name: String,
    /// Where the uncertainty comes from.
    pub source: String,
    /// Unit of estimate, value and standard uncertainty.
    pub unit: String,
    /// Estimate x_i of the quantity.
    pub estimate: f64,
    /// Type of evaluation, A or B.
    #[serde(rename = "type")]
    pub method: Method,
    /// Probability distribution of the quantity.
    pub distribution: Distribution,
    /// Half-width or uncertainty of the estimate as stated in the budget.
    pub value: f64,
    /// value / divisor = u(x_i).
    pub divisor: f64,
    /// Standard uncertainty u(x_i) of the estimate.
    pub standard_uncertainty: f64,
    /// c_i = ∂f/∂x_i, unit of the measurand over that of the quantity.
    pub sensitivity: f64,
    /// |c_i| u(x_i), unit of the measurand.
    pub contribution: f64,
    /// Of the variance of the measurand: c_i² u²(x_i) / u_c². With correlation the rows do not add up to 1.
    pub share: f64,
    /// ν_i; infinite is written as null in JSON.
    pub dof: f64,
}

/// An estimate with its expanded uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Uncertain {
    /// Estimate y of the measurand.
    pub value: f64,
    /// Expanded uncertainty U = k·u_c(y).
    pub expanded_uncertainty: f64,
}

/// The result of a budget.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// y = f(x₁, …, x_n).
    pub estimate: f64,
    /// In the order of the quantities.
    pub rows: Vec<Row>,
    /// Share of the variance that comes from correlation; may be negative.
    pub correlation_share: f64,
    /// Combined standard uncertainty u_c(y) (eq. 4.10).
    pub combined_standard_uncertainty: f64,
    /// ν_eff (eq. 4.9); infinite is written as null in JSON.
    pub effective_dof: f64,
    /// Coverage factor k of U.
    pub coverage_factor: f64,
    /// Requested coverage probability p.
    pub coverage_probability: f64,
    /// What ± k·u_c holds at ν_eff: p, or less where a fixed k is too small.
    pub covered_probability: f64,
    /// U = k·u_c (eq. 4.11).
    pub expanded_uncertainty: f64,
    /// Notes that a reader of the result needs.
    pub notes: Vec<String>,
}

impl Evaluation {
    /// The result y with its expanded uncertainty U.
    pub fn result(&self) -> Uncertain {
        Uncertain { value: self.estimate, expanded_uncertainty: self.expanded_uncertainty }
    }
}
