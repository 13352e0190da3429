//! Why there is no mesh.

use thiserror::Error;

/// More triangles than this would exceed the tree's 32-bit numbers.
pub const MOST_TRIANGLES: usize = 50_000_000;

/// Why there is no mesh.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum MeshError {
    /// A corner is NaN or infinite.
    #[error("triangle {triangle} has a corner that is not a finite number; export the mesh again")]
    NotFinite {
        /// Index of the triangle, from 0.
        triangle: usize,
    },
    /// The mesh has no triangle with an area.
    #[error("no triangle has an area ({given} given); is this the right mesh?")]
    Empty {
        /// Triangles before those without area were left out.
        given: usize,
    },
    /// A surface without an outside.
    #[error(
        "the surface has one side only, seen at triangle {triangle} (counted from 0): it has no outside, so that distances have no \
         sign; repair the mesh"
    )]
    OneSided {
        /// Index of the triangle, from 0.
        triangle: usize,
    },
    /// Beyond what the tree can number.
    #[error("{given} triangles, limit {MOST_TRIANGLES}; reduce the mesh")]
    TooLarge {
        /// Number of triangles in the file.
        given: usize,
    },
}
