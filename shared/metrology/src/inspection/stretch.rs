//! Some points in a row, eight side by side: where they lie, how their surface turns, and which of them a region holds.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x8, mask64x8};
use nalgebra::{Matrix3, Point3, Vector3};

use super::bounds::Bounds;
use super::geometry::{Exclusion, ExclusionShape, Geometry};
use super::region::Region;
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;

/// Points in a row that share a box: a piece of an image row, which is short and thin.
pub(super) const STRETCH: usize = 32;
const LANES: usize = 8;

/// Positions, mm, coordinate by coordinate; beyond the last one the first is repeated.
pub(super) struct Stretch {
    level: Level,
    places: [[f64; STRETCH]; 3],
    /// Unit normals, zero where a point has none; only where they were asked for.
    normals: [[f64; STRETCH]; 3],
    count: usize,
}

impl Stretch {
    /// For points that are still to come.
    pub fn new() -> Self {
        let nothing = [[0.0; STRETCH]; 3];
        Self { level: Level::new(), places: nothing, normals: nothing, count: 0 }
    }

    /// Takes up to 32 positions, one at least.
    pub fn fill(&mut self, positions: impl ExactSizeIterator<Item = Vector3<f64>>) {
        self.count = positions.len().min(STRETCH);
        for (k, position) in positions.take(STRETCH).enumerate() {
            for axis in 0..3 {
                self.places[axis][k] = position[axis];
            }
        }
        for row in &mut self.places {
            let first = row[0];
            row[self.count..].fill(first);
        }
    }

    /// Takes the normals of the points whose positions it has.
    pub fn fill_normals(&mut self, normals: impl Iterator<Item = Vector3<f64>>) {
        for (k, normal) in normals.take(self.count).enumerate() {
            for axis in 0..3 {
                self.normals[axis][k] = normal[axis];
            }
        }
    }

    /// Turns the normals into another frame.
    pub fn turn(&mut self, motion: &Pose) {
        dispatch!(self.level, simd => turn_with(simd, motion, &mut self.normals));
    }

    /// Takes up to 32 points, one at least, in another frame.
    pub fn place(&mut self, points: &[Point], motion: &Pose) {
        self.fill(points.iter().map(|point| Vector3::from(point.position_mm)));
        self.transform(motion);
    }

    /// Moves the positions into another frame.
    pub fn transform(&mut self, motion: &Pose) {
        dispatch!(self.level, simd => self.transform_with(simd, motion));
    }

    /// A box that holds the positions; those that are no numbers are in no region either.
    pub fn bounds(&self) -> Bounds {
        dispatch!(self.level, simd => self.bounds_with(simd))
    }

    /// One of the positions, mm.
    pub fn position(&self, number: usize) -> Vector3<f64> {
        let [x, y, z] = &self.places;
        Vector3::new(x[number], y[number], z[number])
    }

    /// The points that a region holds, a bit each, the first one lowest.
    pub fn held(&self, region: &Region) -> u32 {
        let margin = region.margin_mm;
        let taken = u32::MAX >> (STRETCH - self.count.clamp(1, STRETCH));
        taken
            & match &region.geometry {
                Geometry::Sphere { center_mm, radius_mm, axis, cos_polar } => {
                    let range = [(radius_mm - margin).max(0.0), radius_mm + margin];
                    dispatch!(self.level, simd => self.near_sphere(simd, center_mm, range, (axis, *cos_polar)))
                }
                Geometry::Plane { point_mm, normal, edges, half_size_mm, exclusions } => {
                    let axes = [*normal, edges[0], edges[1]];
                    let reach = [margin, half_size_mm[0], half_size_mm[1]];
                    dispatch!(self.level, simd => self.near_plane(simd, point_mm, (axes, reach), exclusions))
                }
                _ => self.one_by_one(region),
            }
    }

