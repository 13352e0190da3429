//! Solids of CAD: boundary representation, triangles within a stated distance, and nominal elements of inspection plans.
//!
//! A [`Brep`] has faces over elementary surfaces and surfaces of two parameters, bounded by edges that two faces share. [`Brep::mesh`] makes triangles of it: each edge
//! becomes one line of points for both of its faces, each face is triangulated in a plane chart of its surface ([`chart`]) and refined until
//! its triangles lie within the distance; the result is a closed surface, or an error with the face. [`features`] joins faces of one
//! elementary surface that touch into elements: the two halves of a bore are a bore.

mod bend;
mod brep;
mod brep_error;
mod chart;
mod curve;
mod enclosed;
mod extent;
mod faces;
mod freeform;
#[cfg(test)]
mod freeform_solids_tests;
#[cfg(test)]
mod freeform_tests;
mod inverse;
mod shape;
mod sheet;
mod spline;
mod tessellate;
#[cfg(test)]
mod tests;
mod triangulate;
mod whole;

pub use brep::{Bound, Brep, BrepEdge, BrepFace};
pub use brep_error::BrepError;
pub use curve::{Curve, Frame};
pub use faces::{CadFeature, FreeFace, features, free_faces};
pub use freeform::{Freeform, Profile};
pub use shape::{CadShape, Surface};
pub use spline::{Knots, Spline, SplineSurface};

use nalgebra::{Isometry3, Point3};

/// A solid as triangles with common corners, counter-clockwise when seen from outside.
#[derive(Debug, Clone, Default)]
pub struct CadMesh {
    /// Corners of the triangles, mm.
    pub corners: Vec<Point3<f64>>,
    /// Indices of the corners of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Index of the face of each triangle.
    pub face_of: Vec<u32>,
}

impl CadMesh {
    /// The mesh after a motion.
    #[must_use]
    pub fn moved(mut self, motion: &Isometry3<f64>) -> Self {
        self.corners.iter_mut().for_each(|corner| *corner = motion * *corner);
        self
    }

    /// Volume that the triangles enclose, mm³.
    pub fn volume_mm3(&self) -> f64 {
        let six = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|corner| self.corners[corner as usize].coords);
            a.cross(&b).dot(&c)
        };
        self.triangles.iter().map(six).sum::<f64>() / 6.0
    }
}
