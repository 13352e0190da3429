//! Finds the part in the cloud: 3-2-1 on datum elements, coarse to fine.
//!
//! The coarse search fits the datum elements on a thinned cloud, in regions that begin `search_mm` wide and halve with
//! each round: points of other surfaces and outliers drop out as the region closes, without any random choice. The fine
//! rounds use the plan's own margins and free diameters, until the pose stands still.

use crate::spread::Spread;
use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use super::MeasureError;
use super::fit_element::{PLACING_POINTS, REACH_MARGINS, fit, placing, thinned};
use super::fitted_element::FittedElement;
use super::gather::gather;
use super::geometry::Geometry;
use super::plan::{Datums, Element, Plan};
use super::region::Region;
use super::result::AlignmentResult;
use crate::fit::{FitSettings, plane, sphere_centre_near};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;

/// Points that the coarse search looks at.
const COARSE_POINTS: usize = 60_000;

/// Fewest points of a datum element in the coarse search: enough for a place to within the next round's margin.
const COARSE_LEAST: usize = 20;

/// Points near a datum element up to which the fine rounds take them all: what is fitted to it later then lies where the datums say, to the last digits.
const FINE_WHOLE: usize = 20_000;

/// So many points of a larger one: where most are its own, the pose is known to a hundredth of their scatter.
const FINE_POINTS: usize = 10_000;

/// Most fine rounds, and the motion of the datum points below which the pose stands still, mm. Without a change of the
/// points chosen the second fine round moves by rounding only.
const FINE_ROUNDS: usize = 12;
const STILL_MM: f64 = 1e-4;

/// Where datums are: nominal, or measured.
#[derive(Debug, Clone, Copy)]
struct DatumPlaces {
    normal: Vector3<f64>,
    plane_point: Vector3<f64>,
    line: [Vector3<f64>; 2],
    origin: Vector3<f64>,
}

impl DatumPlaces {
    /// Datum targets at their nominal geometry.
    fn nominal(plan: &Plan, datums: &Datums) -> Self {
        let place = |index: usize| plan.elements[index].geometry.place().coords;
        let normal = match &plan.elements[datums.plane].geometry {
            Geometry::Plane { normal, .. } => *normal,
            // The plan's check lets nothing but a plane through.
            _ => Vector3::z(),
        };
        Self {
            normal,
            plane_point: place(datums.plane),
            line: datums.line.map(place),
            origin: place(datums.origin),
        }
    }

    /// The frame of the datums: x along the line across the normal, z the normal, origin the foot of the origin
    /// sphere's centre on the plane. `None` when the line runs along the normal.
    fn frame(&self) -> Option<Pose> {
        let z = self.normal;
        let along = self.line[1] - self.line[0];
        let across = along - z * along.dot(&z);
        let length = across.norm();
        if length <= 0.05 * along.norm() || !length.is_finite() {
            return None;
        }
        let x = across / length;
        let rotation = Matrix3::from_columns(&[x, z.cross(&x), z]);
        let translation = self.origin - z * z.dot(&(self.origin - self.plane_point));
        Some(Pose { rotation, translation })
    }

    /// Distance of the spheres of the line, mm.
    fn length_mm(&self) -> f64 {
        (self.line[1] - self.line[0]).norm()
    }
}

/// The pose of the part as found on its datums.
pub(super) struct PlacedPart {
    pub world_from_part: Pose,
    pub result: AlignmentResult,
}

