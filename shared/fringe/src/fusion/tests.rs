//! Fusion against closed forms.

use super::cells::distance2;
use super::*;
use crate::matching::{MatchSettings, Matcher};
use crate::pattern::Axis;
use crate::synthetic::{Noise, Scene, Surface, looking, rig};
use nalgebra::{Point3, Vector3};

/// A square patch of a surface z = f(x, y), spacing 0.2 mm, shifted sampling, with noise along the normal.
pub(super) fn patch(
    f: impl Fn(f64, f64) -> (f64, [f64; 3]),
    shift: f64,
    sigma_mm: f64,
    seed: u64,
) -> Vec<Point> {
    let mut noise = Noise(seed);
    (0..100 * 100)
        .map(|i| {
            let (x, y) =
                (f64::from(i % 100) * 0.2 + shift - 10.0, f64::from(i / 100) * 0.2 + 0.7 * shift - 10.0);
            let (z, normal) = f(x, y);
            let normal = Vector3::from(normal).normalize();
            let at = Vector3::new(x, y, z) + normal * (sigma_mm * noise.gauss());
            Point {
                position_mm: at.into(),
                normal: [normal.x as f32, normal.y as f32, normal.z as f32],
                sigma_mm: sigma_mm as f32,
                pixel: i as u32,
                ..bytemuck::Zeroable::zeroed()
            }
        })
        .collect()
}

pub(super) fn plane(offset_mm: f64) -> impl Fn(f64, f64) -> (f64, [f64; 3]) {
    move |x, y| (0.3 * x - 0.1 * y + offset_mm * f64::sqrt(1.0 + 0.09 + 0.01), [-0.3, 0.1, 1.0])
}

pub(super) fn sphere(radius_mm: f64) -> impl Fn(f64, f64) -> (f64, [f64; 3]) {
    move |x, y| {
        let z = (radius_mm * radius_mm - x * x - y * y).sqrt();
        (z, [x, y, z])
    }
}

#[test]
fn the_distance_of_two_planes_is_reported_with_its_sign() {
    let (a, b) = (patch(plane(0.0), 0.0, 0.0, 1), patch(plane(0.025), 0.07, 0.0, 2));
    let mut out = Vec::new();
    let report = fuse(&[&a, &b], &FusionSettings::default(), &mut out);
    let overlap = report.overlaps[0];
    assert!(overlap.count > 9_000, "{overlap:?}");
    assert!((overlap.mean_mm + 0.025).abs() < 1e-6, "a lies 25 µm inside of b: {overlap:?}");
    assert!(overlap.sd_mm < 1e-6 && (overlap.max_mm - 0.025).abs() < 1e-6);
    assert_eq!(report.removed, [0, 0]);
    assert_eq!(out.len(), 20_000);
}

/// On a sphere of 22 mm, point-to-plane would be biased by the mean sagitta of 8 µm.
#[test]
fn curvature_does_not_bias_the_distance() {
    let (a, b) = (patch(sphere(15.0), 0.0, 0.0, 1), patch(sphere(15.010), 0.07, 0.0, 2));
    let report = fuse(&[&a, &b], &FusionSettings::default(), &mut Vec::new());
    assert!((report.overlaps[0].mean_mm + 0.010).abs() < 2e-5, "{:?}", report.overlaps);
}

#[test]
fn noise_gives_the_predicted_deviation() {
    for (surface_a, surface_b) in [(patch(plane(0.0), 0.0, 0.01, 1), patch(plane(0.0), 0.07, 0.01, 2)), {
        (patch(sphere(20.0), 0.0, 0.01, 3), patch(sphere(20.0), 0.07, 0.01, 4))
    }] {
        let overlap =
            fuse(&[&surface_a, &surface_b], &FusionSettings::default(), &mut Vec::new()).overlaps[0];
        assert!((0.97..1.03).contains(&overlap.sd_over_sigma.unwrap()), "{overlap:?}");
        assert!((overlap.sd_mm / 0.0102 - 1.0).abs() < 0.03, "{overlap:?}");
        assert!(overlap.mean_mm.abs() < 3e-4, "{overlap:?}");
    }
}

