//! From the plan as written to the plan as meant: names become indices, degrees radians, deviations limits.

use nalgebra::{Isometry3, Point3, Vector3};

use super::plan::{
    Datums, Element, Exclusion, ExclusionShape, Feature, Geometry, PLAN_FORMAT, Plan, PlanError, Quantity,
};
use super::raw::{RawAlignment, RawElement, RawExclusion, RawFeature, RawPlacement, RawPlan};
use crate::fit::{COORDINATE_LIMIT_MM, tangents};
use fringe::math;

impl Plan {
    /// Checks a plan as it is written.
    ///
    /// # Errors
    /// See [`PlanError`].
    pub fn new(raw: RawPlan) -> Result<Self, PlanError> {
        if raw.format != PLAN_FORMAT {
            return Err(PlanError::Format(raw.format));
        }
        printable("plan", &raw.name)?;
        let within = Within("settings".into());
        raw.settings.cluster_mm.map(|edge| within.positive("cluster_mm", edge)).transpose()?;
        within.check("guard_factor", raw.settings.guard_factor, 0.0..=10.0, "0 … 10")?;
        let elements = raw.element.into_iter().map(element).collect::<Result<Vec<_>, _>>()?;
        unique("element", elements.iter().map(|e| e.name.as_str()))?;
        let lookup = Lookup(&elements);
        let features = raw.feature.into_iter().map(|f| feature(f, &lookup)).collect::<Result<Vec<_>, _>>()?;
        unique("feature", features.iter().map(|f| f.name.as_str()))?;
        if elements.is_empty() {
            return Err(PlanError::Empty("element"));
        }
        if features.is_empty() {
            return Err(PlanError::Empty("feature"));
        }
        let datums = raw.alignment.map(|a| datums(&a, &lookup)).transpose()?;
        let world_from_part = placement(raw.placement)?;
        Ok(Self { name: raw.name, settings: raw.settings, world_from_part, datums, elements, features })
    }
}

/// Nominal pose of the part.
fn placement(raw: Option<RawPlacement>) -> Result<Isometry3<f64>, PlanError> {
    let Some(raw) = raw else { return Ok(Isometry3::identity()) };
    let place = Within("placement".into());
    for value in raw.translation_mm {
        place.coordinate("translation_mm", value)?;
    }
    fringe::geometry::camera::pose(raw.rotation, raw.translation_mm)
        .map_err(|error| PlanError::Part { place: place.0, message: error.to_string() })
}

/// Checks of numbers under one place of the plan.
struct Within(String);

impl Within {
    fn check(
        &self,
        key: &'static str,
        value: f64,
        range: std::ops::RangeInclusive<f64>,
        limits: &'static str,
    ) -> Result<f64, PlanError> {
        if range.contains(&value) {
            return Ok(value);
        }
        Err(PlanError::Value { place: self.0.clone(), key, value, limits })
    }

    fn coordinate(&self, key: &'static str, value: f64) -> Result<f64, PlanError> {
        self.check(key, value, -COORDINATE_LIMIT_MM..=COORDINATE_LIMIT_MM, "a length within ±1e7 mm")
    }

    fn positive(&self, key: &'static str, value: f64) -> Result<f64, PlanError> {
        self.check(key, value, f64::MIN_POSITIVE..=COORDINATE_LIMIT_MM, "a positive length up to 1e7 mm")
    }

    fn not_negative(&self, key: &'static str, value: f64) -> Result<f64, PlanError> {
        self.check(key, value, 0.0..=COORDINATE_LIMIT_MM, "zero or a positive number up to 1e7")
    }

    fn point(&self, key: &'static str, values: [f64; 3]) -> Result<Point3<f64>, PlanError> {
        for value in values {
            self.coordinate(key, value)?;
        }
        Ok(Point3::from(values))
    }

    fn unit(&self, key: &'static str, values: [f64; 3]) -> Result<Vector3<f64>, PlanError> {
        let vector = self.point(key, values)?.coords;
        let length = vector.norm();
        self.check(
            key,
            length,
            1e-3..=1e4,
            "a direction (its length is given here) of length 0.001 … 10 000",
        )?;
        Ok(vector / length)
    }

