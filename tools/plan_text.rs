//! What drafts of inspection plans share: keys of nominal geometry as text, colours of elements.

use metrology::inspection::{Exclusion, ExclusionShape, Geometry};
use nalgebra::{Point3, Vector3};
use report::Class;
use std::fmt::Write as _;

/// Colours of elements in a picture, over again where there are more.
const COLOURS: [[u8; 3]; 8] = [
    [31, 119, 180],
    [255, 127, 14],
    [44, 160, 44],
    [214, 39, 40],
    [148, 103, 189],
    [140, 86, 75],
    [227, 119, 194],
    [188, 189, 34],
];

/// Legend of a picture: what belongs to no element, then the elements.
pub fn legend(rest: &str, names: impl IntoIterator<Item = String>) -> Vec<Class> {
    let elements = names.into_iter().zip(COLOURS.iter().cycle());
    let first = Class { name: rest.into(), colour: [205, 205, 205] };
    std::iter::once(first).chain(elements.map(|(name, colour)| Class { name, colour: *colour })).collect()
}

fn numbers(values: impl IntoIterator<Item = f64>, digits: usize) -> String {
    // A sum with zero turns −0 into 0.
    let each = values.into_iter().map(|v| format!("{:.digits$}", (v * 1e9).round() / 1e9 + 0.0));
    format!("[{}]", each.collect::<Vec<_>>().join(", "))
}

/// Keys of the nominal geometry, lengths to a tenth of a micrometre; the ends lose `inset_mm`.
pub fn keys(geometry: &Geometry, inset_mm: f64) -> String {
    match geometry {
        Geometry::Plane { point_mm, normal, edges, half_size_mm, exclusions } => format!(
            "point_mm = {}\nnormal = {}\ndirection = {}\nsize_mm = {}\ninset_mm = {inset_mm:.3}\n{}",
            numbers(point_mm.iter().copied(), 4),
            numbers(normal.iter().copied(), 7),
            numbers(edges[0].iter().copied(), 7),
            numbers(half_size_mm.map(|h| 2.0 * h), 3),
            excluded(exclusions, point_mm, edges, inset_mm)
        ),
        Geometry::Sphere { center_mm, radius_mm, axis, cos_polar } => format!(
            "center_mm = {}\ndiameter_mm = {:.4}\naxis = {}\nmax_polar_deg = {:.1}\n",
            numbers(center_mm.iter().copied(), 4),
            2.0 * radius_mm,
            numbers(axis.iter().copied(), 5),
            fringe::math::acos(cos_polar[0]).to_degrees().clamp(1.0, 180.0)
        ),
        Geometry::Cylinder { point_mm, axis, radius_mm, half_length_mm, internal, sector } => {
            let mut text = format!(
                "point_mm = {}\naxis = {}\ndiameter_mm = {:.4}\nlength_mm = {:.3}\ninset_mm = {inset_mm:.3}\ninternal = {internal}\n",
                numbers(point_mm.iter().copied(), 4),
                numbers(axis.iter().copied(), 7),
                2.0 * radius_mm,
                2.0 * half_length_mm,
            );
            if let Some(sector) = sector {
                let _ = writeln!(
                    text,
                    "direction = {}\nsector_deg = {:.2}",
                    numbers(sector.direction.iter().copied(), 7),
                    2.0 * fringe::math::acos(sector.cos_half).to_degrees()
                );
            }
            text
        }
        Geometry::Cone { point_mm, axis, radius_mm, half_angle_rad, half_length_mm, internal } => format!(
            "point_mm = {}\naxis = {}\ndiameter_mm = {:.4}\nhalf_angle_deg = {:.5}\nlength_mm = {:.3}\ninset_mm = {inset_mm:.3}\ninternal = {internal}\n",
            numbers(point_mm.iter().copied(), 4),
            numbers(axis.iter().copied(), 7),
            2.0 * radius_mm,
            half_angle_rad.to_degrees(),
            2.0 * half_length_mm
        ),
        Geometry::Torus { center_mm, axis, ring_radius_mm, tube_radius_mm } => format!(
            "center_mm = {}\naxis = {}\nring_diameter_mm = {:.4}\ntube_diameter_mm = {:.4}\n",
            numbers(center_mm.iter().copied(), 4),
            numbers(axis.iter().copied(), 7),
            2.0 * ring_radius_mm,
            2.0 * tube_radius_mm
        ),
        _ => String::new(),
    }
}

/// What is cut out of a plane, wider by the inset.
fn excluded(cuts: &[Exclusion], point: &Point3<f64>, edges: &[Vector3<f64>; 2], inset_mm: f64) -> String {
    if cuts.is_empty() {
        return String::new();
    }
    let each = cuts.iter().map(|cut| {
        let place = point + edges[0] * cut.center_mm[0] + edges[1] * cut.center_mm[1];
        let shape = match cut.shape {
            ExclusionShape::Disc(radius) => format!("radius_mm = {:.3}", radius + inset_mm),
            ExclusionShape::Rectangle(half) => {
                format!("size_mm = {}", numbers(half.map(|h| 2.0 * (h + inset_mm)), 3))
            }
        };
        format!("  {{ center_mm = {}, {shape} }},\n", numbers(place.iter().copied(), 4))
    });
    format!("exclude = [\n{}]\n", each.collect::<String>())
}
