//! A tree over points: the nearest one, all within a radius.

use super::bvh::{Aabb, Bvh};
use fringe::math::statistics::median;
use nalgebra::Point3;
use std::ops::Range;

/// Points per leaf: one or two lines of a surface patch; a loop over neighbouring memory beats further box tests.
const LEAF: usize = 8;

/// Number of the neighbour whose distance estimates the density.
const DENSITY_NEIGHBOURS: usize = 8;

/// Number of points at which the density of a cloud is estimated.
const DENSITY_SAMPLES: usize = 1001;

/// Points sorted into a tree. A *slot* is a place in its order, an *index* one in the order given.
#[derive(Debug, Clone)]
pub(crate) struct PointTree {
    tree: Bvh,
    sites: Vec<Point3<f64>>,
}

/// What is known of the points around a place. It still tells the nearest one when the place has moved by less than the others
/// are farther away.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Neighbourhood {
    place: Point3<f64>,
    /// Slot of the nearest point, if one is known.
    nearest: Option<u32>,
    /// No other point is nearer than this, mm.
    others_mm: f64,
}

impl Neighbourhood {
    /// Nothing is known of any place.
    pub fn unknown() -> Self {
        Self { place: Point3::origin(), nearest: None, others_mm: 0.0 }
    }
}

/// Larger than the rounding of a distance, as a part of the coordinates.
const ROUNDING: f64 = 1e-12;

impl PointTree {
    /// Sorts finite points, fewer than 2³².
    pub fn new(points: &[Point3<f64>]) -> Self {
        let bounds = |item: u32| {
            let p = points[item as usize];
            Aabb { low: p, high: p }
        };
        let tree = Bvh::over(points.len(), LEAF, &bounds);
        let sites = tree.items().iter().map(|item| points[*item as usize]).collect();
        Self { tree, sites }
    }

    /// Positions in the order of the tree, mm.
    pub fn sites(&self) -> &[Point3<f64>] {
        &self.sites
    }

    /// Index of each slot.
    pub fn order(&self) -> &[u32] {
        self.tree.items()
    }

    /// Box of all points; `None` without any.
    pub fn bounds(&self) -> Option<Aabb> {
        self.tree.bounds()
    }

