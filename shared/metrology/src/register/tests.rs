//! Clouds moved by known motions.

use super::*;
use crate::reference::CloudReference;
use crate::spatial::TriangleMesh;
use fringe::math::{cos, sin};
use fringe::synthetic::Noise;
use nalgebra::Vector3;

/// A wavy free-form face of 60 mm × 40 mm without any symmetry.
fn face(x: f64, y: f64) -> f64 {
    4.0 * sin(0.11 * x + 0.3) * cos(0.13 * y) + 0.02 * x * y / 10.0 + 2.0 * sin(0.23 * y + 0.05 * x)
}

fn point(at: Point3<f64>) -> Point {
    Point { position_mm: at.coords.into(), ..bytemuck::Zeroable::zeroed() }
}

fn cloud(count: usize, sigma_mm: f64, seed: u64) -> Vec<Point> {
    let mut noise = Noise(seed);
    (0..count)
        .map(|_| {
            let (x, y) = (60.0 * noise.unit() - 20.0, 40.0 * noise.unit() - 15.0);
            point(Point3::new(x, y, face(x, y) + sigma_mm * noise.gauss()))
        })
        .collect()
}

fn moved(points: &[Point], pose: &Pose) -> Vec<Point> {
    points.iter().map(|p| point(Point3::from(pose.point(&p.position().coords)))).collect()
}

fn motion(turn: [f64; 3], shift: [f64; 3]) -> Pose {
    Pose { rotation: motion::rotation(&Vector3::from(turn)), translation: Vector3::from(shift) }
}

fn reference(points: &[Point]) -> Reference {
    Reference::Cloud(CloudReference::new(points, Vector3::z(), None).unwrap().with_normals())
}

fn identity() -> Pose {
    motion([0.0; 3], [0.0; 3])
}

/// Largest displacement of the face's points that is left after the alignment.
fn error_mm(found: &Registration, truth: &Pose, points: &[Point]) -> f64 {
    let rest = found.pose().after(truth);
    points.iter().map(|p| (rest.point(&p.position().coords) - p.position().coords).norm()).fold(0.0, f64::max)
}

#[test]
fn a_known_motion_is_undone() {
    let (points, truth) = (cloud(20_000, 0.0, 1), motion([0.02, -0.03, 0.05], [0.8, -0.5, 0.3]));
    let reference = reference(&cloud(60_000, 0.0, 2));
    let found = register(
        &moved(&points, &truth),
        &reference,
        &InitialPose::Given(identity()),
        &RegisterSettings::default(),
    )
    .unwrap();
    assert!(found.converged && found.undetermined.is_empty(), "{found:?}");
    let error = error_mm(&found, &truth, &points);
    assert!(error < 3e-4, "{error}");
    assert!(found.overlap > 0.97 && found.condition < 100.0, "{found:?}");
    // The same point in 4 × 4 form.
    assert_eq!(found.matrix[1][..3], found.rotation[1]);
    assert_eq!((found.matrix[2][3], found.matrix[3]), (found.translation_mm[2], [0.0, 0.0, 0.0, 1.0]));
}

#[test]
fn the_stated_uncertainty_is_the_scatter_of_many_alignments() {
    let reference = reference(&cloud(40_000, 0.0, 99));
    let trials: Vec<Registration> = (0..40)
        .map(|seed| {
            let points = cloud(3000, 0.05, seed);
            register(&points, &reference, &InitialPose::Given(identity()), &RegisterSettings::default())
                .unwrap()
        })
        .collect();
    // Displacement of the centre of the matches: t + R c − c.
    let mut ratio = 0.0;
    for axis in 0..3 {
        let shifts: Vec<f64> = trials
            .iter()
            .map(|t| {
                let centre = Vector3::from(trials[0].centre_mm);
                (t.pose().point(&centre) - centre)[axis]
            })
            .collect();
        let mean = shifts.iter().sum::<f64>() / 40.0;
        let scatter = (shifts.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>() / 39.0).sqrt();
        let stated = trials.iter().map(|t| t.u_translation_mm[axis]).sum::<f64>() / 40.0;
        ratio += scatter / stated / 3.0;
    }
    // Forty trials in three axes know the ratio to 7 %.
    assert!((0.8..1.25).contains(&ratio), "scatter over stated: {ratio}");
}

