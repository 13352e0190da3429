//! Points sorted into cubes.

use crate::counted_order::counted_order;
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x8};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Cells along one axis that fit into a third of the key.
const CELLS_PER_AXIS: f64 = 2_097_151.0;

/// A grid with at most so many cubes, or four a point, is counted cube by cube; a finer one is sorted.
const FEW_CUBES: usize = 1 << 16;

/// Added to a whole number below 2³², it leaves that number in the lowest bits: most processors have no step of vectors that makes numbers of
/// unsigned type.
const WHOLE: f64 = (1_u64 << 52) as f64;

/// Points that are looked at side by side.
const LANES: usize = 8;

/// Points that a thread takes at once.
const PLACED: usize = 8192;

/// Points whose cubes may have several sizes.
pub(super) struct Cubes<'a> {
    points: &'a [Vector3<f64>],
    lowest: Vector3<f64>,
    extent: Vector3<f64>,
    /// Edge that was asked for last, mm, and the place of each point's cube then.
    placed_mm: f64,
    places: Vec<u32>,
}

impl<'a> Cubes<'a> {
    /// About all of the points.
    pub fn new(points: &'a [Vector3<f64>]) -> Self {
        let (mut lowest, mut highest) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for point in points {
            for axis in 0..3 {
                // Plain comparisons, since all are numbers.
                lowest[axis] = if point[axis] < lowest[axis] { point[axis] } else { lowest[axis] };
                highest[axis] = if point[axis] > highest[axis] { point[axis] } else { highest[axis] };
            }
        }
        Self { points, lowest, extent: highest - lowest, placed_mm: f64::NAN, places: Vec::new() }
    }

    /// Largest edge of the box that holds the points, mm.
    pub fn extent_mm(&self) -> f64 {
        self.extent.max()
    }

    /// Edges of the box that holds the points, mm.
    pub fn extent(&self) -> Vector3<f64> {
        self.extent
    }

    /// Number of the cube along an axis; a product, which takes a fraction of the time of a quotient.
    fn along(value: f64, cubes_per_mm: f64) -> u64 {
        (value * cubes_per_mm).clamp(0.0, CELLS_PER_AXIS) as u64
    }

    /// The grid of cubes of an edge; `None` where they are too many to be counted one by one.
    fn dense(&self, edge_mm: f64) -> Option<Grid> {
        let cubes_per_mm = 1.0 / edge_mm;
        // The largest difference has the largest product.
        let [x, y, z] = [0, 1, 2].map(|axis| Self::along(self.extent[axis], cubes_per_mm) as usize + 1);
        let cubes = x.checked_mul(y)?.checked_mul(z)?;
        let few = cubes <= FEW_CUBES.max(4 * self.points.len()).min(u32::MAX as usize);
        let strides = [y as f64, z as f64];
        few.then(|| Grid { lowest: self.lowest, cubes_per_mm, strides, cubes, level: Level::new() })
    }

    /// Number of cubes of an edge that hold points.
    pub fn count(&mut self, edge_mm: f64) -> usize {
        let Some(cubes) = self.place(edge_mm) else {
            return self.sorted(edge_mm).chunk_by(|a, b| a.0 == b.0).count();
        };
        let mut held = vec![0_u8; cubes];
        self.places.iter().for_each(|place| held[*place as usize] = 1);
        held.iter().map(|held| usize::from(*held)).sum()
    }

    /// Points by the cube they lie in: (number that orders the cubes, index), sorted.
    pub fn members(&mut self, edge_mm: f64) -> Vec<(u64, u32)> {
        let Some(cubes) = self.place(edge_mm) else { return self.sorted(edge_mm) };
        let member = |index: u32| (u64::from(self.places[index as usize]), index);
        counted_order(&self.places, cubes).into_iter().map(member).collect()
    }

