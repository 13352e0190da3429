//! Clouds of known surfaces at known distances.

use super::m3c2::{M3c2Settings, m3c2};
use super::{Comparison, compare, compare_with_nearest};
use crate::reference::{CloudError, CloudReference, Deviation, Reference};
use crate::spatial::TriangleMesh;
use fringe::cloud::Point;
use fringe::math::{cos, sin};
use fringe::synthetic::Noise;
use nalgebra::{Point3, Vector3};
use std::f64::consts::TAU;

/// A surface of two parameters in 0 … 1, with its outer normal.
type Surface = fn(f64, f64) -> (Point3<f64>, Vector3<f64>);

fn plane(a: f64, b: f64) -> (Point3<f64>, Vector3<f64>) {
    (Point3::new(20.0 * a, 20.0 * b, 5.0), Vector3::z())
}

/// The upper part of a sphere of 22 mm.
fn sphere(a: f64, b: f64) -> (Point3<f64>, Vector3<f64>) {
    let (z, turn) = (0.4 + 0.6 * a, TAU * b);
    let across = (1.0 - z * z).max(0.0).sqrt();
    let normal = Vector3::new(across * cos(turn), across * sin(turn), z);
    (Point3::new(1.0, 2.0, 3.0) + normal * 11.0, normal)
}

/// A torus of radii 15 mm and 5 mm: curved both ways, and saddle-shaped inside.
fn torus(a: f64, b: f64) -> (Point3<f64>, Vector3<f64>) {
    let (turn, tube) = (TAU * a, TAU * b);
    let out = Vector3::new(cos(turn), sin(turn), 0.0);
    let normal = out * cos(tube) + Vector3::z() * sin(tube);
    (Point3::from(out * 15.0 + normal * 5.0), normal)
}

/// `count` random points of a surface, lifted and scattered along the normal.
fn cloud(surface: Surface, count: usize, lift_mm: f64, sigma_mm: f64, seed: u64) -> Vec<Point> {
    let mut noise = Noise(seed);
    (0..count)
        .map(|_| {
            let (p, normal) = surface(noise.unit(), noise.unit());
            let at = p + normal * (lift_mm + sigma_mm * noise.gauss());
            Point {
                position_mm: at.coords.into(),
                normal: normal.map(|v| v as f32).into(),
                ..bytemuck::Zeroable::zeroed()
            }
        })
        .collect()
}

fn against(points: &[Point], reference: &[Point]) -> Comparison {
    let reference = CloudReference::new(reference, Vector3::z(), None).unwrap();
    compare(points, &Reference::Cloud(reference), f64::INFINITY)
}

/// Proves: the distance from the nearest point is the least of all distances, and what has none within the limit is counted.
#[test]
fn the_nearest_point_is_the_nearest_of_all() {
    let reference = cloud(torus, 3000, 0.0, 0.01, 5);
    let points = cloud(torus, 700, 0.4, 0.3, 6);
    let brute = |p: &Point| {
        let distances = reference.iter().map(|r| (r.position() - p.position()).norm());
        distances.fold(f64::INFINITY, f64::min)
    };
    let tree = Reference::Cloud(CloudReference::new(&reference, Vector3::z(), None).unwrap());
    let limit_mm = 0.9;
    let found = compare_with_nearest(&points, &tree, limit_mm);
    for (point, deviation) in points.iter().zip(&found.deviations) {
        let least = brute(point);
        match deviation.mm() {
            Some(mm) => assert!((mm - least).abs() < 1e-12 && least <= limit_mm, "{mm} {least}"),
            None => assert!(least > limit_mm, "{deviation:?} {least}"),
        }
    }
    let cut = found.counts.cut_too_far;
    assert!(cut > 20 && found.counts.count > 400 && cut + found.counts.count == points.len(), "{cut}");
}

/// What a paraboloid leaves at the middle of a disc of radius r on a sphere of radius R, in fourth order: ρ⁴/8R³ is fitted
/// by (ρ² r² − r⁴/6)/8R³.
fn fourth_order_mm(reference: &[Point], curvature_radius_mm: f64) -> f64 {
    let radius_mm = CloudReference::new(reference, Vector3::z(), None).unwrap().radius_mm();
    radius_mm.powi(4) / (6.0 * 8.0 * curvature_radius_mm.powi(3))
}

