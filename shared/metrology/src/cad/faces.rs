//! The elements of a solid: faces of one surface that touch, together.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Vector3};

use super::brep::Brep;
use super::extent::geometry;
use super::{CadMesh, CadShape, Surface};
use crate::inspection::Geometry;

/// How far two surfaces may differ that are one, mm.
const SAME_MM: f64 = 1e-4;

/// An element of CAD: one face, or several of one surface that touch.
#[derive(Debug, Clone, PartialEq)]
pub struct CadFeature {
    /// Numbers of the faces in their file, rising.
    pub faces: Vec<u64>,
    /// Names of the faces that have one.
    pub names: Vec<String>,
    /// Nominal geometry with its extent.
    pub geometry: Geometry,
    /// Area of its triangles, mm².
    pub area_mm2: f64,
    /// Whether the material lies around it, as around a bore.
    pub internal: bool,
    /// Indices of its triangles, rising.
    pub triangles: Vec<u32>,
    /// Which of the places of its solid it lies in, counted from 1, where an assembly places the solid more than once.
    pub instance: Option<usize>,
}

/// A face over a surface that is no element of plans: something to compare with.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeFace {
    /// Number of the face in its file.
    pub id: u64,
    /// Name of the face in its file; empty where it has none.
    pub name: String,
    /// Kind of its surface, in words.
    pub kind: &'static str,
    /// Area of its triangles, mm².
    pub area_mm2: f64,
}

/// The faces of a solid that are no elements, in the order of the solid.
pub fn free_faces(brep: &Brep, mesh: &CadMesh) -> Vec<FreeFace> {
    let mut areas = vec![0.0; brep.faces.len()];
    for (triangle, face) in mesh.triangles.iter().zip(&mesh.face_of) {
        areas[*face as usize] += area_vector(mesh, triangle).norm();
    }
    let free = |(face, area_mm2): (&super::BrepFace, f64)| match &face.surface {
        Surface::Element(_) => None,
        Surface::Free(free) => {
            Some(FreeFace { id: face.id, name: face.name.clone(), kind: free.kind(), area_mm2 })
        }
    };
    brep.faces.iter().zip(areas).filter_map(free).collect()
}

/// The elements of a solid that lies somewhere, from its mesh there; in the order of their first faces.
pub fn features(brep: &Brep, place: &Isometry3<f64>, mesh: &CadMesh) -> Vec<CadFeature> {
    let roots = joined(brep, mesh);
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for face in 0..brep.faces.len() {
        groups.entry(root(&roots, face)).or_default().push(face);
    }
    let mut parts: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    for (triangle, face) in mesh.face_of.iter().enumerate() {
        parts.entry(root(&roots, *face as usize)).or_default().push(triangle as u32);
    }
    let feature = |(root, members): (&usize, &Vec<usize>)| {
        let part = parts.get(root)?;
        let first = &brep.faces[members[0]];
        let shape = first.surface.element()?.moved(place);
        let internal = !first.outward && !matches!(shape, CadShape::Plane { .. });
        let geometry = geometry(&shape, !first.outward, part, mesh)?;
        let mut faces: Vec<u64> = members.iter().map(|f| brep.faces[*f].id).collect();
        faces.sort_unstable();
        let names = members.iter().map(|f| &brep.faces[*f].name).filter(|n| !n.is_empty()).cloned().collect();
        let area_mm2 = part.iter().map(|t| area_vector(mesh, &mesh.triangles[*t as usize]).norm()).sum();
        let triangles = part.clone();
        Some(CadFeature { faces, names, geometry, area_mm2, internal, triangles, instance: None })
    };
    let mut found: Vec<CadFeature> = groups.iter().filter_map(feature).collect();
    found.sort_by_key(|f| f.faces[0]);
    found
}

/// The normal of a triangle, as long as its area.
fn area_vector(mesh: &CadMesh, triangle: &[u32; 3]) -> Vector3<f64> {
    let [a, b, c]: [Point3<f64>; 3] = triangle.map(|corner| mesh.corners[corner as usize]);
    (b - a).cross(&(c - a)) * 0.5
}

fn root(roots: &[usize], mut at: usize) -> usize {
    while roots[at] != at {
        at = roots[at];
    }
    at
}

/// Faces of one surface and side that share an edge of the mesh have one root: the lowest of them.
fn joined(brep: &Brep, mesh: &CadMesh) -> Vec<usize> {
    let bounds = crate::spatial::Aabb::of(&mesh.corners);
    let reach_mm = (bounds.high - bounds.low).norm();
    let mut owners: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    let mut roots: Vec<usize> = (0..brep.faces.len()).collect();
    for (triangle, face) in mesh.triangles.iter().zip(&mesh.face_of) {
        let face = *face as usize;
        let [a, b, c] = *triangle;
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let other = *owners.entry([from.min(to), from.max(to)]).or_insert(face);
            let (one, two) = (root(&roots, other), root(&roots, face));
            if one == two {
                continue;
            }
            let (x, y) = (&brep.faces[other], &brep.faces[face]);
            // Two halves of one plane may have their own normals turned against each other.
            let (Some(own), Some(next)) = (x.surface.element(), y.surface.element()) else { continue };
            let sides = match (own, next) {
                (CadShape::Plane { normal: n, .. }, CadShape::Plane { normal: m, .. }) => {
                    (x.outward == y.outward) == (n.dot(m) > 0.0)
                }
                _ => x.outward == y.outward,
            };
            if sides && own.is_same(next, SAME_MM, reach_mm) {
                roots[one.max(two)] = one.min(two);
            }
        }
    }
    roots
}
