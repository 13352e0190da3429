//! The nearest point of a tree for each of many places: places that lie near each other go down the tree together.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::CHUNK;
use super::bvh::Aabb;
use super::points::PointTree;
use super::thin::in_cells;
use super::vicinity::{Lanes, PLACES};
use fearless_simd::{Level, dispatch};
use nalgebra::Point3;
use rayon::prelude::*;
use std::ops::Range;

/// Edge of the box around the places of a group, in distances of neighbours: the eight points of a leaf span three of them.
const GROUP_SPACINGS: f64 = 4.0;

/// Splits places into runs of at most [`PLACES`] that fit into a box of some distances of neighbours.
pub(crate) fn groups(
    places: impl Iterator<Item = Point3<f64>>,
    spacing_mm: f64,
) -> impl Iterator<Item = Range<usize>> {
    let edge_mm = GROUP_SPACINGS * spacing_mm;
    let mut places = places.enumerate().peekable();
    std::iter::from_fn(move || {
        let (first, place) = places.next()?;
        let mut held = Aabb::of(&[place]);
        let mut end = first + 1;
        while end < first + PLACES {
            let grown = |(_, next): &(usize, Point3<f64>)| held.join(&Aabb::of(&[*next]));
            let fits = |b: &Aabb| (b.high - b.low).max() <= edge_mm;
            let Some(joined) = places.peek().map(grown).filter(fits) else { break };
            held = joined;
            end += 1;
            places.next();
        }
        Some(first..end)
    })
}

impl PointTree {
    /// Slots of the nearest points of some places within a distance, as [`Self::nearest`] finds them, and the number of slots for a place
    /// that has none. `spacing_mm`: distance of neighbours in the tree.
    pub fn nearest_of_all(&self, places: &[Point3<f64>], limit_mm: f64, spacing_mm: f64) -> Vec<u32> {
        let order = in_cells(places, GROUP_SPACINGS * spacing_mm);
        let level = Level::new();
        let found: Vec<u32> = order
            .par_chunks(CHUNK)
            .flat_map_iter(|part| {
                let near = |index: &u32| places[*index as usize];
                let mut found = Vec::with_capacity(part.len());
                for group in groups(part.iter().map(near), spacing_mm) {
                    let asked = Asked::new(part[group.clone()].iter().map(near));
                    let slots = self.nearest_of_group(level, &asked, limit_mm);
                    found.extend_from_slice(&slots[..group.len()]);
                }
                found
            })
            .collect();
        let mut slots = vec![0; places.len()];
        for (index, slot) in order.iter().zip(found) {
            slots[*index as usize] = slot;
        }
        slots
    }

    fn nearest_of_group(&self, level: Level, asked: &Asked, limit_mm: f64) -> [u32; PLACES] {
        let limit2 = limit_mm * limit_mm;
        let mut best = Best::none(limit2, self.sites().len());
        let (sites, order) = (self.sites(), self.order());
        self.walk_around(&asked.held, limit2, |leaf, _| {
            let (sites, order) = (&sites[leaf.clone()], &order[leaf.clone()]);
            dispatch!(level, _simd => best.look_at(asked, sites, order, leaf.start));
            best.distance2.iter().fold(0.0, |most: f64, d| most.max(*d))
        });
        best.slot.map(|slot| slot as u32)
    }
}

/// Places that go down the tree together.
struct Asked {
    held: Aabb,
    /// Coordinates, mm; those of idle lanes are those of the first place.
    at: [Lanes; 3],
}

impl Asked {
    fn new(places: impl Iterator<Item = Point3<f64>>) -> Self {
        let (mut held, mut at) = (Aabb::of(&[]), [[0.0; PLACES]; 3]);
        for (lane, place) in places.enumerate() {
            held = held.join(&Aabb::of(&[place]));
            for axis in 0..3 {
                if lane == 0 {
                    at[axis] = [place[axis]; PLACES];
                }
                at[axis][lane] = place[axis];
            }
        }
        Self { held, at }
    }
}

/// The nearest points so far. All numbers are floating, so that vectors of one kind hold them.
struct Best {
    /// Square of the distance, mm²; that of the limit before any was found.
    distance2: Lanes,
    slot: Lanes,
    /// Index in the order given.
    index: Lanes,
}

impl Best {
    fn none(limit2: f64, slots: usize) -> Self {
        Self { distance2: [limit2; PLACES], slot: [slots as f64; PLACES], index: [f64::INFINITY; PLACES] }
    }

    /// Looks at the points of a leaf. Of equally near ones the lowest index.
    #[inline(always)]
    fn look_at(&mut self, asked: &Asked, sites: &[Point3<f64>], order: &[u32], first: usize) {
        for (offset, (site, index)) in sites.iter().zip(order).enumerate() {
            let (slot, index) = ((first + offset) as f64, f64::from(*index));
            for lane in 0..PLACES {
                let [x, y, z] = [0, 1, 2].map(|axis| site[axis] - asked.at[axis][lane]);
                let distance2 = x * x + y * y + z * z;
                let old = self.distance2[lane];
                let better = (distance2 < old) | ((distance2 == old) & (index < self.index[lane]));
                self.distance2[lane] = if better { distance2 } else { old };
                self.slot[lane] = if better { slot } else { self.slot[lane] };
                self.index[lane] = if better { index } else { self.index[lane] };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::points::tests::place;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn many_places_find_what_each_finds_alone(
            points in prop::collection::vec(place(), 0..120),
            queries in prop::collection::vec(place(), 0..60),
            limit in 0.0_f64..5.0,
            spacing_mm in 0.0_f64..4.0,
        ) {
            let tree = PointTree::new(&points);
            let all = tree.nearest_of_all(&queries, limit, spacing_mm);
            let alone = |q: &Point3<f64>| tree.nearest(q, limit).map_or(points.len(), |n| n.0) as u32;
            prop_assert_eq!(all, queries.iter().map(alone).collect::<Vec<_>>());
        }

        /// Every place is in one group, in its order; groups are small.
        #[test]
        fn groups_hold_all_places_once(
            places in prop::collection::vec(place(), 0..60), spacing_mm in 0.0_f64..2.0,
        ) {
            let mut end = 0;
            for group in groups(places.iter().copied(), spacing_mm) {
                prop_assert_eq!(group.start, end);
                end = group.end;
                prop_assert!((1..=PLACES).contains(&group.len()));
                let held = Aabb::of(&places[group]);
                prop_assert!((held.high - held.low).max() <= GROUP_SPACINGS * spacing_mm);
            }
            prop_assert_eq!(end, places.len());
        }
    }
}