#[test]
fn a_lifted_cloud_lies_that_much_above_planes_spheres_and_tori() {
    for (surface, radius_mm) in [(plane as Surface, 1e9), (sphere, 11.0), (torus, 5.0)] {
        let reference = cloud(surface, 40_000, 0.0, 0.0, 1);
        let bound_mm = fourth_order_mm(&reference, radius_mm) + 2e-9;
        assert!(bound_mm < 1e-4, "{bound_mm}");
        for lift_mm in [-0.5, -0.02, 0.0, 0.005, 0.3] {
            let compared = against(&cloud(surface, 5000, lift_mm, 0.0, 2), &reference);
            let s = compared.statistics.unwrap();
            assert!((s.mean_mm - lift_mm).abs() < bound_mm, "{lift_mm}: mean {:e}", s.mean_mm - lift_mm);
            assert!(s.sd_mm.unwrap() < 2.0 * bound_mm, "{lift_mm}: sd {:e} {bound_mm:e}", s.sd_mm.unwrap());
            assert!(compared.counts.count > 4900, "{:?}", compared.counts);
        }
    }
}

#[test]
fn a_sparser_reference_gives_the_same_distances() {
    let compared = cloud(sphere, 4000, 0.03, 0.0, 5);
    for count in [4000, 16_000, 64_000] {
        let reference = cloud(sphere, count, 0.0, 0.0, 6);
        let error_mm = against(&compared, &reference).statistics.unwrap().mean_mm - 0.03;
        assert!(error_mm.abs() < fourth_order_mm(&reference, 11.0) + 1e-8, "{count}: {error_mm:e}");
    }
}

#[test]
fn noise_is_reported_as_it_is() {
    let s = against(&cloud(torus, 40_000, 0.01, 0.02, 7), &cloud(torus, 40_000, 0.0, 0.02, 8))
        .statistics
        .unwrap();
    // 28 points and a paraboloid: the reference's noise falls to about 4/28 of its variance.
    assert!((s.sd_mm.unwrap() - 0.0214).abs() < 0.0006, "{}", s.sd_mm.unwrap());
    assert!((s.mean_mm - 0.01).abs() < 4e-4, "{}", s.mean_mm);
}

#[test]
fn points_beside_the_reference_and_far_away_are_told_apart() {
    let reference = cloud(plane, 20_000, 0.0, 0.0, 1);
    let at = |x: f64, y: f64, z: f64| Point { position_mm: [x, y, z], ..bytemuck::Zeroable::zeroed() };
    let points = [at(10.0, 10.0, 5.25), at(10.0, 10.0, 7.0), at(30.0, 10.0, 5.0), at(21.0, 10.0, 5.0)];
    let reference = Reference::Cloud(CloudReference::new(&reference, Vector3::z(), None).unwrap());
    let compared = compare(&points, &reference, 1.5);
    assert!(matches!(compared.deviations[0], Deviation::Mm(mm) if (mm - 0.25).abs() < 1e-12));
    assert_eq!(compared.deviations[1..], [Deviation::TooFar, Deviation::TooFar, Deviation::BeyondEdge]);
    assert_eq!(
        (compared.counts.count, compared.counts.cut_too_far, compared.counts.cut_beyond_edge),
        (1, 2, 1)
    );
}

#[test]
fn the_far_side_of_a_thin_wall_does_not_count() {
    let mut wall = cloud(plane, 20_000, 0.0, 0.0, 1);
    wall.extend(
        cloud(plane, 20_000, -0.3, 0.0, 2).iter().map(|p| Point { normal: p.normal.map(|n| -n), ..*p }),
    );
    let s = against(&cloud(plane, 3000, 0.05, 0.0, 3), &wall).statistics.unwrap();
    assert!((s.min_mm - 0.05).abs() < 1e-9 && (s.max_mm - 0.05).abs() < 1e-9, "{} {}", s.min_mm, s.max_mm);
}

#[test]
fn without_normals_the_given_direction_is_outside() {
    let bare = |points: Vec<Point>| -> Vec<Point> {
        points.iter().map(|p| Point { normal: [0.0; 3], ..*p }).collect()
    };
    let (points, reference) = (bare(cloud(plane, 100, 0.1, 0.0, 1)), bare(cloud(plane, 9000, 0.0, 0.0, 2)));
    for side in [1.0, -1.0] {
        let reference = CloudReference::new(&reference, Vector3::z() * side, None).unwrap();
        assert!(!reference.has_normals());
        let s = compare(&points, &Reference::Cloud(reference), 1.0).statistics.unwrap();
        assert!((s.mean_mm - side * 0.1).abs() < 1e-12);
    }
}

#[test]
fn the_number_of_threads_does_not_show() {
    let (points, reference) = (cloud(torus, 8000, 0.02, 0.02, 1), cloud(torus, 20_000, 0.0, 0.02, 2));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| against(&points, &reference))
    };
    let (one, three) = (run(1), run(3));
    assert_eq!(one.deviations, three.deviations);
    assert_eq!(one.statistics, three.statistics);
}

