//! Features of a plan from CAD: sizes, forms, distances and angles with general tolerances.

use super::{Args, Chosen};
use metrology::general_tolerance::{FormClass, LengthClass};
use metrology::inspection::Geometry;
use nalgebra::{Point3, Vector3};

/// Directions within this sine are parallel in CAD.
const PARALLEL: f64 = 1e-6;

/// How forms are limited.
pub enum Form {
    /// Flatness by a class of ISO 2768-2.
    Flatness(FormClass),
    /// By the profile of the whole surface.
    Profile,
}

impl Form {
    /// As the arguments say.
    pub fn of(args: &Args) -> Self {
        if args.profile.is_some() { Self::Profile } else { Self::Flatness(args.form.class()) }
    }
}

/// All features as text, without the line of the table.
pub fn features(kept: &[&Chosen], class: LengthClass, form: &Form) -> Vec<String> {
    let mut list: Vec<String> = kept.iter().flat_map(|one| own(one, class, form)).collect();
    let planes: Vec<&Chosen> = of_kind(kept, &["plane"]);
    let axes: Vec<&Chosen> = of_kind(kept, &["cylinder", "cone"]);
    let groups = directions(&planes);
    for group in &groups {
        for other in &group[1..] {
            list.extend(distance(group[0], other, class));
        }
    }
    for other in groups.iter().skip(1) {
        list.extend(angle(groups[0][0], other[0], class));
    }
    for axis in &axes {
        list.extend(groups.first().and_then(|base| angle(base[0], axis, class)));
        // From the edges, as a drawing has it.
        let beside = |g: &&Vec<&Chosen>| direction(g[0]).dot(&direction(axis)).abs() <= PARALLEL;
        for group in groups.iter().filter(beside).take(2) {
            list.extend(distance(group[0], axis, class));
        }
    }
    for group in directions(&axes) {
        for other in &group[1..] {
            list.extend(distance(group[0], other, class));
        }
    }
    let spheres: Vec<&Chosen> = of_kind(kept, &["sphere"]);
    for (index, sphere) in spheres.iter().enumerate() {
        list.extend(spheres.first().filter(|_| index > 0).and_then(|first| distance(first, sphere, class)));
        list.extend(groups.first().and_then(|base| distance(base[0], sphere, class)));
    }
    list
}

fn of_kind<'a>(kept: &[&'a Chosen], kinds: &[&str]) -> Vec<&'a Chosen> {
    kept.iter().copied().filter(|one| kinds.contains(&one.feature.geometry.kind())).collect()
}

/// Elements of one direction together, the largest of each first; the direction of most area first.
fn directions<'a>(all: &[&'a Chosen]) -> Vec<Vec<&'a Chosen>> {
    let mut sorted = all.to_vec();
    // A stable sort: equal ones stay in the order of the file.
    sorted.sort_by(|a, b| b.feature.area_mm2.total_cmp(&a.feature.area_mm2));
    let mut groups: Vec<Vec<&Chosen>> = Vec::new();
    for one in sorted {
        let parallel = |g: &&mut Vec<&Chosen>| direction(g[0]).cross(&direction(one)).norm() <= PARALLEL;
        match groups.iter_mut().find(parallel) {
            Some(group) => group.push(one),
            None => groups.push(vec![one]),
        }
    }
    groups
}

fn direction(one: &Chosen) -> Vector3<f64> {
    match &one.feature.geometry {
        Geometry::Plane { normal, .. } => *normal,
        Geometry::Cylinder { axis, .. } | Geometry::Cone { axis, .. } => *axis,
        _ => Vector3::zeros(),
    }
}

fn place(one: &Chosen) -> Point3<f64> {
    one.feature.geometry.place()
}

/// The shorter side of an element, for tolerances of angles, mm.
fn side(one: &Chosen) -> f64 {
    match &one.feature.geometry {
        Geometry::Plane { half_size_mm, .. } => 2.0 * half_size_mm[0].max(half_size_mm[1]),
        Geometry::Cylinder { half_length_mm, .. } | Geometry::Cone { half_length_mm, .. } => {
            2.0 * half_length_mm
        }
        _ => 0.0,
    }
}

