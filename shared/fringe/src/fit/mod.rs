//! Elements fitted to points by least squares of the orthogonal distance, with covariance.
//!
//! Each function takes points in mm and gives a result that explains itself: the parameters, how many points were
//! used and rejected, the form deviation under three names with three definitions ([`Form`]), and standard
//! uncertainties. All points weigh the same, which is the definition of the Gaussian associated element (ISO 14405,
//! VDI/VDE 2634); a weighted mean would move with the camera's exposure.
//!
//! Method: data about their centroid, an algebraic start, Gauss–Newton steps that fall back to Levenberg–Marquardt
//! when the sum of squares grows, run until the step stops shrinking. Sums run over a fixed binary tree of points, so
//! the bits depend on the order of the points alone.

mod adjust;
mod axis;
mod centred;
mod circle;
mod cluster;
mod cone;
mod cylinder;
mod form;
mod line;
mod linear;
mod plane;
mod solve;
mod sphere;
#[cfg(test)]
pub(crate) mod tests;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use circle::{CircleFit, circle};
pub use cone::{ConeFit, cone};
pub use cylinder::{CylinderFit, cylinder};
pub use form::{Form, Residuals};
pub use line::{LineFit, line};
pub(crate) use linear::tangents;
pub use plane::{PlaneFit, plane};
pub(crate) use sphere::sphere_centre_near;
pub use sphere::{SphereFit, sphere, sphere_of_diameter};

/// Largest coordinate that is taken for a length in mm: beyond it squares lose the micrometre.
pub const COORDINATE_LIMIT_MM: f64 = 1e7;

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

/// Why there is no fit.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum FitError {
    /// Not enough points.
    #[error("{element}: {points} points, needs at least {needs}")]
    TooFewPoints {
        /// Which element.
        element: &'static str,
        /// Points left after rejection.
        points: usize,
        /// Fewest points that determine the element and one residual.
        needs: usize,
    },
    /// A coordinate is NaN, infinite, or no length in mm.
    #[error("{element}: point {index} has the coordinate {value}, limit ±{COORDINATE_LIMIT_MM:e} mm")]
    Coordinate {
        /// Which element.
        element: &'static str,
        /// Which point, from 0.
        index: usize,
        /// The value.
        value: f64,
    },
    /// The points do not determine the element.
    #[error("{element}: the points do not determine it: {why}")]
    Degenerate {
        /// Which element.
        element: &'static str,
        /// What is degenerate.
        why: &'static str,
    },
    /// The iteration did not settle.
    #[error("{element}: no convergence after {iterations} iterations; are the points those of a {element}?")]
    NoConvergence {
        /// Which element.
        element: &'static str,
        /// Iterations done.
        iterations: usize,
    },
    /// A setting out of range.
    #[error("{key} = {value} must lie in {limits}")]
    Setting {
        /// Name of the setting.
        key: &'static str,
        /// Its value.
        value: f64,
        /// Allowed interval.
        limits: &'static str,
    },
}
