//! The surface of a part in small pieces.

use super::error::{MOST_ELEMENTS, ViewPlanError};
use crate::spatial::{Triangle, TriangleMesh};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// A point this far above a face is outside of a body of its own, mm.
pub(super) const SKIN_MM: f64 = 1e-4;

/// Directions in which bodies are counted, no two of them in a plane that parts are built along; two of three decide.
const COUNTED: [[f64; 3]; 3] = [[0.213, 0.377, 0.901], [-0.817, 0.523, 0.243], [0.331, -0.887, -0.321]];

/// Steps of a normal's components within which pieces are joined.
const NORMAL_STEPS: f64 = 4.0;

/// A piece of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Element {
    /// Middle of the element, mm.
    pub at: Point3<f64>,
    /// Its outward unit normal.
    pub normal: Vector3<f64>,
    /// Area of the element, mm².
    pub area_mm2: f64,
    /// Whether it lies within another body of the part, where nothing can see it.
    pub buried: bool,
}

/// Halves triangles at their longest side until no side is longer than `element_mm`, and joins pieces that are much smaller: a curved face of a
/// thousand facets needs no thousand elements. A joined element stands at the piece nearest to the middle of all.
///
/// # Errors
/// More than four million of them.
pub fn elements(mesh: &TriangleMesh, element_mm: f64) -> Result<Vec<Element>, ViewPlanError> {
    let mut found = Vec::new();
    for triangle in mesh.triangles() {
        divide(triangle, element_mm, &mut found);
        if found.len() > MOST_ELEMENTS {
            let area_mm2 = mesh.triangles().iter().map(|t| area_mm2(&t.corners)).sum();
            return Err(ViewPlanError::TooMany { element_mm, area_mm2 });
        }
    }
    let mut found = joined(&found, element_mm);
    found.par_iter_mut().for_each(|element| element.buried = is_buried(mesh, element));
    Ok(found)
}

/// The cell of a piece, and its normal in steps of a quarter: what meets at an edge stays apart.
fn cell(piece: &Element, element_mm: f64) -> [i64; 6] {
    let place = piece.at.coords.map(|c| (c / element_mm).floor() as i64);
    let normal = piece.normal.map(|c| (NORMAL_STEPS * c).round() as i64);
    [place.x, place.y, place.z, normal.x, normal.y, normal.z]
}

/// One element for all pieces of a cell.
fn joined(pieces: &[Element], element_mm: f64) -> Vec<Element> {
    let mut order: Vec<([i64; 6], u32)> =
        pieces.iter().enumerate().map(|(index, piece)| (cell(piece, element_mm), index as u32)).collect();
    order.sort_unstable();
    let one = |same: &[([i64; 6], u32)]| {
        let all = || same.iter().map(|(_, index)| &pieces[*index as usize]);
        let area_mm2: f64 = all().map(|piece| piece.area_mm2).sum();
        let moment: Vector3<f64> = all().map(|piece| piece.at.coords * piece.area_mm2).sum();
        let middle = Point3::from(moment / area_mm2);
        let distance = |piece: &Element| (piece.at - middle).norm_squared();
        let nearest = all().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.map(|piece| Element { area_mm2, ..*piece })
    };
    order.chunk_by(|a, b| a.0 == b.0).filter_map(one).collect()
}

fn area_mm2([a, b, c]: &[Point3<f64>; 3]) -> f64 {
    0.5 * (b - a).cross(&(c - a)).norm()
}

/// Appends the pieces of a triangle; stops where there are too many.
fn divide(triangle: &Triangle, element_mm: f64, out: &mut Vec<Element>) {
    let mut open = vec![triangle.corners];
    while let Some([a, b, c]) = open.pop() {
        let sides = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
        let longest = (0..3).fold(0, |best, side| if sides[side] > sides[best] { side } else { best });
        if sides[longest] <= element_mm {
            let at = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            out.push(Element { at, normal: triangle.normal, area_mm2: area_mm2(&[a, b, c]), buried: false });
            if out.len() > MOST_ELEMENTS {
                return;
            }
            continue;
        }
        let [from, to, opposite] = [[a, b, c], [b, c, a], [c, a, b]][longest];
        let middle = nalgebra::center(&from, &to);
        open.push([middle, to, opposite]);
        open.push([from, middle, opposite]);
    }
}

/// Whether the place just above an element lies in a body.
fn is_buried(mesh: &TriangleMesh, element: &Element) -> bool {
    let above = element.at + element.normal * SKIN_MM;
    let within = COUNTED.iter().filter(|direction| {
        let direction = Vector3::from(**direction).normalize();
        mesh.bodies_around(&above, &direction) > 0
    });
    within.count() >= 2
}
