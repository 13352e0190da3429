//! Minimum zones beside brute force, and where there is none.

use nalgebra::{Matrix5, Point3, Vector3, Vector5};

use super::Noise;
use crate::fit::*;

/// Range of the points along a direction.
fn width(points: &[Point3<f64>], normal: &Vector3<f64>) -> f64 {
    let heights = points.iter().map(|p| p.coords.dot(normal));
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    high - low
}

/// The narrowest slab: its two planes touch three points and one, or two and two, so its normal is across two
/// differences of points.
fn narrowest_slab(points: &[Point3<f64>]) -> f64 {
    let mut arms = Vec::new();
    for (i, a) in points.iter().enumerate() {
        arms.extend(points[i + 1..].iter().map(|b| b - a));
    }
    let mut least = f64::INFINITY;
    for (i, a) in arms.iter().enumerate() {
        for b in &arms[i + 1..] {
            let normal = a.cross(b);
            if normal.norm() > 1e-9 {
                least = least.min(width(points, &(normal / normal.norm())));
            }
        }
    }
    least
}

/// The narrowest shell: five points at R ± h. |p|² = 2 c·p + k ± 2q with k = R² + h² − |c|² and q = R h is linear for
/// given signs.
fn narrowest_shell(points: &[Point3<f64>]) -> f64 {
    let shell = |center: &Vector3<f64>| {
        let radii = points.iter().map(|p| (p.coords - center).norm());
        let (low, high) = radii.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        high - low
    };
    let mut least = f64::INFINITY;
    let n = points.len();
    for mask in (0u32..1 << n).filter(|mask| mask.count_ones() == 5) {
        let chosen: Vec<&Point3<f64>> = (0..n).filter(|i| mask >> i & 1 == 1).map(|i| &points[i]).collect();
        for signs in 0..16 {
            let row = |i: usize, j: usize| match j {
                0..3 => 2.0 * chosen[i][j],
                3 => 1.0,
                _ => {
                    if signs >> i & 1 == 1 {
                        -2.0
                    } else {
                        2.0
                    }
                }
            };
            let matrix = Matrix5::from_fn(row);
            let squares = Vector5::from_fn(|i, _| chosen[i].coords.norm_squared());
            if let Some(solution) = matrix.lu().solve(&squares) {
                let center = Vector3::new(solution[0], solution[1], solution[2]);
                // Far centres are slabs in disguise.
                if center.norm() < 20.0 {
                    least = least.min(shell(&center));
                }
            }
        }
    }
    least
}

#[test]
fn the_plane_zone_is_the_narrowest_slab() {
    for seed in 0..150 {
        let mut noise = Noise(seed);
        let points: Vec<Point3<f64>> = (0..12)
            .map(|_| Point3::new(50.0 * noise.uniform(), 40.0 * noise.uniform(), 0.3 * noise.uniform()))
            .collect();
        let zone = plane_minimum_zone(&points).unwrap();
        let expected = narrowest_slab(&points);
        assert!((zone.minimum_zone_mm - expected).abs() < 1e-10, "{seed}: {zone:?}, brute force {expected}");
        assert!((width(&points, &Vector3::from(zone.normal)) - expected).abs() < 1e-10);
        let range = plane(&points, &FitSettings::default()).unwrap().form.form_range_mm;
        assert!(zone.minimum_zone_mm <= range + 1e-12);
    }
}

#[test]
fn the_sphere_zone_is_the_narrowest_shell() {
    for seed in 0..40 {
        let mut noise = Noise(seed);
        let points: Vec<Point3<f64>> =
            (0..10).map(|_| Point3::from(noise.direction() * (10.0 + 0.1 * noise.uniform()))).collect();
        let zone = sphere_minimum_zone(&points).unwrap();
        let expected = narrowest_shell(&points);
        assert!((zone.minimum_zone_mm - expected).abs() < 1e-9, "{seed}: {zone:?}, brute force {expected}");
    }
}

/// On many points: no motion of the cylinder's axis or the circle's centre makes the zone narrower.
#[test]
fn zones_of_circle_and_cylinder_stand_at_a_minimum() {
    let mut noise = Noise(3);
    let mut points = Vec::new();
    for _ in 0..2000 {
        let (sin, cos) = fringe::math::sincos(6.3 * noise.uniform());
        let radius = 8.0 + 0.01 * noise.normal();
        points.push(Point3::new(radius * cos, radius * sin, 300.0 + 20.0 * noise.uniform()));
    }
    let zone = cylinder_minimum_zone(&points).unwrap();
    let span = |center: Vector3<f64>, axis: Vector3<f64>| {
        let axis = axis / axis.norm();
        let radii = points.iter().map(|p| (p.coords - center).cross(&axis).norm());
        let (low, high) = radii.fold((f64::INFINITY, 0.0), |(l, h): (f64, f64), v| (l.min(v), h.max(v)));
        high - low
    };
    let (center, axis) = (Vector3::from(zone.axis_point_mm), Vector3::from(zone.axis_direction));
    assert!((span(center, axis) - zone.minimum_zone_mm).abs() < 1e-9);
    for _ in 0..100 {
        let (shift, tilt) = (noise.direction() * 1e-3, noise.direction() * 1e-4);
        assert!(span(center + shift, axis) > zone.minimum_zone_mm - 1e-12);
        assert!(span(center, axis + tilt) > zone.minimum_zone_mm - 1e-12);
    }
    let ring: Vec<Point3<f64>> = points.iter().map(|p| Point3::new(p.x, p.y, 300.0)).collect();
    let zone = circle_minimum_zone(&ring).unwrap();
    let span = |x: f64, y: f64| {
        let radii = ring.iter().map(|p| ((p.x - x).powi(2) + (p.y - y).powi(2)).sqrt());
        let (low, high) = radii.fold((f64::INFINITY, 0.0), |(l, h): (f64, f64), v| (l.min(v), h.max(v)));
        high - low
    };
    let [x, y, _] = zone.center_mm;
    assert!((span(x, y) - zone.minimum_zone_mm).abs() < 1e-9);
    assert!((0..100).all(|_| {
        let step = noise.direction() * 1e-3;
        span(x + step.x, y + step.y) > zone.minimum_zone_mm - 1e-12
    }));
}

#[test]
fn zones_of_nothing_are_refused() {
    let line: Vec<Point3<f64>> = (0..20).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
    let flat: Vec<Point3<f64>> =
        (0..20).map(|i| Point3::new(f64::from(i % 5), f64::from(i / 5), 0.0)).collect();
    assert!(plane_minimum_zone(&line).unwrap_err().to_string().contains("on one line"));
    assert!(plane_minimum_zone(&line[..3]).unwrap_err().to_string().contains("needs at least 4"));
    assert!(sphere_minimum_zone(&flat).unwrap_err().to_string().contains("in one plane"));
    assert!(sphere_minimum_zone(&flat[..4]).unwrap_err().to_string().contains("needs at least 5"));
    // Points exactly on the element: a zone of no width.
    assert!(plane_minimum_zone(&flat).unwrap().minimum_zone_mm < 1e-12);
}
