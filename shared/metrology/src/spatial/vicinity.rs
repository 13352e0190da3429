//! The points around places that lie near each other, found once for all of them and looked at side by side.

#[cfg(test)]
mod tests;

use super::bvh::Aabb;
use super::local::{Moments, Patch};
use super::points::PointTree;
use crate::fit::Normal;
use fearless_simd::{Level, dispatch};
use nalgebra::{Point3, SMatrix, SVector, Vector3};
use std::ops::Range;

/// Places looked at together: as many numbers as the widest instructions take at a time.
pub(super) const PLACES: usize = 8;

/// A number for each of the places.
pub(super) type Lanes = [f64; PLACES];

/// Numbers for each of the places.
type Rows<const N: usize> = [Lanes; N];

/// Surroundings whose normals differ by more than 60° belong to another side of the part: the far side of a thin wall.
const OTHER_SIDE_COSINE: f64 = 0.5;

/// Terms of a paraboloid: 1, u, v, u², uv, v².
const TERMS: usize = 6;

/// Place of the product of two terms among 1, u, v, u², uv, v², u³, u²v, uv², v³, u⁴, u³v, u²v², uv³, v⁴.
const PRODUCTS: [[usize; TERMS]; TERMS] = [
    [0, 1, 2, 3, 4, 5],
    [1, 3, 4, 6, 7, 8],
    [2, 4, 5, 7, 8, 9],
    [3, 6, 7, 10, 11, 12],
    [4, 7, 8, 11, 12, 13],
    [5, 8, 9, 12, 13, 14],
];

/// A point that lies around at least one of the places.
struct Near {
    place: [f64; 3],
    /// 1 for each place that it lies around, else 0.
    share: Lanes,
}

/// A place with the normal of the surface there, zero where it is not known.
pub(crate) type Place = (Point3<f64>, [f32; 3]);

/// The places, and what the points around them are compared with.
struct Places {
    /// Coordinates, mm; those of idle lanes are those of the first place.
    origin: Rows<3>,
    /// Normals; zero where there are none.
    normal: Rows<3>,
    /// Least product with a unit normal.
    least: Lanes,
    radius2: f64,
}

/// Sums over the points around each place.
struct Sums {
    count: Lanes,
    first: Rows<3>,
    second: Rows<6>,
    normal: Rows<3>,
}

/// Scratch of one thread: the points around up to [`PLACES`] places.
pub(crate) struct Vicinity {
    level: Level,
    leaves: Vec<Range<usize>>,
    near: Vec<Near>,
    places: Places,
    sums: Sums,
}

impl Vicinity {
    /// Around no places yet.
    pub fn new() -> Self {
        let none = [0.0; PLACES];
        Self {
            level: Level::new(),
            leaves: Vec::new(),
            near: Vec::new(),
            places: Places { origin: [none; 3], normal: [none; 3], least: none, radius2: 0.0 },
            sums: Sums { count: none, first: [none; 3], second: [none; 6], normal: [none; 3] },
        }
    }

    /// Finds the points of a tree around at most [`PLACES`] places that belong to the same side of the part. Each place comes with its
    /// normal, `normals` are those of all slots, or none; what has no normal (zero) belongs to every side.
    pub fn gather(&mut self, tree: &PointTree, normals: &[[f32; 3]], places: &[Place], radius_mm: f64) {
        let Some(first) = places.first() else { return };
        for lane in 0..PLACES {
            let (at, normal) = places.get(lane).unwrap_or(first);
            let normal = normal.map(f64::from);
            for axis in 0..3 {
                self.places.origin[axis][lane] = at[axis];
                self.places.normal[axis][lane] = normal[axis];
            }
            self.places.least[lane] = OTHER_SIDE_COSINE * Vector3::from(normal).norm();
        }
        self.places.radius2 = radius_mm * radius_mm;
        self.leaves.clear();
        let held = places.iter().fold(Aabb::of(&[]), |b, (at, _)| b.join(&Aabb::of(&[*at])));
        let reach = Vector3::repeat(radius_mm);
        // Where rounding moves a border, the squares below decide as they would have.
        let grown = Aabb { low: held.low - reach * 1.000_001, high: held.high + reach * 1.000_001 };
        tree.leaves(|b| b.meets(&grown), |leaf| self.leaves.push(leaf));
        self.near.clear();
        let (sites, leaves, places, near) = (tree.sites(), &self.leaves, &self.places, &mut self.near);
        self.sums = dispatch!(self.level, _simd => places.sums(sites, normals, leaves, near));
    }

