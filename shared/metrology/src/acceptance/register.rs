//! All views of a position in one frame, by the reference spheres that stand beside the artefact.
//!
//! One adjustment over all views: the centres and diameters of the reference spheres (the same in each view) and the
//! motion of each view, weighted by the covariance of each fitted sphere. A sphere of which a camera sees a cap has a
//! centre that is five times less certain along the line of sight than across, and hangs together with its diameter:
//! knowing that the diameter is the same in all views is what fixes it. Diameters need no certificate.

use nalgebra::{Cholesky, Matrix3, Matrix4, Point3, Rotation3, SVector, Vector3, Vector4};

use super::join::motion;
use crate::fit::{Normal, SphereFit};
use fringe::geometry::pose::Pose;

/// Rounds of spheres, then motions; each leaves a part of the error before, a tenth where the weights differ little.
const MOST_ROUNDS: usize = 500;

/// A move below this ends the adjustment, mm.
const SETTLED_MM: f64 = 1e-10;

/// A reference sphere as one view shows it.
struct Observation {
    centre: Vector3<f64>,
    radius_mm: f64,
    /// W with WᵀW the inverse of the covariance of (centre, radius).
    whitening: Matrix4<f64>,
}

/// Motion of each view into the frame of the first, and the root mean square of what remains between its centres and the
/// adjusted ones, mm, the worst over all views. `None` where the spheres fix no motion: fewer than three, or on a line.
pub(super) fn register(views: &[Vec<SphereFit>]) -> Option<(Vec<Pose>, f64)> {
    let observations: Vec<Vec<Observation>> = views
        .iter()
        .map(|view| view.iter().map(observation).collect::<Option<Vec<_>>>())
        .collect::<Option<_>>()?;
    let centres =
        |view: &[Observation]| -> Vec<Point3<f64>> { view.iter().map(|s| s.centre.into()).collect() };
    let first = centres(observations.first()?);
    let mut poses = observations
        .iter()
        .map(|view| Some(motion(&centres(view), &first)?.0))
        .collect::<Option<Vec<Pose>>>()?;
    poses[0] = Pose { rotation: Matrix3::identity(), translation: Vector3::zeros() };
    let mut spheres: Vec<Vector4<f64>> = Vec::new();
    for _ in 0..MOST_ROUNDS {
        spheres =
            (0..first.len()).map(|index| sphere(&observations, &poses, index)).collect::<Option<_>>()?;
        let mut largest_mm = 0.0_f64;
        for (view, pose) in observations.iter().zip(&mut poses).skip(1) {
            largest_mm = largest_mm.max(step_pose(view, pose, &spheres)?);
        }
        if largest_mm <= SETTLED_MM {
            break;
        }
    }
    let off = |view: &[Observation], pose: &Pose| {
        let squares =
            view.iter().zip(&spheres).map(|(s, c)| (pose.point(&s.centre) - c.xyz()).norm_squared());
        (squares.sum::<f64>() / first.len() as f64).sqrt()
    };
    let worst_mm = observations.iter().zip(&poses).map(|(view, pose)| off(view, pose)).fold(0.0, f64::max);
    Some((poses, worst_mm))
}

fn observation(fit: &SphereFit) -> Option<Observation> {
    let factor = Cholesky::new(fit.covariance_mm2)?.l();
    let whitening = factor.try_inverse()?;
    Some(Observation { centre: fit.center().coords, radius_mm: 0.5 * fit.diameter_mm, whitening })
}

/// What a view leaves of a sphere (centre, radius), in its own frame.
fn residual(observation: &Observation, pose: &Pose, sphere: &Vector4<f64>) -> Vector4<f64> {
    let seen = pose.rotation.transpose() * (sphere.xyz() - pose.translation);
    (seen - observation.centre).push(sphere.w - observation.radius_mm)
}

/// The sphere that agrees best with all views: linear.
fn sphere(observations: &[Vec<Observation>], poses: &[Pose], index: usize) -> Option<Vector4<f64>> {
    let start = (poses[0].point(&observations[0][index].centre)).push(observations[0][index].radius_mm);
    let mut sums = Normal::<4>::zero();
    for (view, pose) in observations.iter().zip(poses) {
        let observation = &view[index];
        let rotation = pose.rotation.transpose().insert_row(3, 0.0).insert_column(3, 0.0);
        let derivatives = observation.whitening * (rotation + Matrix4::from_diagonal(&Vector4::w()));
        add(&mut sums, &(observation.whitening * residual(observation, pose, &start)), &derivatives);
    }
    Some(start + sums.step(0.0)?)
}

