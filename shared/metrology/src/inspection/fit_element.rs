//! Fits one element on its region of the cloud.

use crate::spread::Spread;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeSet;

use super::MeasureError;
use super::associate::{associated, outlined};
use super::beyond;
use super::filter::{Across, Filtered, filtered};
use super::fitted_element::FittedElement;
use super::gather::Nearby;
use super::geometry::Geometry;
use super::nominal_surface::SurfaceFit;
use super::plan::Element;
use super::region::Region;
use super::result::DeviationPoint;
use super::shift::shift_mm;
use super::sight;
use super::stretch::{STRETCH, Stretch};
use crate::fit::{self, Correlation, FitError, FitSettings, LeftOut};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;
use fringe::geometry::viewpoint::Viewpoints;
use fringe::math;

/// Candidates are gathered, and elements are allowed to lie, within this many margins of their nominal place.
pub(super) const REACH_MARGINS: f64 = 2.0;

/// A surface whose residuals scatter by more than this part of the margin is none: points spread evenly over the
/// region would have 0.58, and valid ones stay below a tenth.
const LARGEST_SCATTER: f64 = 0.35;

/// Rounds in which region and fit follow each other, and the motion, in margins, below which the region stands still.
/// Its border is many sigma away from the surface, so a hundredth of the margin changes next to no point.
const ROUNDS: usize = 6;
const STILL_MARGINS: f64 = 0.01;

/// Points from which a region is placed: they give the surface to a fiftieth of their scatter, which is a twentieth of
/// the margin at most.
pub(super) const PLACING_POINTS: usize = 4000;

/// Fewest points that thinning may leave.
const THINNED_LEAST: usize = 500;

const NOT_FINITE: &str = "its values or their uncertainties are not finite";

/// A fitted element with its points.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    pub fit: FittedElement,
    pub points: Vec<DeviationPoint>,
    /// The flatness of a plane after each filter that was asked for, with the filter's edge, mm; why there is none, where there is none.
    pub filtered: Vec<(f64, Result<Filtered, MeasureError>)>,
    /// Points of the cloud over the element that face its way, but lie beyond its margin, by their numbers.
    pub beside: Vec<u32>,
    /// Points behind the fit in the part frame; of an outline those of its border.
    pub positions: Vec<Point3<f64>>,
    /// Root mean square of the errors that the points may have in common, mm; of an outline with that of how far out its sides lie.
    pub shared_mm: f64,
}

impl Measured {
    /// What errors in common do to a range of the points, or to twice their largest deviation, mm: at worst both ends err alike, away
    /// from each other.
    pub fn u_range_shared_mm(&self) -> f64 {
        2.0 * self.shared_mm
    }
}

/// The points near a region that belong to it, in the order of the cloud.
#[derive(Debug)]
pub(super) struct Chosen {
    /// In the part frame.
    pub positions: Vec<Point3<f64>>,
    /// Which of the points near the region they are.
    pub places: Vec<u32>,
    /// Standard uncertainty that the cloud states, and what of it may be in common with others, mm.
    sigmas_mm: Vec<f32>,
    shared_mm: Vec<f32>,
    /// Numbers in the cloud of those beside the region (see [`beyond`]).
    beside: Vec<u32>,
}

impl Chosen {
    fn with_capacity(count: usize) -> Self {
        Self {
            positions: Vec::with_capacity(count),
            places: Vec::with_capacity(count),
            sigmas_mm: Vec::with_capacity(count),
            shared_mm: Vec::with_capacity(count),
            beside: Vec::new(),
        }
    }

    fn push(&mut self, place: usize, position: Vector3<f64>, point: &Point) {
        self.positions.push(Point3::from(position));
        self.places.push(place as u32);
        self.sigmas_mm.push(point.sigma_mm);
        self.shared_mm.push(point.shared_mm);
    }
}

impl Chosen {
    /// Keeps those of the points that are marked.
    fn retain(&mut self, kept: &[bool]) {
        fn keep<T>(values: &mut Vec<T>, kept: &[bool]) {
            let mut kept = kept.iter();
            values.retain(|_| *kept.next().unwrap_or(&true));
        }
        keep(&mut self.positions, kept);
        keep(&mut self.places, kept);
        keep(&mut self.sigmas_mm, kept);
        keep(&mut self.shared_mm, kept);
    }
}

