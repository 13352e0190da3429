//! The check against closed-form scenes: what is healthy, what is not, and what it states about it.

mod derivatives;
mod three;

use super::*;
use fringe::geometry::camera::Camera;
use fringe::math::linear::{Dense, dot};
use fringe::pattern::Axis;
use fringe::phase::PhaseMap;
use fringe::synthetic::{Noise, Scene, Surface, rig};
use nalgebra::{Isometry3, Matrix2, Point2, Point3, Vector2, Vector3};

/// Pixels of points all over the volume, with noise in the right view.
fn matches(left: &Camera, right: &Camera, sigma_px: f64, noise: &mut Noise, count: usize) -> Vec<Match> {
    let mut place = |half: f64| (2.0 * noise.unit() - 1.0) * half;
    let points: Vec<Point3<f64>> =
        (0..count).map(|_| Point3::new(place(70.0), place(45.0), place(40.0))).collect();
    let seen = points.iter().filter_map(|p| Some((left.project(p)?, right.project(p)?)));
    seen.map(|(l, r)| Match {
        left: l,
        right: r + Vector2::new(noise.gauss(), noise.gauss()) * sigma_px,
        covariance_px2: Matrix2::identity() * sigma_px * sigma_px,
        lit: None,
    })
    .collect()
}

fn turned(camera: &Camera, axis: usize, degrees: f64) -> Camera {
    let turn = Isometry3::new(Vector3::zeros(), Vector3::ith(axis, degrees.to_radians()));
    Camera { camera_from_world: turn * camera.camera_from_world, ..camera.clone() }
}

const EXACT_PHASE: HealthSettings =
    HealthSettings { false_alarm: 0.01, phase_error_px: 0.0, least_matches: 100 };

/// Noise alone: the statistic is a χ² of as many degrees as there are drifts, so it alarms as often as asked.
#[test]
fn a_healthy_pair_alarms_as_often_as_asked() {
    let [left, right, _] = rig(1124, 750);
    let (mut noise, mut sum, mut alarms) = (Noise(7), 0.0, 0);
    let rounds = 200;
    for _ in 0..rounds {
        let seen = matches(&left, &right, 0.05, &mut noise, 600);
        let drift = check_pair(&left, &right, &seen, None, &EXACT_PHASE).unwrap().drift;
        assert_eq!(drift.degrees_of_freedom, 6);
        sum += drift.statistic / f64::from(rounds);
        alarms += u32::from(drift.statistic > drift.limit);
    }
    // Mean 6, standard deviation of the mean √(12/200) = 0.25; the sandwich may only make the test more careful.
    assert!((4.5..6.8).contains(&sum), "{sum}");
    assert!(alarms <= 7, "{alarms} of 200 at 1 %");
}

/// A rig that is wrong by what its calibration's covariance states is healthy; without the covariance it is not.
#[test]
fn the_covariance_of_the_calibration_is_allowed_for() {
    let [left, right, _] = rig(1124, 750);
    let names = ["rx_rad", "tx_mm", "fx_px"].map(str::to_owned).to_vec();
    let sd = [2e-5, 0.01, 0.3];
    let matrix = (0..36).map(|k| if k % 7 == 0 { f64::powi(sd[k / 6 % 3], 2) } else { 0.0 }).collect();
    let covariance = PairCovariance { names: [names.clone(), names], matrix };
    let (mut noise, mut sum, mut alarms) = (Noise(11), 0.0, 0);
    let rounds = 60;
    for _ in 0..rounds {
        let seen = matches(&left, &right, 0.02, &mut noise, 600);
        let mut wrong = |camera: &Camera| {
            let mut out = turned(camera, 0, (noise.gauss() * sd[0]).to_degrees());
            out.camera_from_world.translation.vector.x += noise.gauss() * sd[1];
            out.focal_px[0] += noise.gauss() * sd[2];
            out
        };
        let file = [wrong(&left), wrong(&right)];
        let with = check_pair(&file[0], &file[1], &seen, Some(&covariance), &EXACT_PHASE).unwrap();
        assert!(with.with_covariance && with.pattern_limit_px > 0.02);
        sum += with.drift.statistic / f64::from(rounds);
        let without = check_pair(&file[0], &file[1], &seen, None, &EXACT_PHASE).unwrap();
        alarms += usize::from(!without.healthy);
    }
    assert!((4.0..8.0).contains(&sum), "{sum}");
    assert!(alarms > 50, "{alarms} of 60");
}

