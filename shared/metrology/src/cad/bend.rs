//! How a surface turns along the edges of its faces: edges get points where it does, for triangles cannot divide them.

use nalgebra::{Point3, Vector3};

use super::freeform::{Freeform, normal_of};
use super::inverse::{Part, Places};

/// Cosine of the largest angle that a surface turns by along a piece of an edge.
const TURN_COSINE: f64 = 0.99;

/// Places along a piece that are looked at.
const LOOKS: u32 = 4;

/// Pieces below this many distances may turn: creases within a surface have no normal.
const CREASE: f64 = 8.0;

/// A surface with the places from which searches begin.
pub(super) struct Bend {
    part: Part,
    places: Places,
}

impl Bend {
    /// A surface whose faces have these corners.
    pub fn new(surface: &Freeform, corners: &[Point3<f64>]) -> Self {
        let part = Part::new(surface, corners);
        let places = part.places();
        Self { part, places }
    }

    /// Whether the surface turns too much along a piece of a line on it.
    pub fn is_off(&self, line: &[Point3<f64>], chord_mm: f64) -> bool {
        let Some(first) = line.first() else { return false };
        let (mut place, _) = self.part.nearest(&self.places, first);
        for pair in line.windows(2) {
            let start = self.normal(place);
            let is_short = (pair[1] - pair[0]).norm() <= CREASE * chord_mm;
            for k in 1..=LOOKS {
                let point = pair[0].lerp(&pair[1], f64::from(k) / f64::from(LOOKS));
                place = self.part.foot(&point, place).0;
                let normal = self.normal(place);
                let has_both = start.norm_squared() > 0.5 && normal.norm_squared() > 0.5;
                if !is_short && has_both && start.dot(&normal) < TURN_COSINE {
                    return true;
                }
            }
        }
        false
    }

    fn normal(&self, place: [f64; 2]) -> Vector3<f64> {
        normal_of(&self.part.at(place).1)
    }
}