/// Digits without rounding noise, at most six after the point.
fn short(value: f64) -> String {
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0');
    if text.ends_with('.') { format!("{text}0") } else { text.to_owned() }
}

fn band(deviation: f64) -> String {
    format!("[-{0}, {0}]", short(deviation))
}

/// What an element has by itself: size, angle, flatness.
fn own(one: &Chosen, class: LengthClass, form: &Form) -> Vec<String> {
    let name = &one.name;
    let size = |which: &str, diameter: f64| {
        let deviation = class.length_mm(diameter)?;
        let key = if which == "diameter" { String::new() } else { format!("size = \"{which}\"\n") };
        let word = which.replace('-', "_");
        Some(format!(
            "kind = \"size\"\nname = \"{name}_{word}\"\nelement = \"{name}\"\n{key}tolerance_mm = {}\n",
            band(deviation)
        ))
    };
    let found = match &one.feature.geometry {
        Geometry::Plane { half_size_mm, .. } => match form {
            Form::Flatness(class) => vec![class.flatness_mm(side(one)).map(|limit| {
                let edge = (half_size_mm[0].min(half_size_mm[1]) / 8.0).max(0.5);
                format!(
                    "kind = \"flatness\"\nname = \"{name}_flatness\"\nelement = \"{name}\"\nfilter_mm = {edge:.2}\nlimit_mm = {}\n",
                    short(limit)
                )
            })],
            Form::Profile => Vec::new(),
        },
        Geometry::Cylinder { radius_mm, .. } | Geometry::Sphere { radius_mm, .. } => {
            vec![size("diameter", 2.0 * radius_mm)]
        }
        Geometry::Cone { half_angle_rad, half_length_mm, .. } => {
            // The angle between opposite sides of the cone is twice that to its axis.
            let slant = 2.0 * half_length_mm / fringe::math::cos(*half_angle_rad);
            vec![Some(format!(
                "kind = \"half-angle\"\nname = \"{name}_half_angle\"\nelement = \"{name}\"\ntolerance_deg = {}\n",
                band(0.5 * class.angle_deg(slant))
            ))]
        }
        Geometry::Torus { ring_radius_mm, tube_radius_mm, .. } => vec![
            size("ring-diameter", 2.0 * ring_radius_mm),
            size("tube-diameter", 2.0 * tube_radius_mm),
        ],
        _ => Vec::new(),
    };
    found.into_iter().flatten().collect()
}

/// Distance between two elements; `None` where they are nominally together, or where the standard has no tolerance.
fn distance(one: &Chosen, other: &Chosen, class: LengthClass) -> Option<String> {
    let arm = place(other) - place(one);
    let (a, b) = (&one.feature.geometry, &other.feature.geometry);
    let nominal = match (a, b) {
        (Geometry::Plane { normal, .. }, _) => arm.dot(normal).abs(),
        (Geometry::Sphere { .. }, _) => arm.norm(),
        (Geometry::Cylinder { axis, .. } | Geometry::Cone { axis, .. }, _) => {
            (arm - axis * arm.dot(axis)).norm()
        }
        _ => return None,
    };
    let deviation = class.length_mm(nominal)?;
    let (x, y) = (&one.name, &other.name);
    Some(format!(
        "kind = \"distance\"\nname = \"{x}_{y}_distance\"\nelements = [\"{x}\", \"{y}\"]\ntolerance_mm = {}\n",
        band(deviation)
    ))
}

/// Angle between two elements, by the shorter one's side.
fn angle(one: &Chosen, other: &Chosen, class: LengthClass) -> Option<String> {
    let sides = [side(one), side(other)];
    let shorter = sides[0].min(sides[1]);
    if shorter <= 0.0 {
        return None;
    }
    let (x, y) = (&one.name, &other.name);
    Some(format!(
        "kind = \"angle\"\nname = \"{x}_{y}_angle\"\nelements = [\"{x}\", \"{y}\"]\ntolerance_deg = {}\n",
        band(class.angle_deg(shorter))
    ))
}