#[test]
fn a_drift_is_named_measured_and_its_uncertainty_holds() {
    let [left, right, _] = rig(1124, 750);
    for (name, truth, file) in [
        ("rotation about x", 1e-4, turned(&right, 0, f64::to_degrees(-1e-4))),
        ("rotation about y", 1e-3, turned(&right, 1, f64::to_degrees(-1e-3))),
        ("rotation about z", -1e-3, turned(&right, 2, f64::to_degrees(1e-3))),
        ("focal length", 1e-3, Camera { focal_px: right.focal_px.map(|f| f / 1.001), ..right.clone() }),
    ] {
        let seen = matches(&left, &right, 0.02, &mut Noise(5), 3000);
        let health = check_pair(&left, &file, &seen, None, &EXACT_PHASE).unwrap();
        let best = &health.drift.causes[0];
        assert!(!health.healthy && best.name == name && best.explains > 0.98, "{name}: {health:?}");
        assert!((best.value - truth).abs() < 4.0 * best.u + 2e-3 * truth.abs(), "{name}: {best:?}");
        // Without a calibration both are the same, up to rounding.
        assert!(best.u_noise <= best.u * (1.0 + 1e-12) && best.u < 0.05 * truth.abs(), "{name}: {best:?}");
        assert!((health.rms_after_px / 0.02 - 0.71).abs() < 0.1, "{name}: {health:?}");
    }
}

#[test]
fn wrong_matches_neither_alarm_nor_hide_a_drift() {
    let [left, right, _] = rig(1124, 750);
    let mut noise = Noise(21);
    let mut seen = matches(&left, &right, 0.02, &mut noise, 2000);
    for wrong in seen.iter_mut().step_by(7) {
        wrong.right += Vector2::new(noise.gauss(), noise.gauss().abs()) * 5.0;
    }
    let healthy = check_pair(&left, &right, &seen, None, &EXACT_PHASE).unwrap();
    assert!(healthy.healthy && healthy.rejected > 200, "{healthy:?}");
    let knocked = check_pair(&left, &turned(&right, 0, 0.001), &seen, None, &EXACT_PHASE).unwrap();
    assert!(!knocked.healthy);
}

/// A shift along the baseline only scales; a lens that changed is no drift of a pose.
#[test]
fn what_cannot_be_seen_is_not_claimed_and_what_is_no_drift_is_told_apart() {
    let [left, right, _] = rig(1124, 750);
    let seen = matches(&left, &right, 0.02, &mut Noise(2), 3000);
    let mut longer = right.clone();
    let baseline = right.camera_from_world * left.centre_mm();
    longer.camera_from_world.translation.vector += baseline.coords.normalize();
    assert!(check_pair(&left, &longer, &seen, None, &EXACT_PHASE).unwrap().healthy);
    let mut warm = right.clone();
    warm.distortion.k[0] += 0.05;
    let settings = HealthSettings { phase_error_px: 0.005, ..EXACT_PHASE };
    let health = check_pair(&left, &warm, &seen, None, &settings).unwrap();
    assert!(!health.healthy && health.pattern_px > health.pattern_limit_px, "{health:?}");
}

/// A plane leaves a drift open; what it determines is still tested.
#[test]
fn a_flat_object_tells_fewer_drifts() {
    let [left, right, _] = rig(1124, 750);
    let mut noise = Noise(4);
    let seen: Vec<Match> = matches(&left, &right, 0.0, &mut noise, 2000)
        .iter()
        .filter_map(|m| {
            let ray = left.ray(m.left)?;
            let at = ray.origin_mm - ray.direction * (ray.origin_mm.z / ray.direction.z);
            let right = right.project(&at)? + Vector2::new(noise.gauss(), noise.gauss()) * 0.02;
            Some(Match { left: m.left, right, covariance_px2: Matrix2::identity() * 4e-4, lit: None })
        })
        .collect();
    let flat = check_pair(&left, &right, &seen, None, &EXACT_PHASE).unwrap();
    assert!(flat.healthy && flat.drift.degrees_of_freedom < 6, "{flat:?}");
    assert!(!check_pair(&left, &turned(&right, 0, 0.002), &seen, None, &EXACT_PHASE).unwrap().healthy);
}

fn scene(projector: Camera) -> Scene {
    let ball = Surface::Sphere { centre: Point3::new(0.0, 0.0, -5.0), radius_mm: 25.0 };
    Scene { surfaces: vec![ball, Surface::plane([0.0, 0.1, 1.0], -20.0)], projector, period_px: 16.0 }
}

