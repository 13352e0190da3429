//! How far a fit lies from the geometry about which its region was taken.

use super::fitted_element::FittedElement;
use super::geometry::Geometry;
use nalgebra::{Point3, Vector3};

/// How far a fit lies from a geometry, mm: centre or radius of a sphere, place and tilt of a plane's rectangle.
pub(super) fn shift_mm(geometry: &Geometry, fit: &FittedElement) -> f64 {
    match (fit, geometry) {
        (FittedElement::Sphere(sphere), Geometry::Sphere { center_mm, radius_mm, .. }) => {
            let resized = (0.5 * sphere.diameter_mm - radius_mm).abs();
            (sphere.center() - center_mm).norm().max(resized)
        }
        (FittedElement::Plane(plane), Geometry::Plane { point_mm, edges, half_size_mm, .. }) => {
            let arms = [edges[0] * half_size_mm[0], edges[1] * half_size_mm[1]];
            let tilt: f64 = arms.iter().map(|arm| plane.normal_vector().dot(arm).abs()).sum();
            plane.distance_mm(point_mm).abs() + tilt
        }
        (
            FittedElement::Cylinder(c),
            Geometry::Cylinder { point_mm, axis, radius_mm, half_length_mm, .. },
        ) => {
            let resized = (0.5 * c.diameter_mm - radius_mm).abs();
            off_axis(&c.axis_point_mm, &c.axis_direction, (point_mm, axis), *half_length_mm).max(resized)
        }
        (FittedElement::Cone(c), Geometry::Cone { point_mm, axis, radius_mm, half_length_mm, .. }) => {
            let height =
                (point_mm.coords - Vector3::from(c.axis_point_mm)).dot(&Vector3::from(c.axis_direction));
            let slope = fringe::math::tan(c.half_angle_deg.to_radians());
            let resized = (0.5 * c.diameter_mm + height * slope - radius_mm).abs();
            off_axis(&c.axis_point_mm, &c.axis_direction, (point_mm, axis), *half_length_mm).max(resized)
        }
        (FittedElement::Torus(t), Geometry::Torus { center_mm, ring_radius_mm, tube_radius_mm, .. }) => {
            let resized = (0.5 * t.ring_diameter_mm - ring_radius_mm).abs();
            let tube = (0.5 * t.tube_diameter_mm - tube_radius_mm).abs();
            (Vector3::from(t.center_mm) - center_mm.coords).norm().max(resized).max(tube)
        }
        // It stays where it is.
        (FittedElement::Surface(_), Geometry::Surface(_)) => 0.0,
        (FittedElement::Point(p), Geometry::Point { point_mm, .. }) => {
            (Vector3::from(p.point_mm) - point_mm.coords).norm()
        }
        (FittedElement::Line(c), Geometry::Line { point_mm, direction, half_size_mm, .. }) => {
            let tilt = Vector3::from(c.direction).cross(direction).norm() * half_size_mm[0];
            (Vector3::from(c.center_mm) - point_mm.coords).norm() + tilt
        }
        (
            FittedElement::Circle(c)
            | FittedElement::Slot(c)
            | FittedElement::Rectangle(c)
            | FittedElement::Edge(c),
            Geometry::Outline { center_mm, outline, .. },
        ) => {
            let sizes = outline.sizes_mm();
            let resized = (0..2).map(|i| 0.5 * (c.size_mm[i] - sizes[i]).abs()).fold(0.0, f64::max);
            (Vector3::from(c.center_mm) - center_mm.coords).norm().max(resized)
        }
        _ => f64::INFINITY,
    }
}

/// How far the ends of a nominal axis lie from a fitted one, mm.
fn off_axis(
    point: &[f64; 3],
    direction: &[f64; 3],
    (nominal, axis): (&Point3<f64>, &Vector3<f64>),
    half_mm: f64,
) -> f64 {
    let off = |end: Vector3<f64>| (end - Vector3::from(*point)).cross(&Vector3::from(*direction)).norm();
    off(nominal.coords + axis * half_mm).max(off(nominal.coords - axis * half_mm))
}
