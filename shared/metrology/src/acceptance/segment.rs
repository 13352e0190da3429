//! Finds the spheres and planes of an artefact in a cloud, by where the plan states they are or by their calibrated size.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};

use super::AcceptanceError;
use super::plan::Segmentation;
use crate::fit::{FitError, FitSettings, find_plane, find_sphere, sphere};
use fringe::cloud::Point;

/// Fewest points of an element: below, a form deviation means nothing.
pub(super) const LEAST_POINTS: usize = 50;

/// Zone of a plane over the margin, where the plan gives none.
const PLANE_ZONE_MARGINS: f64 = 10.0;

/// The points of an element.
#[derive(Debug, Clone, Default)]
pub(super) struct Segment {
    /// Its points: all that lie in its zone.
    pub points: Vec<Point>,
    /// Points in its zone that the plan excludes.
    pub excluded: usize,
    /// Those of them that lie on its surface, within the margin.
    pub excluded_on_surface: usize,
}

impl Segment {
    /// Share of the points on the surface that the plan excludes.
    pub fn excluded_share(&self) -> f64 {
        self.excluded_on_surface as f64 / (self.points.len() + self.excluded_on_surface).max(1) as f64
    }
}

/// What a cloud shows.
#[derive(Debug, Clone)]
pub(super) struct Segments {
    /// The elements, in their order.
    pub elements: Vec<Segment>,
    /// Points in no zone: of other bodies.
    pub elsewhere: usize,
}

/// Points that the plan excludes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Excluded<'a> {
    /// Balls x, y, z, r in mm.
    pub balls_mm: &'a [[f64; 4]],
    /// Diameter of the rod between the first sphere and the others.
    pub rod_diameter_mm: Option<f64>,
}

/// Shape of the element that is searched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ElementShape {
    /// A sphere of this diameter, mm.
    Sphere(f64),
    /// A plane of any extent.
    Plane,
}

/// Where an element is, from the points that agree on it.
#[derive(Debug, Clone, Copy)]
enum Located {
    Sphere {
        center: Point3<f64>,
        radius_mm: f64,
    },
    /// `reach_mm`: how far from `center` its points go.
    Plane {
        center: Point3<f64>,
        normal: Vector3<f64>,
        reach_mm: f64,
    },
}

impl Located {
    /// Distance from the surface, and whether the point lies inside a sphere, where nothing else can be.
    fn distance(&self, point: &Point3<f64>) -> (f64, bool) {
        match self {
            Self::Sphere { center, radius_mm } => {
                let off = (point - center).norm() - radius_mm;
                (off.abs(), off < 0.0)
            }
            Self::Plane { center, normal, reach_mm } => {
                let arm = point - center;
                let off = if arm.norm() <= *reach_mm { arm.dot(normal).abs() } else { f64::INFINITY };
                (off, false)
            }
        }
    }

    fn zone_mm(&self, settings: &Segmentation) -> f64 {
        settings.zone_mm.unwrap_or(match self {
            Self::Sphere { radius_mm, .. } => *radius_mm,
            Self::Plane { .. } => PLANE_ZONE_MARGINS * settings.margin_mm,
        })
    }
}

/// Finds the elements in their order, and with the first `own` of them, which are the artefact's, every point in their zones.
/// The others are reference spheres, of which the points within the margin are taken. `near_mm` is empty or has a ball for
/// each of the artefact's elements. A point in two zones belongs to the nearer surface.
///
/// # Errors
/// An element that is not there; spheres that cannot be distinguished.
pub(super) fn find(
    place: &str,
    cloud: &[Point],
    (wanted, own): (&[ElementShape], usize),
    near_mm: &[[f64; 4]],
    excluded: &Excluded<'_>,
    settings: &Segmentation,
) -> Result<Segments, AcceptanceError> {
    let located = locate(place, cloud, wanted, near_mm, settings)?;
    let mut found = Segments { elements: vec![Segment::default(); wanted.len()], elsewhere: 0 };
    for point in cloud {
        let at = point.position();
        let zones =
            located.iter().enumerate().map(|(index, one)| (index, one.distance(&at), one.zone_mm(settings)));
        let nearest = zones
            .filter(|(_, (off, inside), zone)| *inside || off <= zone)
            .min_by(|(_, (a, _), _), (_, (b, _), _)| a.total_cmp(b));
        let counts =
            |(index, (off, _), _): &(usize, (f64, bool), f64)| *index < own || *off <= settings.margin_mm;
        let held = nearest.filter(counts);
        match held.and_then(|(index, (off, _), _)| Some((found.elements.get_mut(index)?, off))) {
            Some((element, off)) if excluded.holds(&at, &located[..own], settings.margin_mm) => {
                element.excluded += 1;
                element.excluded_on_surface += usize::from(off <= settings.margin_mm);
            }
            Some((element, _)) => element.points.push(*point),
            None => found.elsewhere += 1,
        }
    }
    for (element, one) in found.elements.iter().zip(wanted) {
        if element.points.len() < LEAST_POINTS {
            let message = format!(
                "{}: {} points count, needs {LEAST_POINTS}; the plan excludes {}",
                describe(*one),
                element.points.len(),
                element.excluded
            );
            return Err(not_found(place, message));
        }
    }
    Ok(found)
}

