//! Touching elements beside brute force and beside every small motion.

use nalgebra::{Point3, Vector3};

use super::Noise;
use crate::fit::*;

fn ring(seed: u64, count: usize) -> Vec<Point3<f64>> {
    let mut noise = Noise(seed);
    (0..count)
        .map(|_| {
            let (sin, cos) = fringe::math::sincos(std::f64::consts::TAU * noise.uniform());
            let radius = 8.0 + 0.05 * noise.normal();
            Point3::new(40.0 + radius * cos, radius * sin, 0.0)
        })
        .collect()
}

/// Circles through two and three points: the smallest that holds all, the largest empty one about the centre.
fn brute(points: &[Point3<f64>]) -> (f64, f64) {
    let mut centres = Vec::new();
    for (i, a) in points.iter().enumerate() {
        for (j, b) in points.iter().enumerate().skip(i + 1) {
            centres.push(nalgebra::center(a, b));
            for c in &points[j + 1..] {
                let (u, v) = (b - a, c - a);
                let cross = 2.0 * (u.x * v.y - u.y * v.x);
                if cross.abs() > 1e-9 {
                    let (uu, vv) = (u.norm_squared(), v.norm_squared());
                    let off = Vector3::new((v.y * uu - u.y * vv) / cross, (u.x * vv - v.x * uu) / cross, 0.0);
                    centres.push(a + off);
                }
            }
        }
    }
    let far = |c: &Point3<f64>| points.iter().map(|p| (p - c).norm()).fold(0.0, f64::max);
    let near = |c: &Point3<f64>| points.iter().map(|p| (p - c).norm()).fold(f64::INFINITY, f64::min);
    let outer = centres.iter().map(&far).fold(f64::INFINITY, f64::min);
    let middle = Point3::new(40.0, 0.0, 0.0);
    let inner = centres.iter().filter(|c| (*c - middle).norm() < 2.0).map(near).fold(0.0, f64::max);
    (2.0 * inner, 2.0 * outer)
}

#[test]
fn touching_circles_are_those_of_brute_force() {
    for seed in 0..60 {
        let points = ring(seed, 24);
        let (inner, outer) = brute(&points);
        let found = touching_circle(&points, Side::Circumscribed).unwrap().diameter_mm;
        assert!((found - outer).abs() < 1e-9, "{seed}: circumscribed {found} for {outer}");
        let found = touching_circle(&points, Side::Inscribed).unwrap().diameter_mm;
        assert!((found - inner).abs() < 1e-9, "{seed}: inscribed {found} for {inner}");
        let zone = touching_circle(&points, Side::MinimumZone).unwrap();
        let direct = circle_minimum_zone(&points).unwrap();
        assert!((zone.diameter_mm - direct.diameter_mm).abs() < 1e-12);
    }
}

/// No small motion of axis or centre makes an inscribed element larger or a circumscribed one smaller.
#[test]
fn touching_cylinders_and_spheres_stand_at_their_optimum() {
    let mut noise = Noise(9);
    let mut tube = Vec::new();
    let mut ball = Vec::new();
    for _ in 0..1500 {
        let (sin, cos) = fringe::math::sincos(std::f64::consts::TAU * noise.uniform());
        let radius = 5.0 + 0.01 * noise.normal();
        tube.push(Point3::new(radius * cos, 30.0 * noise.uniform(), 100.0 + radius * sin));
        let out = noise.direction();
        ball.push(Point3::from(Vector3::new(7.0, -3.0, 50.0) + out * (4.0 + 0.01 * noise.normal())));
    }
    for (side, sign) in [(Side::Inscribed, -1.0), (Side::Circumscribed, 1.0)] {
        let level =
            |distances: &mut dyn Iterator<Item = f64>| distances.map(|d| sign * d).fold(f64::MIN, f64::max);
        let cylinder = touching_cylinder(&tube, side).unwrap();
        let (point, axis) = (Point3::from(cylinder.point_mm), Vector3::from(cylinder.direction));
        let of = |p: Point3<f64>, d: Vector3<f64>| {
            level(&mut tube.iter().map(|q| (q - p).cross(&d).norm() / d.norm()))
        };
        let here = of(point, axis);
        assert!((sign * here - 0.5 * cylinder.diameter_mm).abs() < 1e-10);
        let sphere = touching_sphere(&ball, side).unwrap();
        let center = Point3::from(sphere.point_mm);
        let about = |c: Point3<f64>| level(&mut ball.iter().map(|q| (q - c).norm()));
        let there = about(center);
        assert!((sign * there - 0.5 * sphere.diameter_mm).abs() < 1e-10);
        for _ in 0..200 {
            let (shift, tilt) = (noise.direction() * 1e-4, noise.direction() * 1e-5);
            assert!(of(point + shift, axis + tilt) > here - 1e-12);
            assert!(about(center + shift) > there - 1e-12);
        }
    }
}

#[test]
fn what_touches_nothing_is_refused() {
    let line: Vec<Point3<f64>> = (0..20).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
    assert!(touching_circle(&line, Side::Inscribed).is_err());
    assert!(
        touching_circle(&line[..3], Side::Circumscribed)
            .unwrap_err()
            .to_string()
            .contains("needs at least 4")
    );
    // A cap does not surround a sphere: the largest one inside of it has no end.
    let mut noise = Noise(4);
    let cap: Vec<Point3<f64>> = (0..300)
        .map(|_| noise.direction())
        .map(|d| Point3::from(Vector3::new(d.x, d.y, 0.3 + d.z.abs()).normalize() * 4.0))
        .collect();
    let error = touching_sphere(&cap, Side::Inscribed).unwrap_err().to_string();
    assert!(error.contains("do not surround it"), "{error}");
    assert!(touching_sphere(&cap, Side::Circumscribed).is_ok());
    assert!(touching_sphere(&line, Side::MinimumZone).is_err());
    assert!(touching_cylinder(&line, Side::Circumscribed).is_err());
}
