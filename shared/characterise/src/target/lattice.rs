//! Prediction of lattice points from their neighbours.

use nalgebra::{Point2, Vector2};

/// Position on the lattice.
pub(crate) type Place = (i32, i32);

/// Extent of a lattice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Bounds {
    pub least: Place,
    pub most: Place,
}

impl Bounds {
    /// Number of places along u and v.
    pub fn lengths(&self) -> [i32; 2] {
        [self.most.0 - self.least.0 + 1, self.most.1 - self.least.1 + 1]
    }
}

/// Bounds of places; `None` of none.
pub(crate) fn bounds_of<'a>(places: impl Iterator<Item = &'a Place>) -> Option<Bounds> {
    places.fold(None, |bounds: Option<Bounds>, place| {
        let b = bounds.unwrap_or(Bounds { least: *place, most: *place });
        Some(Bounds {
            least: (b.least.0.min(place.0), b.least.1.min(place.1)),
            most: (b.most.0.max(place.0), b.most.1.max(place.1)),
        })
    })
}

/// The directions along a row and a column.
const AXES: [Place; 2] = [(1, 0), (0, 1)];
/// Where else a step is read, the nearest first.
const ASIDE: [i32; 5] = [0, 1, -1, 2, -2];

fn moved(place: Place, by: Place, times: i32) -> Place {
    (place.0 + by.0 * times, place.1 + by.1 * times)
}

/// Points by their place on the lattice.
pub(crate) trait Lattice {
    /// The point at a place.
    fn pixel(&self, place: Place) -> Option<Point2<f64>>;

    /// Way to the next place along u and v, px, from the nearest rows that show it.
    fn steps(&self, place: Place) -> Option<[Vector2<f64>; 2]> {
        let step = |axis: usize| {
            let (along, across) = (AXES[axis], AXES[1 - axis]);
            ASIDE.iter().find_map(|aside| {
                let at = moved(place, across, *aside);
                let here = self.pixel(at);
                let after = self.pixel(moved(at, along, 1));
                let before = self.pixel(moved(at, along, -1));
                match (before, here, after) {
                    (Some(b), _, Some(a)) => Some((a - b) * 0.5),
                    (Some(b), Some(h), None) => Some(h - b),
                    (None, Some(h), Some(a)) => Some(a - h),
                    // Beyond the margin: the step before.
                    (Some(b), None, None) => self.pixel(moved(at, along, -2)).map(|c| b - c),
                    (None, None, Some(a)) => self.pixel(moved(at, along, 2)).map(|c| c - a),
                    _ => None,
                }
            })
        };
        Some([step(0)?, step(1)?])
    }

    /// Position predicted by the neighbours of a place, without the place itself.
    fn predicted(&self, place: Place) -> Option<Point2<f64>> {
        let mut between = Vec::new();
        let mut beyond = Vec::new();
        for axis in AXES {
            let at = |times: i32| self.pixel(moved(place, axis, times));
            if let (Some(a), Some(b)) = (at(1), at(-1)) {
                between.push(nalgebra::center(&a, &b));
                continue;
            }
            for sign in [1, -1] {
                match (at(sign), at(2 * sign), at(3 * sign)) {
                    (Some(a), Some(b), Some(c)) => beyond.push(a + (a - b) * 2.0 - (b - c)),
                    (Some(a), Some(b), None) => beyond.push(a + (a - b)),
                    _ => {}
                }
            }
        }
        let estimates = if between.is_empty() { beyond } else { between };
        if estimates.is_empty() {
            return self.fourth_of_four(place);
        }
        let sum: Vector2<f64> = estimates.iter().map(|p| p.coords).sum();
        Some(Point2::from(sum / estimates.len() as f64))
    }

    /// The fourth point of a parallelogram.
    fn fourth_of_four(&self, place: Place) -> Option<Point2<f64>> {
        [(1, 1), (1, -1), (-1, 1), (-1, -1)].iter().find_map(|(u, v)| {
            let at = |u: i32, v: i32| self.pixel((place.0 + u, place.1 + v));
            Some(at(*u, 0)? + (at(0, *v)? - at(*u, *v)?))
        })
    }

    /// Curvature of the line along an axis through a place, 1/px: mean over the places around it that have both neighbours.
    ///
    /// A line s = κ t²/2 through three points at t = −h, 0, h has s₋ − 2s₀ + s₊ = κ h²; s is counted from the first axis
    /// towards the second of the image, as the corner model does.
    fn mean_curvature(&self, place: Place, axis: usize) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for u in -2..=2 {
            for v in -2..=2 {
                let at = (place.0 + u, place.1 + v);
                let on = |times: i32| self.pixel(moved(at, AXES[axis], times));
                if let (Some(before), Some(here), Some(after)) = (on(-1), on(0), on(1)) {
                    let way = (after - before) * 0.5;
                    let bend = (after - here) - (here - before);
                    let length = way.norm();
                    sum += way.perp(&bend) / (length * length * length);
                    count += 1.0;
                }
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }
}