#[test]
fn isolated_points_go_and_the_order_stays() {
    let mut a = patch(plane(0.0), 0.0, 0.005, 1);
    let lonely = |x: f64, pixel: u32| Point { position_mm: [x, 0.0, 20.0], pixel, ..a[0] };
    let strays: Vec<Point> = (0..4).map(|i| lonely(f64::from(i) * 0.01, 20_000 + i)).collect();
    a.splice(5000..5000, strays);
    a.push(Point { position_mm: [f64::NAN, 0.0, 0.0], ..a[0] });
    let b = patch(plane(0.01), 30.0, 0.005, 2);
    let mut out = Vec::new();
    let report = fuse(&[&a, &b], &FusionSettings::default(), &mut out);
    assert_eq!(report.removed, [5, 0], "four strays are three neighbours to each other");
    assert_eq!(report.overlaps[0].count, 0, "the patches lie apart");
    assert_eq!((report.overlaps[0].mean_mm, report.overlaps[0].sd_mm), (0.0, 0.0));
    let expected: Vec<u32> = (0..10_000).chain(0..10_000).collect();
    assert_eq!(out.iter().map(|p| p.pixel).collect::<Vec<_>>(), expected);
}

/// Proves: of several clouds a fixed share of each is compared, evenly over the surface, and says the same.
#[test]
fn several_clouds_are_compared_by_a_share_of_their_points() {
    let mut noise = Noise(3);
    let mut plane = |depth: f64| -> Vec<Point> {
        let point = |pixel: u32| {
            let place =
                [f64::from(pixel % 100) * 0.1, f64::from(pixel / 100) * 0.1, depth + 0.002 * noise.gauss()];
            let normal = [0.0, 0.0, 1.0];
            Point { position_mm: place, normal, sigma_mm: 0.002, pixel, ..bytemuck::Zeroable::zeroed() }
        };
        (0..10_000).map(point).collect()
    };
    let clouds = [0.0, 0.010, 0.020, 0.030, 0.040].map(&mut plane);
    let clouds: Vec<&[Point]> = clouds.iter().map(Vec::as_slice).collect();
    let two = fuse(&clouds[..2], &FusionSettings::default(), &mut Vec::new()).overlaps[0];
    let all = fuse(&clouds, &FusionSettings::default(), &mut Vec::new()).overlaps;
    assert_eq!((two.count, all.len()), (10_000, 10));
    for overlap in &all {
        let share = f64::from(overlap.count) / f64::from(two.count);
        assert!((0.2..0.3).contains(&share), "{overlap:?}");
        let apart = 0.010 * (overlap.b - overlap.a) as f64;
        assert!((overlap.mean_mm + apart).abs() < 1e-4, "{overlap:?}");
        assert!((overlap.sd_mm / two.sd_mm - 1.0).abs() < 0.1, "{overlap:?}");
    }
}

#[test]
fn degenerate_clouds_are_no_fault() {
    let settings = FusionSettings::default();
    let mut out = vec![bytemuck::Zeroable::zeroed()];
    assert_eq!(fuse(&[], &settings, &mut out), FusionReport::default());
    assert!(out.is_empty());
    let report = fuse(&[&[], &[]], &settings, &mut out);
    assert_eq!((report.points, report.removed.as_slice()), (0, &[0, 0][..]));
    let same = vec![Point { sigma_mm: 0.01, ..bytemuck::Zeroable::zeroed() }; 50];
    let report = fuse(&[&same, &[], &same], &settings, &mut out);
    assert_eq!(report.points, 100, "coincident points support each other");
    assert_eq!(
        report.overlaps.iter().map(|o| (o.a, o.b, o.count)).collect::<Vec<_>>(),
        [(0, 1, 0), (0, 2, 0), (1, 2, 0)]
    );
    let nan = FusionSettings { radius_mm: Some(f64::NAN), ..settings };
    assert_eq!(fuse(&[&same], &nan, &mut out).points, 50);
}