#[test]
fn a_plane_on_a_plane_slides_and_says_so() {
    let mut noise = Noise(3);
    let mut flat = |size: f64, lift: f64| -> Vec<Point> {
        let mut at = || size * noise.unit() - 0.5 * size;
        let mut place = || (at(), at());
        (0..8000).map(|_| place()).map(|(x, y)| point(Point3::new(x, y, lift))).collect()
    };
    let (points, target) = (flat(20.0, 0.4), flat(40.0, 0.0));
    for sigma_mm in [0.0, 0.02] {
        let mut noise = Noise(8);
        let mut noisy = |points: &[Point]| -> Vec<Point> {
            let lift = |p: &Point| point(p.position() + Vector3::z() * (sigma_mm * noise.gauss()));
            points.iter().map(lift).collect()
        };
        let reference = reference(&noisy(&target));
        let start = motion([0.01, 0.0, 0.02], [0.3, 0.0, 0.0]);
        let found =
            register(&noisy(&points), &reference, &InitialPose::Given(start), &RegisterSettings::default())
                .unwrap();
        assert_eq!(found.undetermined.len(), 3, "{sigma_mm}: {found:?}");
        // Neither the turn about the normal nor a shift along the plane has an uncertainty.
        let known = |u: [f64; 3]| u.map(f64::is_finite);
        let stated = [known(found.u_rotation_rad), known(found.u_translation_mm)];
        assert_eq!(stated, [[true, true, false], [false, false, true]], "{sigma_mm}: {found:?}");
        assert!(found.covariance[2][2] == f64::INFINITY && found.covariance[2][5] == 0.0, "{found:?}");
        assert!((found.pose().point(&Vector3::new(0.0, 0.0, 0.4)).z).abs() < 0.01);
        // What is not determined was not touched: the shift along x of the start is still there.
        assert!((found.translation_mm[0] - 0.3).abs() < 0.02, "{:?}", found.translation_mm);
    }
}

#[test]
fn a_sphere_may_turn_and_its_centre_is_found() {
    let mut noise = Noise(3);
    let mut ball = |centre: [f64; 3]| -> Vec<Point> {
        let mut direction = || Vector3::new(noise.gauss(), noise.gauss(), noise.gauss()).normalize();
        (0..20_000).map(|_| point(Point3::from(centre) + direction() * 11.0)).collect()
    };
    let (points, target) = (ball([0.5, -0.4, 0.2]), ball([0.0; 3]));
    let found =
        register(&points, &reference(&target), &InitialPose::Given(identity()), &RegisterSettings::default())
            .unwrap();
    assert_eq!(found.undetermined.len(), 3, "{:?}", found.undetermined);
    let centre = found.pose().point(&Vector3::new(0.5, -0.4, 0.2));
    assert!(centre.norm() < 1e-3, "{centre}");
}

#[test]
fn a_start_is_found_from_anywhere() {
    let points = cloud(8000, 0.01, 1);
    let reference = reference(&cloud(30_000, 0.01, 2));
    for turn in [[0.0, 0.0, 3.0], [2.0, 1.0, -0.5], [0.0, 0.0, 0.0]] {
        let truth = motion(turn, [150.0 * turn[2], -80.0, 300.0 * turn[0]]);
        let found =
            register(&moved(&points, &truth), &reference, &InitialPose::Search, &RegisterSettings::default())
                .unwrap();
        let error = error_mm(&found, &truth, &points);
        assert!(error < 0.01 && found.rival.is_none(), "{turn:?}: {error} {found:?}");
    }
}

#[test]
fn a_part_of_the_surface_is_aligned_with_outliers_present() {
    let truth = motion([0.01, 0.02, -0.02], [0.3, 0.2, -0.2]);
    let half = |p: &&Point| p.position_mm[0] > 5.0;
    let mut points: Vec<Point> = cloud(20_000, 0.01, 1).iter().filter(half).copied().collect();
    let inliers = points.clone();
    let mut noise = Noise(6);
    points
        .extend((0..800).map(|_| {
            point(Point3::new(40.0 * noise.unit(), 20.0 * noise.unit(), 8.0 + 10.0 * noise.unit()))
        }));
    // The reference covers another half.
    let other = |p: &&Point| p.position_mm[0] < 30.0;
    let target: Vec<Point> = cloud(60_000, 0.01, 2).iter().filter(other).copied().collect();
    let found = register(
        &moved(&points, &truth),
        &reference(&target),
        &InitialPose::Given(identity()),
        &RegisterSettings::default(),
    )
    .unwrap();
    let error = error_mm(&found, &truth, &inliers);
    assert!(error < 0.01, "{error}");
    assert!((0.6..0.85).contains(&found.overlap), "{}", found.overlap);
}