    fn angle_rad(&self, key: &'static str, degrees: f64) -> Result<f64, PlanError> {
        Ok(self.check(key, degrees, 0.0..=180.0, "an angle of 0 … 180°")?.to_radians())
    }
}

/// Names reach terminals and reports as they are.
fn printable(what: &'static str, name: &str) -> Result<(), PlanError> {
    if fringe::text::is_printable(name) {
        return Ok(());
    }
    let message = format!("the {what} name {name:?} has characters that do not print; remove them");
    Err(PlanError::Part { place: "name".into(), message })
}

/// Names must be unique.
fn unique<'a>(what: &'static str, names: impl Iterator<Item = &'a str>) -> Result<(), PlanError> {
    let mut seen = std::collections::BTreeSet::new();
    for name in names {
        printable(what, name)?;
        if name.is_empty() || !seen.insert(name) {
            return Err(PlanError::Name { what, name: name.into() });
        }
    }
    Ok(())
}

/// What both kinds of element share.
struct Common {
    name: String,
    margin_mm: f64,
    normal_tolerance_deg: Option<f64>,
    min_points: usize,
    max_reject_fraction: f64,
}

fn element(raw: RawElement) -> Result<Element, PlanError> {
    match raw {
        RawElement::Sphere {
            name,
            center_mm,
            diameter_mm,
            axis,
            min_polar_deg,
            max_polar_deg,
            margin_mm,
            normal_tolerance_deg,
            min_points,
            max_reject_fraction,
        } => {
            let place = Within(format!("element \"{name}\""));
            let smallest = place.angle_rad("min_polar_deg", min_polar_deg)?;
            let largest = place.angle_rad("max_polar_deg", max_polar_deg)?;
            place.check("max_polar_deg", max_polar_deg, min_polar_deg..=180.0, "above min_polar_deg")?;
            let geometry = Geometry::Sphere {
                center_mm: place.point("center_mm", center_mm)?,
                radius_mm: 0.5 * place.positive("diameter_mm", diameter_mm)?,
                axis: place.unit("axis", axis)?,
                cos_polar: [math::cos(largest), math::cos(smallest)],
            };
            let common = Common { name, margin_mm, normal_tolerance_deg, min_points, max_reject_fraction };
            common.with(geometry, &place)
        }
        RawElement::Plane {
            name,
            point_mm,
            normal,
            direction,
            size_mm,
            inset_mm,
            exclude,
            margin_mm,
            normal_tolerance_deg,
            min_points,
            max_reject_fraction,
        } => {
            let place = Within(format!("element \"{name}\""));
            let point = place.point("point_mm", point_mm)?;
            let normal = place.unit("normal", normal)?;
            let edges = edges(&place, &normal, direction)?;
            let geometry = Geometry::Plane {
                point_mm: point,
                normal,
                edges,
                half_size_mm: half_size(&place, size_mm, inset_mm)?,
                exclusions: exclude
                    .into_iter()
                    .map(|e| exclusion(&place, &e, &point, &edges))
                    .collect::<Result<_, _>>()?,
            };
            let common = Common { name, margin_mm, normal_tolerance_deg, min_points, max_reject_fraction };
            common.with(geometry, &place)
        }
    }
}

impl Common {
    fn with(self, geometry: Geometry, place: &Within) -> Result<Element, PlanError> {
        place.positive("margin_mm", self.margin_mm)?;
        place.check("max_reject_fraction", self.max_reject_fraction, 0.0..=0.5, "a fraction of 0 … 0.5")?;
        // A sphere has four parameters; with fewer than ten points the residuals say too little about the fit.
        place.check("min_points", self.min_points as f64, 10.0..=1e9, "10 … 1e9")?;
        let tolerance =
            self.normal_tolerance_deg.map(|d| place.angle_rad("normal_tolerance_deg", d)).transpose()?;
        Ok(Element {
            name: self.name,
            geometry,
            margin_mm: self.margin_mm,
            normal_tolerance_rad: tolerance,
            min_points: self.min_points,
            max_reject_fraction: self.max_reject_fraction,
        })
    }
}