/// Finds the part.
///
/// # Errors
/// Names the datum element that was not found, or states why the pose is not that of the part.
pub(super) fn align(plan: &Plan, datums: &Datums, cloud: &[Point]) -> Result<PlacedPart, MeasureError> {
    let nominal = DatumPlaces::nominal(plan, datums);
    let placed = Pose::new(&plan.world_from_part);
    let coarse = search(plan, datums, &nominal, placed, cloud)?;
    let indices = element_indices(datums);
    let regions: Vec<Region> = indices
        .iter()
        .map(|i| Region::new(&plan.elements[*i], REACH_MARGINS * plan.elements[*i].margin_mm, 0.0))
        .collect();
    let gathered = gather(cloud, &coarse.inverse(), &regions);
    let mut world_from_part = coarse;
    let mut moved_mm = f64::INFINITY;
    for round in 1..=FINE_ROUNDS {
        let part_from_coarse = world_from_part.inverse().after(&coarse);
        let found = find_datums(datums, &indices, &nominal, &|slot| {
            let element = &plan.elements[indices[slot]];
            let region = Region::new(element, element.margin_mm, 0.0);
            let near = &gathered[slot];
            let most = if near.len() <= FINE_WHOLE { FINE_WHOLE } else { FINE_POINTS };
            let limits = (element.min_points, most);
            let thin = thinned(element, &region, (near, Some(&part_from_coarse)), limits)?;
            fit(element, &thin, &placing(element)).map(Place::from)
        })?;
        let correction = correction(&nominal, &found)?;
        world_from_part = world_from_part.after(&correction);
        moved_mm = motion_mm(plan, datums, &correction);
        if moved_mm <= STILL_MM {
            return finish(plan, datums, world_from_part, found.length_mm() - nominal.length_mm(), round);
        }
    }
    Err(MeasureError::Unsettled { moved_mm, rounds: FINE_ROUNDS, limit_mm: STILL_MM })
}

/// Checks the pose against what the plan allows.
fn finish(
    plan: &Plan,
    datums: &Datums,
    world_from_part: Pose,
    line_residual_mm: f64,
    rounds: usize,
) -> Result<PlacedPart, MeasureError> {
    let limit_mm: f64 = datums.line.iter().map(|i| plan.elements[*i].margin_mm).sum();
    if line_residual_mm.abs() > limit_mm {
        let nominal_mm = DatumPlaces::nominal(plan, datums).length_mm();
        return Err(MeasureError::WrongPart {
            measured_mm: nominal_mm + line_residual_mm,
            nominal_mm,
            limit_mm,
        });
    }
    let shift = Pose::new(&plan.world_from_part).inverse().after(&world_from_part);
    let (offset_mm, angle_rad) = (motion_mm(plan, datums, &shift), shift.angle_rad());
    if offset_mm > datums.search_mm || angle_rad > datums.search_rad {
        return Err(MeasureError::OutOfReach {
            offset_mm,
            angle_deg: angle_rad.to_degrees(),
            limit_mm: datums.search_mm,
            limit_deg: datums.search_rad.to_degrees(),
        });
    }
    let result = describe(&world_from_part, offset_mm, angle_rad, line_residual_mm, rounds);
    Ok(PlacedPart { world_from_part, result })
}

/// A pose as it is reported.
pub(super) fn describe(
    world_from_part: &Pose,
    offset_mm: f64,
    angle_rad: f64,
    line_residual_mm: f64,
    rounds: usize,
) -> AlignmentResult {
    AlignmentResult {
        rotation: world_from_part.rotation.transpose().into(),
        translation_mm: world_from_part.translation.into(),
        offset_mm,
        angle_deg: angle_rad.to_degrees(),
        line_residual_mm,
        rounds,
    }
}

/// The coarse search on a thinned cloud.
fn search(
    plan: &Plan,
    datums: &Datums,
    nominal: &DatumPlaces,
    placed: Pose,
    cloud: &[Point],
) -> Result<Pose, MeasureError> {
    let spread = Spread::of(cloud.len(), COARSE_POINTS);
    // Each round looks at them: side by side they are read once from a cloud that no cache holds.
    let chosen: Vec<usize> = spread.indices().collect();
    let coarse: Vec<Point> = chosen.into_par_iter().map(|index| cloud[index]).collect();
    let indices = element_indices(datums);
    let narrowest = indices.iter().map(|i| plan.elements[*i].margin_mm).fold(f64::INFINITY, f64::min);
    let mut pose = placed;
    let mut margin_mm = datums.search_mm;
    loop {
        let widen_rad = datums.search_rad * (margin_mm / datums.search_mm);
        let regions: Vec<Region> = indices
            .iter()
            .map(|i| &plan.elements[*i])
            .map(|e| Region::new(e, margin_mm.max(e.margin_mm), widen_rad))
            .collect();
        let nearby = gather(&coarse, &pose.inverse(), &regions);
        let found = find_datums(datums, &indices, nominal, &|slot| {
            let element = &plan.elements[indices[slot]];
            let needs = (element.min_points / spread.stretch()).max(COARSE_LEAST);
            let few = thinned(element, &regions[slot], (&nearby[slot], None), (needs, PLACING_POINTS))?;
            coarse_place(element, &few)
        })?;
        pose = pose.after(&correction(nominal, &found)?);
        if margin_mm <= narrowest {
            return Ok(pose);
        }
        margin_mm *= 0.5;
    }
}

