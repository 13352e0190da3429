//! Elements of a plan, from as written to as meant.

use nalgebra::{Point3, Vector3};

use super::cad_face::{CadParts, cad_face};
use super::criterion::Criterion;
use super::geometry::{Exclusion, ExclusionShape, Geometry, Sector};
use super::nominal_surface::{NominalSurface, Surfaces};
use super::plan::{Element, PlanError};
use super::raw::{RawElement, RawExclusion};
use super::raw_elements::{
    Common, RawCircle, RawCone, RawCylinder, RawEdge, RawLine, RawMade, RawOblong, RawPoint, RawSurface,
    RawTorus,
};
use super::references::Construction;
use super::within::Within;
use crate::fit::{COORDINATE_LIMIT_MM, Outline, tangents};
use fringe::math;

/// A measured element, or one that is made of others by names.
#[allow(clippy::too_many_lines, reason = "one arm for each kind of element")]
pub(super) fn element(raw: RawElement, surfaces: &Surfaces, cad: &CadParts) -> Result<Written, PlanError> {
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
            criterion,
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
            let common =
                Common { name, margin_mm, normal_tolerance_deg, min_points, max_reject_fraction, criterion };
            common.with(geometry, &place).map(Written::Measured)
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
            criterion,
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
            let common =
                Common { name, margin_mm, normal_tolerance_deg, min_points, max_reject_fraction, criterion };
            common.with(geometry, &place).map(Written::Measured)
        }
        RawElement::Cylinder(raw) => measured(&raw.common(), |place| cylinder(&raw, place)),
        RawElement::Cone(raw) => measured(&raw.common(), |place| cone(&raw, place)),
        RawElement::Torus(raw) => measured(&raw.common(), |place| torus(&raw, place)),
        RawElement::Circle(raw) => measured(&raw.common(), |place| circle(&raw, place)),
        RawElement::Slot(raw) => measured(&raw.common(), |place| oblong(&raw, place, true)),
        RawElement::Rectangle(raw) => measured(&raw.common(), |place| oblong(&raw, place, false)),
        RawElement::Edge(raw) => measured(&raw.common(), |place| edge(&raw, place)),
        RawElement::Line(raw) => measured(&raw.common(), |place| line(&raw, place)),
        RawElement::Surface(raw) => measured(&raw.common(), |place| surface(&raw, surfaces, place)),
        RawElement::CadFace(raw) => measured(&raw.common(), |place| cad_face(&raw, cad, place)),
        RawElement::Point(raw) => measured(&raw.common(), |place| surface_point(&raw, place)),
        RawElement::Intersection(raw) => Ok(made(raw, Construction::Intersection)),
        RawElement::Projection(raw) => Ok(made(raw, Construction::Projection)),
        RawElement::SymmetryPlane(raw) => Ok(made(raw, Construction::SymmetryPlane)),
        RawElement::MiddlePoint(raw) => Ok(made(raw, Construction::MiddlePoint)),
        RawElement::FitLine(raw) => Ok(made(raw, Construction::FitLine)),
        RawElement::FitPlane(raw) => Ok(made(raw, Construction::FitPlane)),
        RawElement::FitCircle(raw) => Ok(made(raw, Construction::FitCircle)),
    }
}

/// An element as it is written.
pub(super) enum Written {
    /// Fitted on a region of the cloud.
    Measured(Element),
    /// Made of others, which it names.
    Made(RawMade, Construction),
}

fn made(raw: RawMade, construction: Construction) -> Written {
    Written::Made(raw, construction)
}

fn measured(
    common: &Common,
    geometry: impl Fn(&Within) -> Result<Geometry, PlanError>,
) -> Result<Written, PlanError> {
    let place = Within(format!("element \"{}\"", common.name));
    let geometry = geometry(&place)?;
    common.clone().with(geometry, &place).map(Written::Measured)
}