/// From phase maps: the places match where they must, with the covariance that the scatter shows, shadow edges left out.
#[test]
fn phases_alone_match_views_and_projector() {
    let [left, right, projector] = rig(500, 340);
    let scene = scene(projector.clone());
    let map = |camera: &Camera, axis, seed| scene.phase_map(camera, axis, 0.01, seed);
    let [lx, ly] = [map(&left, Axis::X, 1), map(&left, Axis::Y, 2)];
    let [rx, ry] = [map(&right, Axis::X, 3), map(&right, Axis::Y, 4)];
    let found = match_views([&lx.view(), &ly.view()], [&rx.view(), &ry.view()]).unwrap();
    assert!(found.matches.len() > 2000 && found.counts.rough > 20, "{:?}", found.counts);
    let mut ratio = 0.0;
    for m in &found.matches {
        let (at, _) = scene.trace(&left.ray(m.left).unwrap()).unwrap();
        let off = m.right - right.project(&at).unwrap();
        let normal = off.dot(&(m.covariance_px2.try_inverse().unwrap() * off));
        assert!(normal < 40.0, "{m:?}: off by {off}");
        ratio += normal / (2.0 * found.matches.len() as f64);
    }
    assert!((ratio - 1.0).abs() < 0.15, "{ratio}");
    let pair = check_pair(&left, &right, &found.matches, None, &HealthSettings::default()).unwrap();
    assert!(pair.healthy && (0.8..1.2).contains(&pair.noise_factor), "{pair:?}");
    let lit = match_projector([&lx.view(), &ly.view()]).unwrap();
    let pair = check_pair(&left, &projector, &lit.matches, None, &HealthSettings::default()).unwrap();
    assert!(pair.healthy, "{pair:?}");
    assert!(
        !check_pair(&left, &turned(&projector, 0, 0.01), &lit.matches, None, &HealthSettings::default())
            .unwrap()
            .healthy
    );
}

#[test]
fn what_tells_nothing_is_refused() {
    let [left, right, projector] = rig(60, 40);
    let whole = |axis: Axis| scene(projector.clone()).phase_map(&left, axis, 0.01, 1);
    let (x, y) = (whole(Axis::X), whole(Axis::Y));
    let error = match_views([&x.view(), &x.view()], [&x.view(), &y.view()]).unwrap_err().to_string();
    assert!(error.contains("left") && error.contains("one map for the columns"), "{error}");
    let dark = |axis| PhaseMap::new(fringe::phase::PhaseInfo { axis, ..x.info });
    let (dx, dy) = (dark(Axis::X), dark(Axis::Y));
    let none = match_views([&x.view(), &y.view()], [&dx.view(), &dy.view()]).unwrap();
    assert!(none.matches.is_empty() && none.counts.unseen > 0);
    let error = check_pair(&left, &right, &none.matches, None, &HealthSettings::default()).unwrap_err();
    assert!(matches!(error, HealthError::TooFew { found: 0, .. }));
    let settings = HealthSettings { false_alarm: 0.0, ..HealthSettings::default() };
    assert!(check_pair(&left, &right, &[], None, &settings).unwrap_err().to_string().contains("false_alarm"));
    let one = Match {
        left: Point2::new(3.0, 4.0),
        right: Point2::new(9.0, 9.0),
        covariance_px2: Matrix2::identity(),
        lit: None,
    };
    let same = vec![one; 300];
    let checked = check_pair(&left, &right, &same, None, &HealthSettings::default());
    assert!(checked.is_err() || checked.unwrap().drift.degrees_of_freedom < 3);
    let covariance = PairCovariance { names: [vec!["hue".into()], vec![]], matrix: vec![1.0] };
    let error = check_pair(&left, &right, &same, Some(&covariance), &HealthSettings::default()).unwrap_err();
    assert!(error.to_string().contains("\"hue\""), "{error}");
}

/// A view with its partners as the tests see them.
fn estimate(view: &Camera, pairs: &[(&Camera, Vec<Match>)]) -> ViewEstimate {
    let partners: Vec<Partner> = pairs
        .iter()
        .enumerate()
        .map(|(device, (fixed, matches))| Partner { fixed, device, matches, lit_by: None, measures: true })
        .collect();
    estimate_view(view, &partners, None, &EXACT_PHASE).unwrap()
}