/// The points that belong to a region, after a motion.
///
/// # Errors
/// Fewer than `needs`.
pub(super) fn choose(
    element: &Element,
    region: &Region,
    (nearby, motion): (&Nearby, Option<&Pose>),
    needs: usize,
) -> Result<Chosen, MeasureError> {
    let mut chosen = Chosen::with_capacity(nearby.len());
    let mut without_normals = 0;
    let mut stretch = Stretch::new();
    let wide = beyond::reach(region).filter(|_| motion.is_none());
    for (first, numbers) in (0..).step_by(STRETCH).zip(nearby.numbers().chunks(STRETCH)) {
        let held = nearby.each_held(region, (numbers, motion), &mut stretch, |k, position, point| {
            chosen.push(first + k, position, point);
        });
        let count = held.count_ones() as usize;
        without_normals += count;
        if let Some(wide) = wide.as_ref().filter(|_| count < numbers.len()) {
            nearby.each_beside(wide, (numbers, held), &mut stretch, |number| chosen.beside.push(number));
        }
    }
    if chosen.positions.len() >= needs {
        return Ok(chosen);
    }
    let (element, points) = (element.name.clone(), chosen.positions.len());
    Err(MeasureError::TooFewPoints { element, points, without_normals, needs })
}

/// Refuses points of which too few differ: a fit through the others would leave no residual, and seem exact.
fn refuse_copies(element: &Element, given: &[Point3<f64>]) -> Result<(), MeasureError> {
    let needs = element.min_points;
    let mut places = BTreeSet::new();
    for point in given {
        places.insert([point.x, point.y, point.z].map(f64::to_bits));
        if places.len() >= needs {
            return Ok(());
        }
    }
    Err(MeasureError::Repeated { element: element.name.clone(), places: places.len(), needs })
}

/// Fits an element on points given in the part frame.
///
/// # Errors
/// The fit's, with the element's name.
pub(super) fn fit(
    element: &Element,
    points: &[Point3<f64>],
    settings: &FitSettings,
) -> Result<FittedElement, MeasureError> {
    match &element.geometry {
        Geometry::Sphere { .. } => fit::sphere(points, settings).map(FittedElement::Sphere),
        Geometry::Plane { normal, .. } => {
            fit::plane(points, settings).map(|plane| FittedElement::Plane(plane.towards(normal)))
        }
        Geometry::Cylinder { .. } => fit::cylinder(points, settings).map(FittedElement::Cylinder),
        Geometry::Cone { .. } => fit::cone(points, settings).map(FittedElement::Cone),
        Geometry::Torus { .. } => fit::torus(points, settings).map(FittedElement::Torus),
        Geometry::Point { point_mm, normal, .. } => {
            fit::surface_point(points, point_mm, normal, settings).map(FittedElement::Point)
        }
        Geometry::Surface(surface) => Ok(FittedElement::Surface(SurfaceFit::new(surface, points))),
        Geometry::Outline { .. } | Geometry::Line { .. } => {
            outlined(element, points, settings).map(|found| found.0)
        }
    }
    .map_err(|source| MeasureError::Fit { element: element.name.clone(), source })
}