/// Directions of a rectangle's edges: the given one made perpendicular to the normal, and the one that completes.
fn edges(
    place: &Within,
    normal: &Vector3<f64>,
    direction: Option<[f64; 3]>,
) -> Result<[Vector3<f64>; 2], PlanError> {
    let Some(direction) = direction else { return Ok(tangents(normal)) };
    let given = place.unit("direction", direction)?;
    let across = given - normal * given.dot(normal);
    let length = place.check("direction", across.norm(), 0.1..=1.0, "well off the normal (sine 0.1 … 1)")?;
    let first = across / length;
    Ok([first, normal.cross(&first)])
}

fn half_size(place: &Within, size_mm: [f64; 2], inset_mm: f64) -> Result<[f64; 2], PlanError> {
    place.not_negative("inset_mm", inset_mm)?;
    for size in size_mm {
        place.positive("size_mm", size)?;
        place.positive("size_mm less twice inset_mm", size - 2.0 * inset_mm)?;
    }
    Ok(size_mm.map(|size| 0.5 * size - inset_mm))
}

fn exclusion(
    place: &Within,
    raw: &RawExclusion,
    point: &Point3<f64>,
    edges: &[Vector3<f64>; 2],
) -> Result<Exclusion, PlanError> {
    let arm = place.point("exclude.center_mm", raw.center_mm)? - point;
    let shape = match (raw.radius_mm, raw.size_mm) {
        (Some(radius), None) => ExclusionShape::Disc(place.positive("exclude.radius_mm", radius)?),
        (None, Some(size)) => {
            for value in size {
                place.positive("exclude.size_mm", value)?;
            }
            ExclusionShape::Rectangle(size.map(|s| 0.5 * s))
        }
        _ => {
            let message = "exclude needs either radius_mm or size_mm, not both".into();
            return Err(PlanError::Part { place: place.0.clone(), message });
        }
    };
    Ok(Exclusion { center_mm: edges.map(|e| arm.dot(&e)), shape })
}

/// Finds elements of a plan by name.
struct Lookup<'a>(&'a [Element]);

impl Lookup<'_> {
    fn find(
        &self,
        place: &Within,
        key: &'static str,
        kind: &'static str,
        name: &str,
    ) -> Result<usize, PlanError> {
        let fits = |e: &&Element| e.geometry.kind() == kind;
        self.0.iter().position(|e| e.name == name && fits(&e)).ok_or_else(|| {
            let known: Vec<&str> = self.0.iter().filter(fits).map(|e| e.name.as_str()).collect();
            let known = if known.is_empty() { "none".into() } else { known.join(", ") };
            PlanError::Reference { place: place.0.clone(), key, name: name.into(), kind, known }
        })
    }

    fn two(&self, place: &Within, kind: &'static str, names: &[String; 2]) -> Result<[usize; 2], PlanError> {
        let [a, b] = names;
        if a == b {
            let message =
                format!("elements names \"{a}\" twice: a value between an element and itself proves nothing");
            return Err(PlanError::Part { place: place.0.clone(), message });
        }
        Ok([self.find(place, "elements", kind, a)?, self.find(place, "elements", kind, b)?])
    }
}

