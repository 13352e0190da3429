//! Matching against exact surfaces. What these tests do not prove: anything about a pixel's finite footprint, which
//! the twin has and these maps do not.

use super::*;
use crate::pattern::Axis;
use crate::phase::PhaseMap;
use crate::synthetic::{Noise, Scene, Surface, looking, pixel_of, rig};
use proptest::prelude::*;
use std::f64::consts::TAU;

fn blank() -> Point {
    bytemuck::Zeroable::zeroed()
}

fn scene(surfaces: &[Surface], projector: &Camera) -> Scene {
    Scene { surfaces: surfaces.to_vec(), projector: projector.clone(), period_px: 16.0 }
}

fn matched(
    cameras: &[Camera; 2],
    left: &PhaseMap,
    right: &PhaseMap,
    settings: &MatchSettings,
) -> (Vec<Point>, MatchReport) {
    let mut matcher = Matcher::new(&cameras[0], &cameras[1], settings).unwrap();
    let mut points = vec![blank(); matcher.capacity()];
    let report = matcher.run(&left.view(), &right.view(), 3, &mut points).unwrap();
    let lost =
        report.unmatched + report.ambiguous + report.inconsistent + report.discontinuous + report.uncertain;
    let surface = report.surface;
    let dropped = surface.spikes + surface.crumbs + surface.steep + surface.rims + surface.uncertain;
    assert_eq!(report.valid, lost + dropped + report.points, "{report:?}");
    let count = |cause: Cause| matcher.causes().iter().filter(|c| **c == cause).count();
    assert_eq!(count(Cause::Point), report.points as usize);
    assert_eq!(count(Cause::Rim) + count(Cause::Steep), (surface.rims + surface.steep) as usize);
    let lit = matcher.causes().len() - count(Cause::Dark);
    assert_eq!(lit, (report.valid + report.outside) as usize, "{report:?}");
    points.truncate(report.points as usize);
    (points, report)
}

