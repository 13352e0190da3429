//! Every element and criterion beside solutions of 50 digits, made by other algorithms: `benches/reference_fits.py`.

use nalgebra::{Point3, Vector3};
use serde_json::Value;
use std::collections::BTreeMap;

use crate::fit::*;

/// What a fit and its reference are compared by: point, direction, sizes; a plane and an axis by any point on them.
#[derive(Default)]
struct Found {
    point: Vector3<f64>,
    direction: Vector3<f64>,
    sizes: Vec<f64>,
    /// Width of the zone or range of the residuals.
    width: Option<f64>,
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().map_or(Vec::new(), |list| list.iter().map(|v| v.as_f64().unwrap()).collect())
}

fn vector(value: &Value) -> Vector3<f64> {
    let list = numbers(value);
    Vector3::from_fn(|i, _| list.get(i).copied().unwrap_or(0.0))
}

fn touching(found: &Touching, width: Option<f64>) -> Found {
    let sizes = if found.diameter_mm > 0.0 { vec![found.diameter_mm] } else { Vec::new() };
    Found { point: found.point_mm.into(), direction: found.direction.into(), sizes, width }
}

/// The fit of the crate; `reference` gives the place at which a cone's diameter is meant.
fn fitted(element: &str, criterion: &str, points: &[Point3<f64>], reference: &Vector3<f64>) -> Found {
    let settings = FitSettings::default();
    match (element, criterion) {
        ("sphere", "least-squares") => {
            let fit = sphere(points, &settings).unwrap();
            let width = Some(fit.form.form_range_mm);
            Found { point: fit.center().coords, sizes: vec![fit.diameter_mm], width, ..Found::default() }
        }
        ("plane", "least-squares") => {
            let fit = plane(points, &settings).unwrap();
            let (point, direction) = (Vector3::from(fit.centroid_mm), fit.normal_vector());
            Found { point, direction, width: Some(fit.form.form_range_mm), ..Found::default() }
        }
        ("plane", _) => {
            let fit = plane_minimum_zone(points).unwrap();
            let direction = Vector3::from(fit.normal);
            let point = direction * fit.offset_mm;
            Found { point, direction, width: Some(fit.minimum_zone_mm), ..Found::default() }
        }
        ("cylinder", "least-squares") => {
            let fit = cylinder(points, &settings).unwrap();
            let (point, direction) = (fit.axis_point_mm.into(), fit.axis_direction.into());
            Found { point, direction, sizes: vec![fit.diameter_mm], width: Some(fit.form.form_range_mm) }
        }
        ("cone", _) => {
            let fit = cone(points, &settings).unwrap();
            let (point, direction) = (Vector3::from(fit.axis_point_mm), Vector3::from(fit.axis_direction));
            let slope = fringe::math::tan(fit.half_angle_deg.to_radians());
            let diameter = fit.diameter_mm + 2.0 * slope * (reference - point).dot(&direction);
            let width = Some(fit.form.form_range_mm);
            Found { point, direction, sizes: vec![diameter, fit.half_angle_deg], width }
        }
        ("torus", _) => {
            let fit = torus(points, &settings).unwrap();
            let sizes = vec![fit.ring_diameter_mm, fit.tube_diameter_mm];
            let (point, direction) = (fit.center_mm.into(), fit.axis_direction.into());
            Found { point, direction, sizes, width: Some(fit.form.form_range_mm) }
        }
        ("circle", "least-squares") => {
            let fit = circle(points, &settings).unwrap();
            let (point, direction) = (fit.center_mm.into(), fit.normal.into());
            Found { point, direction, sizes: vec![fit.diameter_mm], width: None }
        }
        ("line", _) => {
            let fit = line(points, &settings).unwrap();
            let (point, direction) = (fit.axis_point_mm.into(), fit.axis_direction.into());
            Found { point, direction, ..Found::default() }
        }
        _ => fitted_outside(element, criterion, points),
    }
}

/// The fits that touch points, of the crate.
fn fitted_outside(element: &str, criterion: &str, points: &[Point3<f64>]) -> Found {
    let side = match criterion {
        "maximum-inscribed" => Side::Inscribed,
        "minimum-circumscribed" => Side::Circumscribed,
        _ => Side::MinimumZone,
    };
    let zone = criterion == "minimum-zone";
    match element {
        "sphere" => {
            let width = zone.then(|| sphere_minimum_zone(points).unwrap().minimum_zone_mm);
            touching(&touching_sphere(points, side).unwrap(), width)
        }
        "cylinder" => {
            let width = zone.then(|| cylinder_minimum_zone(points).unwrap().minimum_zone_mm);
            touching(&touching_cylinder(points, side).unwrap(), width)
        }
        "circle" => {
            let width = zone.then(|| circle_minimum_zone(points).unwrap().minimum_zone_mm);
            touching(&touching_circle(points, side).unwrap(), width)
        }
        other => panic!("the reference holds an unknown set {other:?}"),
    }
}