/// Fits an element on its candidates: region about the nominal geometry, then about rough fits until it stands still. Of a plane the
/// flatness after filters of these edges, mm, too: here other elements are still fitted beside it. `rims_left_out_px`: what the cloud lacks at the rims of faces;
/// `viewpoints`: whence each pair saw it, in the frame of the cloud.
///
/// # Errors
/// Too few points, no surface, too far from nominal, no fit.
pub(super) fn measure(
    element: &Element,
    nearby: &Nearby,
    correlation: Correlation,
    filters_mm: &[f64],
    (rims_left_out_px, viewpoints): (Option<u32>, &[Option<Viewpoints>]),
) -> Result<Measured, MeasureError> {
    let nominal = Region::new(element, element.margin_mm, 0.0);
    let mut region = nominal.clone();
    for _ in 0..ROUNDS {
        let thin = thinned(element, &region, (nearby, None), (element.min_points, PLACING_POINTS))?;
        let rough = fit(element, &thin, &placing(element))?;
        check(element, &rough)?;
        let moved_mm = shift_mm(&region.geometry, &rough);
        region = about(&nominal, &rough);
        if moved_mm <= STILL_MARGINS * element.margin_mm {
            break;
        }
    }
    let mut chosen = choose(element, &region, (nearby, None), element.min_points)?;
    if let Some(clear) =
        sight::clear_of_limbs(nearby, &chosen, &region.geometry, viewpoints, element.min_points)
    {
        chosen.retain(&clear);
    }
    refuse_copies(element, &chosen.positions)?;
    let across = if filters_mm.is_empty() { Vec::new() } else { across(&nominal, &chosen) };
    let mut shared_mm = std::mem::take(&mut chosen.shared_mm);
    if shared_mm.iter().all(|shared| *shared == 0.0) {
        // As a rule.
        shared_mm.clear();
    }
    let max_reject_fraction = element.max_reject_fraction;
    let left_out = rims_left_out_px.filter(|_| element.geometry.is_outlined());
    let left_out = left_out.map(|pixels| LeftOut { pixels, layers: nearby.layers(&chosen.places) });
    let noise = sight::noise(nearby, &chosen, viewpoints);
    let (shared, noise) = (&shared_mm[..], &noise[..]);
    let settings =
        FitSettings { max_reject_fraction, correlation, shared_mm: shared, noise, within_mm: None, left_out };
    let fitted = fit(element, &chosen.positions, &settings)?;
    let given = std::mem::take(&mut chosen.positions);
    // Behind an outline lie the points of its border.
    let surface = element.geometry.is_outlined().then(|| given.clone());
    let (found, behind) = associated(element, given, fitted, &settings)?;
    check(element, &found)?;
    if !found.is_finite() {
        let source = FitError::Degenerate { element: element.geometry.kind(), why: NOT_FINITE };
        return Err(MeasureError::Fit { element: element.name.clone(), source });
    }
    let numbers = chosen.places.iter().map(|place| nearby.numbers()[*place as usize]);
    let points = deviations(&nominal, &found, numbers, surface.as_ref().unwrap_or(&behind));
    let of_edge = |edge: &f64| (*edge, filtered(&across, &found.residuals().deviation_mm, *edge));
    let filtered = filters_mm.iter().map(of_edge).collect();
    let shared_mm = math::hypot(rms(&shared_mm), found.u_rim_mm());
    Ok(Measured { fit: found, points, filtered, beside: chosen.beside, positions: behind, shared_mm })
}

/// Root mean square of the errors that points may have in common, as far as it counts: what an extreme of the element may be off by. Not the
/// largest: noise raises some points, and just those at its extremes.
pub(super) fn rms(shared_mm: &[f32]) -> f64 {
    let squares: f64 = shared_mm.iter().map(|shared| f64::from(*shared).powi(2)).sum();
    fit::beyond_noise(shared_mm) * (squares / shared_mm.len().max(1) as f64).sqrt()
}

/// How rough fits are made, which place a region; their uncertainties are not used.
pub(super) fn placing(element: &Element) -> FitSettings<'static> {
    FitSettings { max_reject_fraction: element.max_reject_fraction, ..FitSettings::default() }
}

/// Positions of the points that belong to a region, after a motion, among some of those near it, so many that `most` of all these remain.
/// The choice hangs on the points' own places, so that a point that joins or leaves changes nothing but itself.
///
/// # Errors
/// Fewer than `needs` of all points belong to the region.
pub(super) fn thinned(
    element: &Element,
    region: &Region,
    (nearby, motion): (&Nearby, Option<&Pose>),
    (needs, most): (usize, usize),
) -> Result<Vec<Point3<f64>>, MeasureError> {
    let spread = Spread::of(nearby.len(), most);
    let numbers: Vec<u32> = spread.indices().map(|place| nearby.numbers()[place]).collect();
    let mut thin = Vec::with_capacity(numbers.len());
    let mut stretch = Stretch::new();
    for numbers in numbers.chunks(STRETCH) {
        nearby.each_held(region, (numbers, motion), &mut stretch, |_, position, _| {
            thin.push(Point3::from(position));
        });
    }
    // Counted only as far as it must be.
    let mut enough = || {
        let mut count = 0;
        nearby.numbers().chunks(STRETCH).any(|numbers| {
            nearby.each_held(region, (numbers, motion), &mut stretch, |_, _, _| count += 1);
            count >= needs
        })
    };
    if thin.len() >= THINNED_LEAST && (thin.len() >= needs || enough()) {
        return Ok(thin);
    }
    // Where most points are clutter, few of the chosen would be left: then all of them are affordable.
    let Chosen { positions, places, .. } = choose(element, region, (nearby, motion), needs)?;
    let every = places.iter().zip(&positions).filter(|(place, _)| spread.holds(**place as usize));
    let thin: Vec<Point3<f64>> = every.map(|(_, position)| *position).collect();
    Ok(if thin.len() < THINNED_LEAST { positions } else { thin })
}

