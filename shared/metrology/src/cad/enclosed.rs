//! Whether triangles enclose what their faces say: a face laid out on the wrong side of its border closes as well, but then the surface
//! passes through itself.

use super::CadMesh;
use fringe::math::atan2;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Faces that are asked, at most and at least, and the solid angles that this may take.
const MOST: usize = 64;
const LEAST: usize = 8;
const ANGLES: usize = 30_000_000;
/// Distance from a triangle at which is asked, over the root of its area.
const OUTSIDE: f64 = 1e-3;

/// A face of which the surface just outside lies within the solid, by its index; the largest triangles of some faces are asked.
pub(super) fn folded(mesh: &CadMesh) -> Option<u32> {
    let mut largest: Vec<(u32, f64, usize)> = Vec::new();
    for (number, face) in mesh.face_of.iter().enumerate() {
        let area = cross(&triangle(mesh, number)).norm();
        match largest.last_mut() {
            Some(last) if last.0 == *face => {
                if area > last.1 {
                    (last.1, last.2) = (area, number);
                }
            }
            _ => largest.push((*face, area, number)),
        }
    }
    let asked = (ANGLES / mesh.triangles.len().max(1)).clamp(LEAST, MOST);
    largest.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    largest.truncate(asked);
    let inside = |(face, area, number): &(u32, f64, usize)| {
        let corners = triangle(mesh, *number);
        let middle = Point3::from((corners[0].coords + corners[1].coords + corners[2].coords) / 3.0);
        let outside = middle + cross(&corners) * (OUTSIDE * area.sqrt() / area);
        (turns(mesh, &outside).abs() > 0.5).then_some(*face)
    };
    largest.par_iter().filter_map(inside).min()
}

/// How often the surface goes round a place: 1 inside, 0 outside (van Oosterom and Strackee 1983).
fn turns(mesh: &CadMesh, place: &Point3<f64>) -> f64 {
    let angle = |number: usize| {
        let [a, b, c] = triangle(mesh, number).map(|corner| corner - place);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * atan2(a.dot(&b.cross(&c)), below)
    };
    (0..mesh.triangles.len()).map(angle).sum::<f64>() / (2.0 * TAU)
}

fn triangle(mesh: &CadMesh, number: usize) -> [Point3<f64>; 3] {
    mesh.triangles[number].map(|corner| mesh.corners[corner as usize])
}

/// Normal of a triangle with the length of twice its area.
fn cross([a, b, c]: &[Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}
