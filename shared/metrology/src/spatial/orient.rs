//! Which way the triangles of a mesh face: neighbours alike, closed bodies outwards.

use super::error::MeshError;
use super::topology::{corner_names, edges};
use nalgebra::{Point3, Vector3};

/// A body whose volume is below this part of the cube of its size encloses nothing: its outside cannot be determined.
const FLAT: f64 = 1e-9;

/// Triangles that hang together over edges with two owners.
struct Body {
    triangles: Vec<u32>,
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// Six times the signed volume, with all triangles facing alike; `None` for an open or flat body.
    volume6: Option<f64>,
}

impl Body {
    fn holds(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.low[axis] < other.low[axis] && self.high[axis] > other.high[axis])
    }

    /// Closed, and its volume shows that it is turned inside out.
    fn inside_out(&self) -> bool {
        self.volume6.is_some_and(|volume| volume < 0.0)
    }
}

/// Turns triangles round until neighbours face the same way and closed bodies outwards, cavities in them inwards; of an open
/// body the side on which more area faces stays. Returns how many were turned.
///
/// # Errors
/// A surface with one side only, such as a Möbius strip: it has no outside.
pub(super) fn orient(corners: &mut [[Point3<f64>; 3]]) -> Result<usize, MeshError> {
    let names = corner_names(corners);
    let (neighbours, open) = neighbours(&names);
    let mut turned = vec![false; corners.len()];
    let mut known = vec![false; corners.len()];
    let mut bodies = Vec::new();
    for first in 0..corners.len() as u32 {
        if known[first as usize] {
            continue;
        }
        let members = spread(first, &neighbours, &mut turned, &mut known)?;
        let area = |of: bool| -> f64 {
            let chosen = members.iter().filter(|t| turned[**t as usize] == of);
            chosen.map(|t| area(&corners[*t as usize])).sum()
        };
        if area(true) > area(false) {
            for member in &members {
                turned[*member as usize] ^= true;
            }
        }
        bodies.push(body(members, corners, &turned, &open));
    }
    for index in 0..bodies.len() {
        let body = &bodies[index];
        // A cavity faces inwards, and is turned where its body is.
        let around = bodies.iter().enumerate().find(|(i, other)| {
            *i != index
                && other.volume6.is_some()
                && other.holds(body)
                && !bodies.iter().any(|o| o.volume6.is_some() && o.holds(other))
        });
        let turn = match around {
            Some((_, outer)) => outer.inside_out() && body.volume6.is_some(),
            None => body.inside_out(),
        };
        if turn {
            body.triangles.iter().for_each(|t| turned[*t as usize] ^= true);
        }
    }
    for (corners, _) in corners.iter_mut().zip(&turned).filter(|(_, turned)| **turned) {
        corners.swap(1, 2);
    }
    Ok(turned.iter().filter(|t| **t).count())
}

/// Pairs of triangles that share an edge, both ways, in order, with whether they face alike; and which triangles have an
/// edge without exactly two owners.
fn neighbours(names: &[[u32; 3]]) -> (Vec<(u32, u32, bool)>, Vec<bool>) {
    let mut pairs = Vec::new();
    let mut open = vec![false; names.len()];
    let forward = |item: u32, edge: u8| {
        let of = names[item as usize];
        of[edge as usize] < of[(edge as usize + 1) % 3]
    };
    for same in edges(names).chunk_by(|a, b| a.0 == b.0) {
        let [(_, a, edge_a), (_, b, edge_b)] = same else {
            for (_, item, _) in same {
                open[*item as usize] = true;
            }
            continue;
        };
        // Neighbours that face alike run along their edge in opposite directions.
        let alike = forward(*a, *edge_a) != forward(*b, *edge_b);
        pairs.extend([(*a, *b, alike), (*b, *a, alike)]);
    }
    pairs.sort_unstable();
    (pairs, open)
}

/// The triangles that hang together with one, each turned so that it faces like its neighbours.
fn spread(
    first: u32,
    neighbours: &[(u32, u32, bool)],
    turned: &mut [bool],
    known: &mut [bool],
) -> Result<Vec<u32>, MeshError> {
    known[first as usize] = true;
    let mut members = vec![first];
    let mut next = 0;
    while let Some(here) = members.get(next).copied() {
        next += 1;
        let from = neighbours.partition_point(|(item, ..)| *item < here);
        for (_, other, alike) in neighbours[from..].iter().take_while(|(item, ..)| *item == here) {
            let wanted = turned[here as usize] ^ !alike;
            if !known[*other as usize] {
                known[*other as usize] = true;
                turned[*other as usize] = wanted;
                members.push(*other);
            } else if turned[*other as usize] != wanted {
                return Err(MeshError::OneSided { triangle: *other as usize });
            }
        }
    }
    members.sort_unstable();
    Ok(members)
}

fn area(corners: &[Point3<f64>; 3]) -> f64 {
    let [a, b, c] = corners;
    (b - a).cross(&(c - a)).norm()
}

