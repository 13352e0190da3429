//! Whether two clouds are one measurement: by what no motion, order or name changes, and a changed point only at its place.
//!
//! The distances of a point from its nearest neighbours are written by noise. A cloud that was moved, turned, mirrored, put
//! into another order, thinned a little or changed at some points still has most of them; another measurement of the same
//! artefact at the same place has none. Noise that somebody adds to every point hides a copy: that is no check of ours.

use nalgebra::Point3;

use crate::spatial::PointTree;

/// Neighbours whose distances are compared.
const NEIGHBOURS: usize = 4;

/// Points of a cloud that are looked for in another.
const QUERIES: usize = 2000;

/// Distances that differ by no more are the same, mm: what digits of a file leave of small coordinates.
const LEAST_TOLERANCE_MM: f64 = 1e-5;

/// The same over the largest coordinate: four rounding errors of single precision.
const TOLERANCE_SHARE: f64 = 2.4e-7;

/// Distances of every point from its nearest neighbours.
#[derive(Debug, Clone)]
pub(super) struct Neighbourhoods {
    /// Rising by the first distance, mm.
    sorted: Vec<[f64; NEIGHBOURS]>,
    tolerance_mm: f64,
}

impl Neighbourhoods {
    /// Of the points of an element.
    pub fn new(points: &[Point3<f64>]) -> Self {
        let tree = PointTree::new(points);
        let largest = points.iter().flat_map(|p| p.iter()).fold(0.0_f64, |most, v| most.max(v.abs()));
        let of_point = |p: &Point3<f64>| -> [f64; NEIGHBOURS] {
            // The first is the point itself.
            let nearest = tree.nearest2_mm2::<{ NEIGHBOURS + 1 }>(p);
            std::array::from_fn(|index| nearest[index + 1].sqrt())
        };
        let mut sorted: Vec<[f64; NEIGHBOURS]> = points.iter().map(of_point).collect();
        // Of numbers that are not negative the bits have the same order.
        sorted.sort_by_key(|distances| distances.map(f64::to_bits));
        Self { sorted, tolerance_mm: LEAST_TOLERANCE_MM + TOLERANCE_SHARE * largest }
    }

    /// Neighbourhoods here that are those of a point, at most `most`.
    fn count(&self, wanted: &[f64; NEIGHBOURS], tolerance_mm: f64, most: usize) -> usize {
        let first = self.sorted.partition_point(|known| known[0] < wanted[0] - tolerance_mm);
        let near = self.sorted[first..].iter().take_while(|known| known[0] <= wanted[0] + tolerance_mm);
        let same =
            |known: &&[f64; NEIGHBOURS]| known.iter().zip(wanted).all(|(a, b)| (a - b).abs() <= tolerance_mm);
        near.filter(same).take(most).count()
    }

    /// Share of the points, of some spread over all, with at least so many of the same neighbourhoods in a cloud.
    fn share(&self, cloud: &Self, least: usize) -> f64 {
        let tolerance_mm = self.tolerance_mm.max(cloud.tolerance_mm);
        let step = self.sorted.len().div_ceil(QUERIES).max(1);
        let taken = self.sorted.iter().step_by(step);
        let found = taken.clone().filter(|one| cloud.count(one, tolerance_mm, least) >= least).count();
        found as f64 / taken.len().max(1) as f64
    }

    /// Share of the points whose neighbourhood another cloud has too.
    pub fn share_in(&self, other: &Self) -> f64 {
        self.share(other, 1)
    }

    /// Share of the points whose neighbourhood is that of two others too: where it is large, as on an even lattice, a
    /// neighbourhood says nothing. One other may be the mirror image of a computed cloud.
    pub fn share_alike(&self) -> f64 {
        self.share(self, 3)
    }

    /// Share of the points that lie on another one to the last digit.
    pub fn share_twins(&self) -> f64 {
        self.sorted.iter().filter(|one| one[0] == 0.0).count() as f64 / self.sorted.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::math::random::Key;
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};

    /// A cap of a sphere on an even lattice, as a camera sees it, with noise along the line of sight.
    fn cap(seed: u64, noise_mm: f64) -> Vec<Point3<f64>> {
        let key = Key::new(seed);
        let at = |i: i32, j: i32| {
            let (x, y) = (0.15 * f64::from(i), 0.15 * f64::from(j));
            let inside = 100.0 - x * x - y * y;
            let counter = (100 * (i + 60) + j + 60) as u64;
            (inside > 40.0).then(|| Point3::new(x, y, inside.sqrt() + noise_mm * key.symmetric(counter)))
        };
        (-50..=50).flat_map(|i| (-50..=50).filter_map(move |j| at(i, j))).collect()
    }

    #[test]
    fn a_copy_is_known_after_motion_mirror_thinning_and_changes_and_another_measurement_is_none() {
        let first = cap(1, 0.005);
        let known = Neighbourhoods::new(&first);
        let turn = UnitQuaternion::from_euler_angles(0.3, -1.1, 2.5);
        let motion = Isometry3::from_parts(Vector3::new(50.0, -70.0, 110.0).into(), turn);
        let single = |p: Point3<f64>| Point3::from(p.coords.map(|v| f64::from(v as f32)));
        let moved: Vec<_> = first.iter().rev().map(|p| single(motion * p)).collect();
        let mirrored: Vec<_> = first.iter().map(|p| Point3::new(-p.x, p.y, p.z)).collect();
        let thinned: Vec<_> =
            first.iter().enumerate().filter(|(i, _)| i % 10 != 3).map(|(_, p)| *p).collect();
        let mut changed = first.clone();
        changed.iter_mut().step_by(50).for_each(|p| p.z += 0.01);
        for (name, cloud) in
            [("moved", moved), ("mirrored", mirrored), ("thinned", thinned), ("changed", changed)]
        {
            let share = Neighbourhoods::new(&cloud).share_in(&known);
            assert!(share > 0.5, "{name}: {share}");
        }
        // The same place, other noise, with few points so alike that they say nothing.
        let other = Neighbourhoods::new(&cap(2, 0.005));
        assert!(other.share_in(&known) < 0.02, "{}", other.share_in(&known));
        assert!(known.share_alike() < 0.05, "{}", known.share_alike());
        let even: Vec<_> =
            (0..2500).map(|i| Point3::new(f64::from(i % 50), f64::from(i / 50), 0.0)).collect();
        assert!(Neighbourhoods::new(&even).share_alike() > 0.9);
    }

    #[test]
    fn points_that_are_there_twice_are_counted() {
        let mut points = cap(3, 0.005);
        assert_eq!(Neighbourhoods::new(&points).share_twins(), 0.0);
        let count = points.len();
        points.extend_from_within(..count / 4);
        let share = Neighbourhoods::new(&points).share_twins();
        assert!((share - 0.4).abs() < 0.01, "{share}");
        assert_eq!(Neighbourhoods::new(&[]).share_twins(), 0.0);
        assert_eq!(Neighbourhoods::new(&points[..1]).share_alike(), 0.0);
    }
}
