//! Uncertainty budgets, `fringecell-budget/1`.
//!
//! ```toml
//! format = "fringecell-budget/1"
//! name = "Sphere spacing"
//! remark = "thesis table 4.4"           # optional: where the numbers come from
//! coverage_probability = 0.9545         # default; p of U and of the Monte Carlo interval, 0.5 … 0.9999
//! coverage_factor = 2.0                 # optional: fixes k instead of taking t_p(ν_eff)
//! truncate_dof = false                  # default; true cuts ν_eff to a whole number before t is taken (GUM G.6.4)
//!
//! [measurand]
//! symbol = "L"
//! unit = "mm"
//! model = "length_at_20(L_m, alpha, t) + d_probe"   # optional, see metrology::uncertainty::Expression
//!
//! [[quantity]]                          # one per source of uncertainty
//! name = "L_m"                          # symbol, as in the model
//! source = "five repeats"               # optional: what it is
//! unit = "mm"                           # default: that of the measurand
//! readings = [112.461, 112.470, 112.466, 112.473, 112.465]   # type A: mean, s/√n, ν = n − 1
//!
//! [[quantity]]
//! name = "d_probe"
//! estimate = 0.0                        # needed unless there are readings
//! half_width = 0.027
//! distribution = "rectangular"
//! ```
//! Without a model Y is the sum of `sensitivity · quantity` (sensitivity 1 where none is given); with one, sensitivities
//! are its derivatives. Units are compared, not converted: in a sum a quantity of another unit than the measurand's needs the
//! `sensitivity` that converts it, and what a model adds or returns must be of one unit (a factor in the model converts).
//! A quantity states its uncertainty in exactly one of these ways:
//!
//! | keys | meaning |
//! |---|---|
//! | `readings` | at least 2; type A |
//! | `standard_deviation`, `observations` | s of single readings and their number n; type A, u = s/√n, ν = n − 1 |
//! | `standard_uncertainty` | u |
//! | `expanded_uncertainty`, `coverage_factor` | U and k of a certificate |
//! | `half_width`, `distribution` | `rectangular`, `triangular`, `u-shaped`, `trapezoidal` (with `top_ratio`, top over base), `curvilinear-trapezoidal` (rectangular with limits known only within ± `limit_uncertainty`) |
//!
//! Degrees of freedom, for the last three: `dof` (default infinite), or `relative_uncertainty_of_u` = Δu/u, from which
//! ν = ½ (Δu/u)⁻². `type = "A"` marks a standard uncertainty that came from readings elsewhere.
//!
//! ```toml
//! [[correlation]]                       # pairs that are not independent
//! between = ["V", "I"]
//! coefficient = -0.36                   # or: from_readings = true, for readings taken at the same time
//!
//! [monte_carlo]                         # all optional
//! seed = 1
//! digits = 2                            # significant digits of u that must be stable and agree, 1 or 2
//! trials = 1000000                      # a fixed number; without it as many as the tolerance needs
//! max_trials = 30000000                 # where the adaptive method gives up
//! interval = "probabilistically-symmetric"   # or "shortest"
//!
//! [reference]                           # another result of the same measurand, for E_n
//! name = "CMM"
//! value = 112.447
//! expanded_uncertainty = 0.020
//! ```
//! Unknown keys are refused.

mod check;
mod quantity;
mod raw;
#[cfg(test)]
mod tests;

use metrology::uncertainty::{Budget, MonteCarloSettings};
use std::path::Path;

use crate::document::Document;
use crate::error::FileError;

/// As written in `format`.
pub const BUDGET_FORMAT: &str = "fringecell-budget/1";

/// A checked budget file.
#[derive(Debug, Clone, PartialEq)]
pub struct BudgetFile {
    /// SHA-256 of the text that was read, hexadecimal.
    pub sha256: String,
    /// Title of the budget.
    pub name: String,
    /// Where the numbers come from; may be empty.
    pub remark: String,
    /// Symbol of the measurand.
    pub symbol: String,
    /// Unit of the measurand.
    pub unit: String,
    /// Model as written; `None` for a sum.
    pub model: Option<String>,
    /// What follows from it.
    pub budget: Budget,
    /// How trials are done.
    pub monte_carlo: MonteCarloSettings,
    /// Another result of the same measurand.
    pub reference: Option<Reference>,
}

/// Another result of the same measurand, independent of the budget's.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Who or what gave the other result.
    pub name: String,
    /// X, in the unit of the measurand.
    pub value: f64,
    /// U, of the same coverage as the budget's.
    pub expanded_uncertainty: f64,
}

impl BudgetFile {
    /// Reads and checks a file; what only the evaluation can find (contradicting correlations, a model without value) is
    /// left to it.
    ///
    /// # Errors
    /// Absent, no TOML, unknown or missing keys, values that cannot be meant; with file, line and key.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        check::check(&Document::read(path)?)
    }
}
