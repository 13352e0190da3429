//! What unwrapping found.

use serde::Serialize;

/// Figures of one map.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct UnwrapReport {
    /// Pixels with a phase.
    pub valid: usize,
    /// Groups of joined pixels, each with its own constant, in the order of their first pixels.
    pub components: Vec<Component>,
    /// Pairs of valid neighbours that differ by more than half a turn in the result: noise, steps of the part, or errors.
    pub discontinuities: usize,
    /// Residues of the branch cut method.
    pub residues: Option<Residues>,
    /// Convergence of the least-squares methods.
    pub convergence: Option<Convergence>,
}

/// Pixels that valid neighbours join.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Component {
    /// Number of pixels of the component.
    pub pixels: usize,
    /// The first one, row by row.
    pub first_px: [u32; 2],
    /// Whole turns that the anchor added to all of them; 0 without one.
    pub turns: i32,
    /// Number of pixels whose absolute phase the anchor gives.
    pub anchored: usize,
    /// How many of these then agree with the anchor within half a turn.
    pub agreeing: usize,
}

impl Component {
    /// Whether its phase is absolute.
    pub fn is_absolute(&self) -> bool {
        self.anchored > 0
    }
}

/// Residues (eq. 2.20) and what became of them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Residues {
    /// Number of residues with charge +1.
    pub positive: usize,
    /// Number of residues with charge −1.
    pub negative: usize,
    /// Holes of the mask about which the differences do not sum to zero.
    pub charged_holes: usize,
    /// Edges that a cut closes.
    pub cut_edges: usize,
    /// Regions that cuts enclosed, joined with their surroundings over the smallest difference.
    pub joined_across_cuts: usize,
}

/// How an iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Convergence {
    /// Whether the residual reached the tolerance.
    pub converged: bool,
    /// Number of steps taken.
    pub iterations: u32,
    /// Residual, as a fraction of the first one.
    pub residual: f64,
}