    /// Number of the points around a place.
    pub fn count(&self, lane: usize) -> usize {
        self.sums.count[lane] as usize
    }

    /// Moments about a place of the points around it.
    pub fn moments(&self, lane: usize) -> Moments {
        Moments::of_sums(
            self.origin(lane),
            self.count(lane),
            Vector3::from(self.sums.first.map(|row| row[lane])),
            self.sums.second.map(|row| row[lane]),
        )
    }

    /// Sum of the normals of the points around a place.
    pub fn normal(&self, lane: usize) -> Vector3<f64> {
        Vector3::from(self.sums.normal.map(|row| row[lane]))
    }

    fn origin(&self, lane: usize) -> Point3<f64> {
        Point3::from(self.places.origin.map(|row| row[lane]))
    }

    /// The surfaces through the points around the first places; none where they are too few.
    pub fn patches(&self, places: usize) -> [Option<Patch>; PLACES] {
        let mut patches: [Option<Patch>; PLACES] =
            std::array::from_fn(|lane| if lane < places { Patch::plane(&self.moments(lane)) } else { None });
        let mut frame = [[[0.0; PLACES]; 3]; 3];
        for (lane, patch) in patches.iter().enumerate() {
            let Some(patch) = patch else { continue };
            for (rows, axis) in frame.iter_mut().zip(patch.frame()) {
                for (row, value) in rows.iter_mut().zip(&axis) {
                    row[lane] = *value;
                }
            }
        }
        let scale = 1.0 / self.places.radius2.sqrt();
        let (origin, near) = (&self.places.origin, &self.near);
        let heights = dispatch!(self.level, _simd => heights(near, origin, &frame, scale));
        for (lane, patch) in patches.iter_mut().enumerate() {
            if let Some(patch) = patch {
                patch.bend(&heights.normal(lane), self.count(lane), scale);
            }
        }
        patches
    }
}

impl Places {
    /// Sums over the points of some leaves that lie around each place, and those that lie around any.
    #[inline(always)]
    fn sums(
        &self,
        sites: &[Point3<f64>],
        normals: &[[f32; 3]],
        leaves: &[Range<usize>],
        near: &mut Vec<Near>,
    ) -> Sums {
        let none = [0.0; PLACES];
        let mut sums = Sums { count: none, first: [none; 3], second: [none; 6], normal: [none; 3] };
        for slot in leaves.iter().cloned().flatten() {
            let place = [sites[slot].x, sites[slot].y, sites[slot].z];
            let away = away(&place, &self.origin);
            let mut share = within(&away, self.radius2);
            if let Some(normal) = normals.get(slot) {
                let normal = normal.map(f64::from);
                let length = (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]).sqrt();
                self.keep_same_side(&normal, length, &mut share);
                for (sum, along) in sums.normal.iter_mut().zip(normal) {
                    add_products(sum, &share, &[along; PLACES]);
                }
            }
            if share == none {
                continue;
            }
            sums.add(&away, &share);
            near.push(Near { place, share });
        }
        sums
    }

    /// Takes its share from a point whose normal belongs to another side; those without a normal stay.
    #[inline(always)]
    fn keep_same_side(&self, normal: &[f64; 3], length: f64, share: &mut Lanes) {
        let [x, y, z] = &self.normal;
        for lane in 0..PLACES {
            let along = x[lane] * normal[0] + y[lane] * normal[1] + z[lane] * normal[2];
            share[lane] = if along >= self.least[lane] * length { share[lane] } else { 0.0 };
        }
    }
}

impl Sums {
    /// Adds a point at a distance from each place, for those that it lies around.
    #[inline(always)]
    fn add(&mut self, away: &Rows<3>, share: &Lanes) {
        let one = [1.0; PLACES];
        add_products(&mut self.count, share, &one);
        let shared = [product(&away[0], share), product(&away[1], share), product(&away[2], share)];
        for (sum, along) in self.first.iter_mut().zip(&shared) {
            add_products(sum, along, &one);
        }
        let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        for (sum, (a, b)) in self.second.iter_mut().zip(pairs) {
            add_products(sum, &shared[a], &shared[b]);
        }
    }
}

