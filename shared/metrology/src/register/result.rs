//! The alignment and how much it is worth.

use nalgebra::Vector3;
use serde::Serialize;

use super::covariance::{Stated, covariance};
use super::icp::Refined;
use super::motion::{Equations, Principal};
use super::{RegisterError, RegisterSettings};
use fringe::geometry::pose::Pose;

/// How the start was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// Given by the caller.
    Given,
    /// As the cloud lay.
    AsItLay,
    /// By a search over all poses.
    Search,
}

/// What an alignment is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// One pose fits, and the surfaces determine all of it.
    Aligned,
    /// One pose fits, but for motions that bring the surfaces onto themselves (a sphere turns, a plane slides).
    Undetermined,
    /// Another pose fits as well, and no motion along the surfaces leads there.
    Ambiguous,
    /// The points still moved when the rounds were used up.
    NotConverged,
}

/// A pose that the points do not distinguish from the chosen one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rival {
    /// Its share of matches over the chosen one's.
    pub share: f64,
    /// Whether the motion between the two brings the reference onto itself.
    pub symmetric: bool,
    /// The other pose of the cloud.
    pub pose: Pose,
}

/// A motion that the surfaces do not determine: it was left at its start.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Freedom {
    /// What the motion is, as a screw about the centre: share of rotation, rad per unit.
    pub rotation_per_mm: [f64; 3],
    /// Share of translation, mm per unit.
    pub translation: [f64; 3],
    /// Root mean square slope of the distances to this motion of 1 mm.
    pub sensitivity: f64,
}

/// An alignment: x ↦ rotation · x + translation brings the cloud onto the reference.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Registration {
    /// Rotation matrix, row by row.
    pub rotation: [[f64; 3]; 3],
    /// Translation of the cloud, mm.
    pub translation_mm: [f64; 3],
    /// Both as one matrix, row by row.
    pub matrix: [[f64; 4]; 4],
    /// What the alignment is worth.
    pub outcome: Outcome,
    /// How the start was found.
    pub start: Start,
    /// Whether the points stood still at the end.
    pub converged: bool,
    /// Rounds of each level, coarse to fine; last those without the points at edges.
    pub iterations: Vec<usize>,
    /// Motion of the last round, mm.
    pub last_motion_mm: f64,
    /// Root mean square distance along the normal of the matches used, mm.
    pub rms_mm: f64,
    /// Median of the magnitudes of all matches, mm.
    pub median_abs_mm: f64,
    /// Share of the cloud's points, without those at edges, that lie on the reference, within the reach.
    pub overlap: f64,
    /// Number of matches used.
    pub inliers: usize,
    /// Points of the cloud.
    pub points: usize,
    /// Points that stayed out because they lie near an edge of the mesh.
    pub at_edges: usize,
    /// Farthest match of the last round, mm.
    pub reach_mm: f64,
    /// Ratio of largest to smallest root mean square slope of the distances to motions of 1 mm (rotations at the root
    /// mean square distance of the points); of the determined motions only.
    pub condition: f64,
    /// Motions that are not determined; empty when all six are.
    pub undetermined: Vec<Freedom>,
    /// Covariance of a small rotation about `centre_mm` (x, y, z, rad) and a translation (mm), row by row, with the
    /// correlation of neighbours' noise. In a coordinate that an undetermined motion changes: infinite on the diagonal, zero beside it.
    pub covariance: [[f64; 6]; 6],
    /// Standard uncertainties: roots of the diagonal of the covariance, infinite where an undetermined motion leads.
    pub u_rotation_rad: [f64; 3],
    /// Standard uncertainties of the translation x, y, z, mm, infinite as those of the rotation.
    pub u_translation_mm: [f64; 3],
    /// Where the rotation of the covariance turns: centre of the matches, reference frame, mm.
    pub centre_mm: [f64; 3],
    /// Cells behind the uncertainties; 0 where the points had to count as independent.
    pub cells: usize,
    /// How far the noise of neighbours is correlated by the residuals' own account, mm.
    pub correlation_reach_mm: Option<f64>,
    /// Another pose that matches as well: its share of matches over this one's.
    pub rival: Option<f64>,
    /// Whether that pose differs by a symmetry of the reference.
    pub rival_is_symmetry: Option<bool>,
    /// That pose, row by row.
    pub rival_matrix: Option<[[f64; 4]; 4]>,
}

