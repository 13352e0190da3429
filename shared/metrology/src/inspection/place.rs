//! Places a plan on a cloud when the pose of the part is unknown: the cell's world frame is that of its calibration
//! (OpenCV's is the first camera), the plan's that of the part.
//!
//! The pose is searched ([`crate::register`]): the cloud on the part's CAD mesh, or, without one, places on the plan's
//! nominal elements on the cloud. It is accepted when it is the only one that matches, when the surfaces fix all six
//! motions, and when the plan then finds every one of its elements.

use nalgebra::{Isometry3, Point3, Vector3};
use std::f64::consts::TAU;
use thiserror::Error;

use super::evaluate;
use super::geometry::Geometry;
use super::plan::{Element, Plan};
use super::result::InspectionResult;
use crate::fit::tangents;
use crate::reference::{CloudError, CloudReference, Reference};
use crate::register::{
    Freedom, InitialPose, Outcome, RegisterError, RegisterSettings, Registration, register,
};
use crate::spatial::{TriangleMesh, thin_to};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;
use fringe::math;

/// Points of the cloud that the search works on: their mean spacing is a three-hundredth of the part's size.
const CLOUD_POINTS: usize = 40_000;

/// Places on the plan's elements together, and the fewest on each: small ones distinguish poses, too.
const NOMINAL_PLACES: f64 = 1600.0;
const ELEMENT_PLACES: f64 = 80.0;

/// Share of the places (of the cloud, with CAD) that must match. Shadows hide a part of most elements.
const LEAST_OVERLAP: f64 = 0.5;

/// Why a plan is not placed.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum PlaceError {
    /// The cloud is none.
    #[error(transparent)]
    Cloud(#[from] CloudError),
    /// No pose of the part matches the cloud.
    #[error("no pose of the part matches the cloud: {0}")]
    NoPose(RegisterError),
    /// Several poses match the cloud equally well.
    #[error(
        "the pose is not unique: another one matches {share_percent:.1} % as many places; give the CAD (--cad), name more \
         elements in the plan, or give a start (--start)"
    )]
    Ambiguous {
        /// Its matches over those of the best one, %.
        share_percent: f64,
    },
    /// A motion is left open.
    #[error(
        "the surfaces do not fix the pose: {motions} stays open; give the CAD (--cad), or name elements in the plan that \
         fix it"
    )]
    Open {
        /// The motions in words.
        motions: String,
    },
    /// The search did not come to rest.
    #[error(
        "the alignment did not converge: it still moves by {moved_mm:.1e} mm a round; give a start nearer by (--start)"
    )]
    NotConverged {
        /// Motion of the last round.
        moved_mm: f64,
    },
    /// The plan does not find its elements there.
    #[error("the plan does not fit the cloud at the pose found: {reasons}")]
    Elements {
        /// The reason for each element that is not found.
        reasons: String,
    },
}

/// A plan with the pose of its part.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    /// Where the part lies.
    pub world_from_part: Isometry3<f64>,
    /// How well that is known; with CAD the motion of the cloud, otherwise that of the plan.
    pub registration: Registration,
    /// What the plan gives on this cloud, placed so.
    pub inspection: InspectionResult,
}

