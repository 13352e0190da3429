//! Stated uncertainties beside errors that points have in common.

use fringe::cloud::Point;
use fringe::fusion::{FusionSettings, fuse};
use nalgebra::{Point3, Vector3};

use super::Noise;
use super::uncertainty::cap;
use crate::fit::*;

/// Error of each point, mm.
const COMMON_MM: f64 = 0.02;

/// A way in which points err: its name, and the error at a place within ±1.
type Way = (&'static str, fn(f64, f64) -> f64);

/// Ways in which the points of an element may err together, all by the same size: −1 … 1 at a place within ±1.
const TOGETHER: [Way; 6] = [
    ("alike", |_, _| 1.0),
    ("one half up, one down", |x, _| x.signum()),
    ("the other halves", |_, y| y.signum()),
    ("quarters", |x, y| x.signum() * y.signum()),
    ("the middle up", |x, y| (0.5 - x * x - y * y).signum()),
    ("stripes", |x, _| fringe::math::sincos(9.0 * x).0.signum()),
];

/// Points of a plane of 40 × 30 mm, moved along its normal.
fn plane_points(moved_mm: &dyn Fn(f64, f64) -> f64) -> Vec<Point3<f64>> {
    let mut noise = Noise(3);
    (0..3000)
        .map(|_| {
            let [x, y] = [(); 2].map(|()| 2.0 * noise.uniform() - 1.0);
            Point3::new(20.0 * x, 15.0 * y, moved_mm(x, y) + 1e-4 * noise.normal())
        })
        .collect()
}

fn with(shared_mm: &[f32]) -> FitSettings<'_> {
    FitSettings { shared_mm, ..FitSettings::default() }
}

/// Proves: whatever way the points of a plane err in common, its place and its tilts are off by no more than it states; where they
/// all err alike it states just that, and for tilts no more than 1.2 of the worst way.
#[test]
fn a_plane_states_what_its_points_may_have_in_common() {
    let shared = vec![COMMON_MM as f32; 3000];
    let (mut worst_place, mut worst_tilt) = (0.0_f64, 0.0_f64);
    for (name, way) in TOGETHER {
        let fit = plane(&plane_points(&|x, y| COMMON_MM * way(x, y)), &with(&shared)).unwrap();
        let fit = fit.towards(&Vector3::z());
        let normal = fit.normal_vector();
        let place = -fit.distance_mm(&Point3::origin()) / fit.u_at_mm(&Point3::origin());
        worst_place = worst_place.max(place.abs());
        for (slope, along) in [(normal.x, Vector3::x()), (normal.y, Vector3::y())] {
            worst_tilt = worst_tilt.max(slope.abs() / fit.u_tilt_rad(&along));
        }
        assert!(worst_place < 1.01 && worst_tilt < 1.01, "{name}: {worst_place} {worst_tilt}");
    }
    assert!(worst_place > 0.98 && worst_tilt > 1.0 / 1.2, "{worst_place} {worst_tilt}");
}

