//! Triangle meshes from STL bytes: intersection with rays, nearest point.

use crate::solid::{Contact, Nearest};
use metrology::spatial::{Aabb, Bvh, Triangle, first_met, is_blocked, nearest_on_segment};
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;
use std::io::Cursor;
use thiserror::Error;

/// Two neighbouring triangles that bend by more than this share an edge of the part; below, it is the facetting of a
/// curved face (CAD systems export with 5° to 15° chords). Cosine of 25°.
const CREASE_COSINE: f64 = 0.906;

/// More triangles than this would exceed the tree's 32-bit numbers.
const MOST_TRIANGLES: usize = 50_000_000;

/// What is wrong with a mesh.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum MeshError {
    /// Not an STL, or cut off.
    #[error("the STL cannot be read ({0}); is it complete, and is it STL?")]
    Unreadable(String),
    /// A corner is NaN or infinite.
    #[error("triangle {triangle} of the STL has a corner that is not a finite number")]
    NotFinite {
        /// Index of the triangle, from 0.
        triangle: usize,
    },
    /// The mesh has no triangle with an area.
    #[error("the mesh has no triangle of positive area ({given} given)")]
    Empty {
        /// Triangles before those without area were left out.
        given: usize,
    },
    /// Beyond what the tree can number.
    #[error("the mesh has {given} triangles, limit {MOST_TRIANGLES}; reduce it")]
    TooLarge {
        /// Number of triangles in the file.
        given: usize,
    },
}

/// A triangle mesh with its trees. Face numbers are triangle numbers after those without area were left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    triangles: Vec<Triangle>,
    tree: Bvh,
    creases: Vec<(Point3<f64>, Point3<f64>)>,
    crease_tree: Bvh,
}

impl Mesh {
    /// Reads a binary or ASCII STL; lengths in the file times `scale` are mm.
    ///
    /// # Errors
    /// Truncated or foreign bytes, corners that are not finite, no triangle with an area.
    pub fn from_stl(bytes: &[u8], scale: f64) -> Result<Self, MeshError> {
        let unreadable = |e: std::io::Error| MeshError::Unreadable(e.to_string());
        let mut cursor = Cursor::new(bytes);
        let reader = stl_io::create_stl_reader(&mut cursor).map_err(unreadable)?;
        let mut corners = Vec::new();
        for triangle in reader {
            let vertices = triangle.map_err(unreadable)?.vertices;
            corners.push(vertices.map(|v| Point3::from(v.0.map(|c| f64::from(c) * scale))));
            if corners.len() > MOST_TRIANGLES {
                return Err(MeshError::TooLarge { given: corners.len() });
            }
        }
        Self::from_corners(&corners)
    }

    /// Builds a mesh of triangles whose corners run counter-clockwise when seen from outside.
    ///
    /// # Errors
    /// As [`Self::from_stl`].
    pub fn from_corners(corners: &[[Point3<f64>; 3]]) -> Result<Self, MeshError> {
        let finite = |c: &[Point3<f64>; 3]| c.iter().all(|p| p.iter().all(|x| x.is_finite()));
        if let Some(triangle) = corners.iter().position(|c| !finite(c)) {
            return Err(MeshError::NotFinite { triangle });
        }
        let triangles: Vec<_> = corners.iter().filter_map(|c| Triangle::new(*c)).collect();
        if triangles.is_empty() {
            return Err(MeshError::Empty { given: corners.len() });
        }
        if triangles.len() > MOST_TRIANGLES {
            return Err(MeshError::TooLarge { given: triangles.len() });
        }
        let boxes: Vec<_> = triangles.iter().map(|t| Aabb::of(&t.corners)).collect();
        let creases = creases(&triangles);
        let crease_boxes: Vec<_> = creases.iter().map(|(a, b)| Aabb::of(&[*a, *b])).collect();
        Ok(Self { triangles, tree: Bvh::new(&boxes), creases, crease_tree: Bvh::new(&crease_boxes) })
    }

    /// Number of triangles of the mesh.
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// The corners of all triangles.
    pub(crate) fn corners(&self) -> impl Iterator<Item = [Point3<f64>; 3]> + '_ {
        self.triangles.iter().map(|triangle| triangle.corners)
    }

    /// The first triangle a ray meets beyond `least_mm`; the normal points against the ray.
    pub fn enter(&self, origin: &Point3<f64>, d: &Vector3<f64>, least_mm: f64) -> Option<Contact> {
        first_met((&self.tree, &self.triangles), origin, d, least_mm).map(|(t_mm, face)| {
            let normal = self.triangles[face as usize].normal;
            let normal = if normal.dot(d) > 0.0 { -normal } else { normal };
            Contact { t_mm, normal, face }
        })
    }

    /// Whether anything lies on the ray between `least_mm` and `limit_mm`.
    pub fn blocks(&self, origin: &Point3<f64>, d: &Vector3<f64>, least_mm: f64, limit_mm: f64) -> bool {
        is_blocked((&self.tree, &self.triangles), origin, d, (least_mm, limit_mm))
    }

    /// The nearest surface point; the sign is that of the nearest triangle's side.
    pub fn nearest(&self, p: &Point3<f64>) -> Nearest {
        let mut best = (f64::INFINITY, 0_u32, *p);
        self.tree.around_point(p, f64::INFINITY, |item, limit| {
            let foot = self.triangles[item as usize].nearest(p);
            let distance = (p - foot).norm();
            if distance < best.0 || (distance == best.0 && item < best.1) {
                best = (distance, item, foot);
            }
            limit.min(distance)
        });
        let (distance, face, foot_mm) = best;
        let outside = self.triangles[face as usize].normal.dot(&(p - foot_mm)) >= 0.0;
        let mut edge_mm = f64::INFINITY;
        self.crease_tree.around_point(&foot_mm, f64::INFINITY, |item, limit| {
            let (a, b) = self.creases[item as usize];
            edge_mm = edge_mm.min((foot_mm - nearest_on_segment(a, b, &foot_mm)).norm());
            limit.min(edge_mm)
        });
        Nearest { signed_mm: if outside { distance } else { -distance }, foot_mm, face, edge_mm }
    }

    /// Centre and radius of a sphere that holds the mesh, mm.
    pub fn bounding_sphere(&self) -> (Point3<f64>, f64) {
        self.tree.bounds().map_or((Point3::origin(), 0.0), |b| (b.centre(), 0.5 * (b.high - b.low).norm()))
    }
}

/// Edges where the surface bends, ends, or branches.
fn creases(triangles: &[Triangle]) -> Vec<(Point3<f64>, Point3<f64>)> {
    let key = |p: &Point3<f64>| [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits());
    let mut owners: BTreeMap<_, (Vec<usize>, Point3<f64>, Point3<f64>)> = BTreeMap::new();
    for (index, triangle) in triangles.iter().enumerate() {
        let [a, b, c] = triangle.corners;
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (x, y) = (key(&from), key(&to));
            let name = if x <= y { (x, y) } else { (y, x) };
            owners.entry(name).or_insert_with(|| (Vec::new(), from, to)).0.push(index);
        }
    }
    owners
        .into_values()
        .filter(|(faces, ..)| match faces.as_slice() {
            [a, b] => triangles[*a].normal.dot(&triangles[*b].normal) < CREASE_COSINE,
            _ => true,
        })
        .map(|(_, from, to)| (from, to))
        .collect()
}
