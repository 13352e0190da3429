//! Against blurred phases of a sphere, by rays, roots and triangulation; no derivative is taken there.

use super::*;
use fringe::geometry::camera::{Lens, Ray, pose};
use fringe::geometry::rig::Named;
use fringe::geometry::triangulate::midpoint;
use fringe::math::{atan2, sincos};

const RADIUS_MM: f64 = 10.0;
/// Variance of the footprint, px².
const BLUR_PX2: f64 = 0.05;
const SIDE: u32 = 150;
const FOCAL_PX: f64 = 2500.0;

/// A view from a place towards the middle of the sphere.
fn view(centre: [f64; 3]) -> Camera {
    let centre = Vector3::from(centre);
    let z = -centre.normalize();
    let x = Vector3::y().cross(&z).normalize();
    let y = z.cross(&x);
    let rotation = [x, y, z].map(Into::into);
    let to = [x, y, z].map(|axis: Vector3<f64>| -axis.dot(&centre));
    Camera {
        width_px: SIDE,
        height_px: SIDE,
        focal_px: [FOCAL_PX; 2],
        principal_point_px: [0.5 * f64::from(SIDE); 2],
        skew: 0.0,
        distortion: Lens::default(),
        camera_from_world: pose(rotation, to).unwrap(),
    }
}

fn rig(projector: bool) -> Rig {
    let named = |name: &str, centre: [f64; 3]| Named { name: name.into(), camera: view(centre) };
    let pair = Pair {
        name: "pair".into(),
        left: "left".into(),
        right: "right".into(),
        projector: "projector".into(),
    };
    Rig {
        cameras: vec![named("left", [-100.0, 10.0, -480.0]), named("right", [120.0, -5.0, -490.0])],
        projectors: projector.then(|| named("projector", [15.0, 60.0, -500.0])).into_iter().collect(),
        pairs: vec![pair],
        ..Rig::default()
    }
}

/// Where a ray meets the sphere first.
fn met(ray: &Ray) -> Option<Point3<f64>> {
    let (from, along) = (ray.origin_mm.coords, ray.direction);
    let half = from.dot(&along);
    let root = half * half - from.norm_squared() + RADIUS_MM * RADIUS_MM;
    (root > 0.0).then(|| ray.origin_mm + along * (-half - root.sqrt()))
}

/// Phase of a place and its brightness, by a projector.
fn light(projector: &Camera, place: &Point3<f64>) -> (f64, f64) {
    let phase = std::f64::consts::TAU / 16.0 * projector.project(place).unwrap().x;
    let to_light = (projector.centre_mm() - place).normalize();
    (phase, 100.0 * (place.coords / RADIUS_MM).dot(&to_light).max(0.0))
}

/// What blur adds to the phase of a place in a picture, rad: nine rays with the weights of a Gaussian.
fn added(camera: &Camera, projector: &Camera, place: &Point3<f64>) -> f64 {
    let (pixel, own) = (camera.project(place).unwrap(), light(projector, place).0);
    let reach = (3.0 * BLUR_PX2).sqrt();
    let nodes = [(-reach, 1.0 / 6.0), (0.0, 2.0 / 3.0), (reach, 1.0 / 6.0)];
    let (mut real, mut imaginary) = (0.0, 0.0);
    for (u, at_u) in nodes {
        for (v, at_v) in nodes {
            let ray = camera.ray(pixel + nalgebra::Vector2::new(u, v)).unwrap();
            let (phase, brightness) = light(projector, &met(&ray).unwrap());
            let (sin, cos) = sincos(phase - own);
            real += at_u * at_v * brightness * cos;
            imaginary += at_u * at_v * brightness * sin;
        }
    }
    atan2(imaginary, real)
}

/// How far a point moves along its normal by the blur of one of the views, mm.
fn moved_by_blur(rig: &Rig, projector: &Camera, place: &Point3<f64>, left_blurs: bool) -> f64 {
    let [left, right] = ["left", "right"].map(|name| rig.camera(name).unwrap());
    let plane = (place - left.centre_mm()).cross(&(place - right.centre_mm())).normalize();
    let middle = Point3::from(plane * plane.dot(&place.coords));
    let out = place - middle;
    let beside = plane.cross(&out);
    // The surface in the epipolar plane is a circle.
    let at = |angle: f64| {
        let (sin, cos) = sincos(angle);
        middle + out * cos + beside * sin
    };
    let own = light(projector, place).0;
    let wanted = if left_blurs { own + added(left, projector, place) } else { own };
    let off = |angle: f64| {
        let here = at(angle);
        let blur = if left_blurs { 0.0 } else { added(right, projector, &here) };
        light(projector, &here).0 + blur - wanted
    };
    let (mut low, mut high) = (-0.02, 0.02);
    assert!(off(low) * off(high) < 0.0, "the phase changes along the surface");
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if off(low) * off(middle) <= 0.0 { high = middle } else { low = middle }
    }
    let there = at(0.5 * (low + high));
    let towards = |camera: &Camera, place: &Point3<f64>| camera.ray(camera.project(place).unwrap()).unwrap();
    let found = midpoint(&towards(left, place), &towards(right, &there)).unwrap();
    (found - place).dot(&(place.coords / RADIUS_MM))
}

/// The sphere in the left picture.
fn points(rig: &Rig, projector: &Camera) -> Vec<Point> {
    let left = rig.camera("left").unwrap();
    let mut points = Vec::new();
    for pixel in 0..SIDE * SIDE {
        let at = Point2::new(f64::from(pixel % SIDE), f64::from(pixel / SIDE));
        let Some(place) = met(&left.ray(at).unwrap()) else { continue };
        points.push(Point {
            position_mm: place.into(),
            normal: (place.coords / RADIUS_MM).map(|part| part as f32).into(),
            sigma_mm: 0.01,
            modulation: light(projector, &place).1 as f32,
            pair: 0,
            pixel,
            shared_mm: 0.0,
        });
    }
    points
}