    /// Slot of the nearest point within a distance, and its distance squared, mm². Of equally near ones the lowest index.
    pub fn nearest(&self, p: &Point3<f64>, limit_mm: f64) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64)> = None;
        self.tree.walk(
            limit_mm * limit_mm,
            |b, limit| Some(distance2_mm2(b, p)).filter(|d| *d <= limit),
            &mut |slots, mut limit| {
                for slot in slots {
                    let d2 = (self.sites[slot] - p).norm_squared();
                    let order = self.order();
                    let better = |(old, old_d2): (usize, f64)| d2 < old_d2 || order[slot] < order[old];
                    if d2 <= limit && best.is_none_or(better) {
                        (best, limit) = (Some((slot, d2)), d2);
                    }
                }
                limit
            },
        );
        best
    }

    /// As [`Self::nearest`] for a place near one about which something is known, and what is known then.
    pub fn nearest_again(&self, p: &Point3<f64>, limit_mm: f64, known: &mut Neighbourhood) -> Option<usize> {
        let moved_mm = (p - known.place).norm() + ROUNDING * (p.coords.norm() + known.place.coords.norm());
        let others_mm = known.others_mm * (1.0 - ROUNDING) - moved_mm;
        let distance_mm = known.nearest.map(|slot| (self.sites[slot as usize] - p).norm());
        let nearest_mm = distance_mm.unwrap_or(limit_mm);
        if nearest_mm >= others_mm {
            // A little farther than what was nearest, so that the next motion finds it known.
            let reach_mm = distance_mm.map_or(limit_mm, |d| limit_mm.min(2.0 * d + moved_mm));
            *known = self.around(p, reach_mm);
        }
        let slot = known.nearest? as usize;
        ((self.sites[slot] - p).norm_squared() <= limit_mm * limit_mm).then_some(slot)
    }

    /// What lies near a point within a distance. Of equally near ones the lowest index.
    pub fn around(&self, p: &Point3<f64>, limit_mm: f64) -> Neighbourhood {
        let mut nearest: Option<(usize, f64)> = None;
        let mut second = limit_mm * limit_mm;
        self.tree.walk(
            second,
            |b, limit| Some(distance2_mm2(b, p)).filter(|d| *d <= limit),
            &mut |slots, _| {
                for slot in slots {
                    let d2 = (self.sites[slot] - p).norm_squared();
                    if d2 > second {
                        continue;
                    }
                    let order = self.order();
                    let better = |(old, old_d2): (usize, f64)| {
                        d2 < old_d2 || (d2 == old_d2 && order[slot] < order[old])
                    };
                    if nearest.is_none_or(better) {
                        second = nearest.map_or(second, |(_, old_d2)| old_d2);
                        nearest = Some((slot, d2));
                    } else {
                        second = d2;
                    }
                }
                second
            },
        );
        Neighbourhood { place: *p, nearest: nearest.map(|(slot, _)| slot as u32), others_mm: second.sqrt() }
    }

    /// Calls `visit` with the slot of each point within a distance.
    pub fn within(&self, p: &Point3<f64>, radius_mm: f64, mut visit: impl FnMut(usize)) {
        let radius2 = radius_mm * radius_mm;
        self.within_box(
            |b| distance2_mm2(b, p) <= radius2,
            |slot, site| {
                if (site - p).norm_squared() <= radius2 {
                    visit(slot);
                }
            },
        );
    }

    /// Calls `visit` with the slot and place of each point of the leaves whose boxes a condition lets pass.
    pub fn within_box(&self, passes: impl Fn(&Aabb) -> bool, mut visit: impl FnMut(usize, &Point3<f64>)) {
        self.leaves(passes, |slots| {
            for slot in slots {
                visit(slot, &self.sites[slot]);
            }
        });
    }

    /// Calls `visit` with the slots of the leaves whose boxes a condition lets pass, in rising order.
    pub fn leaves(&self, passes: impl Fn(&Aabb) -> bool, mut visit: impl FnMut(Range<usize>)) {
        self.tree.walk(0.0, |b, _| passes(b).then_some(0.0), &mut |slots, limit| {
            visit(slots);
            limit
        });
    }

    /// Walks the leaves that may hold something nearer to a box than the root of `limit2`, near ones first; `visit` returns the new limit.
    pub(super) fn walk_around(
        &self,
        held: &Aabb,
        limit2: f64,
        mut visit: impl FnMut(Range<usize>, f64) -> f64,
    ) {
        let key = |b: &Aabb, limit: f64| Some(b.apart2_mm2(held)).filter(|d| *d <= limit);
        self.tree.walk(limit2, key, &mut visit);
    }

    /// Typical distance of neighbours, mm: the edge of a square of a surface that holds one point.
    ///
    /// The median, over points spread through the cloud, of the distance to the eighth neighbour; a circle of that
    /// radius holds eight points besides its centre. Zero when most points have eight twins.
    pub fn spacing_mm(&self) -> f64 {
        let step = self.sites.len().div_ceil(DENSITY_SAMPLES).max(1);
        let mut reach: Vec<f64> = self.sites.iter().step_by(step).map(|p| self.reach2_mm2(p)).collect();
        let Some(reach2) = median(&mut reach) else { return 0.0 };
        let held = DENSITY_NEIGHBOURS.min(self.sites.len() - 1).max(1) as f64;
        (reach2 * std::f64::consts::PI / held).sqrt()
    }

    /// Squared distance to the farthest of the nearest few neighbours besides the point itself, mm².
    fn reach2_mm2(&self, p: &Point3<f64>) -> f64 {
        // One more: the point itself.
        let nearest = self.nearest2_mm2::<{ DENSITY_NEIGHBOURS + 1 }>(p);
        nearest.into_iter().rev().find(|d| d.is_finite()).unwrap_or(0.0)
    }

    /// Squared distances to the nearest points, rising, mm²; a point of the tree is its own nearest. Infinite where there are
    /// no more.
    pub fn nearest2_mm2<const COUNT: usize>(&self, p: &Point3<f64>) -> [f64; COUNT] {
        let mut nearest = [f64::INFINITY; COUNT];
        self.tree.walk(
            f64::INFINITY,
            |b, limit| Some(distance2_mm2(b, p)).filter(|d| *d <= limit),
            &mut |slots, _| {
                for slot in slots {
                    insert(&mut nearest, (self.sites[slot] - p).norm_squared());
                }
                nearest[COUNT - 1]
            },
        );
        nearest
    }
}

