//! Whether another pose that matches as well is another pose at all, or one along a motion that nothing determines.

use nalgebra::{Matrix3, Vector3};

use super::features::apart_mm;
use super::icp::Refined;
use super::motion::{Motion, rotation};
use super::oriented::Sample;
use fringe::geometry::pose::Pose;
use fringe::math;

/// What a pose is to another one.
pub(super) enum Other {
    /// The same, but for a motion that the surfaces do not determine.
    Same,
    /// One that the symmetry of the reference makes as good.
    Symmetric,
    /// A different pose of the part.
    Different,
}

/// Compares a pose with the chosen one. `symmetric` states whether the motion between them brings the reference onto
/// itself; it is asked only where that matters.
pub(super) fn other(
    samples: &[Sample],
    chosen: &Refined,
    pose: &Pose,
    limit_mm: f64,
    symmetric: impl Fn() -> bool,
) -> Other {
    if apart_mm(samples, &chosen.pose, pose) <= limit_mm {
        return Other::Same;
    }
    // The part of the motion between the two that is free, taken back.
    let centre = chosen.equations.centre.coords;
    let between = pose.after(&chosen.pose.inverse());
    let arm_mm = chosen.equations.arm_mm;
    let twist = logarithm(&between, &centre);
    let scaled = Motion::from_fn(|i, _| if i < 3 { twist.0[i] * arm_mm } else { twist.1[i - 3] });
    let free = chosen.principal.free().fold(Motion::zeros(), |sum, i| {
        let direction = chosen.principal.vectors.column(i).into_owned();
        sum + direction * direction.dot(&scaled)
    });
    let turn = Vector3::new(free[0], free[1], free[2]) / arm_mm;
    let shift = Vector3::new(free[3], free[4], free[5]);
    let rest = exponential(&turn, &shift, &centre).inverse().after(&between);
    if apart_mm(samples, &chosen.pose, &rest.after(&chosen.pose)) <= limit_mm {
        return Other::Same;
    }
    if symmetric() { Other::Symmetric } else { Other::Different }
}

/// Rotation vector of a matrix, rad.
fn turn_of(matrix: &Matrix3<f64>, angle: f64) -> Vector3<f64> {
    let m = matrix;
    let skew = Vector3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]) * 0.5;
    if angle < 3.0 {
        // Below a nanoradian the two are equal to the last bit.
        return if angle < 1e-9 { skew } else { skew * (angle / math::sin(angle)) };
    }
    // Near half a turn: R + Rᵀ = 2 cos θ I + 2 (1 − cos θ) a aᵀ; its longest column is along a.
    let cosine = math::cos(angle);
    let outer = (m + m.transpose()) * 0.5 - Matrix3::identity() * cosine;
    let longest =
        (0..3).max_by(|a, b| outer.column(*a).norm().total_cmp(&outer.column(*b).norm())).unwrap_or(0);
    let axis: Vector3<f64> = outer.column(longest).into_owned();
    let axis = axis.try_normalize(1e-300).unwrap_or_else(Vector3::z);
    axis * if axis.dot(&skew) < 0.0 { -angle } else { angle }
}

/// Rotation and shift of the screw that a motion is, per unit of time, about a centre.
fn logarithm(motion: &Pose, centre: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let angle = motion.angle_rad();
    let turn = turn_of(&motion.rotation, angle);
    let shift = motion.point(centre) - centre;
    let cross = turn.cross_matrix();
    let factor = if angle < 1e-4 {
        1.0 / 12.0
    } else {
        (1.0 - 0.5 * angle * math::sin(angle) / (1.0 - math::cos(angle))) / (angle * angle)
    };
    (turn, (Matrix3::identity() - cross * 0.5 + cross * cross * factor) * shift)
}

/// The motion of a screw about a centre.
fn exponential(turn: &Vector3<f64>, shift: &Vector3<f64>, centre: &Vector3<f64>) -> Pose {
    let angle = turn.norm();
    let cross = turn.cross_matrix();
    let (first, second) = if angle < 1e-4 {
        (0.5, 1.0 / 6.0)
    } else {
        ((1.0 - math::cos(angle)) / (angle * angle), (angle - math::sin(angle)) / (angle * angle * angle))
    };
    let moved = (Matrix3::identity() + cross * first + cross * cross * second) * shift;
    let rotation = rotation(turn);
    Pose { rotation, translation: centre - rotation * centre + moved }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_and_logarithm_undo_each_other() {
        let centre = Vector3::new(3.0, -2.0, 7.0);
        for scale in [1e-7, 1e-3, 0.4, 1.5, 3.05, 3.13] {
            let (turn, shift) = (Vector3::new(0.6, -0.48, 0.64) * scale, Vector3::new(2.0, -30.0, 4.0));
            let (again, moved) = logarithm(&exponential(&turn, &shift, &centre), &centre);
            assert!(
                (again - turn).norm() < 1e-9 && (moved - shift).norm() < 1e-6,
                "{scale}: {again} {moved}"
            );
        }
    }
}
