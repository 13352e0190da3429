//! The axis comes back, with the scatter that it states; views that do not determine it are refused.

use super::*;
use fringe::math::random::{Key, Normal};
use proptest::prelude::*;

fn axis(tilt: [f64; 2], at: [f64; 3]) -> StageAxis {
    StageAxis { point_mm: at.into(), direction: Vector3::new(tilt[0], tilt[1], 1.0).normalize() }
}

fn places(axis: &StageAxis, start: [f64; 3], angles_deg: &[f64]) -> Vec<(f64, Point3<f64>)> {
    let of = |deg: &f64| (deg.to_radians(), axis.turn(deg.to_radians()).point(&Vector3::from(start)).into());
    angles_deg.iter().map(of).collect()
}

/// Distance of the axes at the foot of the calibrated point, and angle between them.
fn off(found: &StageCalibration, truth: &StageAxis) -> (f64, f64) {
    let point = Vector3::from(found.point_mm);
    let apart = (point - truth.foot(&point)).norm();
    (apart, Vector3::from(found.direction).cross(&truth.direction).norm())
}

proptest! {
    #[test]
    fn exact_places_and_motions_give_the_exact_axis(
        tilt in [-0.5_f64..0.5, -0.5_f64..0.5], at in [-50.0_f64..50.0, -50.0_f64..50.0, -50.0_f64..50.0],
        arm in 20.0_f64..80.0, first in 0.0_f64..180.0, step in 25.0_f64..100.0,
    ) {
        let truth = axis(tilt, at);
        let start = [at[0] + arm, at[1] - 0.3 * arm, at[2] + 30.0];
        let angles = [first, first + step, first + 1.7 * step, first + 2.4 * step];
        let found = axis_from_places(&places(&truth, start, &angles)).unwrap();
        let (apart, angle) = off(&found, &truth);
        prop_assert!(apart < 1e-7 && angle < 1e-9, "{apart} mm, {angle} rad");
        prop_assert!(Vector3::from(found.direction).dot(&truth.direction) > 0.0, "the sense is that of the angles");
        let motions: Vec<(f64, Pose)> = [step, 1.5 * step].iter().map(|d| (d.to_radians(), truth.back(d.to_radians()))).collect();
        let found = axis_from_motions(&motions, &Point3::from(start), 40.0).unwrap();
        let (apart, angle) = off(&found, &truth);
        prop_assert!(apart < 1e-7 && angle < 1e-9, "{apart} mm, {angle} rad");
    }
}

#[test]
fn turning_back_undoes_the_turn() {
    let stage = axis([0.1, -0.2], [5.0, 6.0, 7.0]);
    let p = Vector3::new(30.0, -20.0, 10.0);
    assert!((stage.back(0.7).point(&stage.turn(0.7).point(&p)) - p).norm() < 1e-12);
    let up = StageAxis { point_mm: Point3::origin(), direction: Vector3::z() };
    assert!((up.turn(std::f64::consts::FRAC_PI_2).point(&Vector3::x()) - Vector3::y()).norm() < 1e-12);
}

/// The stated uncertainties against the scatter over many noisy calibrations.
#[test]
fn the_axis_scatters_as_stated() {
    let truth = axis([0.05, 0.02], [1.0, -2.0, 0.0]);
    let normal = Normal::default();
    let (mut tilts, mut shifts, mut stated) = (0.0, 0.0, [0.0; 2]);
    let runs = 400;
    for run in 0..runs {
        let key = Key::new(run);
        let mut views = places(&truth, [40.0, 0.0, 20.0], &[0.0, 60.0, 120.0, 180.0, 240.0, 300.0]);
        for (i, (_, at)) in views.iter_mut().enumerate() {
            for (k, value) in at.coords.iter_mut().enumerate() {
                *value += 0.01 * f64::from(normal.draw(key.bits((3 * i + k) as u64)));
            }
        }
        let found = axis_from_places(&views).unwrap();
        let (apart, angle) = off(&found, &truth);
        // Two equal directions each: their squares add.
        tilts += angle * angle / 2.0;
        shifts += apart * apart / 2.0;
        stated[0] += found.u_direction_rad * found.u_direction_rad;
        stated[1] += found.u_point_mm * found.u_point_mm;
    }
    for (observed, stated) in [(tilts, stated[0]), (shifts, stated[1])] {
        let ratio = (observed / stated).sqrt();
        assert!((0.85..1.15).contains(&ratio), "{ratio}");
    }
}