/// Mean and rms of the deviation along the line of sight, in pixels of disparity.
fn disparity_errors(camera: &Camera, other: &Camera, scene: &Scene, points: &[Point]) -> (f64, f64) {
    let baseline = (camera.centre_mm() - other.centre_mm()).norm();
    let errors: Vec<f64> = points
        .iter()
        .map(|point| {
            let ray = camera.ray(pixel_of(point.pixel as usize, camera.width_px)).unwrap();
            let (truth, _) = scene.trace(&ray).unwrap();
            let depth = (truth - ray.origin_mm).norm();
            ((point.position() - ray.origin_mm).norm() - depth) * camera.focal_px[0] * baseline
                / (depth * depth)
        })
        .collect();
    let n = errors.len() as f64;
    (errors.iter().sum::<f64>() / n, (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt())
}

#[test]
fn an_ideal_plane_is_matched_without_bias() {
    let [left, right, projector] = rig(400, 267);
    for normal in [[0.0, 0.0, 1.0], [0.4, 0.3, 1.0], [-0.5, 0.1, 1.0]] {
        let scene = scene(&[Surface::plane(normal, 3.0)], &projector);
        let maps = [&left, &right].map(|c| scene.phase_map(c, Axis::X, 0.0, 0));
        for interpolation in [Interpolation::Quadratic, Interpolation::Cubic, Interpolation::Bilinear] {
            let settings = MatchSettings { interpolation, ..MatchSettings::default() };
            let (points, report) = matched(&[left.clone(), right.clone()], &maps[0], &maps[1], &settings);
            assert!(report.points > 60_000, "{report:?}");
            let (mean, rms) = disparity_errors(&left, &right, &scene, &points);
            assert!(mean.abs() < 3e-4 && rms < 1e-3, "{interpolation:?} {normal:?}: {mean} {rms} px");
            for point in points.iter().step_by(97) {
                let off = (point.normal_vector() - scene.surfaces[0].normal(&point.position())).norm();
                assert!(off < 2e-3, "normal {off} off at {}", point.pixel);
            }
        }
    }
}

#[test]
fn every_level_of_instructions_gives_the_same_points() {
    let [left, right, projector] = rig(300, 200);
    let scene = scene(&[Surface::plane([0.1, 0.2, 1.0], 1.0)], &projector);
    let maps = [(&left, 1), (&right, 2)].map(|(c, seed)| scene.phase_map(c, Axis::X, 0.03, seed));
    let mut expected: Option<Vec<Point>> = None;
    for level in crate::math::simd::levels() {
        let mut matcher = Matcher::new(&left, &right, &MatchSettings::default()).unwrap();
        matcher.limit_level(level);
        let mut points = vec![blank(); matcher.capacity()];
        let count = matcher.run(&maps[0].view(), &maps[1].view(), 0, &mut points).unwrap().points as usize;
        points.truncate(count);
        let expected = expected.get_or_insert_with(|| points.clone());
        let [one, other] = [&*expected, &points].map(|points| bytemuck::cast_slice::<Point, u8>(points));
        assert!(count > 20_000 && one == other, "{level:?}: {count} points");
    }
}

/// What a matcher saw before, in the same pixels or in others, leaves nothing behind.
#[test]
fn the_bytes_do_not_depend_on_the_maps_before() {
    let [left, right, projector] = rig(300, 200);
    let ball = Surface::Sphere { centre: nalgebra::Point3::new(5.0, 2.0, 0.0), radius_mm: 35.0 };
    let of = |surface: Surface, sigma: f64| {
        let scene = scene(&[surface], &projector);
        [(&left, 1), (&right, 2)].map(|(c, seed)| scene.phase_map(c, Axis::X, sigma, seed))
    };
    let run = |matcher: &mut Matcher, [a, b]: &[PhaseMap; 2]| {
        let mut points = vec![blank(); matcher.capacity()];
        let report = matcher.run(&a.view(), &b.view(), 0, &mut points).unwrap();
        points.truncate(report.points as usize);
        (bytemuck::cast_slice::<Point, u8>(&points).to_vec(), matcher.causes().to_vec(), report)
    };
    let new = || Matcher::new(&left, &right, &MatchSettings::default()).unwrap();
    let maps = [of(Surface::plane([0.1, 0.2, 1.0], 1.0), 0.05), of(ball, 0.02)];
    let [plane, ball] = [0, 1].map(|i| run(&mut new(), &maps[i]));
    assert!(ball.2.points > 1000 && plane.2.points > 4 * ball.2.points, "{:?} {:?}", ball.2, plane.2);
    let mut matcher = new();
    for (map, expected) in [(0, &plane), (1, &ball), (0, &plane)] {
        assert!(run(&mut matcher, &maps[map]) == *expected, "map {map}");
    }
}

/// Every wrong way to treat order of work shows in the bytes.
#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let [left, right, projector] = rig(300, 200);
    let scene = scene(&[Surface::plane([0.1, 0.2, 1.0], 1.0)], &projector);
    let maps = [(&left, 1), (&right, 2)].map(|(c, seed)| scene.phase_map(c, Axis::X, 0.03, seed));
    let bytes = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (points, report) =
                matched(&[left.clone(), right.clone()], &maps[0], &maps[1], &MatchSettings::default());
            (bytemuck::cast_slice::<Point, u8>(&points).to_vec(), report)
        })
    };
    let one = bytes(1);
    assert!(one.1.points > 30_000);
    for threads in [2, 3, 5] {
        assert_eq!(one, bytes(threads));
    }
}

/// Predicted uncertainty beside the scatter of noisy realisations, on flat, tilted and curved surfaces, also where one view sees the surface
/// larger than the other.
#[test]
fn predicted_uncertainty_meets_the_scatter() {
    let [left, right, projector] = rig(300, 200);
    let ball = Surface::Sphere { centre: nalgebra::Point3::new(5.0, 2.0, 0.0), radius_mm: 40.0 };
    for (surface, sigmas) in [
        (Surface::plane([0.0, 0.0, 1.0], 0.0), [0.01, 0.01]),
        (Surface::plane([0.6, 0.3, 1.0], 0.0), [0.02, 0.005]),
        (Surface::plane([0.9, 0.0, 1.0], 0.0), [0.005, 0.02]),
        (Surface::plane([-0.9, 0.0, 1.0], 0.0), [0.005, 0.02]),
        (ball, [0.04, 0.06]),
    ] {
        let scene = scene(&[surface], &projector);
        let (mut sum, mut n) = (0.0, 0.0);
        for seed in 0..16 {
            let a = scene.phase_map(&left, Axis::X, sigmas[0], 2 * seed + 1);
            let b = scene.phase_map(&right, Axis::X, sigmas[1], 2 * seed + 2);
            let (points, _) = matched(&[left.clone(), right.clone()], &a, &b, &MatchSettings::default());
            for point in &points {
                let ratio = surface.distance(&point.position()) / f64::from(point.sigma_mm);
                sum += ratio * ratio;
                n += 1.0;
            }
        }
        let ratio = f64::sqrt(sum / n);
        assert!((0.97..1.03).contains(&ratio), "{ratio} for {surface:?}, {n} points");
    }
}