/// Moments of the tangent coordinates, and of these with the heights.
struct Heights {
    moments: Rows<15>,
    height: Rows<TERMS>,
}

impl Heights {
    /// Normal equations of a place's paraboloid, whose residuals are the heights below it.
    fn normal(&self, lane: usize) -> Normal<TERMS> {
        let moment = |r: usize, c: usize| self.moments[PRODUCTS[r][c]][lane];
        Normal::of_sums(SMatrix::from_fn(moment), SVector::from_fn(|r, _| -self.height[r][lane]))
    }
}

/// Sums over the points around each place, in frames (two tangents and the normal) and lengths of its own; frames of zeros give nothing.
#[inline(always)]
fn heights(near: &[Near], origin: &Rows<3>, frame: &[Rows<3>; 3], scale: f64) -> Heights {
    let none = [0.0; PLACES];
    let mut sums = Heights { moments: [none; 15], height: [none; TERMS] };
    for point in near {
        let away = away(&point.place, origin);
        let scaled = scaled(&point.share, scale);
        let u = product(&along(&frame[0], &away), &scaled);
        let v = product(&along(&frame[1], &away), &scaled);
        let h = product(&along(&frame[2], &away), &point.share);
        let (uu, uv, vv) = (product(&u, &u), product(&u, &v), product(&v, &v));
        let terms = [&point.share, &u, &v, &uu, &uv, &vv];
        for (sum, term) in sums.height.iter_mut().zip(terms) {
            add_products(sum, term, &h);
        }
        let one = [1.0; PLACES];
        for (sum, term) in sums.moments.iter_mut().zip(terms) {
            add_products(sum, term, &one);
        }
        let higher = [(&uu, &u), (&uu, &v), (&u, &vv), (&vv, &v)];
        for (sum, (a, b)) in sums.moments[6..10].iter_mut().zip(higher) {
            add_products(sum, a, b);
        }
        let highest = [(&uu, &uu), (&uu, &uv), (&uu, &vv), (&uv, &vv), (&vv, &vv)];
        for (sum, (a, b)) in sums.moments[10..].iter_mut().zip(highest) {
            add_products(sum, a, b);
        }
    }
    sums
}

/// A point as seen from each place.
#[inline(always)]
fn away(place: &[f64; 3], origin: &Rows<3>) -> Rows<3> {
    let mut away = [[0.0; PLACES]; 3];
    for axis in 0..3 {
        for lane in 0..PLACES {
            away[axis][lane] = place[axis] - origin[axis][lane];
        }
    }
    away
}

/// 1 where the square of a distance is no larger than this, else 0.
#[inline(always)]
fn within([x, y, z]: &Rows<3>, radius2: f64) -> Lanes {
    let mut share = [0.0; PLACES];
    for lane in 0..PLACES {
        let square = x[lane] * x[lane] + y[lane] * y[lane] + z[lane] * z[lane];
        share[lane] = if square <= radius2 { 1.0 } else { 0.0 };
    }
    share
}

/// Products with a direction.
#[inline(always)]
fn along(direction: &Rows<3>, away: &Rows<3>) -> Lanes {
    let mut along = [0.0; PLACES];
    for lane in 0..PLACES {
        along[lane] = direction[0][lane] * away[0][lane]
            + direction[1][lane] * away[1][lane]
            + direction[2][lane] * away[2][lane];
    }
    along
}

#[inline(always)]
fn product(a: &Lanes, b: &Lanes) -> Lanes {
    let mut all = [0.0; PLACES];
    for lane in 0..PLACES {
        all[lane] = a[lane] * b[lane];
    }
    all
}

#[inline(always)]
fn scaled(a: &Lanes, factor: f64) -> Lanes {
    let mut all = [0.0; PLACES];
    for lane in 0..PLACES {
        all[lane] = a[lane] * factor;
    }
    all
}

#[inline(always)]
fn add_products(sums: &mut Lanes, a: &Lanes, b: &Lanes) {
    for lane in 0..PLACES {
        sums[lane] += a[lane] * b[lane];
    }
}
