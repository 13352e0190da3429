//! Boundary representation of a solid, as CAD systems write it.

use nalgebra::{Isometry3, Point3};

use super::curve::Curve;
use super::shape::{CadShape, Surface};

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
    pub surface: Surface,
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

impl Brep {
    /// Places that the solid reaches about, mm: its corners, and the sides of round faces, which have few.
    pub fn reach(&self, place: &Isometry3<f64>) -> Vec<Point3<f64>> {
        let sides = self.faces.iter().flat_map(|face| match &face.surface {
            Surface::Free(free) => free.points(),
            Surface::Element(CadShape::Sphere { center_mm, radius_mm }) => about(center_mm, *radius_mm),
            Surface::Element(CadShape::Torus { center_mm, ring_radius_mm, tube_radius_mm, .. }) => {
                about(center_mm, ring_radius_mm + tube_radius_mm)
            }
            Surface::Element(_) => Vec::new(),
        });
        self.vertices.iter().copied().chain(sides).map(|p| place * p).collect()
    }
}

/// Two opposite corners of the box about a ball.
fn about(center: &Point3<f64>, radius: f64) -> Vec<Point3<f64>> {
    [-radius, radius].map(|arm| center.map(|c| c + arm)).to_vec()
}