/// One Gauss–Newton step of a view's motion, about the middle of the spheres; returns how far it moved them at most, mm.
fn step_pose(view: &[Observation], pose: &mut Pose, spheres: &[Vector4<f64>]) -> Option<f64> {
    let middle = spheres.iter().map(Vector4::xyz).sum::<Vector3<f64>>() / spheres.len() as f64;
    let mut sums = Normal::<6>::zero();
    for (observation, sphere) in view.iter().zip(spheres) {
        // x ↦ middle + exp(ω) (x − middle) + d after the motion: seen moves by −Rᵀ(ω × (sphere − middle) + d).
        let arm = sphere.xyz() - middle;
        let back = pose.rotation.transpose();
        let by_turn = back * arm.cross_matrix();
        let mut derivatives = nalgebra::SMatrix::<f64, 4, 6>::zeros();
        derivatives.fixed_view_mut::<3, 3>(0, 0).copy_from(&by_turn);
        derivatives.fixed_view_mut::<3, 3>(0, 3).copy_from(&-back);
        add(
            &mut sums,
            &(observation.whitening * residual(observation, pose, sphere)),
            &(observation.whitening * derivatives),
        );
    }
    let step = sums.step(0.0)?;
    let (angle, shift) = (step.fixed_rows::<3>(0).into_owned(), step.fixed_rows::<3>(3).into_owned());
    let turn = Rotation3::new(angle).into_inner();
    let moved = Pose { rotation: turn, translation: middle + shift - turn * middle };
    *pose = moved.after(pose);
    let reach = spheres.iter().map(|s| (s.xyz() - middle).norm()).fold(0.0, f64::max);
    Some(shift.norm() + angle.norm() * reach)
}

fn add<const P: usize>(
    sums: &mut Normal<P>,
    residual: &Vector4<f64>,
    derivatives: &nalgebra::SMatrix<f64, 4, P>,
) {
    for row in 0..4 {
        let derivatives: SVector<f64, P> = SVector::from_fn(|k, _| derivatives[(row, k)]);
        sums.add(residual[row], &derivatives);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::FitSettings;
    use fringe::math::random::{Key, normal_quantile};
    use nalgebra::{Isometry3, UnitQuaternion};

    const SPHERES: [([f64; 3], f64); 4] = [
        ([38.0, 0.0, -6.0], 5.5),
        ([3.0, 37.0, 4.0], 6.5),
        ([-36.0, 5.0, -4.0], 7.5),
        ([-2.0, -39.0, 8.0], 8.5),
    ];

    fn place(view: usize) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_euler_angles(0.02, -0.01, 1.2566 * view as f64);
        Isometry3::from_parts(Vector3::new(view as f64, -0.5, 0.3).into(), turn)
    }

    /// The spheres of a view, each from a cap of 60° about the line of sight, with noise.
    fn seen(view: usize, noise_mm: f64, key: Key) -> Vec<SphereFit> {
        let one = |(index, (centre, radius)): (usize, &([f64; 3], f64))| {
            let centre = place(view) * Point3::from(*centre);
            let points: Vec<Point3<f64>> = (0..800_u32)
                .map(|i| {
                    let up = 1.0 - 0.5 * (f64::from(i) + 0.5) / 800.0;
                    let (sine, cosine) = fringe::math::sincos(2.399_963 * f64::from(i));
                    let across = (1.0 - up * up).sqrt();
                    let draw = key.with(view as u64).with(index as u64).open(u64::from(i));
                    let away = radius + noise_mm * normal_quantile(draw);
                    centre + away * Vector3::new(across * cosine, across * sine, up)
                })
                .collect();
            crate::fit::sphere(&points, &FitSettings::default()).unwrap()
        };
        SPHERES.iter().enumerate().map(one).collect()
    }

    /// How far the middle of the spheres is off after motions onto the first view, root mean square.
    fn off_mm(poses: &[Pose]) -> f64 {
        let off = |(view, pose): (usize, &Pose)| {
            let middle = place(view) * Point3::new(0.0, 0.0, 0.0);
            (pose.point(&middle.coords) - place(0).translation.vector).norm_squared()
        };
        let squares: f64 = poses.iter().enumerate().skip(1).map(off).sum();
        (squares / (poses.len() - 1) as f64).sqrt()
    }

    #[test]
    fn views_without_noise_come_into_one_frame() {
        let views: Vec<_> = (0..5).map(|view| seen(view, 1e-9, Key::new(1))).collect();
        let (poses, rms_mm) = register(&views).unwrap();
        assert!(off_mm(&poses) < 1e-8 && rms_mm < 1e-8, "{} {rms_mm}", off_mm(&poses));
        assert_eq!(poses[0], Pose::new(&Isometry3::identity()));
    }

    /// Centres alone, all weighted alike, beside the adjustment, on the same noise.
    #[test]
    fn weights_and_common_diameters_halve_the_error_of_centres_alone() {
        let (mut alike, mut adjusted) = (0.0, 0.0);
        for trial in 0..10 {
            let views: Vec<_> = (0..5).map(|view| seen(view, 0.02, Key::new(7).with(trial))).collect();
            adjusted += off_mm(&register(&views).unwrap().0).powi(2);
            let centres = |v: &[SphereFit]| v.iter().map(SphereFit::center).collect::<Vec<_>>();
            let first = centres(&views[0]);
            let poses: Vec<Pose> = views.iter().map(|v| motion(&centres(v), &first).unwrap().0).collect();
            alike += off_mm(&poses).powi(2);
        }
        assert!(adjusted < 0.25 * alike, "{} against {} mm", adjusted.sqrt(), alike.sqrt());
    }

    #[test]
    fn spheres_on_a_line_fix_no_motion() {
        let line = |_| {
            (0..3)
                .map(|i| {
                    let mut fit = seen(0, 0.01, Key::new(3)).swap_remove(0);
                    fit.center_mm = [f64::from(i) * 30.0, 0.0, 0.0];
                    fit
                })
                .collect()
        };
        assert!(register(&(0..2).map(line).collect::<Vec<_>>()).is_none());
    }
}