impl Excluded<'_> {
    /// The rod is taken two margins wider than it is: its points scatter too.
    fn holds(&self, point: &Point3<f64>, located: &[Located], margin_mm: f64) -> bool {
        let in_ball = |[x, y, z, r]: &[f64; 4]| (point - Point3::new(*x, *y, *z)).norm() <= *r;
        if self.balls_mm.iter().any(in_ball) {
            return true;
        }
        let (Some(diameter), Some(Located::Sphere { center: first, .. })) =
            (self.rod_diameter_mm, located.first())
        else {
            return false;
        };
        let in_rod = |other: &Located| {
            let Located::Sphere { center, .. } = other else { return false };
            let (axis, arm) = (center - first, point - first);
            let Some(direction) = axis.try_normalize(0.0) else { return false };
            let along = arm.dot(&direction);
            let across = (arm - direction * along).norm();
            (0.0..=axis.norm()).contains(&along) && across <= 0.5 * diameter + 2.0 * margin_mm
        };
        located.iter().skip(1).any(in_rod)
    }
}

/// Where the elements are.
fn locate(
    place: &str,
    cloud: &[Point],
    wanted: &[ElementShape],
    near_mm: &[[f64; 4]],
    settings: &Segmentation,
) -> Result<Vec<Located>, AcceptanceError> {
    if cloud.is_empty() {
        return Err(not_found(place, "the cloud has no point".into()));
    }
    let at = |one: &ElementShape, held: &[Point]| {
        located(*one, &positions(held))
            .map_err(|source| AcceptanceError::Fit { place: place.to_owned(), source })
    };
    let mut found = Vec::new();
    for (one, ball) in wanted.iter().zip(near_mm) {
        found.push(at(one, &in_ball(place, cloud, *one, ball, settings)?)?);
    }
    if found.len() < wanted.len() {
        let mut left = bodies(cloud, settings.gap_mm);
        for one in &wanted[found.len()..] {
            found.push(at(one, &take(place, &mut left, *one, wanted, settings)?)?);
        }
    }
    Ok(found)
}

fn located(wanted: ElementShape, held: &[Point3<f64>]) -> Result<Located, FitError> {
    let settings = FitSettings::default();
    match wanted {
        ElementShape::Sphere(diameter) => {
            let fit = crate::fit::sphere_of_diameter(held, diameter, &settings)?;
            Ok(Located::Sphere { center: fit.center(), radius_mm: 0.5 * diameter })
        }
        ElementShape::Plane => {
            let normal = crate::fit::plane(held, &settings)?.normal_vector();
            let sum: Vector3<f64> = held.iter().map(|p| p.coords).sum();
            let center = Point3::from(sum / held.len() as f64);
            let reach_mm = held.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
            Ok(Located::Plane { center, normal, reach_mm })
        }
    }
}

fn not_found(place: &str, message: String) -> AcceptanceError {
    AcceptanceError::NotFound { place: place.to_owned(), message }
}

fn in_ball(
    place: &str,
    cloud: &[Point],
    wanted: ElementShape,
    [x, y, z, r]: &[f64; 4],
    settings: &Segmentation,
) -> Result<Vec<Point>, AcceptanceError> {
    let centre = Point3::new(*x, *y, *z);
    let region: Vec<Point> = cloud.iter().filter(|p| (p.position() - centre).norm() <= *r).copied().collect();
    let held = mark(&region, wanted, settings.margin_mm).unwrap_or_default();
    let held = kept(&region, &held);
    if held.len() < LEAST_POINTS {
        let message = format!(
            "{} in near_mm = [{x}, {y}, {z}, {r}]: {} of {} points there lie on one, needs {LEAST_POINTS}",
            describe(wanted),
            held.len(),
            region.len()
        );
        return Err(not_found(place, message));
    }
    Ok(held)
}

fn describe(wanted: ElementShape) -> String {
    match wanted {
        ElementShape::Sphere(diameter) => format!("sphere of {diameter} mm"),
        ElementShape::Plane => "plane".to_owned(),
    }
}

