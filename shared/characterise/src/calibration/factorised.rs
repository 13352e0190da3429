//! The normal equations, factorised: steps and solutions.

use super::eliminated_points::Eliminated;
use super::model::POSE;
use super::normal::{Normal, Step};
use fringe::math::linear::{Dense, Factor};

/// The normal equations, factorised.
pub(super) enum Factorised<'a> {
    /// With the poses eliminated.
    Poses {
        /// Factor of the reduced matrix.
        factor: Factor,
        /// Right side of the reduced matrix.
        right: Vec<f64>,
        /// V⁻¹ of each pose.
        inverses: Vec<Option<Dense>>,
    },
    /// With the points of the target eliminated.
    Points(Eliminated<'a>),
}

impl Factorised<'_> {
    /// Devices, warp and points of the solution for a right side that is zero for the poses.
    pub fn solve(&self, right: &[f64]) -> Vec<f64> {
        match self {
            Self::Poses { factor, .. } => factor.solve(right),
            Self::Points(eliminated) => {
                let (devices, points) = right.split_at(eliminated.devices());
                let (mut solved, _, points) = eliminated.solve(devices, &[], points);
                solved.extend(points);
                solved
            }
        }
    }
}

impl Normal {
    /// The factorised system; `None` when something is open.
    pub fn factorised(&self, damping: f64) -> Option<Factorised<'_>> {
        if let Some(points) = &self.points {
            return Eliminated::new(self, points, damping).map(Factorised::Points);
        }
        let inverses = self.pose_inverses(damping).ok()?;
        let (matrix, right) = self.reduced(&inverses, damping);
        Some(Factorised::Poses { factor: Factor::new(&matrix).ok()?, right, inverses })
    }

    /// The step (JᵀJ + λ diag)⁻¹ Jᵀr; `None` when singular.
    pub fn step(&self, damping: f64) -> Option<Step> {
        let (factor, right, inverses) = match self.factorised(damping)? {
            Factorised::Poses { factor, right, inverses } => (factor, right, inverses),
            Factorised::Points(eliminated) => {
                let (devices, of_points) = self.right.split_at(self.devices.rows);
                let of_poses: Vec<_> =
                    self.poses.iter().map(|block| block.as_ref().map(|b| b.right.clone())).collect();
                let (mut devices, poses, points) = eliminated.solve(devices, &of_poses, of_points);
                devices.extend(points);
                return Some(Step { devices, poses });
            }
        };
        let devices = factor.solve(&right);
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
}