/// Puts a value into a sorted list and drops the largest.
fn insert(sorted: &mut [f64], value: f64) {
    let place = sorted.partition_point(|v| *v <= value);
    if place < sorted.len() {
        sorted[place..].rotate_right(1);
        sorted[place] = value;
    }
}

/// Squared distance of a point from a box, mm²; zero inside.
#[inline]
fn distance2_mm2(b: &Aabb, p: &Point3<f64>) -> f64 {
    b.apart2_mm2(&Aabb { low: *p, high: *p })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Whole numbers make ties.
    pub(in crate::spatial) fn place() -> impl Strategy<Value = Point3<f64>> {
        [-6_i32..6, -6_i32..6, 0_i32..2].prop_map(|c| Point3::from(c.map(f64::from)))
    }

    proptest! {
        #[test]
        fn the_tree_equals_brute_force(
            points in prop::collection::vec(place(), 0..120),
            query in place(),
            limit in 0.0_f64..5.0,
        ) {
            let tree = PointTree::new(&points);
            let found = tree.nearest(&query, limit).map(|(slot, d2)| (tree.order()[slot] as usize, d2));
            let brute = points
                .iter()
                .map(|p| (p - query).norm_squared())
                .enumerate()
                .filter(|(_, d2)| *d2 <= limit * limit)
                .min_by(|a, b| a.1.total_cmp(&b.1));
            prop_assert_eq!(found, brute);
            let mut inside = Vec::new();
            tree.within(&query, limit, |slot| inside.push(tree.order()[slot] as usize));
            inside.sort_unstable();
            let near = |i: &usize| (points[*i] - query).norm_squared() <= limit * limit;
            prop_assert_eq!(inside, (0..points.len()).filter(near).collect::<Vec<_>>());
        }
    }

    proptest! {
        /// What is known of earlier places never changes what is found, however far a place moves and the limit changes.
        #[test]
        fn what_is_known_changes_nothing(
            points in prop::collection::vec(place(), 0..120),
            first in place(),
            motions in prop::collection::vec((place(), 0_u32..7, 0.0_f64..5.0), 1..12),
        ) {
            let tree = PointTree::new(&points);
            let mut known = Neighbourhood::unknown();
            let mut query = first;
            for (motion, exponent, limit) in motions {
                query += motion.coords * 0.1_f64.powi(exponent as i32);
                let found = tree.nearest_again(&query, limit, &mut known);
                prop_assert_eq!(found, tree.nearest(&query, limit).map(|(slot, _)| slot));
            }
        }
    }

    #[test]
    fn the_spacing_of_a_square_lattice_is_its_pitch() {
        let lattice: Vec<Point3<f64>> = (0..10_000)
            .map(|i| Point3::new(0.2 * f64::from(i % 100), 0.2 * f64::from(i / 100), 0.0))
            .collect();
        let spacing = PointTree::new(&lattice).spacing_mm();
        // The eighth neighbour is the diagonal one: π · 2 · 0.04 / 8 under the root.
        assert!((spacing - 0.2).abs() < 0.03, "{spacing}");
        assert_eq!(PointTree::new(&[Point3::origin(); 50]).spacing_mm(), 0.0);
        assert_eq!(PointTree::new(&[]).spacing_mm(), 0.0);
        assert_eq!(PointTree::new(&[Point3::origin()]).spacing_mm(), 0.0);
    }

    #[test]
    fn a_large_cloud_has_the_same_tree_built_in_parts() {
        let mut noise = fringe::synthetic::Noise(7);
        let cloud: Vec<Point3<f64>> =
            (0..40_000).map(|_| Point3::new(noise.unit(), noise.unit(), 0.1 * noise.unit())).collect();
        let tree = PointTree::new(&cloud);
        for query in cloud.iter().step_by(1999).map(|p| p + nalgebra::Vector3::new(0.01, -0.02, 0.03)) {
            let (slot, d2) = tree.nearest(&query, f64::INFINITY).unwrap();
            let brute = cloud.iter().map(|p| (p - query).norm_squared()).fold(f64::INFINITY, f64::min);
            assert_eq!((d2, (tree.sites()[slot] - query).norm_squared()), (brute, brute));
        }
    }
}
