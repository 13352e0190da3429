//! How far an element of CAD reaches, from its triangles.

use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use super::shape::across;
use super::{CadMesh, CadShape};
use crate::fit::tangents;
use crate::inspection::{Exclusion, ExclusionShape, Geometry, Sector};
use fringe::math;

/// A gap about an axis that is wider than any facet: there the surface is absent, rad.
const GAP_RAD: f64 = 0.8;

/// Directions that are tried for the sides of a rectangle.
const MOST_DIRECTIONS: usize = 64;

/// The nominal geometry of triangles on a surface; `None` where they enclose nothing that can be measured.
pub(super) fn geometry(shape: &CadShape, internal: bool, part: &[u32], mesh: &CadMesh) -> Option<Geometry> {
    let mut corners: Vec<u32> = part.iter().flat_map(|t| mesh.triangles[*t as usize]).collect();
    corners.sort_unstable();
    corners.dedup();
    let places: Vec<Point3<f64>> = corners.iter().map(|c| mesh.corners[*c as usize]).collect();
    match *shape {
        CadShape::Plane { normal, .. } => {
            plane(&(if internal { -normal } else { normal }), &places, part, mesh)
        }
        CadShape::Cylinder { point_mm, axis, radius_mm } => {
            let [low, high] = span(&places, &point_mm, &axis)?;
            Some(Geometry::Cylinder {
                point_mm: point_mm + axis * (0.5 * (low + high)),
                axis,
                radius_mm,
                half_length_mm: 0.5 * (high - low),
                internal,
                sector: sector(&places, &point_mm, &axis),
            })
        }
        CadShape::Cone { point_mm, axis, radius_mm, half_angle_rad } => {
            let [low, high] = span(&places, &point_mm, &axis)?;
            let middle = 0.5 * (low + high);
            Some(Geometry::Cone {
                point_mm: point_mm + axis * middle,
                axis,
                radius_mm: radius_mm + middle * math::tan(half_angle_rad),
                half_angle_rad,
                half_length_mm: 0.5 * (high - low),
                internal,
            })
        }
        CadShape::Sphere { center_mm, radius_mm } => {
            let arms: Vec<Vector3<f64>> =
                places.iter().map(|p| (p - center_mm) / radius_mm.max(f64::MIN_POSITIVE)).collect();
            let middle: Vector3<f64> = part
                .iter()
                .map(|t| {
                    let [a, b, c] = mesh.triangles[*t as usize].map(|c| mesh.corners[c as usize]);
                    let area = 0.5 * (b - a).cross(&(c - a)).norm();
                    (a.coords + b.coords + c.coords - center_mm.coords * 3.0) * area
                })
                .sum();
            let size: f64 = middle.norm();
            // A whole sphere has no middle; its corners lie all around.
            let axis =
                if size > 1e-6 * radius_mm * radius_mm * radius_mm { middle / size } else { Vector3::z() };
            let lowest = arms.iter().map(|arm| arm.dot(&axis)).fold(1.0, f64::min);
            Some(Geometry::Sphere { center_mm, radius_mm, axis, cos_polar: [lowest.max(-1.0), 1.0] })
        }
        CadShape::Torus { center_mm, axis, ring_radius_mm, tube_radius_mm } => {
            Some(Geometry::Torus { center_mm, axis, ring_radius_mm, tube_radius_mm })
        }
    }
}

/// Where places lie along an axis; `None` where they have no length along it.
fn span(places: &[Point3<f64>], from: &Point3<f64>, axis: &Vector3<f64>) -> Option<[f64; 2]> {
    let along = places.iter().map(|p| (p - from).dot(axis));
    let [low, high] =
        along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], h| [low.min(h), high.max(h)]);
    (high - low > 1e-6).then_some([low, high])
}

/// The part of the circumference that places lie on; `None`: all of it.
fn sector(places: &[Point3<f64>], from: &Point3<f64>, axis: &Vector3<f64>) -> Option<Sector> {
    let [first, second] = tangents(axis);
    let mut angles: Vec<f64> = places
        .iter()
        .map(|p| across(&(p - from), axis))
        .map(|arm| math::atan2(arm.dot(&second), arm.dot(&first)))
        .collect();
    angles.sort_unstable_by(f64::total_cmp);
    let next = |i: usize| if i + 1 < angles.len() { angles[i + 1] } else { angles[0] + TAU };
    let (gap, after) = (0..angles.len())
        .map(|i| (next(i) - angles[i], next(i)))
        .fold((0.0, 0.0), |best: (f64, f64), one| if one.0 > best.0 { one } else { best });
    if gap <= GAP_RAD {
        return None;
    }
    let half = (PI - 0.5 * gap).max(0.0);
    let (sin, cos) = math::sincos(after + half);
    Some(Sector { direction: first * cos + second * sin, cos_half: math::cos(half) })
}