/// Half of a length, the inset taken off at both ends, mm.
fn half_length(place: &Within, length_mm: f64, inset_mm: f64) -> Result<f64, PlanError> {
    place.not_negative("inset_mm", inset_mm)?;
    place.positive("length_mm", length_mm)?;
    Ok(0.5 * place.positive("length_mm less twice inset_mm", length_mm - 2.0 * inset_mm)?)
}

fn cylinder(raw: &RawCylinder, place: &Within) -> Result<Geometry, PlanError> {
    let axis = place.unit("axis", raw.axis)?;
    let sector = match (raw.direction, raw.sector_deg) {
        (None, None) => None,
        (Some(direction), Some(degrees)) => {
            let half = 0.5 * place.check("sector_deg", degrees, 1.0..=360.0, "an angle of 1 … 360°")?;
            Some(Sector {
                direction: across(place, &axis, direction)?,
                cos_half: math::cos(half.to_radians()),
            })
        }
        _ => {
            return Err(place
                .refuse("direction and sector_deg go together: give both, or none for all around".into()));
        }
    };
    Ok(Geometry::Cylinder {
        point_mm: place.point("point_mm", raw.point_mm)?,
        axis,
        radius_mm: 0.5 * place.positive("diameter_mm", raw.diameter_mm)?,
        half_length_mm: half_length(place, raw.length_mm, raw.inset_mm)?,
        internal: raw.internal,
        sector,
    })
}

fn cone(raw: &RawCone, place: &Within) -> Result<Geometry, PlanError> {
    let half_angle_rad =
        place.check("half_angle_deg", raw.half_angle_deg, 0.1..=89.0, "an angle of 0.1 … 89°")?.to_radians();
    let radius_mm = 0.5 * place.positive("diameter_mm", raw.diameter_mm)?;
    let half_length_mm = half_length(place, raw.length_mm, raw.inset_mm)?;
    let narrowest = 2.0 * (radius_mm - half_length_mm * math::tan(half_angle_rad));
    place.check(
        "smaller diameter (diameter_mm less length_mm times tan half_angle_deg)",
        narrowest,
        0.0..=COORDINATE_LIMIT_MM,
        "zero or positive: the length may not reach beyond the apex",
    )?;
    Ok(Geometry::Cone {
        point_mm: place.point("point_mm", raw.point_mm)?,
        axis: place.unit("axis", raw.axis)?,
        radius_mm,
        half_angle_rad,
        half_length_mm,
        internal: raw.internal,
    })
}

fn torus(raw: &RawTorus, place: &Within) -> Result<Geometry, PlanError> {
    let ring = place.positive("ring_diameter_mm", raw.ring_diameter_mm)?;
    let tube = place.check(
        "tube_diameter_mm",
        raw.tube_diameter_mm,
        f64::MIN_POSITIVE..=ring,
        "positive and below ring_diameter_mm",
    )?;
    Ok(Geometry::Torus {
        center_mm: place.point("center_mm", raw.center_mm)?,
        axis: place.unit("axis", raw.axis)?,
        ring_radius_mm: 0.5 * ring,
        tube_radius_mm: 0.5 * tube,
    })
}

/// A direction made perpendicular to another.
fn across(place: &Within, normal: &Vector3<f64>, direction: [f64; 3]) -> Result<Vector3<f64>, PlanError> {
    edges(place, normal, Some(direction)).map(|[first, _]| first)
}

fn circle(raw: &RawCircle, place: &Within) -> Result<Geometry, PlanError> {
    let normal = place.unit("normal", raw.normal)?;
    Ok(Geometry::Outline {
        center_mm: place.point("center_mm", raw.center_mm)?,
        normal,
        edges: tangents(&normal),
        outline: Outline::Circle(0.5 * place.positive("diameter_mm", raw.diameter_mm)?),
        internal: raw.internal,
        band_mm: place.positive("band_mm", raw.band_mm)?,
        inset_mm: 0.0,
    })
}