/// Finds where the part of a plan lies in a cloud.
///
/// # Errors
/// See [`PlaceError`].
pub fn place(
    plan: &Plan,
    cloud: &[Point],
    cad: Option<TriangleMesh>,
    initial: &InitialPose,
) -> Result<Placement, PlaceError> {
    let positions: Vec<Point3<f64>> = cloud.iter().map(Point::position).collect();
    let thin: Vec<Point> = thin_to(&positions, CLOUD_POINTS).into_iter().map(|i| cloud[i as usize]).collect();
    let settings = RegisterSettings { least_overlap: LEAST_OVERLAP, ..RegisterSettings::default() };
    let with_cad = cad.is_some();
    let (points, reference) = if let Some(mesh) = cad {
        (thin, Reference::Mesh(mesh))
    } else {
        let surface = CloudReference::new(&thin, Vector3::z(), None)?.with_normals();
        (nominal_places(plan), Reference::Cloud(surface))
    };
    // A start states where the part lies; the alignment with CAD moves the cloud to the part.
    let initial = match initial {
        InitialPose::Given(pose) if with_cad => InitialPose::Given(pose.inverse()),
        other => *other,
    };
    let found = register(&points, &reference, &initial, &settings).map_err(|error| match error {
        RegisterError::Cloud(error) => PlaceError::Cloud(error),
        other => PlaceError::NoPose(other),
    })?;
    unique(&found)?;
    let pose = found.pose();
    let mut world_from_part = (if with_cad { pose.inverse() } else { pose }).isometry();
    let mut placed = Plan { world_from_part, ..plan.clone() };
    let mut inspection = evaluate(&placed, cloud);
    // Where the plan has datums, they say where the part lies.
    if let Some(alignment) = &inspection.alignment
        && plan.datums.is_some()
    {
        let rotation = nalgebra::Matrix3::from_fn(|r, c| alignment.rotation[r][c]);
        let translation = Vector3::from(alignment.translation_mm);
        world_from_part = Pose { rotation, translation }.isometry();
        placed.world_from_part = world_from_part;
        inspection = evaluate(&placed, cloud);
    }
    all_found(&inspection)?;
    Ok(Placement { world_from_part, registration: found, inspection })
}

/// Refuses an alignment that leaves a choice.
fn unique(found: &Registration) -> Result<(), PlaceError> {
    if !found.undetermined.is_empty() {
        let motions: Vec<String> = found.undetermined.iter().map(Freedom::describe).collect();
        return Err(PlaceError::Open { motions: motions.join(", ") });
    }
    match found.outcome {
        Outcome::Ambiguous => {
            Err(PlaceError::Ambiguous { share_percent: 100.0 * found.rival.unwrap_or(1.0) })
        }
        Outcome::NotConverged => Err(PlaceError::NotConverged { moved_mm: found.last_motion_mm }),
        Outcome::Aligned | Outcome::Undetermined => Ok(()),
    }
}

/// Refuses a pose at which the plan cannot measure what it names.
fn all_found(inspection: &InspectionResult) -> Result<(), PlaceError> {
    let alignment = inspection.alignment_failure.iter().cloned();
    let elements = inspection.elements.iter().filter_map(|e| e.reason.clone());
    let features = inspection.features.iter().filter(|f| f.verdict.is_none());
    let features =
        features.map(|f| format!("feature {}: {}", f.name, f.reason.as_deref().unwrap_or("not measured")));
    let mut reasons: Vec<String> = alignment.collect();
    if reasons.is_empty() {
        reasons = elements.collect();
    }
    if reasons.is_empty() {
        reasons = features.collect();
    }
    if reasons.is_empty() { Ok(()) } else { Err(PlaceError::Elements { reasons: reasons.join("; ") }) }
}

/// Places on the nominal elements, with their normals.
fn nominal_places(plan: &Plan) -> Vec<Point> {
    let areas: Vec<f64> = plan.elements.iter().map(area_mm2).collect();
    let whole: f64 = areas.iter().sum();
    let of = |(element, area): (&Element, &f64)| {
        let wanted = (NOMINAL_PLACES * area / whole).max(ELEMENT_PLACES);
        places(&element.geometry, (area / wanted).sqrt())
    };
    plan.elements.iter().zip(&areas).flat_map(of).collect()
}

/// Area of an element's region, what is cut out of it included.
fn area_mm2(element: &Element) -> f64 {
    match &element.geometry {
        Geometry::Plane { half_size_mm: [a, b], .. } | Geometry::Line { half_size_mm: [a, b], .. } => {
            4.0 * a * b
        }
        Geometry::Sphere { radius_mm, cos_polar: [low, high], .. } => {
            TAU * radius_mm * radius_mm * (high - low)
        }
        Geometry::Cylinder { radius_mm, half_length_mm, .. }
        | Geometry::Cone { radius_mm, half_length_mm, .. } => 2.0 * TAU * radius_mm * half_length_mm,
        Geometry::Torus { ring_radius_mm, tube_radius_mm, .. } => TAU * ring_radius_mm * TAU * tube_radius_mm,
        Geometry::Point { radius_mm, .. } => 0.5 * TAU * radius_mm * radius_mm,
        Geometry::Outline { outline, band_mm, .. } => outline.length_mm() * band_mm,
        Geometry::Surface(surface) => surface.area_mm2(),
    }
}

