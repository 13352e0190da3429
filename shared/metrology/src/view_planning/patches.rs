//! Connected pieces of the surface that no pair sees.

use super::elements::Element;
use super::seeing::{Cause, Seeing};
use nalgebra::{Point3, Vector3};
use serde::Serialize;
use std::collections::BTreeMap;

/// Elements in cells of so many sizes of an element are neighbours when their cells are.
const CELL: f64 = 1.5;

/// Cosine of the largest angle between the normals of neighbouring cells of one patch: 60°.
const SAME_FACE: f64 = 0.5;

/// A piece of the surface that no pair sees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Patch {
    /// Area of the piece, mm².
    pub area_mm2: f64,
    /// Its centroid, mm in the world frame.
    pub centre_mm: [f64; 3],
    /// Its mean unit normal; zeros where the normals cancel.
    pub normal: [f64; 3],
    /// What keeps most of it from being seen.
    pub cause: Cause,
}

/// Sums over the elements of a cell, or of a patch.
#[derive(Clone, Copy)]
struct Sums {
    area_mm2: f64,
    moment: Vector3<f64>,
    normal: Vector3<f64>,
    causes: [f64; Cause::ALL.len()],
}

impl Sums {
    const NONE: Self = Self {
        area_mm2: 0.0,
        moment: Vector3::new(0.0, 0.0, 0.0),
        normal: Vector3::new(0.0, 0.0, 0.0),
        causes: [0.0; Cause::ALL.len()],
    };

    fn add(&mut self, other: &Self) {
        self.area_mm2 += other.area_mm2;
        self.moment += other.moment;
        self.normal += other.normal;
        self.causes.iter_mut().zip(other.causes).for_each(|(sum, area)| *sum += area);
    }

    fn patch(&self) -> Patch {
        let most = Cause::ALL
            .into_iter()
            .max_by(|a, b| self.causes[*a as usize].total_cmp(&self.causes[*b as usize]).then(b.cmp(a)));
        Patch {
            area_mm2: self.area_mm2,
            centre_mm: Point3::from(self.moment / self.area_mm2).coords.into(),
            normal: self.normal.try_normalize(1e-9).unwrap_or_else(Vector3::zeros).into(),
            cause: most.unwrap_or(Cause::Outside),
        }
    }
}

/// The place of a cell, and the main direction of its normals: faces that meet at an edge are different cells.
type Cell = ([i64; 3], u8);

/// The pieces that no pair sees, the largest first; `seeing` has all pairs of each element.
pub fn patches(elements: &[Element], seeing: &[Seeing], pairs: usize, element_mm: f64) -> Vec<Patch> {
    let mut cells: BTreeMap<Cell, Sums> = BTreeMap::new();
    for (element, seeing) in elements.iter().zip(seeing.chunks(pairs.max(1))) {
        let Some(best) = seeing.iter().map(|seeing| seeing.cause).max() else { continue };
        if best == Cause::Seen || element.buried {
            continue;
        }
        let mut sums = Sums {
            area_mm2: element.area_mm2,
            moment: element.at.coords * element.area_mm2,
            normal: element.normal * element.area_mm2,
            ..Sums::NONE
        };
        sums.causes[best as usize] = element.area_mm2;
        let axis = element.normal.iamax();
        let direction = 2 * axis as u8 + u8::from(element.normal[axis] > 0.0);
        let place = element.at.coords.map(|c| (c / (CELL * element_mm)).floor() as i64);
        cells.entry((place.into(), direction)).or_insert(Sums::NONE).add(&sums);
    }
    let mut found = Vec::new();
    while let Some((cell, sums)) = cells.pop_first() {
        found.push(connected(&mut cells, cell, sums).patch());
    }
    found.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    found
}

/// Takes a cell and all that it is connected with.
fn connected(cells: &mut BTreeMap<Cell, Sums>, cell: Cell, sums: Sums) -> Sums {
    let mut whole = Sums::NONE;
    let mut open = vec![(cell, sums)];
    while let Some((([x, y, z], _), sums)) = open.pop() {
        whole.add(&sums);
        for step in 0..27 * 6 {
            let (near, direction) = (step / 6, (step % 6) as u8);
            let place = [x + near / 9 - 1, y + near / 3 % 3 - 1, z + near % 3 - 1];
            let agrees = cells.get(&(place, direction)).is_some_and(|other| {
                other.normal.dot(&sums.normal) > SAME_FACE * other.normal.norm() * sums.normal.norm()
            });
            if agrees && let Some(other) = cells.remove(&(place, direction)) {
                open.push(((place, direction), other));
            }
        }
    }
    whole
}