    /// The points whose normals fit the surface of a region, a bit each, the first one lowest; of points that the region does not hold it may say
    /// anything.
    pub fn facing(&self, region: &Region) -> u32 {
        let Some(limit) = region.cos_normal() else { return u32::MAX };
        match &region.geometry {
            Geometry::Sphere { center_mm, .. } => {
                dispatch!(self.level, simd => self.faces_out(simd, center_mm, limit))
            }
            Geometry::Plane { normal, .. } => {
                dispatch!(self.level, simd => self.faces_along(simd, normal, limit))
            }
            _ => {
                let [x, y, z] = &self.normals;
                let fits =
                    |k: &usize| region.holds_normal(&self.position(*k), &Vector3::new(x[*k], y[*k], z[*k]));
                (0..self.count).filter(fits).fold(0, |facing, k| facing | 1 << k)
            }
        }
    }

    /// Normals within an angle of the direction from a centre.
    #[inline(always)]
    fn faces_out<S: Simd>(&self, simd: S, center_mm: &Point3<f64>, limit: f64) -> u32 {
        let mut facing = 0;
        for block in 0..STRETCH / LANES {
            let arm = self.arms(simd, block, center_mm);
            let length = (arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2]).sqrt();
            let normal = block_of(simd, &self.normals, block);
            let along = normal[0] * arm[0] + normal[1] * arm[1] + normal[2] * arm[2];
            facing |= (bits(along.simd_ge(length * limit)) & there(simd, &normal)) << (block * LANES);
        }
        facing
    }

    /// Normals within an angle of a direction.
    #[inline(always)]
    fn faces_along<S: Simd>(&self, simd: S, direction: &Vector3<f64>, limit: f64) -> u32 {
        let mut facing = 0;
        for block in 0..STRETCH / LANES {
            let normal = block_of(simd, &self.normals, block);
            let along = dot(&normal, direction);
            let least = f64x8::splat(simd, limit);
            facing |= (bits(along.simd_ge(least)) & there(simd, &normal)) << (block * LANES);
        }
        facing
    }

    fn one_by_one(&self, region: &Region) -> u32 {
        let holds = |k: &usize| region.holds_position(&self.position(*k));
        (0..self.count).filter(holds).fold(0, |held, k| held | 1 << k)
    }

    /// Points within a range of distances from a centre, between two polar angles.
    #[inline(always)]
    fn near_sphere<S: Simd>(
        &self,
        simd: S,
        center_mm: &Point3<f64>,
        [inner, outer]: [f64; 2],
        (axis, cos_polar): (&Vector3<f64>, [f64; 2]),
    ) -> u32 {
        let mut held = 0;
        for block in 0..STRETCH / LANES {
            let arm = self.arms(simd, block, center_mm);
            let square = arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2];
            let (along, length) = (dot(&arm, axis), square.sqrt());
            let far = bits(square.simd_gt(outer * outer)) | bits(square.simd_lt(inner * inner));
            let polar =
                bits(along.simd_ge(cos_polar[0] * length)) & bits(along.simd_le(cos_polar[1] * length));
            held |= (polar & !far) << (block * LANES);
        }
        held
    }

    /// Points in a box about a place, by its axes (the normal first) and its reach along them, less what is cut out of it.
    #[inline(always)]
    fn near_plane<S: Simd>(
        &self,
        simd: S,
        point_mm: &Point3<f64>,
        (axes, reach): ([Vector3<f64>; 3], [f64; 3]),
        exclusions: &[Exclusion],
    ) -> u32 {
        let mut held = 0;
        for block in 0..STRETCH / LANES {
            let arm = self.arms(simd, block, point_mm);
            let [depth, first, second] = [dot(&arm, &axes[0]), dot(&arm, &axes[1]), dot(&arm, &axes[2])];
            let across = bits(first.abs().simd_le(reach[1])) & bits(second.abs().simd_le(reach[2]));
            let mut near = across & !bits(depth.abs().simd_gt(reach[0]));
            for Exclusion { center_mm, shape } in exclusions {
                let (x, y) = (first - center_mm[0], second - center_mm[1]);
                near &= !match shape {
                    ExclusionShape::Disc(radius) => bits((x * x + y * y).simd_le(radius * radius)),
                    ExclusionShape::Rectangle([half_x, half_y]) => {
                        bits(x.abs().simd_le(*half_x)) & bits(y.abs().simd_le(*half_y))
                    }
                };
            }
            held |= near << (block * LANES);
        }
        held
    }

    /// From a place to some positions, mm.
    #[inline(always)]
    fn arms<S: Simd>(&self, simd: S, block: usize, from: &Point3<f64>) -> [f64x8<S>; 3] {
        let [x, y, z] = block_of(simd, &self.places, block);
        [x - from.x, y - from.y, z - from.z]
    }

    #[inline(always)]
    fn bounds_with<S: Simd>(&self, simd: S) -> Bounds {
        let ends = |row: &[f64; STRETCH]| {
            let mut low = f64x8::splat(simd, f64::INFINITY);
            let mut high = f64x8::splat(simd, f64::NEG_INFINITY);
            for block in row.chunks_exact(LANES) {
                let values = f64x8::from_slice(simd, block);
                low = low.min_precise(values);
                high = high.max_precise(values);
            }
            let low = low.as_slice().iter().copied().fold(f64::INFINITY, f64::min);
            (low, high.as_slice().iter().copied().fold(f64::NEG_INFINITY, f64::max))
        };
        let [x, y, z] = self.places.each_ref().map(ends);
        Bounds::between(Vector3::new(x.0, y.0, z.0), Vector3::new(x.1, y.1, z.1))
    }

    #[inline(always)]
    fn transform_with<S: Simd>(&mut self, simd: S, motion: &Pose) {
        let (rotation, translation) = (&motion.rotation, &motion.translation);
        for block in 0..STRETCH / LANES {
            let vectors = block_of(simd, &self.places, block);
            for (axis, row) in self.places.iter_mut().enumerate() {
                let moved = turned(rotation, &vectors, axis) + translation[axis];
                row[block * LANES..][..LANES].copy_from_slice(moved.as_slice());
            }
        }
    }
}