/// A turn and a longer focal length, or a shift too where a second partner sees it, are taken back within their uncertainty.
#[test]
fn a_drifted_view_is_brought_back() {
    let [left, right, third] = rig(1124, 750);
    let mut drifted = turned(&right, 1, 0.01);
    drifted.focal_px = drifted.focal_px.map(|f| f * 1.0002);
    let mut noise = Noise(5);
    let seen = vec![(&left, matches(&left, &drifted, 0.03, &mut noise, 4000))];
    let found = estimate(&right, &seen);
    let possible: Vec<_> = found.models().into_iter().filter(ViewCorrection::is_possible).collect();
    let one = possible.first().unwrap();
    assert_eq!(one.name(), "rotation and focal length");
    let (truth, u) = ([0.0, 0.01_f64.to_radians(), 0.0, 0.0, 0.0, 0.0, 2e-4], one.u());
    for i in 0..7 {
        assert!((one.drift[i] - truth[i]).abs() < 4.0 * u[i] + 1e-9, "{i}: {:?}, u {u:?}", one.drift);
    }
    assert!(check_pair(&left, &one.camera, &seen[0].1, None, &EXACT_PHASE).unwrap().healthy);

    drifted.camera_from_world.translation.vector += Vector3::new(0.05, -0.03, 0.02);
    let pairs = [&left, &third].map(|fixed| (fixed, matches(fixed, &drifted, 0.03, &mut noise, 4000)));
    let both = estimate(&right, &pairs).models().pop().unwrap();
    assert_eq!(both.name(), "rotation, shift and focal length");
    let shift: Vec<f64> = both.drift[3..6].to_vec();
    for (found, (truth, u)) in shift.iter().zip([0.05, -0.03, 0.02].iter().zip(&both.u()[3..6])) {
        assert!((found - truth).abs() < 4.0 * u, "{shift:?}, u {:?}", both.u());
    }
    assert_eq!(both.parameter_covariance(16).len(), 256);
}

/// One partner does not see how far a view went along their baseline: lengths are open, and a length settles them.
#[test]
fn a_shift_needs_a_length_where_one_partner_sees_it() {
    let [left, right, _] = rig(1124, 750);
    let mut drifted = right.clone();
    // Along the baseline and across it: the latter shows.
    drifted.camera_from_world.translation.vector += Vector3::new(0.05, 0.05, 0.0);
    let seen = vec![(&left, matches(&left, &drifted, 0.03, &mut Noise(9), 4000))];
    let found = estimate(&right, &seen);
    let Some(Choice::LengthsOpen { models, apart }) = found.choose() else { panic!("{:?}", found.choose()) };
    assert!(models[0].name() == "shift" && apart > 1e-5, "{apart}");

    // A bar of 100 mm, measured with the view in the state of the estimate.
    let ends = [Point3::new(-50.0, 0.0, 0.0), Point3::new(50.0, 0.0, 0.0)];
    let length = |camera: &Camera| {
        let at = |end: &Point3<f64>| {
            let pixels = (left.project(end).unwrap(), drifted.project(end).unwrap());
            let met = fringe::geometry::triangulate::triangulate((&left, pixels.0), (camera, pixels.1));
            met.unwrap().position_mm
        };
        (at(&ends[0]) - at(&ends[1])).norm()
    };
    let here = found.camera();
    let by = std::array::from_fn(|k| {
        let mut step = [0.0; 7];
        step[k] = if k < 3 || k == 6 { 1e-5 } else { 1e-2 };
        (length(&stepped(&here, &step)) - length(&here)) / step[k]
    });
    let reading = LengthReading {
        error_mm: 100.0 - length(&here),
        u_mm: 5e-4,
        certified_mm: 100.0,
        u_certified_mm: 0.0,
        by,
    };
    // A standard that nobody knows would not show the shift, and many readings of it do not make it better known.
    let poor = LengthReading { u_certified_mm: 0.05, ..reading };
    let many = found.clone().with_lengths(&[poor; 9]);
    assert!(many.u_scale.is_some_and(|u| (u / 5e-4 - 1.0).abs() < 1e-3), "{:?}", many.u_scale);
    assert!(matches!(many.choose(), Some(Choice::LengthsOpen { .. })));
    let many = found.clone().with_lengths(&[reading; 9]);
    assert!(many.u_scale.is_some_and(|u| (u / (5e-6 / 3.0) - 1.0).abs() < 1e-3), "{:?}", many.u_scale);
    let Some(Choice::Clear(known)) = found.with_lengths(&[reading]).choose() else { panic!("still open") };
    assert!((length(&known.camera) - 100.0).abs() < 0.002, "{:?}", known.drift);
    assert!((known.drift[3] - 0.05).abs() < 0.005 && known.name() == "shift", "{:?}", known.drift);
}

