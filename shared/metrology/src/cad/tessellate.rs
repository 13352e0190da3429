//! From faces and edges to one closed surface of triangles.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::CadMesh;
use super::bend::Bend;
use super::brep::{Bound, Brep, BrepFace};
use super::brep_error::BrepError;
use super::enclosed::folded;
use super::freeform::Freeform;
use super::shape::Surface;
use super::triangulate::{Domain, patch};
use super::whole::whole;

/// An edge has at most so many times the points that its line needs by itself.
const MOST_PARTS: f64 = 64.0;

impl Brep {
    /// Triangles within a distance of all surfaces: a closed surface that faces outwards.
    ///
    /// # Errors
    /// Edges off their curves, faces that cannot be laid out, gaps, solids inside out, too many triangles.
    pub fn mesh(&self, chord_mm: f64, limit: usize) -> Result<CadMesh, BrepError> {
        let mut corners = self.vertices.clone();
        let lines = self.lines(chord_mm, &mut corners)?;
        let mut mesh = CadMesh::default();
        for (index, face) in self.faces.iter().enumerate() {
            let triangles = Self::face(face, &lines, &mut corners, chord_mm, limit)?;
            mesh.face_of.resize(mesh.face_of.len() + triangles.len(), index as u32);
            mesh.triangles.extend(triangles);
            if mesh.triangles.len() > limit {
                return Err(BrepError::TooMany { limit, chord_mm });
            }
        }
        mesh.corners = corners;
        self.check_closed(&mesh)?;
        let volume_mm3 = mesh.volume_mm3();
        if volume_mm3 <= 0.0 {
            return Err(BrepError::InsideOut { volume_mm3 });
        }
        if let Some(index) = folded(&mesh) {
            return Err(fault(
                &self.faces[index as usize],
                "it, or one near it, is laid out on the wrong side of its border",
            ));
        }
        Ok(mesh)
    }

    /// The corners of each edge from its start to its end; new ones are added.
    fn lines(&self, chord_mm: f64, corners: &mut Vec<Point3<f64>>) -> Result<Vec<Vec<u32>>, BrepError> {
        let mut lines = Vec::with_capacity(self.edges.len());
        let beside = self.free_faces_beside();
        let bends: BTreeMap<usize, Bend> =
            beside.iter().flatten().map(|(face, free)| (*face, Bend::new(free, &self.vertices))).collect();
        for (edge, beside) in self.edges.iter().zip(&beside) {
            let [from, to] = edge.ends;
            let ends = [self.vertices[from], self.vertices[to]];
            let mut parts = 1.0;
            let between = loop {
                let between = edge.curve.between(edge.id, ends, from == to, edge.along, [chord_mm, parts])?;
                let line: Vec<Point3<f64>> =
                    [&ends[..1], &between[..], &ends[1..]].into_iter().flatten().copied().collect();
                if parts >= MOST_PARTS || !beside.iter().any(|(face, _)| bends[face].is_off(&line, chord_mm))
                {
                    break between;
                }
                parts *= 2.0;
            };
            let mut line = vec![from as u32];
            for point in between {
                line.push(corners.len() as u32);
                corners.push(point);
            }
            line.push(to as u32);
            lines.push(line);
        }
        Ok(lines)
    }

    /// The faces beside each edge that are no elements, with their surfaces.
    fn free_faces_beside(&self) -> Vec<Vec<(usize, &Freeform)>> {
        let mut beside: Vec<Vec<(usize, &Freeform)>> = vec![Vec::new(); self.edges.len()];
        for (index, face) in self.faces.iter().enumerate() {
            let Surface::Free(free) = &face.surface else { continue };
            for bound in &face.bounds {
                let Bound::Loop(edges) = bound else { continue };
                for (edge, _) in edges {
                    beside[*edge].push((index, free));
                }
            }
        }
        beside
    }

    fn face(
        face: &BrepFace,
        lines: &[Vec<u32>],
        corners: &mut Vec<Point3<f64>>,
        chord_mm: f64,
        limit: usize,
    ) -> Result<Vec<[u32; 3]>, BrepError> {
        let mut used: BTreeMap<u32, u32> = BTreeMap::new();
        let mut sides: BTreeMap<[u32; 2], i32> = BTreeMap::new();
        for bound in &face.bounds {
            match bound {
                Bound::Corner(vertex) => {
                    used.insert(*vertex as u32, 0);
                }
                Bound::Loop(edges) => {
                    for (edge, forward) in edges {
                        let line = &lines[*edge];
                        for pair in line.windows(2) {
                            let [a, b] = if *forward { [pair[0], pair[1]] } else { [pair[1], pair[0]] };
                            used.insert(a, 0);
                            used.insert(b, 0);
                            // A seam is walked forth and back, and bounds nothing.
                            *sides.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
                        }
                    }
                }
            }
        }
        let names: Vec<u32> = used.keys().copied().collect();
        for (index, name) in names.iter().enumerate() {
            used.insert(*name, index as u32);
        }
        let mut points: Vec<Point3<f64>> = names.iter().map(|name| corners[*name as usize]).collect();
        let mut border: Vec<[u32; 2]> = Vec::new();
        for ([a, b], times) in sides {
            let [a, b] = [used[&a], used[&b]];
            // The face lies on the left when it is seen from outside.
            match times * if face.outward { 1 } else { -1 } {
                0 => {}
                1 => border.push([a, b]),
                -1 => border.push([b, a]),
                _ => return Err(fault(face, "an edge bounds it twice on one side")),
            }
        }
        let surface = &face.surface;
        let (inner, triangles) = if border.is_empty() {
            points.clear();
            whole(surface, chord_mm, limit).ok_or_else(|| fault(face, "nothing bounds it"))?
        } else {
            let domain = Domain { surface, points: &points, sides: &border, chord_mm, limit };
            let patch = patch(&domain).map_err(|reason| fault(face, reason))?;
            (patch.inner, patch.triangles)
        };
        let (known, first) = (points.len() as u32, corners.len() as u32);
        corners.extend(inner);
        let name = |index: u32| if index < known { names[index as usize] } else { first + index - known };
        let turned = |[a, b, c]: [u32; 3]| if face.outward { [a, b, c] } else { [a, c, b] };
        Ok(triangles.into_iter().map(|t| turned(t.map(name))).collect())
    }

    /// Each edge of a triangle belongs to one other triangle, the other way round.
    fn check_closed(&self, mesh: &CadMesh) -> Result<(), BrepError> {
        let mut edges: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * mesh.triangles.len());
        for (triangle, face) in mesh.triangles.iter().zip(&mesh.face_of) {
            let [a, b, c] = *triangle;
            edges.extend([([a, b], *face), ([b, c], *face), ([c, a], *face)]);
        }
        edges.sort_unstable();
        let has = |edge: [u32; 2]| edges.binary_search_by_key(&edge, |e| e.0).is_ok();
        let mut open = edges.iter().filter(|([a, b], _)| !has([*b, *a])).map(|e| e.1);
        let twice = edges.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[0].1);
        let first = open.next();
        let count = usize::from(first.is_some()) + open.count();
        let doubled: Vec<u32> = twice.collect();
        match first.or(doubled.first().copied()) {
            None => Ok(()),
            Some(face) => {
                let face = &self.faces[face as usize];
                let kind = face.surface.kind();
                Err(BrepError::Open { face: face.id, kind, open: count + doubled.len() })
            }
        }
    }
}

fn fault(face: &BrepFace, reason: &'static str) -> BrepError {
    BrepError::Face { face: face.id, kind: face.surface.kind(), reason }
}
