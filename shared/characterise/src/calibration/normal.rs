//! Normal equations with the poses eliminated (Schur complement), in a fixed order of sums.

use super::free_points::Points;
use super::model::POSE;
use fringe::math::linear::{Dense, Factor, dot};
use nalgebra::Vector3;

/// Normal equations: devices and warp dense, poses and points of the target block diagonal.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    /// Matrix of devices and warp before elimination.
    pub devices: Dense,
    /// Their right side Jᵀr.
    pub right: Vec<f64>,
    /// One block per pose that is used.
    pub poses: Vec<Option<PoseBlock>>,
    /// The points of the target, where they are adjusted; their unknowns stand behind those of devices and warp.
    pub points: Option<Points>,
    /// The 6 × 6 information of each view about its pose.
    pub shares: Vec<Dense>,
    /// Trace of the information of each view about the target's points; 0 unless they are adjusted.
    pub point_shares: Vec<f64>,
    /// Weighted sum of squares.
    pub cost: f64,
}

/// What belongs to one pose.
#[derive(Debug, Clone)]
pub(super) struct PoseBlock {
    /// Normal matrix of the pose, 6 × 6.
    pub matrix: Dense,
    /// Right side of the pose, Jᵀr.
    pub right: Vec<f64>,
    /// Parameters of devices and warp × 6.
    pub coupling: Dense,
}

impl PoseBlock {
    /// Normal equations without any image point.
    pub fn new(unknowns: usize) -> Self {
        let coupling = Dense::zeros(unknowns, POSE);
        Self { matrix: Dense::zeros(POSE, POSE), right: vec![0.0; POSE], coupling }
    }
}

/// A step of all parameters.
#[derive(Debug, Clone)]
pub(super) struct Step {
    /// Step of the reduced parameters.
    pub devices: Vec<f64>,
    /// Six for each pose that is used.
    pub poses: Vec<Option<Vec<f64>>>,
}

impl Normal {
    /// V⁻¹ of each pose, damped; `Err` names a pose that is open.
    pub fn pose_inverses(&self, damping: f64) -> Result<Vec<Option<Dense>>, usize> {
        let inverse = |(pose, block): (usize, &Option<PoseBlock>)| match block {
            None => Ok(None),
            // All its image points are outliers: the pose stays where it is.
            Some(block) if (0..POSE).all(|i| block.matrix.at(i, i) == 0.0) => Ok(None),
            Some(block) => {
                Factor::new(&damped(&block.matrix, damping)).map(|f| Some(f.inverse())).map_err(|_| pose)
            }
        };
        self.poses.iter().enumerate().map(inverse).collect()
    }

    /// The reduced matrix U − Σ W V⁻¹ Wᵀ and right side, given the inverses of the poses.
    pub fn reduced(&self, inverses: &[Option<Dense>], damping: f64) -> (Dense, Vec<f64>) {
        let mut matrix = damped(&self.devices, damping);
        let mut right = self.right.clone();
        for (block, inverse) in self.poses.iter().zip(inverses) {
            let (Some(block), Some(inverse)) = (block, inverse) else { continue };
            // Rows of devices that do not see the pose are zero.
            let touched: Vec<usize> =
                (0..matrix.rows).filter(|r| block.coupling.row(*r).iter().any(|v| *v != 0.0)).collect();
            let known = inverse.apply(&block.right);
            for row in &touched {
                let left = inverse.apply(block.coupling.row(*row));
                right[*row] -= dot(block.coupling.row(*row), &known);
                for col in &touched {
                    matrix.add(*row, *col, -dot(&left, block.coupling.row(*col)));
                }
            }
        }
        (matrix, right)
    }

    /// The coupling of a pose to all unknowns, those of the target's points last; unknowns × 6.
    pub fn coupling(&self, pose: usize) -> Option<Dense> {
        let block = self.poses[pose].as_ref()?;
        let mut all = Dense::zeros(self.right.len(), POSE);
        for row in 0..self.devices.rows {
            (0..POSE).for_each(|i| all.set(row, i, block.coupling.at(row, i)));
        }
        for (number, point) in self.points.iter().flat_map(|points| points.blocks.iter().enumerate()) {
            for (i, slopes) in point.by_pose.get(&pose).into_iter().flatten().enumerate() {
                (0..3).for_each(|axis| all.set(self.devices.rows + 3 * number + axis, i, slopes[axis]));
            }
        }
        Some(all)
    }

    /// δᵀ JᵀJ δ: the square of a step in standard deviations.
    pub fn length(&self, step: &Step) -> f64 {
        let (devices, of_points) = step.devices.split_at(self.devices.rows);
        let mut sum = dot(devices, &self.devices.apply(devices));
        for (block, pose) in self.poses.iter().zip(&step.poses) {
            let (Some(block), Some(pose)) = (block, pose) else { continue };
            sum += dot(pose, &block.matrix.apply(pose));
            sum += 2.0 * dot(devices, &block.coupling.apply(pose));
        }
        let Some(points) = &self.points else { return sum.max(0.0) };
        for (point, step_mm) in points.blocks.iter().zip(of_points.chunks_exact(3)) {
            let step_mm = Vector3::from_column_slice(step_mm);
            let mut coupled: Vector3<f64> = point.matrix * step_mm;
            for (column, slopes) in &point.by_device {
                coupled += slopes * (2.0 * devices[*column]);
            }
            for (pose, slopes) in &point.by_pose {
                let Some(pose) = &step.poses[*pose] else { continue };
                slopes.iter().zip(pose).for_each(|(w, step)| coupled += w * (2.0 * step));
            }
            sum += step_mm.dot(&coupled);
        }
        (sum + points.datum_length(of_points)).max(0.0)
    }
}

fn damped(matrix: &Dense, damping: f64) -> Dense {
    let mut damped = matrix.clone();
    for i in 0..matrix.rows {
        damped.add(i, i, damping * matrix.at(i, i));
    }
    damped
}
