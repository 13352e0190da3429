//! Why there is no fit.

use thiserror::Error;

/// Largest coordinate that is taken for a length in mm: beyond it squares lose the micrometre.
pub const COORDINATE_LIMIT_MM: f64 = 1e7;

/// The ending of a word beside a number.
fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

/// Why there is no fit.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum FitError {
    /// Fewer points than the element needs.
    #[error("{element}: {points} point{}, needs at least {needs}", plural(*.points))]
    TooFewPoints {
        /// Kind of the element.
        element: &'static str,
        /// Points left after rejection.
        points: usize,
        /// Fewest points that determine the element and one residual.
        needs: usize,
    },
    /// A coordinate is NaN, infinite, or no length in mm.
    #[error("{element}: point {index} has the coordinate {value}, limit ±{COORDINATE_LIMIT_MM:e} mm")]
    Coordinate {
        /// Kind of the element.
        element: &'static str,
        /// Which point, from 0.
        index: usize,
        /// Largest coordinate magnitude found, mm.
        value: f64,
    },
    /// The points do not determine the element.
    #[error("{element}: the points do not determine it: {why}")]
    Degenerate {
        /// Kind of the element.
        element: &'static str,
        /// Why the points do not determine the element.
        why: &'static str,
    },
    /// The iteration did not settle.
    #[error("{element}: no convergence after {iterations} iterations; are the points those of a {element}?")]
    NoConvergence {
        /// Kind of the element.
        element: &'static str,
        /// Iterations before the search ended.
        iterations: usize,
    },
    /// The choice of points by a margin takes part of their noise away.
    #[error(
        "the margin of {margin_mm} mm cuts into the noise of the points: those within it scatter by {scatter_mm:.2e} mm, without it they would by more; \
         choose twice the margin or more"
    )]
    Margin {
        /// Largest distance from the element, mm.
        margin_mm: f64,
        /// Root mean square distance of the points within, mm.
        scatter_mm: f64,
    },
    /// A setting out of range.
    #[error("{key} = {value}: must be in {limits}")]
    Setting {
        /// Name of the setting.
        key: &'static str,
        /// Value given for the setting.
        value: f64,
        /// Interval allowed for the setting.
        limits: &'static str,
    },
}