fn feature(raw: RawFeature, elements: &Lookup) -> Result<Feature, PlanError> {
    let within = |name: &str| Within(format!("feature \"{name}\""));
    match raw {
        RawFeature::SphereDiameter { name, element, nominal_mm, tolerance_mm, u_system_mm } => {
            let place = within(&name);
            let quantity = Quantity::SphereDiameter(elements.find(&place, "element", "sphere", &element)?);
            tolerated(&place, name, quantity, nominal_mm, tolerance_mm, u_system_mm)
        }
        RawFeature::CentreDistance { name, elements: names, nominal_mm, tolerance_mm, u_system_mm } => {
            let place = within(&name);
            let quantity = Quantity::CentreDistance(elements.two(&place, "sphere", &names)?);
            tolerated(&place, name, quantity, nominal_mm, tolerance_mm, u_system_mm)
        }
        RawFeature::PlaneFlatness { name, element, limit_mm, filter_mm, u_system_mm } => {
            let place = within(&name);
            let plane = elements.find(&place, "element", "plane", &element)?;
            let filter_mm = filter_mm.map(|edge| place.positive("filter_mm", edge)).transpose()?;
            let quantity = Quantity::PlaneFlatness { plane, filter_mm };
            let limit = place.positive("limit_mm", limit_mm)?;
            tolerated(&place, name, quantity, 0.0, [0.0, limit], u_system_mm)
        }
        RawFeature::PlaneDistance { name, elements: names, nominal_mm, tolerance_mm, u_system_mm } => {
            let place = within(&name);
            let quantity = Quantity::PlaneDistance(elements.two(&place, "plane", &names)?);
            tolerated(&place, name, quantity, nominal_mm, tolerance_mm, u_system_mm)
        }
        RawFeature::PlaneAngle {
            name,
            elements: names,
            supplement,
            nominal_deg,
            tolerance_deg,
            u_system_deg,
        } => {
            let place = within(&name);
            let planes = elements.two(&place, "plane", &names)?;
            place.angle_rad("nominal_deg", nominal_deg)?;
            let quantity = Quantity::PlaneAngle { planes, supplement };
            tolerated(&place, name, quantity, nominal_deg, tolerance_deg, u_system_deg)
        }
        RawFeature::HemisphereHeight { name, sphere, plane, nominal_mm, tolerance_mm, u_system_mm } => {
            let place = within(&name);
            let sphere = elements.find(&place, "sphere", "sphere", &sphere)?;
            let plane = elements.find(&place, "plane", "plane", &plane)?;
            let quantity = Quantity::HemisphereHeight { sphere, plane };
            tolerated(&place, name, quantity, nominal_mm, tolerance_mm, u_system_mm)
        }
    }
}

/// Turns deviations from nominal into limits.
fn tolerated(
    place: &Within,
    name: String,
    quantity: Quantity,
    nominal: f64,
    deviations: [f64; 2],
    u_system: f64,
) -> Result<Feature, PlanError> {
    place.coordinate("nominal", nominal)?;
    let [low, high] = deviations;
    place.coordinate("tolerance (lower deviation)", low)?;
    place.coordinate("tolerance (upper deviation)", high)?;
    place.check(
        "tolerance (upper deviation)",
        high,
        low..=COORDINATE_LIMIT_MM,
        "not below the lower deviation",
    )?;
    place.not_negative("u_system", u_system)?;
    Ok(Feature { name, quantity, nominal, lower: nominal + low, upper: nominal + high, u_system })
}

fn datums(raw: &RawAlignment, elements: &Lookup) -> Result<Datums, PlanError> {
    let place = Within("alignment".into());
    let [a, b] = &raw.line;
    let datums = Datums {
        plane: elements.find(&place, "plane", "plane", &raw.plane)?,
        line: [elements.find(&place, "line", "sphere", a)?, elements.find(&place, "line", "sphere", b)?],
        origin: elements.find(&place, "origin", "sphere", &raw.origin)?,
        search_mm: place.positive("search_mm", raw.search_mm)?,
        search_rad: place
            .check("search_deg", raw.search_deg, 0.0..=45.0, "an angle of 0 … 45°")?
            .to_radians(),
    };
    let center = |index: usize| match &elements.0[index].geometry {
        Geometry::Sphere { center_mm, .. } => *center_mm,
        Geometry::Plane { point_mm, .. } => *point_mm,
    };
    let Geometry::Plane { normal, .. } = &elements.0[datums.plane].geometry else {
        return Err(PlanError::Datum("the plane is none"));
    };
    let along = center(datums.line[1]) - center(datums.line[0]);
    let across = along - normal * along.dot(normal);
    // Below a tenth the turn about the normal would hang on the height of the spheres.
    if across.norm() <= 0.1 * along.norm() {
        return Err(PlanError::Datum(
            "the line runs along the plane's normal (or has no length); choose two spheres apart across it",
        ));
    }
    Ok(datums)
}