/// A datum element as seen: centre of a sphere, or plane.
enum Place {
    Centre(Vector3<f64>),
    Plane { normal: Vector3<f64>, point: Vector3<f64> },
}

impl From<FittedElement> for Place {
    fn from(fit: FittedElement) -> Self {
        match fit {
            FittedElement::Plane(plane) => {
                Self::Plane { normal: plane.normal_vector(), point: Vector3::from(plane.centroid_mm) }
            }
            other => Self::Centre(other.place()),
        }
    }
}

/// Place of a datum element on coarse points: spheres with their nominal diameter, so that dirt in the region cannot
/// blow them up.
fn coarse_place(element: &Element, points: &[Point3<f64>]) -> Result<Place, MeasureError> {
    match &element.geometry {
        Geometry::Sphere { center_mm, radius_mm, .. } => {
            sphere_centre_near(points, 2.0 * radius_mm, center_mm).map(|center| Place::Centre(center.coords))
        }
        Geometry::Plane { normal, .. } => {
            let settings = FitSettings::default();
            plane(points, &settings).map(|fit| FittedElement::Plane(fit.towards(normal)).into())
        }
        // The plan's check lets nothing but spheres and planes through.
        other => Ok(Place::Centre(other.place().coords)),
    }
    .map_err(|source| MeasureError::Fit { element: element.name.clone(), source })
}

/// Elements of the datums: plane, line, origin.
fn element_indices(datums: &Datums) -> [usize; 4] {
    [datums.plane, datums.line[0], datums.line[1], datums.origin]
}

/// Looks for all datums, side by side; an element that serves twice is fitted once.
fn find_datums(
    datums: &Datums,
    indices: &[usize; 4],
    nominal: &DatumPlaces,
    place: &(impl Fn(usize) -> Result<Place, MeasureError> + Sync),
) -> Result<DatumPlaces, MeasureError> {
    let mut found = *nominal;
    let earlier = |slot: usize| indices[..slot].iter().position(|i| *i == indices[slot]);
    let new = |slot: usize| !(slot == 3 && earlier(slot).is_some());
    let mut places = [None, None, None, None];
    places.par_iter_mut().enumerate().for_each(|(slot, found)| *found = new(slot).then(|| place(slot)));
    for (slot, place) in places.into_iter().enumerate() {
        match place {
            None => found.origin = found.line[earlier(slot).unwrap_or(1) - 1],
            Some(place) => match place? {
                Place::Plane { normal, point } => (found.normal, found.plane_point) = (normal, point),
                Place::Centre(center) if slot == 3 => found.origin = center,
                Place::Centre(center) => found.line[slot - 1] = center,
            },
        }
    }
    debug_assert!(datums.line[0] != datums.line[1]);
    Ok(found)
}

/// The motion that brings the nominal datums onto the measured ones.
fn correction(nominal: &DatumPlaces, measured: &DatumPlaces) -> Result<Pose, MeasureError> {
    match (measured.frame(), nominal.frame()) {
        (Some(measured), Some(nominal)) => Ok(measured.after(&nominal.inverse())),
        _ => Err(MeasureError::WrongPart {
            measured_mm: measured.length_mm(),
            nominal_mm: nominal.length_mm(),
            limit_mm: 0.0,
        }),
    }
}

/// Largest motion of the datum spheres' centres and the datum plane's corners, mm.
fn motion_mm(plan: &Plan, datums: &Datums, motion: &Pose) -> f64 {
    let moved = |p: &Vector3<f64>| (motion.point(p) - p).norm();
    element_indices(datums).iter().map(|i| &plan.elements[*i].geometry).fold(0.0, |most: f64, g| match g {
        Geometry::Sphere { center_mm, .. } => most.max(moved(&center_mm.coords)),
        Geometry::Plane { point_mm, edges, half_size_mm, .. } => {
            let [a, b] = [edges[0] * half_size_mm[0], edges[1] * half_size_mm[1]];
            [a + b, a - b, -a + b, -a - b].iter().fold(most, |m, arm| m.max(moved(&(point_mm.coords + arm))))
        }
        other => most.max(moved(&other.place().coords)),
    })
}
