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

/// Initial capacity of a region's list of points: small lists would grow a dozen times in every cycle.
const GATHERED: usize = 4096;

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
    let part = |number: usize| {
        let mut lists: Vec<Vec<Sample>> = regions.iter().map(|_| Vec::new()).collect();
        let range = (number * length).min(cloud.len())..((number + 1) * length).min(cloud.len());
        let mut stretch = Stretch::new();
        for first in range.clone().step_by(STRETCH) {
            let points = &cloud[first..(first + STRETCH).min(range.end)];
            stretch.fill(points.iter().map(|point| Vector3::from(point.position_mm)));
            stretch.transform(part_from_world);
            let about = stretch.bounds();
            for ((region, bounds), list) in regions.iter().zip(&bounds).zip(&mut lists) {
                if bounds.as_ref().is_some_and(|bounds| bounds.misses(&about)) {
                    continue;
                }
                let mut held = stretch.held(region);
                if held != 0 && list.is_empty() {
                    list.reserve(GATHERED);
                }
                while held != 0 {
                    let number = held.trailing_zeros() as usize;
                    held &= held - 1;
                    list.push(Sample {
                        index: (first + number) as u32,
                        sigma_mm: points[number].sigma_mm,
                        position: stretch.position(number),
                        normal: part_from_world.rotation * points[number].normal_vector(),
                    });
                }
            }
        }
        lists
    };
    let parts: Vec<Vec<Vec<Sample>>> = (0..PARTS).into_par_iter().map(part).collect();
    let join = |region: usize| {
        let mut all = Vec::with_capacity(parts.iter().map(|lists| lists[region].len()).sum());
        for lists in &parts {
            all.extend_from_slice(&lists[region]);
        }
        all
    };
    (0..regions.len()).into_par_iter().map(join).collect()
}
