//! Normal equations with the poses eliminated (Schur complement), in a fixed order of sums.

use super::model::POSE;
use fringe::math::linear::{Dense, Factor, dot};

/// Normal equations: devices dense, poses block diagonal.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    /// Matrix of the reduced parameters before elimination.
    pub devices: Dense,
    /// Their right side Jᵀr.
    pub right: Vec<f64>,
    /// One block per pose that is used.
    pub poses: Vec<Option<PoseBlock>>,
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
    /// Reduced parameters × 6.
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

    /// The step (JᵀJ + λ diag)⁻¹ Jᵀr; `None` when singular.
    pub fn step(&self, damping: f64) -> Option<Step> {
        let inverses = self.pose_inverses(damping).ok()?;
        let (matrix, right) = self.reduced(&inverses, damping);
        let devices = Factor::new(&matrix).ok()?.solve(&right);
        let poses = self.poses.iter().zip(&inverses).map(|(block, inverse)| {
            let (block, inverse) = (block.as_ref()?, inverse.as_ref()?);
            let rest: Vec<f64> = (0..POSE)
                .map(|j| {
                    block.right[j]
                        - (0..devices.len()).map(|r| block.coupling.at(r, j) * devices[r]).sum::<f64>()
                })
                .collect();
            Some(inverse.apply(&rest))
        });
        Some(Step { poses: poses.collect(), devices })
    }

    /// δᵀ JᵀJ δ: the square of a step in standard deviations.
    pub fn length(&self, step: &Step) -> f64 {
        let mut sum = dot(&step.devices, &self.devices.apply(&step.devices));
        for (block, pose) in self.poses.iter().zip(&step.poses) {
            let (Some(block), Some(pose)) = (block, pose) else { continue };
            sum += dot(pose, &block.matrix.apply(pose));
            sum += 2.0 * dot(&step.devices, &block.coupling.apply(pose));
        }
        sum.max(0.0)
    }
}

fn damped(matrix: &Dense, damping: f64) -> Dense {
    let mut damped = matrix.clone();
    for i in 0..matrix.rows {
        damped.add(i, i, damping * matrix.at(i, i));
    }
    damped
}