impl Freedom {
    /// In words: what may slide or turn.
    pub fn describe(&self) -> String {
        let vector = |v: Vector3<f64>| format!("({:.3}, {:.3}, {:.3})", v.x, v.y, v.z);
        let (turn, shift) = (Vector3::from(self.rotation_per_mm), Vector3::from(self.translation));
        let shift_share = shift.norm();
        match turn.try_normalize(1e-300) {
            Some(axis) if shift_share < 0.1 => format!("rotation about {} through the centre", vector(axis)),
            Some(axis) if shift_share < 0.995 => {
                format!("rotation about {} with a shift along {}", vector(axis), vector(shift / shift_share))
            }
            _ => format!("shift along {}", vector(shift / shift_share)),
        }
    }
}

impl Registration {
    /// Whether the pose may be used: the points stand still, and no other pose fits as well.
    pub fn is_reliable(&self) -> bool {
        matches!(self.outcome, Outcome::Aligned | Outcome::Undetermined)
    }

    /// Angle of the rotation, degrees.
    pub fn angle_deg(&self) -> f64 {
        self.pose().angle_rad().to_degrees()
    }

    /// Rotation and translation as a pose.
    pub fn pose(&self) -> Pose {
        let rows = self.rotation;
        Pose {
            rotation: nalgebra::Matrix3::from_fn(|r, c| rows[r][c]),
            translation: Vector3::from(self.translation_mm),
        }
    }
}

/// Builds the report and sets its outcome.
///
/// # Errors
/// Too little overlap, or nothing that the surfaces determine.
pub(super) fn conclude(
    last: &Refined,
    iterations: Vec<usize>,
    start: Start,
    (rival, at_edges): (Option<Rival>, usize),
    settings: &RegisterSettings,
) -> Result<Registration, RegisterError> {
    let overlap = last.overlapping as f64 / last.points as f64;
    if overlap < settings.least_overlap {
        let (share_percent, least_percent) = (overlap * 100.0, settings.least_overlap * 100.0);
        return Err(RegisterError::Overlap { share_percent, least_percent });
    }
    let (equations, principal) = (&last.equations, &last.principal);
    let slopes: Vec<f64> = principal.determined().map(|i| principal.values[i].sqrt()).collect();
    let (Some(least), Some(most)) = (slopes.first(), slopes.last()) else {
        return Err(RegisterError::Free);
    };
    let Stated { covariance, cells, correlation_reach_mm } = covariance(last);
    let u = |i: usize| covariance[(i, i)].max(0.0).sqrt();
    let (r, t) = (last.pose.rotation, last.pose.translation);
    let row = |i: usize| [r[(i, 0)], r[(i, 1)], r[(i, 2)]];
    let undetermined: Vec<Freedom> = principal.free().map(|i| freedom(equations, principal, i)).collect();
    Ok(Registration {
        rotation: [row(0), row(1), row(2)],
        translation_mm: t.into(),
        matrix: matrix(&last.pose),
        outcome: outcome(last.converged, !undetermined.is_empty(), rival.as_ref()),
        start,
        converged: last.converged,
        iterations,
        last_motion_mm: last.moved_mm,
        rms_mm: (equations.normal.sum / equations.normal.rows.max(1) as f64).sqrt(),
        median_abs_mm: last.median_mm,
        overlap,
        inliers: equations.normal.rows,
        points: last.points + at_edges,
        at_edges,
        reach_mm: last.next_reach_mm,
        condition: most / least,
        undetermined,
        covariance: std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)])),
        u_rotation_rad: [u(0), u(1), u(2)],
        u_translation_mm: [u(3), u(4), u(5)],
        centre_mm: equations.centre.coords.into(),
        cells,
        correlation_reach_mm,
        rival: rival.map(|r| r.share),
        rival_is_symmetry: rival.map(|r| r.symmetric),
        rival_matrix: rival.map(|r| matrix(&r.pose)),
    })
}

/// What weighs most, first. Where the surfaces leave a motion free, a symmetry of the reference is no further doubt.
fn outcome(converged: bool, free: bool, rival: Option<&Rival>) -> Outcome {
    match rival {
        _ if !converged => Outcome::NotConverged,
        Some(rival) if !(free && rival.symmetric) => Outcome::Ambiguous,
        _ if free => Outcome::Undetermined,
        _ => Outcome::Aligned,
    }
}

/// A motion as a 4 × 4 matrix, row by row.
fn matrix(pose: &Pose) -> [[f64; 4]; 4] {
    let (r, t) = (&pose.rotation, &pose.translation);
    std::array::from_fn(
        |i| {
            if i == 3 { [0.0, 0.0, 0.0, 1.0] } else { [r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]] }
        },
    )
}

fn freedom(equations: &Equations, principal: &Principal, i: usize) -> Freedom {
    let v = principal.vectors.column(i);
    Freedom {
        rotation_per_mm: [v[0], v[1], v[2]].map(|c| c / equations.arm_mm),
        translation: [v[3], v[4], v[5]],
        sensitivity: principal.values[i].max(0.0).sqrt(),
    }
}
