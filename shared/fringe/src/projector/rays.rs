//! Where a camera's ray meets a projector column or row.

use super::report::Task;
use super::settings::ProjectorSettings;
use crate::geometry::camera::Camera;
use crate::surface::{Cause, Sample};
use nalgebra::{Matrix3, Point2, Vector2, Vector3};

/// Newton steps along the ray; from the ideal plane three reach 1e-12 mm.
const MAX_STEPS: usize = 8;

/// A step shorter than this ends the iteration, relative to the depth: it is quadratic, the next one is below rounding.
const SETTLED: f64 = 1e-9;

/// One observed projector coordinate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observation {
    pub pixel: f64,
    pub sigma_px: f64,
}

pub(super) enum Miss {
    Missed,
    Contradicting,
}

/// The camera's rays in the projector frame: X(Z) = rotation · (x, y, 1) Z + origin.
pub(super) struct Rays<'a> {
    pub projector: &'a Camera,
    pub settings: &'a ProjectorSettings,
    pub rotation: Matrix3<f64>,
    pub origin: Vector3<f64>,
}

impl Rays<'_> {
    pub fn solve(
        &self,
        [x, y]: [f64; 2],
        observed: [Option<Observation>; 2],
        modulation: f32,
        (limbs, sample): (u8, &mut Sample),
        task: &mut Task,
    ) {
        task.valid += 1;
        let along = self.rotation * Vector3::new(x, y, 1.0);
        match self.depth(&along, &observed) {
            Ok((depth, sigma_depth, disagreement_px)) => {
                if let Some(off) = disagreement_px {
                    task.checked += 1;
                    task.squares_px2 += off * off;
                }
                // dq = dZ / Z².
                let sigma = (sigma_depth / (depth * depth)) as f32;
                let inverse_depth = 1.0 / depth;
                *sample =
                    Sample { inverse_depth, sigma, own_share: 1.0, modulation, limbs, cause: Cause::Point };
            }
            Err(Miss::Missed) => {
                *sample = Sample::without(Cause::Missed);
                task.missed += 1;
            }
            Err(Miss::Contradicting) => {
                *sample = Sample::without(Cause::Inconsistent);
                task.contradicting += 1;
            }
        }
    }

    /// Depth, its uncertainty, and the disagreement of both axes where both are given.
    pub fn depth(
        &self,
        along: &Vector3<f64>,
        observed: &[Option<Observation>; 2],
    ) -> Result<(f64, f64, Option<f64>), Miss> {
        let start = self.start(along, observed).ok_or(Miss::Missed)?;
        let solved = self.newton(along, observed, start).ok_or(Miss::Missed)?;
        let Solution { depth, pixel, slope } = solved;
        let [near, far] = self.settings.depth_mm.unwrap_or([0.0, f64::INFINITY]);
        let margin = self.settings.margin_px;
        let inside =
            |value: f64, count: u32| value >= -0.5 - margin && value <= f64::from(count) - 0.5 + margin;
        let on_image = inside(pixel.x, self.projector.width_px) && inside(pixel.y, self.projector.height_px);
        if !(on_image && depth >= near && depth <= far) {
            return Err(Miss::Missed);
        }
        let mut information = 0.0;
        let mut residuals = [None; 2];
        for axis in 0..2 {
            if let Some(o) = observed[axis] {
                let weight = weight(observed, axis);
                information += weight * slope[axis] * slope[axis];
                residuals[axis] = Some(pixel[axis] - o.pixel);
            }
        }
        let off = match residuals {
            [Some(u), Some(v)] => Some((u * u + v * v).sqrt()),
            _ => None,
        };
        if off.is_some_and(|off| off > self.settings.max_epipolar_px) {
            return Err(Miss::Contradicting);
        }
        // Weights are relative to the first sigma when that is zero (ideal data): then so is the result.
        let exact = observed.iter().flatten().any(|o| o.sigma_px == 0.0);
        let sigma = if exact { 0.0 } else { 1.0 / information.sqrt() };
        if sigma.is_finite() { Ok((depth, sigma, off)) } else { Err(Miss::Missed) }
    }

    /// Intersection with the ideal plane of the column (or row) through its pixel beside the principal point.
    fn start(&self, along: &Vector3<f64>, observed: &[Option<Observation>; 2]) -> Option<f64> {
        let [cx, cy] = self.projector.principal_point_px;
        let axis = usize::from(observed[0].is_none());
        let value = observed[axis]?.pixel;
        let pixel = if axis == 0 { Point2::new(value, cy) } else { Point2::new(cx, value) };
        let ideal = self.projector.normalised_from_pixel(pixel)?[axis];
        // Plane X − ideal·Z = 0 (or Y − ideal·Z = 0) in the projector frame.
        let depth = (ideal * self.origin.z - self.origin[axis]) / (along[axis] - ideal * along.z);
        (depth > 0.0 && depth.is_finite()).then_some(depth)
    }

    /// Gauss–Newton on the observed coordinates along the ray.
    fn newton(
        &self,
        along: &Vector3<f64>,
        observed: &[Option<Observation>; 2],
        start: f64,
    ) -> Option<Solution> {
        let mut depth = start;
        for _ in 0..MAX_STEPS {
            let (pixel, slope) = self.project(along, depth)?;
            let (mut pull, mut stiffness) = (0.0, 0.0);
            for axis in 0..2 {
                if let Some(o) = observed[axis] {
                    let weight = weight(observed, axis);
                    pull += weight * slope[axis] * (o.pixel - pixel[axis]);
                    stiffness += weight * slope[axis] * slope[axis];
                }
            }
            let step = pull / stiffness;
            depth += step;
            let sane = depth > 0.0 && depth.is_finite();
            if !sane {
                return None;
            }
            if step.abs() < SETTLED * depth {
                return Some(Solution { depth, pixel: pixel + slope * step, slope });
            }
        }
        None
    }

    /// Projector pixel of the ray at a depth, and its derivative by the depth.
    pub fn project(&self, along: &Vector3<f64>, depth: f64) -> Option<(Point2<f64>, Vector2<f64>)> {
        let at = along * depth + self.origin;
        if at.z <= 1e-9 {
            return None;
        }
        let ideal = Vector2::new(at.x / at.z, at.y / at.z);
        let turn = Vector2::new(along.x - ideal.x * along.z, along.y - ideal.y * along.z) / at.z;
        let lens = self.projector.distortion.jacobian(ideal) * turn;
        let [fx, fy] = self.projector.focal_px;
        let slope = Vector2::new(fx * lens.x + self.projector.skew * lens.y, fy * lens.y);
        Some((self.projector.pixel_from_normalised(ideal), slope))
    }
}

struct Solution {
    depth: f64,
    pixel: Point2<f64>,
    slope: Vector2<f64>,
}

/// 1/σ² of an axis; 1 when a sigma is zero, as in ideal data.
fn weight(observed: &[Option<Observation>; 2], axis: usize) -> f64 {
    let exact = observed.iter().flatten().any(|o| o.sigma_px == 0.0);
    observed[axis].map_or(0.0, |o| if exact { 1.0 } else { 1.0 / (o.sigma_px * o.sigma_px) })
}