fn oblong(raw: &RawOblong, place: &Within, round: bool) -> Result<Geometry, PlanError> {
    let normal = place.unit("normal", raw.normal)?;
    let [length, width] = raw.size_mm;
    place.positive("size_mm", width)?;
    place.check(
        "size_mm",
        length,
        width..=COORDINATE_LIMIT_MM,
        "length, then width, the length not the smaller one",
    )?;
    let (half, radius) = (0.5 * length, 0.5 * width);
    Ok(Geometry::Outline {
        center_mm: place.point("center_mm", raw.center_mm)?,
        normal,
        edges: edges(place, &normal, Some(raw.direction))?,
        outline: if round {
            Outline::Slot([half - radius, radius])
        } else {
            Outline::Rectangle([half, radius])
        },
        internal: raw.internal,
        band_mm: place.positive("band_mm", raw.band_mm)?,
        inset_mm: if round {
            0.0
        } else {
            place.check("inset_mm", raw.inset_mm, 0.0..=0.4 * width, "0 … 0.4 of the width")?
        },
    })
}

fn edge(raw: &RawEdge, place: &Within) -> Result<Geometry, PlanError> {
    let normal = place.unit("normal", raw.normal)?;
    let outward = across(place, &normal, raw.outward)?;
    // The material lies on the left of the edge's direction, seen against the normal.
    let along = normal.cross(&outward);
    Ok(Geometry::Outline {
        center_mm: place.point("point_mm", raw.point_mm)?,
        normal,
        edges: [along, normal.cross(&along)],
        outline: Outline::Edge(half_length(place, raw.length_mm, raw.inset_mm)?),
        internal: false,
        band_mm: place.positive("band_mm", raw.band_mm)?,
        inset_mm: 0.0,
    })
}

fn line(raw: &RawLine, place: &Within) -> Result<Geometry, PlanError> {
    let normal = place.unit("normal", raw.normal)?;
    Ok(Geometry::Line {
        point_mm: place.point("point_mm", raw.point_mm)?,
        direction: across(place, &normal, raw.direction)?,
        normal,
        half_size_mm: [
            half_length(place, raw.length_mm, raw.inset_mm)?,
            0.5 * place.positive("width_mm", raw.width_mm)?,
        ],
    })
}

fn surface(raw: &RawSurface, surfaces: &Surfaces, place: &Within) -> Result<Geometry, PlanError> {
    place.check(
        "max_reject_fraction",
        raw.max_reject_fraction,
        0.0..=0.0,
        "0: a profile is that of every point",
    )?;
    let mesh = surfaces.get(&raw.file).ok_or_else(|| {
        place.refuse(format!(
            "file = \"{}\" was not read: nominal geometry comes from the file beside a plan",
            raw.file
        ))
    })?;
    Ok(Geometry::Surface(NominalSurface::new(&raw.file, mesh.clone())))
}

fn surface_point(raw: &RawPoint, place: &Within) -> Result<Geometry, PlanError> {
    Ok(Geometry::Point {
        point_mm: place.point("point_mm", raw.point_mm)?,
        normal: place.unit("normal", raw.normal)?,
        radius_mm: place.positive("radius_mm", raw.radius_mm)?,
    })
}

/// Criteria that an element knows.
fn criteria(geometry: &Geometry) -> &'static [Criterion] {
    use Criterion::{LeastSquares, MaximumInscribed, MinimumCircumscribed, MinimumZone};
    match geometry.kind() {
        "sphere" | "cylinder" | "circle" => {
            &[LeastSquares, MinimumZone, MaximumInscribed, MinimumCircumscribed]
        }
        "plane" => &[LeastSquares, MinimumZone],
        _ => &[LeastSquares],
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
        let known = criteria(&geometry);
        if !known.contains(&self.criterion) {
            let known: Vec<&str> = known.iter().map(|c| c.key()).collect();
            let (criterion, kind) = (self.criterion.key(), geometry.kind());
            return Err(place.refuse(format!(
                "criterion = \"{criterion}\", a {kind} knows: {}; choose one of these",
                known.join(", ")
            )));
        }
        Ok(Element {
            name: self.name,
            criterion: self.criterion,
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
