//! Reference sets made elsewhere, with solutions known beforehand.

use nalgebra::{Point3, Vector3};
use serde_json::Value;

use crate::fit::*;

fn vector(value: &Value) -> Vector3<f64> {
    let at = |i: usize| value[i].as_f64().expect("the reference holds three numbers");
    Vector3::new(at(0), at(1), at(2))
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("the reference holds a number")
}

/// Distance between two lines' directions and of a point from a line, both in their unit.
fn off_line(point: Vector3<f64>, other: Vector3<f64>, direction: Vector3<f64>) -> f64 {
    (point - other).cross(&direction).norm()
}

/// Largest disagreement with one reference, mm (directions: mm over 1 mm).
fn disagreement(set: &Value, points: &[Point3<f64>]) -> f64 {
    let settings = FitSettings::default();
    let params = &set["params"];
    let (form, error) = match set["element"].as_str() {
        Some("sphere") => {
            let fit = sphere(points, &settings).unwrap();
            let center = (fit.center().coords - vector(&params["center"])).amax();
            (fit.form, center.max((0.5 * fit.diameter_mm - number(&params["radius"])).abs()))
        }
        Some("plane") => {
            let fit = plane(points, &settings).unwrap();
            let normal = vector(&params["normal"]);
            let normal = normal * normal.dot(&fit.normal_vector()).signum();
            let point = Point3::from(vector(&params["point"]));
            let offset = (fit.offset_mm - normal.dot(&point.coords)).abs();
            (fit.form, (fit.normal_vector() - normal).amax().max(offset).max(fit.distance_mm(&point).abs()))
        }
        Some("cylinder") => {
            let fit = cylinder(points, &settings).unwrap();
            let axis = vector(&params["axis"]);
            let direction = Vector3::from(fit.axis_direction).cross(&axis).norm();
            let place = off_line(Vector3::from(fit.axis_point_mm), vector(&params["point_on_axis"]), axis);
            let radius = (0.5 * fit.diameter_mm - number(&params["radius"])).abs();
            (fit.form, direction.max(place).max(radius))
        }
        Some("cone") => {
            let fit = cone(points, &settings).unwrap();
            let axis = vector(&params["axis"]);
            let found = Vector3::from(fit.axis_direction);
            let reference = vector(&params["point_on_axis"]);
            let along = (reference - Vector3::from(fit.axis_point_mm)).dot(&found);
            let slope = fringe::math::tan(number(&params["half_angle_deg"]).to_radians());
            let radius = 0.5 * fit.diameter_mm + along * slope;
            let angle = (fit.half_angle_deg - number(&params["half_angle_deg"])).abs();
            let place = off_line(Vector3::from(fit.axis_point_mm), reference, axis);
            let errors =
                [found.cross(&axis).norm(), place, angle, radius - number(&params["radius_at_point"])];
            (fit.form, errors.iter().fold(0.0, |worst: f64, e| worst.max(e.abs())))
        }
        other => panic!("the reference holds an unknown element {other:?}"),
    };
    error.max((form.form_range_mm - number(&set["range"])).abs())
}

/// Largest disagreement with a minimum-zone reference, mm.
fn zone_disagreement(set: &Value, points: &[Point3<f64>]) -> f64 {
    let params = &set["params"];
    let (width, error) = match set["element"].as_str() {
        Some("sphere") => {
            let zone = sphere_minimum_zone(points).unwrap();
            let center = (Vector3::from(zone.center_mm) - vector(&params["center"])).amax();
            (zone.minimum_zone_mm, center.max((0.5 * zone.diameter_mm - number(&params["radius"])).abs()))
        }
        Some("plane") => {
            let zone = plane_minimum_zone(points).unwrap();
            let normal = vector(&params["normal"]);
            let normal = normal * normal.dot(&Vector3::from(zone.normal)).signum();
            let offset = (zone.offset_mm - normal.dot(&vector(&params["point"]))).abs();
            (zone.minimum_zone_mm, (Vector3::from(zone.normal) - normal).amax().max(offset))
        }
        other => panic!("the reference holds an unknown element {other:?}"),
    };
    error.max((width - number(&set["zone"])).abs())
}

/// Thirteen sets whose solution is known before the points are, eleven by least squares and two minimum zones:
/// agreement to 1e-9 mm.
#[test]
#[cfg_attr(
    not(shared_data),
    ignore = "../shared/data is absent; with it: cargo test -p fringe-metrology reference::"
)]
#[expect(
    clippy::disallowed_methods,
    clippy::disallowed_macros,
    reason = "a test reads its reference and says so"
)]
fn the_reference_sets_are_met_to_a_picometre() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/fit_reference/reference_fits.json");
    let Ok(text) = std::fs::read_to_string(path) else {
        eprintln!("skipped: {path} is absent");
        return;
    };
    let sets: Vec<Value> = serde_json::from_str(&text).unwrap();
    let mut met = 0;
    for set in &sets {
        let points: Vec<Point3<f64>> =
            set["points"].as_array().unwrap().iter().map(|p| Point3::from(vector(p))).collect();
        let error = match set["criterion"].as_str() {
            Some("LSQ") => disagreement(set, &points),
            Some("MINZONE") => zone_disagreement(set, &points),
            other => panic!("the reference holds an unknown criterion {other:?}"),
        };
        assert!(error < 1e-9, "{}: off by {error:e} mm", set["name"]);
        eprintln!("{}: {error:.1e} mm", set["name"]);
        met += 1;
    }
    assert_eq!(met, 13);
}