/// Points that all views see at less than 50°, some of them.
fn frontal(rig: &Rig, points: &[Point]) -> Vec<usize> {
    let seen = |camera: &Camera, point: &Point| {
        (camera.centre_mm() - point.position()).normalize().dot(&point.normal_vector()) > 0.64
    };
    let all = |i: &usize| ["left", "right"].iter().all(|name| seen(rig.camera(name).unwrap(), &points[*i]));
    (0..points.len()).step_by(31).filter(all).collect()
}

#[test]
fn what_blur_does_to_a_sphere_is_predicted_for_either_camera() {
    let rig = rig(true);
    let projector = rig.projector("projector").unwrap();
    let points = points(&rig, projector);
    for (name, left_blurs) in [("left", true), ("right", false)] {
        let effect = FootprintEffect::of(&rig, name, &points).along_mm;
        let (mut squares, mut off) = (0.0, 0.0);
        let chosen = frontal(&rig, &points);
        assert!(chosen.len() > 30);
        for i in chosen {
            let wanted = moved_by_blur(&rig, projector, &points[i].position(), left_blurs) / BLUR_PX2;
            squares += wanted * wanted;
            off += (effect[i] - wanted).powi(2);
        }
        assert!(off < 0.05_f64.powi(2) * squares, "{name}: {} of 1", (off / squares).sqrt());
    }
}

/// The same error of both cameras moves the front inwards by p² / R.
#[test]
fn both_cameras_together_move_the_front_of_a_sphere_by_its_curvature() {
    for projector in [true, false] {
        let rig = rig(projector);
        let points = points(&rig, &view([15.0, 60.0, -500.0]));
        let [left, right] = ["left", "right"].map(|name| FootprintEffect::of(&rig, name, &points).along_mm);
        let front = frontal(&rig, &points).into_iter().filter(|i| points[*i].normal[2] < -0.98);
        for i in front {
            let pixel_mm = (points[i].position_mm[2] + 485.0) / FOCAL_PX;
            let both = (left[i] + right[i]) / (pixel_mm * pixel_mm / RADIUS_MM);
            assert!((both + 1.0).abs() < 0.25, "{both} at {:?}", points[i].position_mm);
        }
    }
}

#[test]
fn planes_sparse_clouds_and_strange_points_stay() {
    let rig = rig(true);
    let projector = rig.projector("projector").unwrap();
    let sphere = points(&rig, projector);
    let sparse: Vec<Point> = sphere.iter().step_by(53).copied().collect();
    assert_eq!(FootprintEffect::of(&rig, "left", &sparse).moved(&sparse, 0.1), sparse);
    assert_eq!(FootprintEffect::of(&rig, "nobody", &sphere).moved(&sphere, 0.1), sphere);
    let without: Vec<Point> = sphere.iter().map(|point| Point { normal: [0.0; 3], ..*point }).collect();
    assert_eq!(FootprintEffect::of(&rig, "left", &without).moved(&without, 0.1), without);
    let other: Vec<Point> = sphere.iter().map(|point| Point { pair: 7, ..*point }).collect();
    assert_eq!(FootprintEffect::of(&rig, "left", &other).moved(&other, 0.1), other);
    // Without a modulation curvature alone counts; other strange values are no fault.
    let dark: Vec<Point> = sphere.iter().map(|point| Point { modulation: 0.0, ..*point }).collect();
    let effect = FootprintEffect::of(&rig, "left", &dark).along_mm;
    assert!(effect.iter().filter(|along_mm| **along_mm != 0.0).count() > dark.len() / 2);
    for strange in [f32::NAN, f32::INFINITY, -1.0, f32::MAX] {
        let points: Vec<Point> = sphere
            .iter()
            .zip(0..)
            .map(|(point, i)| if i % 7 == 0 { Point { modulation: strange, ..*point } } else { *point })
            .collect();
        let effect = FootprintEffect::of(&rig, "right", &points).along_mm;
        assert!(effect.iter().all(|along_mm| along_mm.is_finite()), "{strange}");
    }
    let far: Vec<Point> =
        sphere.iter().map(|point| Point { position_mm: [f64::NAN, 1e300, -1e300], ..*point }).collect();
    let effect = FootprintEffect::of(&rig, "left", &far).along_mm;
    assert!(effect.iter().all(|along_mm| *along_mm == 0.0));
    // Two rows of points do not determine a curvature across them.
    let rows: Vec<Point> =
        sphere.iter().filter(|point| (70..72).contains(&(point.pixel / SIDE))).copied().collect();
    let strip = FootprintEffect::of(&rig, "left", &rows);
    assert!(rows.len() > 100 && strip.judged() < 0.01, "{}", strip.judged());
    assert!(FootprintEffect::of(&rig, "left", &sphere).judged() > 0.9);
    // A plane in even light.
    let left = rig.camera("left").unwrap();
    let flat = sphere.iter().map(|point| {
        let ray = left.ray(left.project(&point.position()).unwrap()).unwrap();
        let place = ray.origin_mm - ray.direction * (ray.origin_mm.z / ray.direction.z);
        Point { position_mm: place.into(), normal: [0.0, 0.0, -1.0], modulation: 80.0, ..*point }
    });
    let flat: Vec<Point> = flat.collect();
    let effect = FootprintEffect::of(&rig, "right", &flat).along_mm;
    // Perspective alone is left, some nanometres.
    assert!(effect.iter().all(|along_mm| along_mm.abs() < 1e-4), "{effect:?}");
}