#[test]
fn views_that_leave_the_axis_open_are_refused() {
    let stage = axis([0.0, 0.0], [0.0; 3]);
    let refused = |start, angles: &[f64]| axis_from_places(&places(&stage, start, angles)).unwrap_err();
    assert!(matches!(refused([40.0, 0.0, 0.0], &[0.0, 90.0]), StageError::Few { .. }));
    assert!(matches!(refused([40.0, 0.0, 0.0], &[0.0, 180.0, 360.0]), StageError::Open { .. }));
    assert!(matches!(refused([40.0, 0.0, 0.0], &[30.0; 4]), StageError::Open { .. }));
    assert!(matches!(refused([0.0, 0.0, 9.0], &[0.0, 90.0, 180.0]), StageError::Open { .. }));
    assert!(matches!(refused([f64::NAN; 3], &[0.0, 90.0, 180.0]), StageError::Number));
    let half = [(std::f64::consts::PI, stage.back(std::f64::consts::PI))];
    assert!(matches!(axis_from_motions(&half, &Point3::origin(), 10.0), Err(StageError::Open { .. })));
    assert!(matches!(axis_from_motions(&[], &Point3::origin(), 10.0), Err(StageError::Few { .. })));
    let still = [(0.5, Pose { rotation: Matrix3::identity(), translation: Vector3::zeros() })];
    assert!(axis_from_motions(&still, &Point3::origin(), 10.0).is_err());
}

/// A mean of blocks, each with an error of its own: the jackknife states the scatter of the mean, however many views repeat it.
#[test]
fn the_jackknife_states_what_blocks_with_errors_of_their_own_make() {
    let truth = axis([0.1, -0.1], [2.0, 1.0, 0.0]);
    let normal = Normal::default();
    let (blocks, runs) = (8_u64, 300);
    let (mut tilts, mut shifts, mut stated) = (0.0, 0.0, [0.0; 2]);
    for run in 0..runs {
        let key = Key::new(900 + run);
        let draw = |block: u64, i: u64| f64::from(normal.draw(key.bits(4 * block + i)));
        // The axis that the blocks without one of them give: the mean of their errors.
        let estimate = |left_out: Option<u64>| {
            let held: Vec<u64> = (0..blocks).filter(|b| Some(*b) != left_out).collect();
            let mean = |i: u64| held.iter().map(|b| draw(*b, i)).sum::<f64>() / held.len() as f64;
            let [e, f] = [
                truth.direction.cross(&Vector3::x()).normalize(),
                truth.direction.cross(&truth.direction.cross(&Vector3::x()).normalize()),
            ];
            let direction = (truth.direction + (e * mean(0) + f * mean(1)) * 1e-4).normalize();
            let point = truth.point_mm.coords + (e * mean(2) + f * mean(3)) * 0.01;
            StageCalibration {
                point_mm: point.into(),
                direction: direction.into(),
                u_point_mm: 0.0,
                u_direction_rad: 0.0,
                rms_mm: 0.0,
                views: 4,
                arm_mm: 30.0,
            }
        };
        let without: Vec<StageCalibration> = (0..blocks).map(|b| estimate(Some(b))).collect();
        let found = jackknife(&estimate(None), &without).unwrap();
        let (apart, angle) = off(&found, &truth);
        tilts += angle * angle / 2.0;
        shifts += apart * apart / 2.0;
        stated[0] += found.u_direction_rad.powi(2);
        stated[1] += found.u_point_mm.powi(2);
    }
    for (observed, stated) in [(tilts, stated[0]), (shifts, stated[1])] {
        let ratio = (observed / stated).sqrt();
        // The worst of two directions is stated: with eight blocks it is some 1.2 times the mean one.
        assert!((0.7..1.0).contains(&ratio), "{ratio}");
    }
    let one = axis_from_places(&places(&truth, [40.0, 0.0, 20.0], &[0.0, 60.0, 120.0])).unwrap();
    assert!(matches!(jackknife(&one, &[one]), Err(StageError::Few { .. })));
}