/// Two pairs from orthogonal sides measure a sphere: their surfaces agree, and by as much as the noise predicts.
/// What two pairs that see a sphere from two sides say of each other.
fn overlap_on_a_sphere(settings: &MatchSettings) -> Overlap {
    let surface = Surface::Sphere { centre: Point3::new(0.0, 0.0, 0.0), radius_mm: 30.0 };
    let tilted = |degrees: f64, side: f64| {
        let angle = degrees.to_radians();
        let (s, c) = (crate::math::sin(angle), crate::math::cos(angle));
        [500.0 * s * 0.9, side * 150.0, 500.0 * c]
    };
    let mut clouds = Vec::new();
    for (pair, side) in [(0, 1.0), (1, -1.0)] {
        let cameras = [-12.0, 12.0].map(|d| looking(tilted(d, side), [0.0; 3], [1.0, 0.0, 0.0], 562, 375));
        let mut projector = rig(562, 375)[2].clone();
        projector.camera_from_world =
            looking(tilted(0.0, side), [0.0; 3], [1.0, 0.0, 0.0], 608, 684).camera_from_world;
        let scene = Scene { surfaces: vec![surface], projector, period_px: 16.0 };
        let maps =
            [0, 1].map(|c| scene.phase_map(&cameras[c], Axis::X, 0.005, 10 * u64::from(pair) + c as u64));
        let mut matcher = Matcher::new(&cameras[0], &cameras[1], settings).unwrap();
        let mut points = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
        let report = matcher.run(&maps[0].view(), &maps[1].view(), pair, &mut points).unwrap();
        points.truncate(report.points as usize);
        clouds.push(points);
    }
    let report = fuse(&[&clouds[0], &clouds[1]], &FusionSettings::default(), &mut Vec::new());
    let overlap = report.overlaps[0];
    assert!(overlap.count > 5_000, "{report:?}");
    assert!(overlap.mean_mm.abs() < 1e-3, "{overlap:?}");
    overlap
}

#[test]
fn two_pairs_agree_on_a_sphere() {
    let mut settings = MatchSettings::default();
    settings.surface.smoothing_px = 1;
    let raw = overlap_on_a_sphere(&settings);
    assert!((0.95..1.1).contains(&raw.sd_over_sigma.unwrap()), "{raw:?}");
    // Smoothed points agree better, and share noise that the prediction takes as independent.
    let smoothed = overlap_on_a_sphere(&MatchSettings::default());
    assert!(smoothed.sd_mm < 0.6 * raw.sd_mm, "{smoothed:?}");
    assert!(smoothed.sd_over_sigma > raw.sd_over_sigma, "{smoothed:?}");
}

#[test]
fn buffers_do_not_leak_from_one_run_to_the_next() {
    let (a, b) = (patch(plane(0.0), 0.0, 0.01, 1), patch(sphere(20.0), 0.1, 0.01, 2));
    let mut fuser = Fuser::default();
    let (mut first, mut again) = (Vec::new(), Vec::new());
    let before = fuser.fuse(&[&a, &b], &FusionSettings::default(), &mut first).clone();
    fuser.fuse(&[&b, &a, &a], &FusionSettings::default(), &mut again);
    let after = fuser.fuse(&[&a, &b], &FusionSettings::default(), &mut again).clone();
    assert_eq!((before, first), (after, again));
}