#[test]
fn a_mesh_is_a_reference_too() {
    let at = |i: i32, j: i32| {
        let (x, y) = (0.5 * f64::from(i) - 20.0, 0.5 * f64::from(j) - 15.0);
        Point3::new(x, y, face(x, y))
    };
    let mut triangles = Vec::new();
    for i in 0..120 {
        for j in 0..80 {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    let mesh = Reference::Mesh(TriangleMesh::new(&triangles).unwrap());
    let (points, truth) = (cloud(20_000, 0.0, 1), motion([0.0, 3.0, 1.0], [0.8, -100.5, 0.3]));
    let found =
        register(&moved(&points, &truth), &mesh, &InitialPose::Search, &RegisterSettings::default()).unwrap();
    let error = error_mm(&found, &truth, &points);
    // Facets lie within curvature · edge²/8 = 0.15 · 0.5/8 of the surface, inside of humps and outside of hollows.
    assert!(error < 9e-3, "{error}");
}

#[test]
fn clouds_that_do_not_meet_are_told() {
    let reference = reference(&cloud(5000, 0.0, 1));
    let far = moved(&cloud(500, 0.0, 2), &motion([0.0; 3], [1000.0, 0.0, 0.0]));
    let error = register(&far, &reference, &InitialPose::Given(identity()), &RegisterSettings::default())
        .unwrap_err();
    assert!(matches!(error, RegisterError::Few { matched: 0, .. }), "{error}");
    let few =
        register(&far[..3], &reference, &InitialPose::Search, &RegisterSettings::default()).unwrap_err();
    assert!(matches!(few, RegisterError::Cloud(_)), "{few}");
}

#[test]
fn the_number_of_threads_does_not_show() {
    let (points, target) = (cloud(30_000, 0.01, 1), cloud(30_000, 0.01, 2));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            register(&points, &reference(&target), &InitialPose::Search, &RegisterSettings::default())
                .unwrap()
        })
    };
    assert_eq!(run(1), run(3));
}

/// A lattice on the face with noise that is averaged over `2 · half + 1` steps along both axes.
fn smoothed(half: i32, sigma_mm: f64, seed: u64) -> Vec<Point> {
    let (columns, rows, step_mm) = (120, 80, 0.5);
    let mut noise = Noise(seed);
    let wide = (columns + 2 * half, rows + 2 * half);
    let white: Vec<f64> = (0..wide.0 * wide.1).map(|_| noise.gauss()).collect();
    let side = 2 * half + 1;
    let at = |i: i32, j: i32| {
        let near = (0..side).flat_map(|b| (0..side).map(move |a| ((j + b) * wide.0 + i + a) as usize));
        sigma_mm * near.map(|k| white[k]).sum::<f64>() / f64::from(side)
    };
    let (x, y) = (|i: i32| step_mm * f64::from(i) - 20.0, |j: i32| step_mm * f64::from(j) - 15.0);
    (0..rows)
        .flat_map(|j| (0..columns).map(move |i| (i, j)))
        .map(|(i, j)| point(Point3::new(x(i), y(j), face(x(i), y(j)) + at(i, j))))
        .collect()
}

/// Root mean square of error over stated uncertainty, over the six parameters and many seeds.
fn pull(half: i32, seeds: std::ops::Range<u64>) -> f64 {
    let reference = reference(&cloud(60_000, 0.0, 99));
    let count = 6.0 * (seeds.end - seeds.start) as f64;
    let squares: f64 = seeds
        .map(|seed| {
            let points = smoothed(half, 0.04, seed);
            let start = InitialPose::Given(identity());
            let found = register(&points, &reference, &start, &RegisterSettings::default()).unwrap();
            assert!(found.converged, "{found:?}");
            let pose = found.pose();
            let centre = Vector3::from(found.centre_mm);
            let (shift, r) = (pose.point(&centre) - centre, pose.rotation);
            let turn = [r[(2, 1)], r[(0, 2)], r[(1, 0)]];
            (0..3)
                .map(|i| {
                    let (a, b) = (shift[i] / found.u_translation_mm[i], turn[i] / found.u_rotation_rad[i]);
                    a * a + b * b
                })
                .sum::<f64>()
        })
        .sum();
    (squares / count).sqrt()
}

#[test]
fn pulls_are_one_for_single_and_for_smoothed_points() {
    // 240 parameters know the ratio to 5 %.
    for half in [0, 2] {
        let ratio = pull(half, 0..40);
        assert!((0.88..1.12).contains(&ratio), "smoothed over {} points: {ratio}", 2 * half + 1);
    }
}

#[test]
#[ignore = "500 alignments: cargo test --release -p fringe-metrology figures_of_the_pulls -- --ignored --nocapture"]
#[allow(clippy::disallowed_macros, reason = "the figures are what this trial is for")]
fn figures_of_the_pulls() {
    for half in [0, 1, 2, 3, 5] {
        eprintln!("smoothed over {} points: pull {:.3}", 2 * half + 1, pull(half, 0..100));
    }
}

/// Points of a surface given by two parameters, with its normals, after a motion.
fn surface(count: usize, seed: u64, pose: &Pose, at: impl Fn(f64, f64) -> [Vector3<f64>; 2]) -> Vec<Point> {
    let mut noise = Noise(seed);
    (0..count)
        .map(|_| {
            let [place, normal] = at(noise.unit(), noise.unit());
            let place = pose.point(&(place + normal * (0.01 * noise.gauss())));
            Point { normal: (pose.rotation * normal).map(|v| v as f32).into(), ..point(Point3::from(place)) }
        })
        .collect()
}