/// Proves: errors in common add to those of noise, count as far as points have them, and go with the points that are left out;
/// the element itself does not move.
#[test]
fn what_is_in_common_counts_for_the_points_that_have_it() {
    let points = plane_points(&|_, _| 0.0);
    let at = |shared: &[f32], reject: f64| {
        let fit = plane(&points, &FitSettings { max_reject_fraction: reject, ..with(shared) }).unwrap();
        (fit.u_centroid_mm, fit.offset_mm)
    };
    let (noise, offset) = at(&[], 0.0);
    let third: Vec<f32> = (0..3000).map(|i| if i % 3 == 0 { COMMON_MM as f32 } else { 0.0 }).collect();
    let (u, same) = at(&third, 0.0);
    // What noise may raise is taken off.
    let expected = (noise * noise + (COMMON_MM / 3.0 * 0.85 / 0.95).powi(2)).sqrt();
    assert!((u / expected - 1.0).abs() < 0.01 && same.to_bits() == offset.to_bits(), "{u} {expected}");
    let few: Vec<f32> = (0..3000).map(|i| if i % 25 == 0 { COMMON_MM as f32 } else { 0.0 }).collect();
    assert_eq!(at(&few, 0.0).0.to_bits(), noise.to_bits());
    // The points that are left out are those that stand off most.
    let (without, _) = at(&[], 0.1);
    let all = plane(&points, &FitSettings::default()).unwrap();
    let mut sizes: Vec<f64> = all.residuals.deviation_mm.iter().map(|d| d.abs()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let far = |d: &f64| if d.abs() > sizes[2800] { COMMON_MM as f32 } else { 0.0 };
    let of_far: Vec<f32> = all.residuals.deviation_mm.iter().map(far).collect();
    assert_eq!(at(&of_far, 0.1).0.to_bits(), without.to_bits());
    assert!(at(&of_far, 0.0).0 > 2.0 * noise, "{} {noise}", at(&of_far, 0.0).0);
}

/// Proves: diameter and centre of a sphere's cap are off by no more than they state, whatever way its points err in common.
#[test]
fn a_sphere_states_what_its_points_may_have_in_common() {
    let centre = Point3::new(100.0, -40.0, 500.0);
    let points = cap(&mut Noise(5), 2000);
    let settled = sphere(&points, &FitSettings::default()).unwrap();
    let shared = vec![COMMON_MM as f32; points.len()];
    for (name, way) in TOGETHER {
        let moved: Vec<Point3<f64>> = points
            .iter()
            .map(|point| {
                let out = (point - centre).normalize();
                point + out * (COMMON_MM * way(out.x, out.y))
            })
            .collect();
        let fit = sphere(&moved, &with(&shared)).unwrap();
        let diameter = (fit.diameter_mm - settled.diameter_mm).abs() / fit.u_diameter_mm;
        assert!(diameter < 1.01, "{name}: {diameter}");
        for axis in 0..3 {
            let off = (fit.center_mm[axis] - settled.center_mm[axis]).abs() / fit.u_center_mm[axis];
            assert!(off < 1.01, "{name}: axis {axis}: {off}");
        }
    }
}

/// A plane of a pair with noise of 4 µm.
fn pair_cloud(pair: u32, moved_mm: &dyn Fn(f64, f64) -> f64) -> Vec<Point> {
    let mut noise = Noise(u64::from(pair) + 7);
    let place = |i: usize| [(i % 150) as f64 * 0.3 - 22.5, (i / 150) as f64 * 0.3 - 15.0];
    (0..15_000)
        .map(|i| {
            let [x, y] = place(i);
            Point {
                position_mm: [x, y, moved_mm(x / 22.5, y / 15.0) + 0.004 * noise.normal()],
                normal: [0.0, 0.0, 1.0],
                sigma_mm: 0.004,
                pair,
                ..bytemuck::Zeroable::zeroed()
            }
        })
        .collect()
}

/// Proves: where two pairs disagree by a step or by a wedge, the plane through both states what it is off by, whichever pair is
/// right; where they agree it states its noise.
#[test]
fn a_plane_of_pairs_that_disagree_holds_the_right_one() {
    let ways: [Way; 3] = [("step", |_, _| 0.03), ("wedge", |x, _| 0.03 * x), ("nothing", |_, _| 0.0)];
    for (name, way) in ways {
        let mut fused = Vec::new();
        fuse(&[&pair_cloud(0, &|_, _| 0.0), &pair_cloud(1, &way)], &FusionSettings::default(), &mut fused);
        let points: Vec<Point3<f64>> = fused.iter().map(Point::position).collect();
        let shared: Vec<f32> = fused.iter().map(|point| point.shared_mm).collect();
        let fit = plane(&points, &with(&shared)).unwrap().towards(&Vector3::z());
        let u = [fit.u_at_mm(&Point3::origin()), fit.u_tilt_rad(&Vector3::x())];
        if name == "nothing" {
            assert!(u[0] < 0.0004 && u[1] < 3e-5, "{u:?}");
            continue;
        }
        for right in [0.0, 1.0] {
            let off = [
                (fit.distance_mm(&Point3::origin()) + right * way(0.0, 0.0)) / u[0],
                (fit.normal_vector().x + right * (way(1.0, 0.0) - way(-1.0, 0.0)) / 45.0) / u[1],
            ];
            assert!(off.iter().all(|off| off.abs() < 1.0), "{name}: {off:?}");
        }
    }
}