/// Turns vectors into another frame.
#[inline(always)]
fn turn_with<S: Simd>(simd: S, motion: &Pose, vectors: &mut [[f64; STRETCH]; 3]) {
    for block in 0..STRETCH / LANES {
        let before = block_of(simd, vectors, block);
        for (axis, row) in vectors.iter_mut().enumerate() {
            row[block * LANES..][..LANES].copy_from_slice(turned(&motion.rotation, &before, axis).as_slice());
        }
    }
}

/// A coordinate of eight vectors after a rotation.
#[inline(always)]
fn turned<S: Simd>(rotation: &Matrix3<f64>, [x, y, z]: &[f64x8<S>; 3], axis: usize) -> f64x8<S> {
    rotation[(axis, 0)] * *x + rotation[(axis, 1)] * *y + rotation[(axis, 2)] * *z
}

/// Eight vectors, coordinate by coordinate.
#[inline(always)]
fn block_of<S: Simd>(simd: S, [x, y, z]: &[[f64; STRETCH]; 3], block: usize) -> [f64x8<S>; 3] {
    let part = block * LANES..(block + 1) * LANES;
    let of = |row: &[f64; STRETCH]| f64x8::from_slice(simd, &row[part.clone()]);
    [of(x), of(y), of(z)]
}

/// Vectors that are not zero, a bit each.
#[inline(always)]
fn there<S: Simd>(simd: S, [x, y, z]: &[f64x8<S>; 3]) -> u32 {
    let nothing = f64x8::splat(simd, 0.0);
    !(bits(x.simd_eq(nothing)) & bits(y.simd_eq(nothing)) & bits(z.simd_eq(nothing)))
}

#[inline(always)]
fn dot<S: Simd>(arm: &[f64x8<S>; 3], axis: &Vector3<f64>) -> f64x8<S> {
    arm[0] * axis.x + arm[1] * axis.y + arm[2] * axis.z
}

