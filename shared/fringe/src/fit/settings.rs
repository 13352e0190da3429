//! What may be set about a fit.

use serde::{Deserialize, Serialize};

/// How a fit treats its points.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FitSettings {
    /// Fraction of the points that is left out, 0 … 0.5: ⌊fraction · n⌋ points, those of largest |residual|, chosen
    /// anew after each refit until the choice is stable. VDI/VDE 2634 part 3 allows 0.03.
    pub max_reject_fraction: f64,
    /// Edge of the cells, mm, within which noise may be correlated. With it, the uncertainties come from the
    /// cell sums of the residuals (cluster-robust); without it, points count as independent.
    pub cluster_mm: Option<f64>,
}
