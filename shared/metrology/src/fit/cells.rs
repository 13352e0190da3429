//! Points sorted into cubes.

use crate::counted_order::counted_order;
use nalgebra::Vector3;

/// Cells along one axis that fit into a third of the key.
const CELLS_PER_AXIS: f64 = 2_097_151.0;

/// A grid with at most so many cubes, or four a point, is counted cube by cube; a finer one is sorted.
const FEW_CUBES: usize = 1 << 16;

/// Points whose cubes may have several sizes.
pub(super) struct Cubes<'a> {
    points: &'a [Vector3<f64>],
    lowest: Vector3<f64>,
    extent: Vector3<f64>,
}

impl<'a> Cubes<'a> {
    /// About all of the points.
    pub fn new(points: &'a [Vector3<f64>]) -> Self {
        let lowest = points.iter().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(p));
        let highest = points.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |high, p| high.sup(p));
        Self { points, lowest, extent: highest - lowest }
    }

    /// Largest edge of the box that holds the points, mm.
    pub fn extent_mm(&self) -> f64 {
        self.extent.max()
    }

    /// Edges of the box that holds the points, mm.
    pub fn extent(&self) -> Vector3<f64> {
        self.extent
    }

    fn along(value: f64, edge_mm: f64) -> u64 {
        (value / edge_mm).clamp(0.0, CELLS_PER_AXIS) as u64
    }

    /// The place of each point's cube in the order of keys, and the number of cubes; `None` where they are too many.
    fn dense(&self, edge_mm: f64) -> Option<(impl Iterator<Item = usize>, usize)> {
        // The largest difference has the largest quotient.
        let [x, y, z] = [0, 1, 2].map(|axis| Self::along(self.extent[axis], edge_mm) as usize + 1);
        let cubes = x.checked_mul(y)?.checked_mul(z)?;
        if cubes > FEW_CUBES.max(4 * self.points.len()) {
            return None;
        }
        let place = move |p: &Vector3<f64>| {
            let offset = p - self.lowest;
            let [i, j, k] = [offset.x, offset.y, offset.z].map(|v| Self::along(v, edge_mm) as usize);
            (i * y + j) * z + k
        };
        Some((self.points.iter().map(place), cubes))
    }

    /// Number of cubes of an edge that hold points.
    pub fn count(&self, edge_mm: f64) -> usize {
        let Some((places, cubes)) = self.dense(edge_mm) else {
            return self.sorted(edge_mm).chunk_by(|a, b| a.0 == b.0).count();
        };
        let mut held = vec![0_u8; cubes];
        places.for_each(|place| held[place] = 1);
        held.iter().map(|held| usize::from(*held)).sum()
    }

    /// Points by the cube they lie in: (number that orders the cubes, index), sorted.
    pub fn members(&self, edge_mm: f64) -> Vec<(u64, u32)> {
        let Some((places, cubes)) = self.dense(edge_mm) else { return self.sorted(edge_mm) };
        let places: Vec<u32> = places.map(|place| place as u32).collect();
        let member = |index: u32| (u64::from(places[index as usize]), index);
        counted_order(&places, cubes).into_iter().map(member).collect()
    }

    fn sorted(&self, edge_mm: f64) -> Vec<(u64, u32)> {
        let numbered = self.points.iter().zip(0..);
        let mut keyed: Vec<(u64, u32)> = numbered
            .map(|(p, index)| {
                let [x, y, z] = (p - self.lowest).map(|v| Self::along(v, edge_mm) as f64).into();
                (((x as u64) << 42) | ((y as u64) << 21) | z as u64, index)
            })
            .collect();
        keyed.sort_unstable();
        keyed
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
            let cubes = Cubes::new(&points);
            let groups = |members: &[(u64, u32)]| -> Vec<Vec<u32>> {
                members.chunk_by(|a, b| a.0 == b.0).map(|g| g.iter().map(|m| m.1).collect()).collect()
            };
            let sorted = groups(&cubes.sorted(edge_mm));
            prop_assert_eq!(&groups(&cubes.members(edge_mm)), &sorted);
            prop_assert_eq!(cubes.count(edge_mm), sorted.len());
        }
    }
}