fn body(triangles: Vec<u32>, corners: &[[Point3<f64>; 3]], turned: &[bool], open: &[bool]) -> Body {
    let all = || triangles.iter().map(|t| &corners[*t as usize]);
    let points = || all().flatten().map(|p| p.coords);
    let low = points().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(&p));
    let high = points().fold(Vector3::repeat(f64::NEG_INFINITY), |high, p| high.sup(&p));
    let middle = (low + high) * 0.5;
    let of_one = |t: &u32| {
        let [a, b, c] = corners[*t as usize].map(|p| p.coords - middle);
        let volume6 = a.dot(&b.cross(&c));
        if turned[*t as usize] { -volume6 } else { volume6 }
    };
    let closed = triangles.iter().all(|t| !open[*t as usize]);
    let volume6: f64 = triangles.iter().map(of_one).sum();
    let size = (high - low).norm();
    let volume6 = (closed && volume6.abs() > FLAT * size * size * size).then_some(volume6);
    Body { triangles, low, high, volume6 }
}

#[cfg(test)]
mod tests {
    use super::super::mesh::TriangleMesh;
    use super::*;

    /// A box about the origin as twelve triangles, half its edges given.
    fn cuboid(half: [f64; 3]) -> Vec<[Point3<f64>; 3]> {
        let corner = |i: usize| {
            let side = |bit: usize, half: f64| if i >> bit & 1 == 1 { half } else { -half };
            Point3::new(side(0, half[0]), side(1, half[1]), side(2, half[2]))
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|t| t.map(corner)).collect()
    }

    fn inverted(mut triangles: Vec<[Point3<f64>; 3]>) -> Vec<[Point3<f64>; 3]> {
        for triangle in &mut triangles {
            triangle.swap(1, 2);
        }
        triangles
    }

    fn at(mesh: &TriangleMesh, x: f64) -> f64 {
        mesh.nearest(&Point3::new(x, 0.1, 0.2), f64::INFINITY).unwrap().signed_mm
    }

    #[test]
    fn an_inverted_or_mixed_body_faces_outwards() {
        let sound = cuboid([1.0, 1.5, 2.0]);
        for (count, triangles) in [(0, sound.clone()), (12, inverted(sound.clone()))] {
            let mesh = TriangleMesh::new(&triangles).unwrap();
            assert_eq!(mesh.turned(), count);
            assert!((at(&mesh, 3.0) - 2.0).abs() < 1e-12 && (at(&mesh, 0.5) + 0.5).abs() < 1e-12);
        }
        for wrong in 0..12 {
            let mut mixed = sound.clone();
            mixed[wrong].swap(0, 1);
            mixed[(wrong + 5) % 12].swap(1, 2);
            let mesh = TriangleMesh::new(&mixed).unwrap();
            assert_eq!(mesh.turned(), 2, "{wrong}");
            assert!((at(&mesh, 3.0) - 2.0).abs() < 1e-12);
        }
    }

    #[test]
    fn each_body_is_oriented_alone_and_a_cavity_faces_its_hollow() {
        let away = |triangles: Vec<[Point3<f64>; 3]>| -> Vec<[Point3<f64>; 3]> {
            triangles.iter().map(|t| t.map(|p| p + Vector3::new(20.0, 0.0, 0.0))).collect()
        };
        let two = [cuboid([3.0; 3]), away(inverted(cuboid([1.0; 3])))].concat();
        let mesh = TriangleMesh::new(&two).unwrap();
        assert_eq!(mesh.turned(), 12);
        assert!((at(&mesh, 18.0) - 1.0).abs() < 1e-12 && (at(&mesh, 4.0) - 1.0).abs() < 1e-12);
        let hollow = [cuboid([3.0; 3]), inverted(cuboid([1.0; 3]))].concat();
        for (turned, triangles) in [(0, hollow.clone()), (24, inverted(hollow))] {
            let mesh = TriangleMesh::new(&triangles).unwrap();
            assert_eq!(mesh.turned(), turned);
            // In the wall, outside, in the hollow.
            assert!(at(&mesh, 2.5) < 0.0 && at(&mesh, 4.0) > 0.0 && at(&mesh, 0.5) > 0.0);
        }
    }

    #[test]
    fn an_open_surface_keeps_the_side_of_its_larger_part() {
        let mut open = cuboid([1.0, 1.5, 2.0]);
        open.truncate(10);
        assert_eq!(TriangleMesh::new(&open).unwrap().turned(), 0);
        open[3].swap(0, 2);
        assert_eq!(TriangleMesh::new(&open).unwrap().turned(), 1);
    }

    #[test]
    fn a_surface_with_one_side_is_refused() {
        // Five triangles in a ring, turned over once: Möbius' own.
        let place = |i: usize| {
            let (sin, cos) = fringe::math::sincos(std::f64::consts::TAU * i as f64 / 5.0);
            Point3::new(cos, sin, 0.3 * (i * i % 5) as f64)
        };
        let strip: Vec<_> = (0..5).map(|i| [place(i), place((i + 1) % 5), place((i + 2) % 5)]).collect();
        let error = TriangleMesh::new(&strip).unwrap_err();
        assert!(matches!(error, MeshError::OneSided { .. }), "{error}");
        assert!(error.to_string().contains("one side"));
    }
}