/// Places one step apart.
fn places(geometry: &Geometry, step_mm: f64) -> Vec<Point> {
    let point = |place: Vector3<f64>, normal: Vector3<f64>| Point {
        position_mm: place.into(),
        normal: normal.map(|v| v as f32).into(),
        ..bytemuck::Zeroable::zeroed()
    };
    match geometry {
        Geometry::Plane { point_mm, normal, edges, half_size_mm, exclusions } => {
            let axis = |half: f64| {
                let count = (2.0 * half / step_mm).ceil().max(1.0);
                (0..count as usize).map(move |i| half * ((2 * i + 1) as f64 / count - 1.0))
            };
            let [a, b] = *half_size_mm;
            axis(a)
                .flat_map(|x| axis(b).map(move |y| [x, y]))
                .filter(|across| !exclusions.iter().any(|e| e.covers(*across)))
                .map(|[x, y]| point(point_mm.coords + edges[0] * x + edges[1] * y, *normal))
                .collect()
        }
        Geometry::Sphere { center_mm, radius_mm, axis, cos_polar: [low, high] } => {
            let count = (TAU * radius_mm * radius_mm * (high - low) / (step_mm * step_mm)).ceil().max(1.0);
            let [x, y] = tangents(axis);
            // Equal steps of height hold equal areas; the golden angle spreads them around.
            (0..count as usize)
                .map(|i| {
                    let cosine = low + (high - low) * (i as f64 + 0.5) / count;
                    let (sine, around) =
                        ((1.0 - cosine * cosine).max(0.0).sqrt(), i as f64 * 2.399_963_229_728_653);
                    let (s, c) = math::sincos(around);
                    let normal = axis * cosine + (x * c + y * s) * sine;
                    point(center_mm.coords + normal * *radius_mm, normal)
                })
                .collect()
        }
        Geometry::Cylinder { point_mm, axis, half_length_mm, sector, .. } => {
            let held =
                |normal: &Vector3<f64>| sector.is_none_or(|s| normal.dot(&s.direction).abs() >= s.cos_half);
            around(geometry, (&point_mm.coords, axis), *half_length_mm, step_mm, &point)
                .into_iter()
                .filter(|p| held(&p.normal_vector()))
                .collect()
        }
        Geometry::Cone { point_mm, axis, half_length_mm, .. } => {
            around(geometry, (&point_mm.coords, axis), *half_length_mm, step_mm, &point)
        }
        Geometry::Surface(surface) => {
            surface.places(step_mm).into_iter().map(|(place, normal)| point(place, normal)).collect()
        }
        // What is small or open on most sides does not help to find a part.
        Geometry::Torus { .. }
        | Geometry::Outline { .. }
        | Geometry::Line { .. }
        | Geometry::Point { .. } => Vec::new(),
    }
}

/// Places on a cylinder or cone, one step apart around and along it.
fn around(
    geometry: &Geometry,
    (middle, axis): (&Vector3<f64>, &Vector3<f64>),
    half_mm: f64,
    step_mm: f64,
    point: &dyn Fn(Vector3<f64>, Vector3<f64>) -> Point,
) -> Vec<Point> {
    let [x, y] = tangents(axis);
    let rings = (2.0 * half_mm / step_mm).ceil().max(1.0);
    let mut places = Vec::new();
    for ring in 0..rings as usize {
        let height = half_mm * ((2 * ring + 1) as f64 / rings - 1.0);
        let radius = match geometry {
            Geometry::Cone { radius_mm, half_angle_rad, .. } => {
                radius_mm + height * math::tan(*half_angle_rad)
            }
            Geometry::Cylinder { radius_mm, .. } => *radius_mm,
            _ => 0.0,
        };
        let count = (TAU * radius / step_mm).ceil().max(3.0);
        for i in 0..count as usize {
            let (sin, cos) = math::sincos(TAU * i as f64 / count);
            let place = middle + axis * height + (x * cos + y * sin) * radius;
            places.push(point(place, geometry.normal_at(&place)));
        }
    }
    places
}