/// Both rays of a match meet: the general triangulation of its two pixels is the same point, without correction.
#[test]
fn triangulation_of_the_two_pixels_gives_the_same_point() {
    let [left, right, projector] = rig(300, 200);
    let scene = scene(&[Surface::plane([0.3, -0.2, 1.0], 2.0)], &projector);
    let maps = [&left, &right].map(|c| scene.phase_map(c, Axis::X, 0.02, 5));
    let (points, _) = matched(&[left.clone(), right.clone()], &maps[0], &maps[1], &MatchSettings::default());
    for point in points.iter().step_by(31) {
        let seen = (pixel_of(point.pixel as usize, 300), right.project(&point.position()).unwrap());
        let found = crate::geometry::triangulate::triangulate((&left, seen.0), (&right, seen.1)).unwrap();
        assert!((found.position_mm - point.position()).norm() < 1e-8);
        assert!(found.linear_reprojection_px < 1e-8, "{found:?}");
        assert_eq!(point.pair, 3);
    }
}

/// Cameras above each other, horizontal fringes: the rectified rows are image columns.
#[test]
fn a_vertical_baseline_with_horizontal_fringes_works_as_well() {
    let at = |degrees: f64| {
        let angle = degrees.to_radians();
        [10.0, 500.0 * crate::math::sin(angle), 500.0 * crate::math::cos(angle)]
    };
    let side = [1.0, 0.0, 0.05];
    let cameras =
        [looking(at(-12.0), [0.0; 3], side, 300, 200), looking(at(12.0), [1.0, 1.0, 0.0], side, 300, 200)];
    let projector = looking(at(0.0), [0.0; 3], side, 608, 684);
    let surface = Surface::plane([0.2, 0.3, 1.0], 1.0);
    let scene = scene(&[surface], &projector);
    for (a, b) in [(0, 1), (1, 0)] {
        let maps = [a, b].map(|c: usize| scene.phase_map(&cameras[c], Axis::Y, 0.0, 0));
        let pair = [cameras[a].clone(), cameras[b].clone()];
        let (points, report) = matched(&pair, &maps[0], &maps[1], &MatchSettings::default());
        assert!(report.points > 30_000, "{report:?}");
        let (mean, rms) = disparity_errors(&pair[0], &pair[1], &scene, &points);
        assert!(mean.abs() < 3e-4 && rms < 1e-3, "{mean} {rms} px");
        assert!(points.windows(2).all(|w| w[0].pixel < w[1].pixel), "pixel order");
    }
}

/// A ball in front of a plate: no point floats between them.
#[test]
fn nothing_bridges_a_depth_step() {
    let [left, right, projector] = rig(562, 375);
    let ball = Surface::Sphere { centre: nalgebra::Point3::new(0.0, 0.0, 10.0), radius_mm: 20.0 };
    let plate = Surface::plane([0.05, 0.0, 1.0], -25.0);
    let scene = scene(&[ball, plate], &projector);
    for (sigma, limit_mm) in [(0.0, 0.1), (0.01, 0.5)] {
        let maps = [(&left, 1), (&right, 2)].map(|(c, seed)| scene.phase_map(c, Axis::X, sigma, seed));
        let (points, report) =
            matched(&[left.clone(), right.clone()], &maps[0], &maps[1], &MatchSettings::default());
        let on_ball = points.iter().filter(|p| ball.distance(&p.position()).abs() < limit_mm).count();
        assert!(on_ball > 3_000 && report.points > 80_000, "{on_ball} of {report:?}");
        for point in &points {
            let off = ball.distance(&point.position()).abs().min(plate.distance(&point.position()).abs());
            assert!(off < limit_mm, "{off} mm off at pixel {}, sigma {}", point.pixel, point.sigma_mm);
        }
    }
}