/// A partner that is wrong by what its calibration states moves the view by less where that is known, and the estimate's χ² has as many
/// degrees of freedom as there are causes.
#[test]
fn errors_of_the_calibration_are_no_drift_and_lengths_hold_all_over_the_volume() {
    let [left, right, third] = rig(1124, 750);
    let sd = [4e-5, 0.02];
    // Blocks of the second partner and of the view; the first partner is exact.
    let variance = |k: usize| if k.is_multiple_of(5) && k < 10 { f64::powi(sd[k / 5], 2) } else { 0.0 };
    let names = ["rx_rad", "tz_mm"].map(str::to_owned).to_vec();
    let known = ViewCovariance { blocks: vec![1, 2], names, matrix: (0..16).map(variance).collect() };
    let (mut noise, rounds) = (Noise(31), 16);
    let (mut chi2, mut squares, mut lengths, mut stated) = (0.0, [0.0; 2], Vec::new(), 0.0);
    for _ in 0..rounds {
        let seen = [&left, &third].map(|fixed| matches(fixed, &right, 0.02, &mut noise, 500));
        let mut wrong = turned(&third, 0, (noise.gauss() * sd[0]).to_degrees());
        wrong.camera_from_world.translation.vector.z += noise.gauss() * sd[1];
        let partners = [(&left, &seen[0]), (&wrong, &seen[1])].map(|(fixed, matches)| Partner {
            fixed,
            device: usize::from(fixed != &left),
            matches,
            lit_by: None,
            measures: fixed == &left,
        });
        let found =
            [Some(&known), None].map(|known| estimate_view(&right, &partners, known, &EXACT_PHASE).unwrap());
        for (sum, found) in squares.iter_mut().zip(&found) {
            *sum += found.drift[0].powi(2);
        }
        let found = &found[0];
        chi2 += dot(&found.drift, &found.weight.apply(&found.drift)) / f64::from(rounds);
        lengths.resize(found.volume.len(), 0.0);
        for (sum, by) in lengths.iter_mut().zip(&found.volume) {
            *sum += dot(by, &found.drift).powi(2) / f64::from(rounds);
        }
        stated += found.models().pop().unwrap().u_volume / f64::from(rounds);
    }
    // Mean 7, standard deviation of the mean √(14/16) = 0.9.
    assert!((4.5..9.5).contains(&chi2), "{chi2}");
    // The exact partner tells this turn by itself.
    assert!(squares[0] < 0.3 * squares[1], "{squares:?}");
    let worst = lengths.iter().copied().fold(0.0, f64::max).sqrt();
    assert!(lengths.len() > 100 && (0.5..1.5).contains(&(worst / stated)), "{worst} beside {stated}");
}

/// A focal length that changed by two of its uncertainties contradicts nothing, but may be true: the rotation is taken, and its uncertainty
/// says so.
#[test]
fn a_larger_model_that_may_be_true_enters_the_uncertainty() {
    let [_, right, _] = rig(1124, 750);
    let u = [1e-6, 1e-6, 1e-6, 1e-3, 1e-3, 1e-3, 5e-5];
    let found = |focal: f64| {
        let estimate = ViewEstimate {
            start: right.clone(),
            drift: [0.0, 1e-4, 0.0, 0.0, 0.0, 0.0, focal],
            weight: Dense::from_fn(7, 7, |i, j| if i == j { f64::powi(u[i], -2) } else { 0.0 }),
            object: Vec::new(),
            volume: vec![[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]],
            baselines_mm: vec![Vector3::x() * 200.0],
            u_scale: None,
            three_views: Vec::new(),
            by_pairs: None,
        };
        let Some(Choice::Clear(view)) = estimate.choose() else { panic!("{:?}", estimate.choose()) };
        assert_eq!(view.name(), "rotation");
        view
    };
    let (open, clear) = (found(1e-4), found(1e-5));
    // χ² + 2 k: 4 + 6 for the rotation, 0 + 8 with the focal length, 4 + 12 with the shift, 0 + 14 with both; the lengths are 10⁻⁴ apart.
    let [chosen, focal, shift, both] = [10.0, 8.0, 16.0, 14.0].map(|akaike| fringe::math::exp(-0.5 * akaike));
    let share = (focal + both) / (chosen + focal + shift + both);
    assert!((open.u_volume / (share.sqrt() * 1e-4) - 1.0).abs() < 0.01, "{}", open.u_volume);
    assert_eq!(open.u_volume, open.u()[6], "the rig file has it too");
    assert!(clear.u_volume < 1e-5, "{}", clear.u_volume);
}