/// Area of a rectangle, its directions and where it begins and ends along them, mm.
type Rectangle = (f64, [Vector3<f64>; 2], [[f64; 2]; 2]);

/// The smallest rectangle about a plane face, with what is cut out of it.
fn plane(normal: &Vector3<f64>, places: &[Point3<f64>], part: &[u32], mesh: &CadMesh) -> Option<Geometry> {
    let loops = border(part, mesh);
    let mut sides: Vec<Vector3<f64>> = loops
        .iter()
        .flat_map(|l| l.iter().zip(l.iter().cycle().skip(1)))
        .map(|(a, b)| mesh.corners[*b as usize] - mesh.corners[*a as usize])
        .collect();
    sides.sort_by(|a, b| b.norm_squared().total_cmp(&a.norm_squared()));
    sides.truncate(MOST_DIRECTIONS);
    sides.push(tangents(normal)[0]);
    let mut best: Option<Rectangle> = None;
    for side in sides {
        let flat = across(&side, normal);
        if flat.norm() <= 1e-9 {
            continue;
        }
        let first = flat / flat.norm();
        let edges = [first, normal.cross(&first)];
        let spans = edges.map(|edge| span(places, &places[0], &edge));
        let [Some(a), Some(b)] = spans else { return None };
        let area = (a[1] - a[0]) * (b[1] - b[0]);
        // Longer sides come first: an equal rectangle keeps the direction of the longest.
        if best.is_none_or(|(least, ..)| area < least * (1.0 - 1e-9)) {
            best = Some((area, edges, [a, b]));
        }
    }
    let (_, edges, [a, b]) = best?;
    let point_mm = places[0] + edges[0] * (0.5 * (a[0] + a[1])) + edges[1] * (0.5 * (b[0] + b[1]));
    let exclusions = loops.iter().filter_map(|l| hole(l, mesh, normal, &point_mm, &edges)).collect();
    Some(Geometry::Plane {
        point_mm,
        normal: *normal,
        edges,
        half_size_mm: [0.5 * (a[1] - a[0]), 0.5 * (b[1] - b[0])],
        exclusions,
    })
}

/// Closed lines at which triangles end; the surface lies to their left when seen from outside.
fn border(part: &[u32], mesh: &CadMesh) -> Vec<Vec<u32>> {
    let mut open: BTreeSet<(u32, u32)> = BTreeSet::new();
    for triangle in part {
        let [a, b, c] = mesh.triangles[*triangle as usize];
        for (from, to) in [(a, b), (b, c), (c, a)] {
            if !open.remove(&(to, from)) {
                open.insert((from, to));
            }
        }
    }
    let mut loops = Vec::new();
    while let Some((start, mut at)) = open.pop_first() {
        let mut line = vec![start];
        while at != start {
            line.push(at);
            let Some(&edge) = open.range((at, 0)..=(at, u32::MAX)).next() else { break };
            open.remove(&edge);
            at = edge.1;
        }
        loops.push(line);
    }
    loops
}

/// What a hole in a face cuts out: the smaller one of a disc and a rectangle about it. `None` for the outer border.
fn hole(
    line: &[u32],
    mesh: &CadMesh,
    normal: &Vector3<f64>,
    point: &Point3<f64>,
    edges: &[Vector3<f64>; 2],
) -> Option<Exclusion> {
    let places: Vec<[f64; 2]> = line
        .iter()
        .map(|c| {
            let arm = mesh.corners[*c as usize] - point;
            edges.map(|edge| arm.dot(&edge))
        })
        .collect();
    debug_assert!(edges[0].cross(&edges[1]).dot(normal) > 0.0);
    let turned: f64 = places
        .iter()
        .zip(places.iter().cycle().skip(1))
        .map(|(a, b)| 0.5 * (a[0] * b[1] - a[1] * b[0]))
        .sum();
    if turned >= 0.0 {
        return None;
    }
    let [low, high] = places.iter().fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[l, h], p| {
        [[l[0].min(p[0]), l[1].min(p[1])], [h[0].max(p[0]), h[1].max(p[1])]]
    });
    let center_mm = [0, 1].map(|i| 0.5 * (low[i] + high[i]));
    let half = [0, 1].map(|i| 0.5 * (high[i] - low[i]));
    let square = |p: &[f64; 2]| {
        let [x, y] = [p[0] - center_mm[0], p[1] - center_mm[1]];
        x * x + y * y
    };
    let radius = places.iter().map(square).fold(0.0, f64::max).sqrt();
    let disc = PI * radius * radius <= 4.0 * half[0] * half[1];
    let shape = if disc { ExclusionShape::Disc(radius) } else { ExclusionShape::Rectangle(half) };
    Some(Exclusion { center_mm, shape })
}
