//! From faces and edges to one closed surface of triangles.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::CadMesh;
use super::brep::{Bound, Brep, BrepError, BrepFace};
use super::shape::CadShape;
use super::triangulate::{Domain, patch};

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
        Ok(mesh)
    }

    /// The corners of each edge from its start to its end; new ones are added.
    fn lines(&self, chord_mm: f64, corners: &mut Vec<Point3<f64>>) -> Result<Vec<Vec<u32>>, BrepError> {
        let mut lines = Vec::with_capacity(self.edges.len());
        for edge in &self.edges {
            let [from, to] = edge.ends;
            let ends = [self.vertices[from], self.vertices[to]];
            let between = edge.curve.between(edge.id, ends, from == to, edge.along, chord_mm)?;
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
        let shape = &face.shape;
        let (inner, triangles) = if border.is_empty() {
            points.clear();
            whole(shape, chord_mm, limit).ok_or_else(|| fault(face, "nothing bounds it"))?
        } else {
            let domain = Domain { shape, points: &points, sides: &border, chord_mm, limit };
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
                let kind = face.shape.kind();
                Err(BrepError::Open { face: face.id, kind, open: count + doubled.len() })
            }
        }
    }
}

fn fault(face: &BrepFace, reason: &'static str) -> BrepError {
    BrepError::Face { face: face.id, kind: face.shape.kind(), reason }
}

/// Points of a surface, and triangles between them.
type Whole = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// Pieces of a circle that keep the chordal error.
fn pieces(radius_mm: f64, chord_mm: f64) -> usize {
    let step = 2.0 * fringe::math::acos((1.0 - 0.5 * chord_mm / radius_mm).clamp(0.0, 1.0));
    (std::f64::consts::TAU / step.clamp(1e-4, super::curve::ANGLE_RAD)).ceil() as usize
}

/// Sine and cosine of a whole circle's parts.
fn turn(k: usize, of: usize) -> (f64, f64) {
    fringe::math::sincos(std::f64::consts::TAU * k as f64 / of as f64)
}

/// A whole sphere or torus, which nothing bounds.
fn whole(shape: &CadShape, chord_mm: f64, limit: usize) -> Option<Whole> {
    match *shape {
        CadShape::Torus { center_mm, axis, ring_radius_mm, tube_radius_mm } => {
            whole_torus(&center_mm, &axis, [ring_radius_mm, tube_radius_mm], chord_mm, limit)
        }
        CadShape::Sphere { center_mm, radius_mm } => whole_sphere(&center_mm, radius_mm, chord_mm, limit),
        _ => None,
    }
}

fn whole_torus(
    center_mm: &Point3<f64>,
    axis: &Vector3<f64>,
    [ring_mm, tube_mm]: [f64; 2],
    chord_mm: f64,
    limit: usize,
) -> Option<Whole> {
    let [x, y] = crate::fit::tangents(axis);
    let (around, about) = (pieces(ring_mm + tube_mm, chord_mm), pieces(tube_mm, chord_mm));
    let mut points = Vec::new();
    if around.checked_mul(about)? > limit {
        return None;
    }
    for i in 0..around {
        let (sin, cos) = turn(i, around);
        let out = x * cos + y * sin;
        for j in 0..about {
            let (s, c) = turn(j, about);
            points.push(center_mm + out * (ring_mm + tube_mm * c) + axis * (tube_mm * s));
        }
    }
    let at = |i: usize, j: usize| ((i % around) * about + j % about) as u32;
    let quad = |(i, j): (usize, usize)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let all = (0..around).flat_map(|i| (0..about).map(move |j| (i, j)));
    Some((points, all.flat_map(quad).collect()))
}

fn whole_sphere(center_mm: &Point3<f64>, radius_mm: f64, chord_mm: f64, limit: usize) -> Option<Whole> {
    let around = pieces(radius_mm, chord_mm).next_multiple_of(2);
    let rings = around / 2;
    if around.checked_mul(rings)? > limit {
        return None;
    }
    let mut points = vec![center_mm + Vector3::z() * radius_mm];
    for j in 1..rings {
        let (s, c) = turn(j, around);
        for i in 0..around {
            let (sin, cos) = turn(i, around);
            points.push(center_mm + Vector3::new(s * cos, s * sin, c) * radius_mm);
        }
    }
    points.push(center_mm - Vector3::z() * radius_mm);
    let last = points.len() as u32 - 1;
    let at = |j: usize, i: usize| (1 + (j - 1) * around + i % around) as u32;
    let mut triangles = Vec::new();
    for i in 0..around {
        triangles.push([0, at(1, i), at(1, i + 1)]);
        triangles.push([last, at(rings - 1, i + 1), at(rings - 1, i)]);
        for j in 1..rings - 1 {
            let [a, b, c, d] = [at(j, i), at(j + 1, i), at(j + 1, i + 1), at(j, i + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    Some((points, triangles))
}