#[test]
fn a_mesh_of_a_sphere_is_inside_by_its_sagitta() {
    let mut triangles = Vec::new();
    let at = |i: usize, j: usize| {
        // The poles exactly, and the last meridian the first: a closed mesh.
        let (up, turn) = (std::f64::consts::PI * i as f64 / 90.0, TAU * (j % 180) as f64 / 180.0);
        let across = if i.is_multiple_of(90) { 0.0 } else { sin(up) };
        Point3::new(across * cos(turn), across * sin(turn), cos(up)) * 10.0
    };
    for i in 0..90 {
        for j in 0..180 {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    let mesh = Reference::Mesh(TriangleMesh::new(&triangles).unwrap());
    let mut noise = Noise(1);
    let points: Vec<Point> = (0..2000)
        .map(|_| {
            let d = Vector3::new(noise.gauss(), noise.gauss(), noise.gauss()).normalize();
            Point { position_mm: (d * (10.0 + noise.unit() - 0.5)).into(), ..bytemuck::Zeroable::zeroed() }
        })
        .collect();
    let compared = compare(&points, &mesh, f64::INFINITY);
    for (point, deviation) in points.iter().zip(&compared.deviations) {
        let expected = point.position().coords.norm() - 10.0;
        let error = deviation.mm().unwrap() - expected;
        // Sagitta of an edge of 2°: 10 (1 − cos 1°) = 1.5 µm, of a diagonal √2 longer twice as much.
        assert!((-1e-9..3.1e-3).contains(&error), "{error}");
    }
}

#[test]
fn clouds_that_are_no_reference_are_refused() {
    let new = |points: &[Point]| CloudReference::new(points, Vector3::z(), None).map(|_| ()).unwrap_err();
    let p = cloud(plane, 100, 0.0, 0.0, 1);
    assert_eq!(new(&[]), CloudError::Few { found: 0, needed: 4 });
    assert_eq!(new(&p[..1]), CloudError::Few { found: 1, needed: 4 });
    assert_eq!(new(&[p[0]; 50]), CloudError::Coincident);
    let mut far = p.clone();
    far[7].position_mm[1] = f64::NAN;
    assert_eq!(new(&far), CloudError::Coordinate { index: 7 });
    // Points on a line make no surface.
    let line: Vec<Point> = (0..100)
        .map(|i| Point { position_mm: [f64::from(i), 0.0, 0.0], ..bytemuck::Zeroable::zeroed() })
        .collect();
    let reference = Reference::Cloud(CloudReference::new(&line, Vector3::z(), None).unwrap());
    assert_eq!(compare(&p[..1], &reference, f64::INFINITY).deviations, [Deviation::NoSurface]);
}

#[test]
fn m3c2_finds_a_step_and_says_what_is_significant() {
    let settings = M3c2Settings {
        normal_scales_mm: vec![1.0, 2.0, 4.0],
        projection_scale_mm: 1.0,
        depth_mm: 2.0,
        core_mm: 1.0,
        registration_mm: 0.0,
    };
    let reference = cloud(plane, 40_000, 0.0, 0.02, 1);
    let reference = CloudReference::new(&reference, Vector3::z(), None).unwrap();
    for (lift_mm, significant) in [(0.0, 0.05), (0.05, 1.0)] {
        let found = m3c2(&cloud(plane, 40_000, lift_mm, 0.02, 2), &reference, &settings);
        let s = found.statistics.unwrap();
        assert!((s.mean_mm - lift_mm).abs() < 0.001, "{}", s.mean_mm);
        let share = found.significant as f64 / found.with_level as f64;
        assert!((share - significant).abs() < 0.06, "{lift_mm}: {share}");
        // σ √(2/n) with some 78 points each.
        let level_mm = found.median_level_mm.unwrap();
        assert!((level_mm - 1.96 * 0.02 * (2.0_f64 / 78.0).sqrt()).abs() < 5e-4, "{level_mm}");
    }
}

/// What a reference states where points are compared is that of its nearest point; a reference without uncertainties, and a point with none near,
/// have 0.
#[test]
fn the_uncertainty_of_the_reference_is_that_of_its_nearest_point() {
    let plain = cloud(torus, 3000, 0.0, 0.0, 11);
    let stated: Vec<Point> =
        (1..).zip(&plain).map(|(number, point)| Point { sigma_mm: number as f32, ..*point }).collect();
    let points = cloud(torus, 300, 0.2, 0.0, 12);
    let of = |reference: &[Point], points: &[Point]| {
        let reference = CloudReference::new(reference, Vector3::z(), None).unwrap();
        Reference::Cloud(reference).sigmas_mm(points, 5.0)
    };
    let nearest = |point: &Point| {
        let apart = |other: &Point| (point.position() - other.position()).norm_squared();
        stated.iter().min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap().sigma_mm
    };
    assert_eq!(of(&stated, &points), points.iter().map(nearest).collect::<Vec<f32>>());
    assert_eq!(of(&plain, &points), vec![0.0; points.len()]);
    let far = Point { position_mm: [0.0, 0.0, 900.0], ..points[0] };
    assert_eq!(of(&stated, &[far]), [0.0]);
}