/// A patch of wrong fringe order has twins of its phase elsewhere in the row, or no support.
#[test]
fn wrong_orders_do_not_reach_the_cloud() {
    let [left, right, projector] = rig(300, 200);
    let surface = Surface::plane([0.1, 0.0, 1.0], 0.0);
    let scene = scene(&[surface], &projector);
    let clean = [&left, &right].map(|c| scene.phase_map(c, Axis::X, 0.005, 3));
    for side in 0..2 {
        let mut maps = clean.clone();
        for row in 50..120 {
            for column in 100..104 {
                maps[side].phase_rad[row * 300 + column] += TAU as f32;
            }
        }
        let (points, report) =
            matched(&[left.clone(), right.clone()], &maps[0], &maps[1], &MatchSettings::default());
        assert!(report.points > 40_000, "{report:?}");
        let worst = points.iter().map(|p| surface.distance(&p.position()).abs()).fold(0.0, f64::max);
        assert!(worst < 0.5, "{worst} mm, {report:?}");
    }
}

#[test]
fn depth_limits_hold() {
    let [left, right, projector] = rig(300, 200);
    let scene = scene(&[Surface::plane([0.4, 0.0, 1.0], 0.0)], &projector);
    let maps = [&left, &right].map(|c| scene.phase_map(c, Axis::X, 0.0, 3));
    let settings = MatchSettings { depth_mm: Some([490.0, 505.0]), ..MatchSettings::default() };
    let (points, report) = matched(&[left.clone(), right.clone()], &maps[0], &maps[1], &settings);
    assert!(points.len() > 1000 && report.unmatched > 1000, "{report:?}");
    for point in &points {
        let depth = (left.camera_from_world * point.position()).z;
        assert!((490.0..=505.0).contains(&depth), "{depth}");
    }
    for depth_mm in [[0.0, 1.0], [10.0, 5.0], [f64::NAN, 5.0], [1.0, f64::INFINITY]] {
        let settings = MatchSettings { depth_mm: Some(depth_mm), ..settings };
        assert!(
            matches!(Matcher::new(&left, &right, &settings), Err(MatchError::Setting { .. })),
            "{depth_mm:?}"
        );
    }
}

#[test]
fn a_phase_that_falls_along_the_row_is_matched_alike() {
    let [left, right, mut projector] = rig(300, 200);
    // Half a turn about its axis: the columns run the other way.
    let turn = nalgebra::Isometry3::rotation(nalgebra::Vector3::z() * std::f64::consts::PI);
    projector.camera_from_world = turn * projector.camera_from_world;
    let scene = scene(&[Surface::plane([0.1, 0.2, 1.0], 0.0)], &projector);
    let maps = [&left, &right].map(|c| scene.phase_map(c, Axis::X, 0.0, 3));
    let (points, report) =
        matched(&[left.clone(), right.clone()], &maps[0], &maps[1], &MatchSettings::default());
    assert!(report.points > 30_000, "{report:?}");
    let (mean, rms) = disparity_errors(&left, &right, &scene, &points);
    assert!(mean.abs() < 3e-4 && rms < 1e-3, "{mean} {rms} px");
}

#[test]
fn maps_that_tell_nothing_give_no_points() {
    let [left, right, projector] = rig(60, 40);
    let scene = scene(&[Surface::plane([0.0, 0.0, 1.0], 0.0)], &projector);
    let good = [&left, &right].map(|c| scene.phase_map(c, Axis::X, 0.0, 3));
    let pair = [left.clone(), right.clone()];
    let settings = MatchSettings::default();
    let masked = PhaseMap::new(good[0].info);
    assert_eq!(matched(&pair, &masked, &masked, &settings).1, MatchReport::default());
    assert_eq!(matched(&pair, &good[0], &masked, &settings).1.points, 0);
    let mut constant = good.clone();
    let mut poisoned = good.clone();
    for side in 0..2 {
        constant[side].phase_rad.fill(3.0);
        constant[side].valid.fill(1);
        constant[side].sigma_rad.fill(0.01);
        // Valid by the mask, but not a number.
        poisoned[side].phase_rad.fill(f32::NAN);
        poisoned[side].valid.fill(1);
    }
    assert_eq!(
        matched(&pair, &constant[0], &constant[1], &settings).1.points,
        0,
        "a constant phase has no place"
    );
    assert_eq!(matched(&pair, &poisoned[0], &poisoned[1], &settings).1, MatchReport::default());
}