#[test]
fn what_is_truly_symmetric_is_undetermined_and_no_failure_of_the_search() {
    let tau = std::f64::consts::TAU;
    let sphere = move |a: f64, b: f64| {
        let (height, around) = (2.0 * a - 1.0, tau * b);
        let flat = (1.0 - height * height).sqrt();
        let normal = Vector3::new(flat * cos(around), flat * sin(around), height);
        [normal * 11.0, normal]
    };
    let cylinder = move |a: f64, b: f64| {
        let normal = Vector3::new(cos(tau * a), sin(tau * a), 0.0);
        [normal * 8.0 + Vector3::z() * (40.0 * b - 20.0), normal]
    };
    let plane = |a: f64, b: f64| [Vector3::new(40.0 * a - 20.0, 30.0 * b - 15.0, 0.0), Vector3::z()];
    let truth = motion([1.0, -2.0, 0.7], [200.0, -50.0, 90.0]);
    let found = |points: Vec<Point>, target: Vec<Point>| {
        register(&points, &reference(&target), &InitialPose::Search, &RegisterSettings::default()).unwrap()
    };
    for (name, free, found) in [
        ("sphere", 3, found(surface(6000, 1, &truth, sphere), surface(20_000, 2, &identity(), sphere))),
        ("cylinder", 2, found(surface(6000, 1, &truth, cylinder), surface(20_000, 2, &identity(), cylinder))),
        ("plane", 3, found(surface(6000, 1, &truth, plane), surface(20_000, 2, &identity(), plane))),
    ] {
        assert_eq!(
            (found.outcome, found.undetermined.len()),
            (Outcome::Undetermined, free),
            "{name}: {found:?}"
        );
        assert!(found.overlap > 0.9, "{name}: {found:?}");
    }
}

/// A cuboid's faces, as triangles.
fn cuboid(half: [f64; 3]) -> Vec<[Point3<f64>; 3]> {
    let corner = |i: usize| {
        let side = |bit: usize| if i >> bit & 1 == 1 { half[bit] } else { -half[bit] };
        Point3::new(side(0), side(1), side(2))
    };
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|t| t.map(corner)).collect()
}

/// Points on triangles in proportion to their areas.
fn on_triangles(triangles: &[[Point3<f64>; 3]], per_mm2: f64, seed: u64) -> Vec<Point> {
    let mut noise = Noise(seed);
    let mut points = Vec::new();
    for [a, b, c] in triangles {
        let cross = (b - a).cross(&(c - a));
        for _ in 0..(0.5 * cross.norm() * per_mm2) as usize {
            let (u, v) = (noise.unit(), noise.unit());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let place = a + (b - a) * u + (c - a) * v + cross.normalize() * (0.01 * noise.gauss());
            points.push(Point { normal: cross.normalize().map(|v| v as f32).into(), ..point(place) });
        }
    }
    points
}

#[test]
fn a_part_with_equal_poses_is_ambiguous_and_one_with_a_mark_is_not() {
    let block = cuboid([20.0, 15.0, 10.0]);
    let mut marked = block.clone();
    // A pyramid of 4 mm on one face: one part in a hundred of the surface.
    let tip = Point3::new(10.0, 8.0, 14.0);
    let foot = [[6.0, 4.0], [14.0, 4.0], [14.0, 12.0], [6.0, 12.0]].map(|[x, y]| Point3::new(x, y, 10.0));
    marked.extend((0..4).map(|i| [foot[i], foot[(i + 1) % 4], tip]));
    let truth = motion([0.4, 2.0, -1.0], [90.0, 20.0, -300.0]);
    let found = |triangles: &[[Point3<f64>; 3]]| {
        let points: Vec<Point> = on_triangles(triangles, 1.5, 5)
            .iter()
            .map(|p| Point {
                normal: (truth.rotation * p.normal_vector()).map(|v| v as f32).into(),
                ..point(Point3::from(truth.point(&p.position().coords)))
            })
            .collect();
        let mesh = Reference::Mesh(TriangleMesh::new(triangles).unwrap());
        register(&points, &mesh, &InitialPose::Search, &RegisterSettings::default()).unwrap()
    };
    let equal = found(&block);
    assert_eq!((equal.outcome, equal.rival_is_symmetry), (Outcome::Ambiguous, Some(true)), "{equal:?}");
    let single = found(&marked);
    assert_eq!(single.outcome, Outcome::Aligned, "{single:?}");
    let rest = single.pose().after(&truth);
    let off = (rest.point(&Vector3::new(20.0, 15.0, 10.0)) - Vector3::new(20.0, 15.0, 10.0)).norm();
    assert!(off < 0.02, "{off}");
}
