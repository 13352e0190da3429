//! A freeform surface of CAD data as an element: its points are held against it where it nominally lies.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

use super::bounds::Bounds;
use crate::fit::{Form, Residuals};
use crate::spatial::{Foot, Triangle, TriangleMesh};

/// Meshes of the files that a plan names, by the path as it writes them.
pub type Surfaces = BTreeMap<String, TriangleMesh>;

/// A nominal surface in the part frame, with the name of its file.
#[derive(Debug, Clone)]
pub struct NominalSurface {
    file: String,
    mesh: Arc<TriangleMesh>,
}

/// Equal are surfaces of the same triangles.
impl PartialEq for NominalSurface {
    fn eq(&self, other: &Self) -> bool {
        self.file == other.file && self.mesh.triangles() == other.mesh.triangles()
    }
}

impl NominalSurface {
    /// Of a mesh in the part frame, mm.
    pub fn new(file: &str, mesh: TriangleMesh) -> Self {
        Self { file: file.to_owned(), mesh: Arc::new(mesh) }
    }

    /// Name of the file, as the plan writes it.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Middle of the surface's box, mm.
    pub fn middle(&self) -> Point3<f64> {
        let bounds = self.mesh.bounds();
        nalgebra::center(&bounds.low, &bounds.high)
    }

    /// Box about all places within a distance of the surface, mm.
    pub(super) fn bounds(&self, margin_mm: f64) -> Bounds {
        let bounds = self.mesh.bounds();
        let half = (bounds.high - bounds.low) * 0.5;
        Bounds::about(&self.middle().coords, &half.add_scalar(margin_mm))
    }

    fn foot(&self, position: &Vector3<f64>, limit_mm: f64) -> Option<Foot> {
        self.mesh.nearest(&Point3::from(*position), limit_mm)
    }

    /// Whether a position lies within a distance of the surface, and beside none of its borders.
    pub fn holds(&self, position: &Vector3<f64>, margin_mm: f64) -> bool {
        let bounds = self.mesh.bounds();
        let boxed = (0..3).all(|axis| {
            (bounds.low[axis] - margin_mm..=bounds.high[axis] + margin_mm).contains(&position[axis])
        });
        boxed && self.foot(position, margin_mm).is_some_and(|foot| !foot.at_border)
    }

    /// Signed distance from the surface, mm, positive out of the material.
    pub fn distance_mm(&self, position: &Vector3<f64>) -> f64 {
        self.foot(position, f64::INFINITY).map_or(f64::NAN, |foot| foot.signed_mm)
    }

    /// Area of all triangles, mm².
    pub fn area_mm2(&self) -> f64 {
        self.mesh.triangles().iter().map(area_mm2).sum()
    }

    /// Places with their normals, one for each square of a step: several on a large triangle, one on some small ones.
    pub(super) fn places(&self, step_mm: f64) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let (mut places, mut open) = (Vec::new(), 0.0);
        for triangle in self.mesh.triangles() {
            open += area_mm2(triangle) / (step_mm * step_mm);
            let count = open.floor();
            open -= count;
            let [a, b, c] = triangle.corners.map(|corner| corner.coords);
            // Spread by two irrational steps (Roberts 2018), folded into the triangle.
            let place = |i: f64| {
                let [u, v] =
                    [0.754_877_666_246_693, 0.569_840_290_998_053].map(|step| (0.5 + i * step).fract());
                let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
                (a + (b - a) * u + (c - a) * v, triangle.normal)
            };
            places.extend((0..count as usize).map(|i| place(i as f64)));
        }
        places
    }

    /// Unit normal of the triangle that is nearest.
    pub fn normal_at(&self, position: &Vector3<f64>) -> Vector3<f64> {
        self.foot(position, f64::INFINITY).map_or(Vector3::zeros(), |foot| foot.normal)
    }
}

fn area_mm2(triangle: &Triangle) -> f64 {
    let [a, b, c] = triangle.corners;
    0.5 * (b - a).cross(&(c - a)).norm()
}

/// The points of a freeform surface: nothing is fitted, the surface stays where it nominally is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SurfaceFit {
    /// Middle of the nominal surface, mm.
    pub place_mm: [f64; 3],
    /// Points and their form about the nominal surface.
    #[serde(flatten)]
    pub form: Form,
    /// Signed distance of each point from the nominal surface.
    #[serde(skip)]
    pub residuals: Residuals,
}

impl SurfaceFit {
    /// Holds points in the part frame against the surface.
    pub(super) fn new(surface: &NominalSurface, points: &[Point3<f64>]) -> Self {
        let deviation_mm: Vec<f64> = points.iter().map(|p| surface.distance_mm(&p.coords)).collect();
        let residuals = Residuals { used: vec![true; deviation_mm.len()], deviation_mm };
        Self { place_mm: surface.middle().into(), form: residuals.form(), residuals }
    }
}