#[test]
fn views_that_share_nothing_give_no_points() {
    let [left, _, projector] = rig(60, 40);
    let aside = looking([300.0, 0.0, 500.0], [300.0, 400.0, 0.0], [1.0, 0.0, 0.0], 60, 40);
    let scene = scene(&[Surface::plane([0.0, 0.0, 1.0], 0.0)], &projector);
    let maps = [&left, &aside].map(|c| scene.phase_map(c, Axis::X, 0.0, 3));
    assert_eq!(matched(&[left, aside], &maps[0], &maps[1], &MatchSettings::default()).1.points, 0);
}

#[test]
fn images_of_one_row_or_one_column_are_matched_or_empty_but_no_fault() {
    for (width, height) in [(1, 1), (1, 40), (60, 1), (2, 2), (60, 2)] {
        let [mut left, mut right, projector] = rig(60, 40);
        for camera in [&mut left, &mut right] {
            (camera.width_px, camera.height_px) = (width, height);
        }
        let scene = scene(&[Surface::plane([0.0, 0.0, 1.0], 0.0)], &projector);
        let maps = [&left, &right].map(|c| scene.phase_map(c, Axis::X, 0.0, 3));
        matched(&[left, right], &maps[0], &maps[1], &MatchSettings::default());
    }
}

#[test]
fn maps_that_do_not_fit_are_refused_with_both_numbers() {
    let [left, right, projector] = rig(60, 40);
    let scene = scene(&[Surface::plane([0.0, 0.0, 1.0], 0.0)], &projector);
    let maps = [&left, &right].map(|c| scene.phase_map(c, Axis::X, 0.0, 3));
    let mut matcher = Matcher::new(&left, &right, &MatchSettings::default()).unwrap();
    let mut out = vec![blank(); matcher.capacity()];
    let mut refused = |left: &PhaseView, right: &PhaseView, capacity: usize, wanted: [&str; 2]| {
        let message = matcher.run(left, right, 0, &mut out[..capacity]).unwrap_err().to_string();
        assert!(wanted.iter().all(|w| message.contains(w)), "{message}");
    };
    let other = scene.phase_map(&rig(30, 20)[1], Axis::X, 0.0, 3);
    refused(&maps[0].view(), &other.view(), 2400, ["[30, 20]", "[60, 40]"]);
    let turned = scene.phase_map(&right, Axis::Y, 0.0, 3);
    refused(&maps[0].view(), &turned.view(), 2400, ["X", "Y"]);
    let mut period = maps[1].clone();
    period.info.period_px = 18.0;
    refused(&maps[0].view(), &period.view(), 2400, ["16", "18"]);
    let cut = maps[1].view();
    refused(&maps[0].view(), &PhaseView { sigma_rad: &cut.sigma_rad[1..], ..cut }, 2400, ["2399", "2400"]);
    refused(&maps[0].view(), &maps[1].view(), 100, ["100", "2400"]);
    period.info.period_px = f64::NAN;
    refused(&period.view(), &period.view(), 2400, ["period_px", "NaN"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// Noise, holes and jumps of any kind: no panic, the counts add up, the points are finite and in pixel order.
    #[test]
    fn any_map_is_survived(seed in any::<u64>(), kind in 0..4_u8) {
        let [left, right, projector] = rig(80, 54);
        let scene = scene(&[Surface::plane([0.1, 0.0, 1.0], 0.0)], &projector);
        let mut noise = Noise(seed);
        let maps = [&left, &right].map(|camera| {
            let mut map = scene.phase_map(camera, Axis::X, 0.01, seed);
            for index in 0..map.info.len() {
                let roll = noise.unit();
                match kind {
                    0 => map.phase_rad[index] = (roll * 300.0) as f32,
                    1 if roll < 0.3 => map.valid[index] = 0,
                    2 if roll < 0.2 => map.phase_rad[index] = f32::from_bits(noise.next_bits() as u32),
                    _ if roll < 0.1 => map.sigma_rad[index] = f32::from_bits(noise.next_bits() as u32),
                    _ => {}
                }
            }
            map
        });
        let (points, _) = matched(&[left, right], &maps[0], &maps[1], &MatchSettings::default());
        for point in &points {
            prop_assert!(point.position_mm.iter().all(|v| v.is_finite()) && point.sigma_mm.is_finite());
        }
        prop_assert!(points.windows(2).all(|w| w[0].pixel < w[1].pixel));
    }
}