/// Proves: fusing into a given buffer gives the same points and report, touches nothing behind them, and refuses a buffer that is too short.
#[test]
fn fusing_into_a_given_buffer_gives_the_same() {
    let (a, b) = (patch(plane(0.0), 0.0, 0.01, 1), patch(sphere(20.0), 0.1, 0.01, 2));
    let mut list = Vec::new();
    let report = fuse(&[&a, &b], &FusionSettings::default(), &mut list);
    let marked = Point { pixel: u32::MAX, ..bytemuck::Zeroable::zeroed() };
    let mut buffer = vec![marked; a.len() + b.len() + 1];
    let mut fuser = Fuser::default();
    let into = fuser.fuse_into(&[&a, &b], &FusionSettings::default(), &mut buffer).cloned();
    assert_eq!((into, &buffer[..list.len()]), (Some(report), &list[..]));
    assert!(buffer[list.len()..].iter().all(|point| *point == marked));
    let small = &mut buffer[..a.len()];
    assert!(fuser.fuse_into(&[&a, &b], &FusionSettings::default(), small).is_none());
}

/// Proves: points kept and overlap are those of comparing all points with all, on any number of threads, with pieces and parts of cells
/// that end anywhere.
#[test]
fn fusing_equals_brute_force_on_any_number_of_threads() {
    let mut noise = Noise(7);
    let mut cloud = |count: u32, depth: f64| -> Vec<Point> {
        let point = |pixel: u32| {
            let place = [6.0 * noise.gauss(), 6.0 * noise.gauss(), depth + 0.2 * noise.gauss()];
            let normal = Vector3::new(0.3 * noise.gauss(), 0.3 * noise.gauss(), 1.0).normalize();
            let normal = [normal.x as f32, normal.y as f32, normal.z as f32];
            Point { position_mm: place, normal, sigma_mm: 0.01, pixel, ..bytemuck::Zeroable::zeroed() }
        };
        (0..count).map(point).collect()
    };
    let (mut a, b) = (cloud(PIECE as u32 + 900, 0.0), cloud(2500, 0.1));
    a[17].position_mm[1] = f64::INFINITY;
    a[18].normal = [0.0; 3];
    let settings = FusionSettings { radius_mm: Some(0.5), ..FusionSettings::default() };
    let near = |p: &Point, q: &Point| distance2(&p.position_mm, &q.position_mm) <= 0.25;
    let stays = |p: &&Point| is_finite(p) && a.iter().chain(&b).filter(|q| near(p, q)).count() > 4;
    let [left, right]: [Vec<Point>; 2] = [&a, &b].map(|cloud| cloud.iter().filter(stays).copied().collect());
    let cosine = crate::math::cos(30.0_f64.to_radians());
    let distance = |p: &Point| {
        let normal = p.normal_vector();
        let beside = right.iter().filter(|q| near(p, q) && normal.dot(&q.normal_vector()) >= cosine);
        let all: Vec<f64> =
            beside.map(|q| 0.5 * (normal + q.normal_vector()).dot(&(p.position() - q.position()))).collect();
        (all.len() >= 6 && normal != Vector3::zeros()).then(|| all.iter().sum::<f64>() / all.len() as f64)
    };
    let distances: Vec<f64> = left.iter().filter_map(distance).collect();
    let mean = distances.iter().sum::<f64>() / distances.len() as f64;
    let mut seen = None;
    for threads in 1..=3 {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut out = Vec::new();
        let report = pool.install(|| fuse(&[&a, &b], &settings, &mut out));
        // What scatters by more than it states gets the uncertainty that this asks for, and keeps all else.
        let as_stated = out.iter().map(|point| Point { sigma_mm: 0.01, shared_mm: 0.0, ..*point });
        assert!(as_stated.eq([left.clone(), right.clone()].concat()));
        let raised = out.iter().filter(|point| point.sigma_mm > 0.01).count();
        assert!(raised > 20 && raised == report.disagreeing as usize, "{raised}");
        assert_eq!(report.overlaps[0].count as usize, distances.len());
        assert!(distances.len() > 200 && report.removed[0] > 100, "{report:?}");
        assert!((report.overlaps[0].mean_mm - mean).abs() < 1e-13, "{report:?}, {mean}");
        let found = (report, out);
        let first = seen.get_or_insert_with(|| found.clone());
        assert!(*first == found, "{threads} threads");
    }
}
