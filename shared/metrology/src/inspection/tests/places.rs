//! Plans placed on clouds of a prismatic part and of the artefact.

use crate::inspection::{PlaceError, Plan, place};
use crate::register::InitialPose;
use crate::spatial::TriangleMesh;
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;
use fringe::synthetic::Noise;
use nalgebra::{Isometry3, Point3, Vector3};

/// The bracket of the documentation: its plan, and its faces as the file has them.
const PLAN: &str = include_str!("../../../../../configs/bracket/bracket.plan.toml");
const STL: &str = include_str!("../../../../../configs/bracket/bracket.stl");

fn triangles() -> Vec<[Point3<f64>; 3]> {
    let numbers = STL.lines().filter_map(|line| line.trim().strip_prefix("vertex "));
    let corners: Vec<Point3<f64>> = numbers
        .map(|line| {
            let values: Vec<f64> = line.split_whitespace().map(|v| v.parse().unwrap()).collect();
            Point3::new(values[0], values[1], values[2])
        })
        .collect();
    corners.chunks(3).map(|c| [c[0], c[1], c[2]]).collect()
}

/// What a camera above sees of the bracket, in the world frame.
fn seen(world_from_part: &Pose, triangles: &[[Point3<f64>; 3]]) -> Vec<Point> {
    let mut noise = Noise(4);
    let mut points = Vec::new();
    for [a, b, c] in triangles {
        let cross = (b - a).cross(&(c - a));
        let normal = cross.normalize();
        if normal.z < 0.2 {
            continue;
        }
        for _ in 0..(3.0 * cross.norm()) as usize {
            let (u, v) = (noise.unit(), noise.unit());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let place = a + (b - a) * u + (c - a) * v + normal * (0.02 * noise.gauss());
            points.push(Point {
                position_mm: world_from_part.point(&place.coords).into(),
                normal: (world_from_part.rotation * normal).map(|v| v as f32).into(),
                ..bytemuck::Zeroable::zeroed()
            });
        }
    }
    points
}

fn lies() -> Pose {
    Pose::new(&Isometry3::new(Vector3::new(30.0, -12.0, 610.0), Vector3::new(1.9, -1.6, 0.4)))
}

/// Largest displacement of the part's corners against where it lies.
fn off_mm(found: &Isometry3<f64>) -> f64 {
    let rest = lies().inverse().after(&Pose::new(found));
    triangles().iter().flatten().map(|p| (rest.point(&p.coords) - p.coords).norm()).fold(0.0, f64::max)
}

#[test]
fn a_prismatic_part_is_placed_by_its_planes_and_by_its_cad() {
    let (plan, cloud) = (Plan::from_toml(PLAN).unwrap(), seen(&lies(), &triangles()));
    for cad in [None, Some(TriangleMesh::new(&triangles()).unwrap())] {
        let found = place(&plan, &cloud, cad, &InitialPose::Search).unwrap();
        let off = off_mm(&found.world_from_part);
        assert!(off < 0.05, "{off}");
        assert!(found.inspection.elements.iter().all(|e| e.fit.is_some()));
    }
}

#[test]
fn what_leaves_a_choice_or_does_not_fit_is_refused() {
    let cloud = seen(&lies(), &triangles());
    // Two parallel planes fix neither turn nor shift.
    let two: String = PLAN.split("[[element]]").take(3).collect::<Vec<_>>().join("[[element]]");
    let feature = PLAN.find("[[feature]]").unwrap();
    let second = PLAN[feature + 1..].find("[[feature]]").unwrap() + feature + 1;
    let two = Plan::from_toml(&format!("{two}{}", &PLAN[feature..second])).unwrap();
    let error = place(&two, &cloud, None, &InitialPose::Search).unwrap_err();
    assert!(matches!(error, PlaceError::Open { .. } | PlaceError::Ambiguous { .. }), "{error}");
    // Another part: the block is 3 mm higher.
    let higher = |p: Point3<f64>| if p.z > 1.0 { p + Vector3::z() * 3.0 } else { p };
    let other: Vec<[Point3<f64>; 3]> = triangles().iter().map(|t| t.map(higher)).collect();
    let plan = Plan::from_toml(PLAN).unwrap();
    for cad in [None, Some(TriangleMesh::new(&triangles()).unwrap())] {
        let error = place(&plan, &seen(&lies(), &other), cad, &InitialPose::Search).unwrap_err();
        // For which reason depends on where the fit of a part that cannot fit comes to rest, if it does.
        assert!(!matches!(error, PlaceError::Cloud(_)), "{error}");
    }
}