/// The region about a fit.
pub(super) fn about(region: &Region, fit: &FittedElement) -> Region {
    region.clone().about(fit)
}

/// Refuses a fit that is no surface, or that lies where the element cannot be.
fn check(element: &Element, fit: &FittedElement) -> Result<(), MeasureError> {
    let sigma_mm = fit.form().form_sigma_mm;
    let shift_mm = shift_mm(&element.geometry, fit);
    let (margin_mm, name) = (element.margin_mm, || element.name.clone());
    // Border points scatter by the spacing of the cloud, which has nothing to do with the margin.
    let margin_mm = match &element.geometry {
        Geometry::Outline { band_mm, .. } => band_mm.max(margin_mm),
        _ => margin_mm,
    };
    let limit_mm = LARGEST_SCATTER * margin_mm;
    if sigma_mm > limit_mm {
        return Err(MeasureError::Scattered { element: name(), sigma_mm, margin_mm, limit_mm });
    }
    let limit_mm = REACH_MARGINS * margin_mm;
    if shift_mm > limit_mm {
        return Err(MeasureError::Displaced { element: name(), shift_mm, limit_mm });
    }
    Ok(())
}

/// Places of the chosen points in a plane; empty for a sphere.
fn across(nominal: &Region, chosen: &Chosen) -> Vec<Across> {
    let Geometry::Plane { point_mm, edges, .. } = &nominal.geometry else { return Vec::new() };
    let across = |(position, sigma_mm): (&Point3<f64>, &f32)| {
        let arm = position - point_mm;
        Across { place_mm: edges.map(|edge| edge.dot(&arm)), sigma_mm: *sigma_mm }
    };
    chosen.positions.iter().zip(&chosen.sigmas_mm).map(across).collect()
}

/// Deviations of points from the fit and from the nominal geometry; with their numbers in the cloud.
fn deviations(
    nominal: &Region,
    fit: &FittedElement,
    numbers: impl Iterator<Item = u32>,
    positions: &[Point3<f64>],
) -> Vec<DeviationPoint> {
    let bore = nominal.geometry.is_internal();
    // Of a sphere, plane or freeform surface the residuals; the others' sign and reference are those of the surface they bound.
    let residuals = &fit.residuals().deviation_mm;
    let direct =
        matches!(fit, FittedElement::Sphere(_) | FittedElement::Plane(_) | FittedElement::Surface(_));
    let from_fit = |place: usize, position: &Vector3<f64>| {
        if direct {
            return residuals[place];
        }
        let distance = fit.distance_mm(&nominal.geometry, position);
        if bore { -distance } else { distance }
    };
    let from_nominal = |place: usize, position: &Vector3<f64>| match &nominal.geometry {
        // An outline's points are those of its plane.
        Geometry::Outline { center_mm, normal, .. } => (position - center_mm.coords).dot(normal),
        // A freeform surface stays where it nominally is, and to look for its nearest triangle again takes long.
        Geometry::Surface(_) => from_fit(place, position),
        geometry => geometry.distance_mm(position),
    };
    let deviation = |(place, (index, position)): (usize, (u32, &Point3<f64>))| DeviationPoint {
        index,
        from_fit_mm: from_fit(place, &position.coords) as f32,
        from_nominal_mm: from_nominal(place, &position.coords) as f32,
    };
    numbers.zip(positions).enumerate().map(deviation).collect()
}
