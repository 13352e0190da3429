//! Finds the spheres and planes of an artefact in a cloud, by where the plan says they are or by their calibrated size.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point3;

use super::AcceptanceError;
use super::plan::Segmentation;
use crate::fit::{FitSettings, find_plane, find_sphere, sphere};
use fringe::cloud::Point;

/// Fewest points of an element: below, a form deviation says nothing.
pub(super) const LEAST_POINTS: usize = 50;

/// Points this many margins from the surface are told as lying beside it.
const BESIDE_MARGINS: f64 = 3.0;

/// The points of an element.
#[derive(Debug, Clone)]
pub(super) struct Segment {
    /// Its points.
    pub points: Vec<Point>,
    /// Points within three margins of the surface, but not within one.
    pub beside: usize,
}

/// What is looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Wanted {
    /// A sphere of this diameter, mm.
    Sphere(f64),
    /// A plane.
    Plane,
}

/// Finds the elements in their order; `near_mm` is empty or has a ball for each.
///
/// # Errors
/// An element that is not there; spheres that cannot be told apart.
pub(super) fn find(
    place: &str,
    cloud: &[Point],
    wanted: &[Wanted],
    near_mm: &[[f64; 4]],
    settings: &Segmentation,
) -> Result<Vec<Segment>, AcceptanceError> {
    if cloud.is_empty() {
        return Err(not_found(place, "the cloud has no point".into()));
    }
    if near_mm.len() == wanted.len() {
        return wanted
            .iter()
            .zip(near_mm)
            .map(|(one, ball)| in_ball(place, cloud, *one, ball, settings))
            .collect();
    }
    let mut left = bodies(cloud, settings.gap_mm);
    let mut found = Vec::new();
    for one in wanted {
        found.push(take(place, &mut left, *one, wanted, settings)?);
    }
    Ok(found)
}

fn not_found(place: &str, message: String) -> AcceptanceError {
    AcceptanceError::NotFound { place: place.to_owned(), message }
}

fn in_ball(
    place: &str,
    cloud: &[Point],
    wanted: Wanted,
    [x, y, z, r]: &[f64; 4],
    settings: &Segmentation,
) -> Result<Segment, AcceptanceError> {
    let centre = Point3::new(*x, *y, *z);
    let region: Vec<Point> = cloud.iter().filter(|p| (p.position() - centre).norm() <= *r).copied().collect();
    let held = mark(&region, wanted, settings.margin_mm).unwrap_or_default();
    let segment = segment(&region, &held, wanted, settings.margin_mm);
    if segment.points.len() < LEAST_POINTS {
        let message = format!(
            "{} in near_mm = [{x}, {y}, {z}, {r}]: {} of {} points there lie on one, needs {LEAST_POINTS}",
            describe(wanted),
            segment.points.len(),
            region.len()
        );
        return Err(not_found(place, message));
    }
    Ok(segment)
}

fn describe(wanted: Wanted) -> String {
    match wanted {
        Wanted::Sphere(diameter) => format!("sphere of {diameter} mm"),
        Wanted::Plane => "plane".to_owned(),
    }
}

/// Takes the element that most points show out of the bodies.
fn take(
    place: &str,
    bodies: &mut [Vec<Point>],
    wanted: Wanted,
    all: &[Wanted],
    settings: &Segmentation,
) -> Result<Segment, AcceptanceError> {
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
             artefact in sight, and is the cloud in mm? near_mm tells where to look",
            describe(wanted),
            settings.margin_mm,
            if bodies.is_empty() { "no".to_owned() } else { bodies.join(", ") }
        );
        return Err(not_found(place, message));
    };
    let body = &mut bodies[index];
    let found = segment(body, &held, wanted, settings.margin_mm);
    let mut rest = held.iter();
    body.retain(|_| rest.next().is_some_and(|held| !held));
    Ok(found)
}

/// Whether points taken for a sphere of one diameter are not those of another wanted one.
fn is_sized(body: &[Point], held: &[bool], wanted: Wanted, all: &[Wanted], margin_mm: f64) -> bool {
    let Wanted::Sphere(diameter) = wanted else { return true };
    let Ok(fit) = sphere(&positions(&kept(body, held)), &FitSettings::default()) else { return false };
    let off = (fit.diameter_mm - diameter).abs();
    let nearer = |other: &Wanted| matches!(other, Wanted::Sphere(d) if (fit.diameter_mm - d).abs() < off);
    off <= 2.0 * margin_mm
        && !all.iter().any(|other| {
            // Two balls of a bar differ by less than any measurement tells.
            nearer(other) && matches!(other, Wanted::Sphere(d) if (d - diameter).abs() >= margin_mm)
        })
}

fn mark(points: &[Point], wanted: Wanted, margin_mm: f64) -> Option<Vec<bool>> {
    let points = positions(points);
    match wanted {
        Wanted::Sphere(diameter) => find_sphere(&points, Some(diameter), margin_mm).ok(),
        Wanted::Plane => find_plane(&points, margin_mm).ok(),
    }
}

fn segment(points: &[Point], held: &[bool], wanted: Wanted, margin_mm: f64) -> Segment {
    let inside = kept(points, held);
    let beside = beside(points, &inside, wanted, margin_mm);
    Segment { points: inside, beside }
}

/// Points that a wider margin would take.
fn beside(points: &[Point], inside: &[Point], wanted: Wanted, margin_mm: f64) -> usize {
    let settings = FitSettings::default();
    let wide = BESIDE_MARGINS * margin_mm;
    let within = |distance: &dyn Fn(&Point3<f64>) -> f64| {
        points.iter().filter(|p| distance(&p.position()).abs() <= wide).count().saturating_sub(inside.len())
    };
    match wanted {
        Wanted::Sphere(diameter) => crate::fit::sphere_of_diameter(&positions(inside), diameter, &settings)
            .map_or(0, |fit| within(&|p| (p - fit.center()).norm() - 0.5 * diameter)),
        Wanted::Plane => {
            crate::fit::plane(&positions(inside), &settings).map_or(0, |fit| within(&|p| fit.distance_mm(p)))
        }
    }
}

fn kept(points: &[Point], held: &[bool]) -> Vec<Point> {
    points.iter().zip(held).filter(|(_, held)| **held).map(|(point, _)| *point).collect()
}

/// Positions of points.
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