    /// Finds the places of the points among the cubes of an edge, and the number of these; `None` where they are too many to be counted.
    fn place(&mut self, edge_mm: f64) -> Option<usize> {
        let grid = self.dense(edge_mm)?;
        if self.placed_mm != edge_mm {
            self.places.resize(self.points.len(), 0);
            grid.place(self.points, &mut self.places);
            self.placed_mm = edge_mm;
        }
        Some(grid.cubes)
    }

    fn sorted(&self, edge_mm: f64) -> Vec<(u64, u32)> {
        let cubes_per_mm = 1.0 / edge_mm;
        let numbered = self.points.iter().zip(0..);
        let mut keyed: Vec<(u64, u32)> = numbered
            .map(|(p, index)| {
                let [x, y, z] = (p - self.lowest).map(|v| Self::along(v, cubes_per_mm) as f64).into();
                (((x as u64) << 42) | ((y as u64) << 21) | z as u64, index)
            })
            .collect();
        keyed.sort_unstable();
        keyed
    }
}

/// Cubes that are few enough to be numbered.
struct Grid {
    lowest: Vector3<f64>,
    cubes_per_mm: f64,
    /// Cubes along y, and along z.
    strides: [f64; 2],
    cubes: usize,
    level: Level,
}

impl Grid {
    /// Writes the place of each point's cube in the order of keys.
    fn place(&self, points: &[Vector3<f64>], places: &mut [u32]) {
        let chunks = places.par_chunks_mut(PLACED).zip(points.par_chunks(PLACED));
        chunks.for_each(
            |(places, points)| dispatch!(self.level, simd => self.place_with(simd, points, places)),
        );
    }

    #[inline(always)]
    fn place_with<S: Simd>(&self, simd: S, points: &[Vector3<f64>], places: &mut [u32]) {
        for (places, points) in places.chunks_mut(LANES).zip(points.chunks(LANES)) {
            let found = self.places_of(simd, points);
            places.copy_from_slice(&found[..points.len()]);
        }
    }

    /// The places of up to eight points. Whole numbers, which are exact: they have far fewer than 53 bits.
    #[inline(always)]
    fn places_of<S: Simd>(&self, simd: S, group: &[Vector3<f64>]) -> [u32; LANES] {
        let [i, j, k] = [self.along(simd, group, 0), self.along(simd, group, 1), self.along(simd, group, 2)];
        let places = (i * self.strides[0] + j) * self.strides[1] + k + WHOLE;
        let mut numbers = [0; LANES];
        for (number, place) in numbers.iter_mut().zip(places.as_slice()) {
            *number = place.to_bits() as u32;
        }
        numbers
    }

    /// Numbers of the cubes along an axis.
    #[inline(always)]
    fn along<S: Simd>(&self, simd: S, group: &[Vector3<f64>], axis: usize) -> f64x8<S> {
        let mut offsets = [0.0; LANES];
        for (offset, point) in offsets.iter_mut().zip(group) {
            *offset = point[axis] - self.lowest[axis];
        }
        let products = f64x8::from_slice(simd, &offsets) * self.cubes_per_mm;
        products.max_precise(0.0).min(CELLS_PER_AXIS).floor()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Counting gives the cubes that sorting gives, in the same order, with the same points.
        #[test]
        fn counting_equals_sorting(
            places in prop::collection::vec([-3.0_f64..3.0, -1.0_f64..9.0, 0.0_f64..0.2], 1..300),
            edge_mm in prop_oneof![0.01_f64..0.1, 0.1_f64..2.0, Just(20.0)],
        ) {
            let points: Vec<Vector3<f64>> = places.into_iter().map(Vector3::from).collect();
            let mut cubes = Cubes::new(&points);
            let groups = |members: &[(u64, u32)]| -> Vec<Vec<u32>> {
                members.chunk_by(|a, b| a.0 == b.0).map(|g| g.iter().map(|m| m.1).collect()).collect()
            };
            let sorted = groups(&cubes.sorted(edge_mm));
            prop_assert_eq!(&groups(&cubes.members(edge_mm)), &sorted);
            prop_assert_eq!(cubes.count(edge_mm), sorted.len());
        }
    }
}
