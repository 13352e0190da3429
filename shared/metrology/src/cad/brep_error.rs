//! Why a solid does not become triangles.

use thiserror::Error;

/// Why a solid does not become triangles.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum BrepError {
    /// A face whose border cannot be laid out.
    #[error("face #{face} (on a {kind}): {reason}")]
    Face {
        /// Number of the face.
        face: u64,
        /// Kind of its surface.
        kind: &'static str,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// An edge that does not lie on its curve.
    #[error("edge #{edge}: its ends lie {off_mm:.4} mm off its curve, limit {limit_mm:.4} mm")]
    Edge {
        /// Number of the edge.
        edge: u64,
        /// How far the ends lie off, mm.
        off_mm: f64,
        /// How far they may lie off, mm.
        limit_mm: f64,
    },
    /// The triangles do not close.
    #[error("face #{face} (on a {kind}) and its neighbours do not close: {open} open edges of the solid")]
    Open {
        /// Number of a face beside the gap.
        face: u64,
        /// Kind of its surface.
        kind: &'static str,
        /// Number of open edges.
        open: usize,
    },
    /// Normals that point inwards.
    #[error("the solid is inside out: it encloses {volume_mm3:.3} mm³")]
    InsideOut {
        /// Volume that the triangles enclose, mm³.
        volume_mm3: f64,
    },
    /// More triangles than are meant.
    #[error("more than {limit} triangles within {chord_mm} mm of the surfaces")]
    TooMany {
        /// Largest number of triangles.
        limit: usize,
        /// Distance that was asked for, mm.
        chord_mm: f64,
    },
}
