//! The points of a cloud near the regions of a plan: whole stretches of the cloud are passed over where no region lies.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::bounds::Bounds;
use super::region::Region;
use super::stretch::{STRETCH, Stretch};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;

/// Parts of a cloud that threads take. Their number is fixed: the allocations of a cycle do not depend on the cloud.
const PARTS: usize = 8;

/// Points that a thread writes at least.
const WRITTEN: usize = 8192;

/// A point of the cloud in the part frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub index: u32,
    /// Standard uncertainty that the cloud states, mm.
    pub sigma_mm: f32,
    pub position: Vector3<f64>,
    pub normal: Vector3<f64>,
}

impl Sample {
    /// A point of the cloud by its number.
    fn new(index: u32, point: &Point, part_from_world: &Pose) -> Self {
        Self {
            index,
            sigma_mm: point.sigma_mm,
            position: part_from_world.point(&Vector3::from(point.position_mm)),
            normal: part_from_world.rotation * point.normal_vector(),
        }
    }

    /// The same in another frame.
    pub fn moved(&self, motion: &Pose) -> Self {
        Self {
            index: self.index,
            sigma_mm: self.sigma_mm,
            position: motion.point(&self.position),
            normal: motion.rotation * self.normal,
        }
    }
}

/// One pass over a cloud: the points near each region, in the part frame, in the order of the cloud.
pub(super) fn gather(cloud: &[Point], part_from_world: &Pose, regions: &[Region]) -> Vec<Vec<Sample>> {
    let bounds: Vec<Option<Bounds>> = regions.iter().map(Region::bounds).collect();
    // The parts are cut by the length of the cloud alone, so their order is that of the cloud on any number of threads.
    let length = cloud.len().div_ceil(PARTS).max(1);
    let part = |(number, points): (usize, &[Point])| {
        numbers(number * length, points, part_from_world, (regions, &bounds))
    };
    let parts: Vec<Vec<Vec<u32>>> = cloud.par_chunks(length).enumerate().map(part).collect();
    let sample = |index: &u32| Sample::new(*index, &cloud[*index as usize], part_from_world);
    let samples = |region: usize| {
        let numbers: Vec<u32> = parts.iter().flat_map(|part| &part[region]).copied().collect();
        numbers.par_iter().with_min_len(WRITTEN).map(sample).collect()
    };
    (0..regions.len()).into_par_iter().map(samples).collect()
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
