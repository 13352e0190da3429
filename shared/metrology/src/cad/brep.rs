//! Boundary representation of a solid, as CAD systems write it.

use nalgebra::{Isometry3, Point3};
use thiserror::Error;

use super::curve::Curve;
use super::shape::CadShape;

/// A solid: faces that are bounded by edges, each edge by two of them.
#[derive(Debug, Clone, Default)]
pub struct Brep {
    /// Corners at which edges end, mm.
    pub vertices: Vec<Point3<f64>>,
    /// The edges, by index.
    pub edges: Vec<BrepEdge>,
    /// The faces of all shells.
    pub faces: Vec<BrepFace>,
}

/// An edge between two corners, which may be one.
#[derive(Debug, Clone)]
pub struct BrepEdge {
    /// Number of the edge in its file.
    pub id: u64,
    /// The line in space that it runs along.
    pub curve: Curve,
    /// Indices of the corners at its start and end.
    pub ends: [usize; 2],
    /// Whether it runs as the curve does.
    pub along: bool,
}

/// A face over a part of a surface.
#[derive(Debug, Clone)]
pub struct BrepFace {
    /// Number of the face in its file.
    pub id: u64,
    /// Name of the face in its file; empty where it has none.
    pub name: String,
    /// Its surface, without an end.
    pub shape: CadShape,
    /// Whether the outside is on the side of the surface's own normal.
    pub outward: bool,
    /// Closed lines and corners that bound it.
    pub bounds: Vec<Bound>,
}

/// A closed line about a face, or a single corner in it.
#[derive(Debug, Clone)]
pub enum Bound {
    /// Edges with their direction; `true`: as the edge runs.
    Loop(Vec<(usize, bool)>),
    /// A corner, such as the tip of a cone.
    Corner(usize),
}

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

impl Brep {
    /// Places that the solid reaches about, mm: its corners, and the sides of round faces, which have few.
    pub fn reach(&self, place: &Isometry3<f64>) -> Vec<Point3<f64>> {
        let sides = self.faces.iter().filter_map(|face| match face.shape {
            CadShape::Sphere { center_mm, radius_mm } => Some((center_mm, radius_mm)),
            CadShape::Torus { center_mm, ring_radius_mm, tube_radius_mm, .. } => {
                Some((center_mm, ring_radius_mm + tube_radius_mm))
            }
            _ => None,
        });
        let sides = sides.flat_map(|(at, radius)| [-radius, radius].map(|arm| at.map(|c| c + arm)));
        self.vertices.iter().copied().chain(sides).map(|p| place * p).collect()
    }
}