/// What eight points were asked, a bit each.
#[inline(always)]
fn bits<S: Simd>(lanes: mask64x8<S>) -> u32 {
    lanes.to_bitmask() as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::math::random::Key;
    use nalgebra::{Rotation3, UnitVector3};

    fn geometries() -> Vec<Geometry> {
        let axis = UnitVector3::new_normalize(Vector3::new(0.3, -0.2, 0.9)).into_inner();
        let first = axis.cross(&Vector3::x()).normalize();
        let plane = |exclusions: Vec<Exclusion>| Geometry::Plane {
            point_mm: Point3::new(1.0, -2.0, 0.5),
            normal: axis,
            edges: [first, axis.cross(&first)],
            half_size_mm: [9.0, 6.0],
            exclusions,
        };
        let center_mm = [1.0, -0.5];
        vec![
            Geometry::Sphere {
                center_mm: Point3::new(0.5, 1.0, 0.0),
                radius_mm: 8.0,
                axis,
                cos_polar: [-0.2, 0.9],
            },
            Geometry::Sphere { center_mm: Point3::origin(), radius_mm: 1.0, axis, cos_polar: [-1.0, 1.0] },
            plane(vec![]),
            plane(vec![
                Exclusion { center_mm, shape: ExclusionShape::Disc(3.0) },
                Exclusion { center_mm: [-5.0, 2.0], shape: ExclusionShape::Rectangle([2.0, 1.5]) },
            ]),
            Geometry::Torus { center_mm: Point3::origin(), axis, ring_radius_mm: 7.0, tube_radius_mm: 2.0 },
        ]
    }

    /// Proves: places and regions of whole stretches are, to the bit, those of their points one by one.
    #[test]
    fn a_stretch_tells_what_its_points_tell_one_by_one() {
        let motion = Pose {
            rotation: *Rotation3::from_euler_angles(0.3, -0.7, 1.9).matrix(),
            translation: Vector3::new(0.1, -0.2, 0.3),
        };
        let (mut stretch, mut held, mut facing) = (Stretch::new(), vec![0; geometries().len()], 0);
        for round in 0..2000 {
            let count = 1 + round % STRETCH;
            let random =
                |k: usize, axis: usize| Key::new(7).with(round as u64).symmetric((3 * k + axis) as u64);
            let place = |k| Vector3::from_fn(|axis, _| 12.0 * random(k, axis));
            let mut points: Vec<Vector3<f64>> = (0..count).map(place).collect();
            if round % 50 == 0 {
                points[0].x = f64::NAN;
            }
            let mut normals: Vec<Vector3<f64>> = (0..count)
                .map(|k| Vector3::from_fn(|axis, _| random(k + STRETCH, axis)).normalize())
                .collect();
            match round % 3 {
                0 => normals[count / 2] = Vector3::zeros(),
                1 => normals[count - 1].y = f64::NAN,
                _ => {}
            }
            stretch.fill(points.iter().copied());
            stretch.transform(&motion);
            for (k, point) in points.iter().enumerate() {
                let (found, moved) = (stretch.position(k), motion.point(point));
                assert_eq!(found.map(f64::to_bits), moved.map(f64::to_bits), "{point}");
            }
            for (geometry, sum) in geometries().into_iter().zip(&mut held) {
                let region = Region::of(geometry, 1.5);
                let holds = |k: &usize| region.holds_position(&stretch.position(*k));
                let expected = (0..count).filter(holds).fold(0_u32, |bits, k| bits | 1 << k);
                assert_eq!(stretch.held(&region), expected, "{region:?}");
                *sum += expected.count_ones();
                facing += normals_tell(&mut stretch, &motion, &region.looking_at_normals(0.3), &normals);
            }
        }
        assert!(held.iter().all(|sum| *sum > 100), "{held:?}");
        assert!(facing > 1000, "{facing}");
    }

    /// Compares what the normals of a stretch tell with what each tells by itself; how many fit the surface.
    fn normals_tell(stretch: &mut Stretch, motion: &Pose, region: &Region, normals: &[Vector3<f64>]) -> u32 {
        stretch.fill_normals(normals.iter().copied());
        stretch.turn(motion);
        let fits = |k: &usize| region.holds_normal(&stretch.position(*k), &(motion.rotation * normals[*k]));
        let expected = (0..normals.len()).filter(fits).fold(0_u32, |bits, k| bits | 1 << k);
        let all = u32::MAX >> (STRETCH - normals.len());
        assert_eq!(stretch.facing(region) & all, expected, "{region:?}");
        expected.count_ones()
    }
}