/// An outline in the plane z = 0.
fn outlined(element: &str, points: &[[f64; 2]], near: &[f64]) -> Found {
    let outline = match element {
        "outline-circle" => Outline::Circle(near[3]),
        "slot" => Outline::Slot([near[3], near[4]]),
        "rectangle" => Outline::Rectangle([near[3], near[4]]),
        "edge" => Outline::Edge(near[3]),
        other => panic!("the reference holds an unknown outline {other:?}"),
    };
    // Off by what a plan's nominal place may be.
    let near = Placed { outline, center: [near[0] + 0.05, near[1] - 0.03], turn_rad: near[2] + 0.002 };
    let sheet = Sheet { origin: Vector3::zeros(), edges: [Vector3::x(), Vector3::y()] };
    let fit = contour(points, &near, &sheet, None, &FitSettings::default()).unwrap();
    let width = (element == "edge").then(|| strip_minimum_zone_mm(points).unwrap());
    let direction = if element == "outline-circle" { Vector3::zeros() } else { fit.direction.into() };
    let sizes = fit.size_mm.into_iter().filter(|size| *size > 0.0).collect();
    Found { point: fit.center_mm.into(), direction, sizes, width }
}

/// Differences of place, direction, sizes and width, mm; directions in mm over 1 mm, angles in degrees.
fn differences(element: &str, found: &Found, reference: &Value) -> [f64; 4] {
    let (point, mut direction) = (vector(&reference["point"]), vector(&reference["direction"]));
    if let Some(turn) = reference["turn"].as_f64() {
        let (sin, cos) = fringe::math::sincos(turn);
        direction = Vector3::new(cos, sin, 0.0);
    }
    let arm = found.point - point;
    let place = match element {
        "plane" => arm.dot(&found.direction).abs(),
        "cylinder" | "cone" | "line" | "edge" => arm.cross(&found.direction).norm(),
        _ => arm.norm(),
    };
    let turned = if direction == Vector3::zeros() { 0.0 } else { found.direction.cross(&direction).norm() };
    let sizes = numbers(&reference["sizes"]);
    assert_eq!(found.sizes.len(), sizes.len(), "{element}");
    let size = found.sizes.iter().zip(&sizes).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let width = ["range", "zone", "strip"].iter().find_map(|key| reference[*key].as_f64());
    let width = width.map_or(0.0, |width| (found.width.unwrap() - width).abs());
    [place, turned, size, width]
}

#[test]
#[expect(clippy::disallowed_macros, reason = "prints figures")]
fn every_element_and_criterion_agrees_with_solutions_of_fifty_digits() {
    let sets: Vec<Value> = serde_json::from_str(include_str!("independent.json")).unwrap();
    let mut worst: BTreeMap<(&str, &str), f64> = BTreeMap::new();
    for set in &sets {
        let (element, criterion) = (set["element"].as_str().unwrap(), set["criterion"].as_str().unwrap());
        let (points, reference) = (set["points"].as_array().unwrap(), &set["found"]);
        let found = if reference["near"].is_array() {
            let flat: Vec<[f64; 2]> = points.iter().map(|p| vector(p).xy().into()).collect();
            outlined(element, &flat, &numbers(&reference["near"]))
        } else {
            let points: Vec<Point3<f64>> = points.iter().map(|p| vector(p).into()).collect();
            fitted(element, criterion, &points, &vector(&reference["point"]))
        };
        let off = differences(element, &found, reference);
        assert!(off.iter().all(|off| *off < 1e-9), "{}: off by {off:?} mm", set["name"]);
        let off = off.into_iter().fold(0.0, f64::max);
        let entry = worst.entry((element, criterion)).or_default();
        *entry = entry.max(off);
    }
    for ((element, criterion), off) in &worst {
        eprintln!("{element:16} {criterion:24} {off:.1e} mm");
    }
    // Seven elements and four outlines by least squares, four zones, three elements from either side.
    assert_eq!((sets.len(), worst.len()), (42, 21));
}