/// Takes the element that most points show out of the bodies.
fn take(
    place: &str,
    bodies: &mut [Vec<Point>],
    wanted: ElementShape,
    all: &[ElementShape],
    settings: &Segmentation,
) -> Result<Vec<Point>, AcceptanceError> {
    let mut best: Option<(usize, Vec<bool>, usize)> = None;
    for (index, body) in bodies.iter().enumerate() {
        if body.len() < LEAST_POINTS || best.as_ref().is_some_and(|(_, _, count)| *count >= body.len()) {
            continue;
        }
        let Some(held) = mark(body, wanted, settings.margin_mm) else { continue };
        let count = held.iter().filter(|h| **h).count();
        let sized = is_sized(body, &held, wanted, all, settings.margin_mm);
        if count >= LEAST_POINTS && sized && best.as_ref().is_none_or(|(_, _, most)| count > *most) {
            best = Some((index, held, count));
        }
    }
    let Some((index, held, _)) = best else {
        let bodies: Vec<String> = bodies.iter().map(|b| b.len().to_string()).take(12).collect();
        let message = format!(
            "no {} with {LEAST_POINTS} points within margin_mm = {}; the cloud has bodies of {} points: is the \
             artefact visible, and is the cloud in mm? near_mm limits the search to its place",
            describe(wanted),
            settings.margin_mm,
            if bodies.is_empty() { "no".to_owned() } else { bodies.join(", ") }
        );
        return Err(not_found(place, message));
    };
    let body = &mut bodies[index];
    let found = kept(body, &held);
    let mut rest = held.iter();
    body.retain(|_| rest.next().is_some_and(|held| !held));
    Ok(found)
}

/// Whether points taken for a sphere of one diameter are not those of another wanted one.
fn is_sized(
    body: &[Point],
    held: &[bool],
    wanted: ElementShape,
    all: &[ElementShape],
    margin_mm: f64,
) -> bool {
    let ElementShape::Sphere(diameter) = wanted else { return true };
    let Ok(fit) = sphere(&positions(&kept(body, held)), &FitSettings::default()) else { return false };
    let off = (fit.diameter_mm - diameter).abs();
    let nearer =
        |other: &ElementShape| matches!(other, ElementShape::Sphere(d) if (fit.diameter_mm - d).abs() < off);
    off <= 2.0 * margin_mm
        && !all.iter().any(|other| {
            // Two balls of a bar differ by less than any measurement resolves.
            nearer(other) && matches!(other, ElementShape::Sphere(d) if (d - diameter).abs() >= margin_mm)
        })
}

fn mark(points: &[Point], wanted: ElementShape, margin_mm: f64) -> Option<Vec<bool>> {
    let points = positions(points);
    match wanted {
        ElementShape::Sphere(diameter) => find_sphere(&points, Some(diameter), margin_mm).ok(),
        ElementShape::Plane => find_plane(&points, margin_mm).ok(),
    }
}

fn kept(points: &[Point], held: &[bool]) -> Vec<Point> {
    points.iter().zip(held).filter(|(_, held)| **held).map(|(point, _)| *point).collect()
}

/// Positions of the points, mm.
pub(super) fn positions(points: &[Point]) -> Vec<Point3<f64>> {
    points.iter().map(Point::position).collect()
}

type Cell = [i64; 3];

/// Parts of a cloud that lie farther apart than the gap: cells of that edge, joined with their 26 neighbours. Largest first.
fn bodies(cloud: &[Point], gap_mm: f64) -> Vec<Vec<Point>> {
    // A cast saturates; points that far out make bodies of their own.
    let cell = |p: &Point| -> Cell { p.position_mm.map(|v| (v / gap_mm).floor() as i64) };
    let mut cells: BTreeMap<Cell, Vec<usize>> = BTreeMap::new();
    for (index, point) in cloud.iter().enumerate() {
        cells.entry(cell(point)).or_default().push(index);
    }
    let mut open: BTreeSet<Cell> = cells.keys().copied().collect();
    let mut found: Vec<Vec<usize>> = Vec::new();
    while let Some(first) = open.pop_first() {
        let (mut queue, mut body) = (vec![first], Vec::new());
        while let Some(here) = queue.pop() {
            body.extend(cells.get(&here).into_iter().flatten());
            for next in neighbours(here) {
                if open.remove(&next) {
                    queue.push(next);
                }
            }
        }
        // The order of the points decides the bits of a fit.
        body.sort_unstable();
        found.push(body);
    }
    found.sort_by_key(|body| std::cmp::Reverse(body.len()));
    found.iter().map(|body| body.iter().map(|index| cloud[*index]).collect()).collect()
}

fn neighbours([x, y, z]: Cell) -> impl Iterator<Item = Cell> {
    (0..27).filter(|i| *i != 13).map(move |i| {
        [x.saturating_add(i % 3 - 1), y.saturating_add(i / 3 % 3 - 1), z.saturating_add(i / 9 - 1)]
    })
}
