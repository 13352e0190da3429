//! A grid that gives the reference's sample near a place in one step: coarse, and fast enough for a million poses.

use nalgebra::Vector3;

use super::motion::{Equations, Principal, orthonormal};
use super::oriented::Sample;
use crate::fit::Normal;
use fringe::geometry::pose::Pose;

/// Most cells along an axis.
const MOST_CELLS: f64 = 250.0;

/// Largest angle between the normals of a pair: 45°.
const NORMAL_COSINE: f64 = 0.7;

/// No sample near this cell.
const NONE: u32 = u32::MAX;

/// Fewest pairs of an adjustment.
const FEWEST_PAIRS: usize = 12;

/// Samples by cells of a grid around the reference.
pub(super) struct Near<'a> {
    samples: &'a [Sample],
    signed: bool,
    low: Vector3<f64>,
    edge_mm: f64,
    cells: [usize; 3],
    nearest: Vec<u32>,
}

impl<'a> Near<'a> {
    /// Each cell gets the sample nearest to its middle among those within `reach_mm` of it.
    pub fn new(samples: &'a [Sample], signed: bool, reach_mm: f64) -> Self {
        let fold = |start: f64, pick: fn(&Vector3<f64>, &Vector3<f64>) -> Vector3<f64>| {
            samples.iter().fold(Vector3::repeat(start), |sum, s| pick(&sum, &s.place))
        };
        let margin = Vector3::repeat(reach_mm);
        let low = fold(f64::INFINITY, Vector3::inf) - margin;
        let high = fold(f64::NEG_INFINITY, Vector3::sup) + margin;
        let edge_mm = (0.4 * reach_mm).max((high - low).max() / MOST_CELLS);
        let cells: [usize; 3] = std::array::from_fn(|axis| ((high - low)[axis] / edge_mm) as usize + 1);
        let mut near =
            Self { samples, signed, low, edge_mm, cells, nearest: vec![NONE; cells.iter().product()] };
        let mut square = vec![(reach_mm * reach_mm) as f32; near.nearest.len()];
        for (number, sample) in (0..).zip(samples) {
            near.enter(number, &sample.place, reach_mm, &mut square);
        }
        near
    }

    /// Offers a sample to the cells around it.
    fn enter(&mut self, number: u32, place: &Vector3<f64>, reach_mm: f64, square: &mut [f32]) {
        let range = |axis: usize| {
            let at = place[axis] - self.low[axis];
            let from = ((at - reach_mm) / self.edge_mm).max(0.0) as usize;
            from..=(((at + reach_mm) / self.edge_mm) as usize).min(self.cells[axis] - 1)
        };
        let (xs, ys, zs) = (range(0), range(1), range(2));
        let offset =
            |axis: usize, cell: usize| self.low[axis] + (cell as f64 + 0.5) * self.edge_mm - place[axis];
        for z in zs {
            for y in ys.clone() {
                let across = offset(2, z) * offset(2, z) + offset(1, y) * offset(1, y);
                for x in xs.clone() {
                    let distance = (across + offset(0, x) * offset(0, x)) as f32;
                    let slot = (z * self.cells[1] + y) * self.cells[0] + x;
                    if distance < square[slot] {
                        square[slot] = distance;
                        self.nearest[slot] = number;
                    }
                }
            }
        }
    }

    /// The sample near a place whose normal agrees.
    #[inline]
    fn find(&self, place: &Vector3<f64>, normal: &Vector3<f64>) -> Option<&Sample> {
        let at = (place - self.low) / self.edge_mm;
        let mut slot = 0;
        for axis in [2, 1, 0] {
            if !(at[axis] >= 0.0 && at[axis] < self.cells[axis] as f64) {
                return None;
            }
            slot = slot * self.cells[axis] + at[axis] as usize;
        }
        let sample = self.samples.get(self.nearest[slot] as usize)?;
        let cosine = sample.normal.dot(normal);
        ((if self.signed { cosine } else { cosine.abs() }) > NORMAL_COSINE).then_some(sample)
    }

    /// How many of the samples lie on the reference to within `limit_mm` along its normal; counting stops as soon as
    /// fewer than `least` can be reached.
    pub fn count(&self, samples: &[Sample], pose: &Pose, limit_mm: f64, least: usize) -> usize {
        let mut found = 0;
        for (done, sample) in samples.iter().enumerate() {
            let place = pose.point(&sample.place);
            let near = self.find(&place, &(pose.rotation * sample.normal));
            found += usize::from(near.is_some_and(|s| s.normal.dot(&(place - s.place)).abs() <= limit_mm));
            if found + (samples.len() - done - 1) < least {
                return 0;
            }
        }
        found
    }

    /// A pose after some rounds of adjustment to the samples near it, the limit shrinking from the first to the last.
    pub fn settled(&self, samples: &[Sample], start: &Pose, limits_mm: [f64; 2], rounds: i32) -> Pose {
        let shrink = fringe::math::pow(limits_mm[1] / limits_mm[0], 1.0 / f64::from(rounds - 1).max(1.0));
        let (mut pose, mut limit_mm) = (*start, limits_mm[0]);
        for _ in 0..rounds {
            let Some(next) = self.round(samples, &pose, limit_mm) else { return pose };
            pose = next;
            limit_mm *= shrink;
        }
        pose
    }

    /// One round: pairs, equations, step.
    fn round(&self, samples: &[Sample], pose: &Pose, limit_mm: f64) -> Option<Pose> {
        let mut pairs = Vec::with_capacity(samples.len());
        for sample in samples {
            let place = pose.point(&sample.place);
            let Some(near) = self.find(&place, &(pose.rotation * sample.normal)) else { continue };
            let distance_mm = near.normal.dot(&(place - near.place));
            if distance_mm.abs() <= limit_mm {
                pairs.push((place, near.normal, distance_mm));
            }
        }
        if pairs.len() < FEWEST_PAIRS {
            return None;
        }
        let count = pairs.len() as f64;
        let centre = pairs.iter().map(|p| p.0).sum::<Vector3<f64>>() / count;
        let arm_mm = (pairs.iter().map(|p| (p.0 - centre).norm_squared()).sum::<f64>() / count).sqrt();
        let (centre, arm_mm) = (centre.into(), arm_mm.max(f64::MIN_POSITIVE));
        let mut normal = Normal::zero();
        for (place, direction, distance_mm) in &pairs {
            normal.add(*distance_mm, &Equations::derivatives(&centre, arm_mm, &(*place).into(), direction));
        }
        let equations = Equations { normal, centre, arm_mm };
        let principal: Principal = equations.principal(0.0);
        let step = equations.pose(&equations.step(&principal)).after(pose);
        Some(Pose { rotation: orthonormal(&step.rotation), translation: step.translation })
    }
}
