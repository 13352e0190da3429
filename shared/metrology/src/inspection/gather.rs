//! The points of a cloud near the regions of a plan: whole stretches of the cloud are passed over where no region lies.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::bounds::Bounds;
use super::region::Region;
use super::stretch::{STRETCH, Stretch};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;
use std::collections::BTreeMap;

/// Parts of a cloud that threads take. Their number is fixed: the allocations of a cycle do not depend on the cloud.
const PARTS: usize = 8;

/// Points of a cloud near a region, by their numbers. They are read where they lie, and nothing is written of those that no region takes.
#[derive(Debug)]
pub(super) struct Nearby<'a> {
    cloud: &'a [Point],
    part_from_world: Pose,
    numbers: Vec<u32>,
}

impl<'a> Nearby<'a> {
    /// How many they are.
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Numbers in the cloud, in its order.
    pub fn numbers(&self) -> &[u32] {
        &self.numbers
    }

    /// How many pairs see the same of some of them, by their places here: as many as there would be with an equal number of points each.
    pub fn layers(&self, places: &[u32]) -> f64 {
        let mut counts = BTreeMap::new();
        for place in places {
            *counts.entry(self.point(self.numbers[*place as usize]).pair).or_insert(0.0) += 1.0;
        }
        let squares: f64 = counts.values().map(|count: &f64| count * count).sum();
        let all = places.len() as f64;
        if squares > 0.0 { all * all / squares } else { 1.0 }
    }

    /// Where the frame of the cloud lies in that of the part.
    pub fn part_from_world(&self) -> &Pose {
        &self.part_from_world
    }

    /// A point by its number in the cloud.
    pub fn point(&self, number: u32) -> &'a Point {
        &self.cloud[number as usize]
    }

    /// Calls `take` with those of some of them, a stretch, that belong to a region, after a motion: place in the stretch, position in the part
    /// frame, point. Tells which lie in the region, whatever their normals, a bit each.
    pub fn each_held(
        &self,
        region: &Region,
        (numbers, motion): (&[u32], Option<&Pose>),
        stretch: &mut Stretch,
        mut take: impl FnMut(usize, Vector3<f64>, &Point),
    ) -> u32 {
        self.place(numbers, motion, stretch);
        let inside = stretch.held(region);
        let mut held = inside;
        if inside != 0 && region.cos_normal().is_some() {
            self.turn(numbers, motion, stretch);
            held &= stretch.facing(region);
        }
        while held != 0 {
            let k = held.trailing_zeros() as usize;
            take(k, stretch.position(k), self.point(numbers[k]));
            held &= held - 1;
        }
        inside
    }

    /// Calls `take` with the numbers of those of a stretch, which was placed last, that a wider region holds beside some (`held`), and that face its way.
    pub fn each_beside(
        &self,
        wide: &Region,
        (numbers, held): (&[u32], u32),
        stretch: &mut Stretch,
        mut take: impl FnMut(u32),
    ) {
        let mut beside = stretch.held(wide) & !held;
        if beside != 0 {
            self.turn(numbers, None, stretch);
            beside &= stretch.facing(wide);
        }
        while beside != 0 {
            take(numbers[beside.trailing_zeros() as usize]);
            beside &= beside - 1;
        }
    }

    fn place(&self, numbers: &[u32], motion: Option<&Pose>, stretch: &mut Stretch) {
        stretch.fill(numbers.iter().map(|number| Vector3::from(self.point(*number).position_mm)));
        stretch.transform(&self.part_from_world);
        if let Some(motion) = motion {
            stretch.transform(motion);
        }
    }

    /// Takes the normals of the points that were placed.
    fn turn(&self, numbers: &[u32], motion: Option<&Pose>, stretch: &mut Stretch) {
        stretch.fill_normals(numbers.iter().map(|number| self.point(*number).normal_vector()));
        stretch.turn(&self.part_from_world);
        if let Some(motion) = motion {
            stretch.turn(motion);
        }
    }
}

/// One pass over a cloud: the points near each region, in the part frame, in the order of the cloud.
pub(super) fn gather<'a>(cloud: &'a [Point], part_from_world: &Pose, regions: &[Region]) -> Vec<Nearby<'a>> {
    let bounds: Vec<Option<Bounds>> = regions.iter().map(Region::bounds).collect();
    // The parts are cut by the length of the cloud alone, so their order is that of the cloud on any number of threads.
    let length = cloud.len().div_ceil(PARTS).max(1);
    let part = |(number, points): (usize, &[Point])| {
        numbers(number * length, points, part_from_world, (regions, &bounds))
    };
    let parts: Vec<Vec<Vec<u32>>> = cloud.par_chunks(length).enumerate().map(part).collect();
    let nearby = |region: usize| {
        let numbers = parts.iter().map(|part| &part[region][..]).collect::<Vec<_>>().concat();
        Nearby { cloud, part_from_world: *part_from_world, numbers }
    };
    (0..regions.len()).into_par_iter().map(nearby).collect()
}

/// Numbers in the cloud of the points that each region holds, of a part of it from `first` on; the regions with their boxes.
fn numbers(
    first: usize,
    points: &[Point],
    part_from_world: &Pose,
    (regions, bounds): (&[Region], &[Option<Bounds>]),
) -> Vec<Vec<u32>> {
    let mut lists: Vec<Vec<u32>> = regions.iter().map(|_| Vec::new()).collect();
    let mut stretch = Stretch::new();
    for (points_here, first_here) in points.chunks(STRETCH).zip((first..).step_by(STRETCH)) {
        stretch.place(points_here, part_from_world);
        let about = stretch.bounds();
        for ((region, bounds), list) in regions.iter().zip(bounds).zip(&mut lists) {
            if bounds.as_ref().is_some_and(|bounds| bounds.misses(&about)) {
                continue;
            }
            let mut held = stretch.held(region);
            if held != 0 && list.is_empty() {
                // Lists never grow: what is not written takes no memory.
                list.reserve_exact(points.len());
            }
            while held != 0 {
                list.push(first_here as u32 + held.trailing_zeros());
                held &= held - 1;
            }
        }
    }
    lists
}
