//! A first plan from a cloud: which planes, spheres, cylinders and cones it shows, as nominal elements.
//!
//! Samples of oriented points give candidates (a plane one point, a sphere and a cylinder two, a cone three; Schnabel,
//! Wahl & Klein 2007), drawn by a counter, so that the same cloud gives the same draft. The candidate that most points
//! agree on, by place and normal, is fitted to them by least squares until the choice stands still; its points leave the
//! cloud, and the search goes on with the rest.

use crate::spread::Spread;
use nalgebra::{Matrix3, Point3, Vector3};

use super::geometry::Geometry;
use crate::fit::{self, FitSettings, Form, tangents};
use fringe::cloud::Point;
use fringe::math;
use fringe::math::random::Key;

/// Candidates of each kind that a search draws, and points that vote on them.
const SAMPLES: u64 = 1500;
const VOTERS: usize = 3000;

/// Rounds of fit and choice for an element.
const ROUNDS: usize = 8;

/// A curved candidate must hold so many times the points of the best plane: every patch has a sphere close to it.
const CURVED_GAIN: f64 = 1.05;

/// Largest radius of a curved element, in extents of the cloud.
const LARGEST_RADIUS: f64 = 1.0;

/// How an element is looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DraftSettings {
    /// Largest distance of a point from its element, mm.
    pub within_mm: f64,
    /// Largest angle between the normals of point and element, rad.
    pub normal_rad: f64,
    /// Fewest points of an element.
    pub min_points: usize,
    /// Most elements that are looked for.
    pub most: usize,
}

/// An element that the cloud shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Its geometry as fitted, with its extents.
    pub geometry: Geometry,
    /// Form of the points behind the fit.
    pub form: Form,
    /// Indices of these points in the cloud.
    pub points: Vec<u32>,
}

/// A surface without borders.
#[derive(Debug, Clone, Copy)]
enum Rough {
    Plane { point: Vector3<f64>, normal: Vector3<f64> },
    Sphere { center: Vector3<f64>, radius: f64, outward: f64 },
    Cylinder { point: Vector3<f64>, axis: Vector3<f64>, radius: f64, outward: f64 },
    Cone { apex: Vector3<f64>, axis: Vector3<f64>, half_angle: f64, outward: f64 },
}

impl Rough {
    /// Signed distance and normal next to a place.
    fn see(&self, p: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let unit = |v: Vector3<f64>| if v.norm() > 0.0 { v / v.norm() } else { v };
        match self {
            Self::Plane { point, normal } => ((p - point).dot(normal), *normal),
            Self::Sphere { center, radius, outward } => {
                ((p - center).norm() - radius, unit(p - center) * *outward)
            }
            Self::Cylinder { point, axis, radius, outward } => {
                let out = (p - point) - axis * axis.dot(&(p - point));
                (out.norm() - radius, unit(out) * *outward)
            }
            Self::Cone { apex, axis, half_angle, outward } => {
                let arm = p - apex;
                let height = arm.dot(axis);
                let out = arm - axis * height;
                let (sin, cos) = math::sincos(*half_angle);
                (out.norm() * cos - height * sin, (unit(out) * cos - axis * sin) * *outward)
            }
        }
    }

    fn holds(&self, (p, n): &(Vector3<f64>, Vector3<f64>), within_mm: f64, cosine: f64) -> bool {
        let (distance, normal) = self.see(p);
        distance.abs() <= within_mm && normal.dot(n) >= cosine
    }
}

/// The elements that a cloud with normals shows, those of most points first.
pub fn draft(cloud: &[Point], settings: &DraftSettings) -> Vec<Found> {
    let oriented: Vec<(Vector3<f64>, Vector3<f64>)> =
        cloud.iter().map(|p| (Vector3::from(p.position_mm), p.normal_vector())).collect();
    let valid = |(p, n): &(Vector3<f64>, Vector3<f64>)| p.iter().all(|v| v.is_finite()) && n.norm() > 0.5;
    let mut rest: Vec<u32> = (0..cloud.len() as u32).filter(|i| valid(&oriented[*i as usize])).collect();
    let extent_mm = extent_mm(&oriented, &rest);
    let mut found = Vec::new();
    while found.len() < settings.most && rest.len() >= settings.min_points {
        let Some(rough) = best(&oriented, &rest, extent_mm, settings, found.len() as u64) else { break };
        let Some(element) = refined(&oriented, &rest, rough, extent_mm, settings) else { break };
        let taken: std::collections::BTreeSet<u32> = element.points.iter().copied().collect();
        rest.retain(|i| !taken.contains(i));
        found.push(element);
    }
    found
}

/// Largest edge of the box around points, mm.
fn extent_mm(oriented: &[(Vector3<f64>, Vector3<f64>)], chosen: &[u32]) -> f64 {
    let places = || chosen.iter().map(|i| oriented[*i as usize].0);
    let low = places().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(&p));
    let high = places().fold(Vector3::repeat(f64::NEG_INFINITY), |high, p| high.sup(&p));
    (high - low).max()
}

/// The candidate that most voters agree on.
fn best(
    oriented: &[(Vector3<f64>, Vector3<f64>)],
    rest: &[u32],
    extent_mm: f64,
    settings: &DraftSettings,
    round: u64,
) -> Option<Rough> {
    let spread = Spread::of(rest.len(), VOTERS);
    let voters: Vec<(Vector3<f64>, Vector3<f64>)> =
        spread.indices().map(|i| oriented[rest[i] as usize]).collect();
    let cosine = math::cos(settings.normal_rad);
    let least = (settings.min_points / spread.stretch()).max(8);
    let mut best: Option<(f64, Rough)> = None;
    for sample in 0..SAMPLES {
        let key = Key::new(1).with(round).with(sample);
        // The second and third point are near the first in most draws: large clouds hold few clean triples.
        let first = (key.bits(0) % voters.len() as u64) as usize;
        let near = |k: u64| {
            let mut pick = (key.bits(k) % voters.len() as u64) as usize;
            for j in 1..12 {
                let other = (key.bits(16 * k + j) % voters.len() as u64) as usize;
                let gap = |i: usize| (voters[i].0 - voters[first].0).norm_squared();
                if other != first && (gap(other) < gap(pick) || pick == first) {
                    pick = other;
                }
            }
            pick
        };
        let (a, b, c) = (voters[first], voters[near(1)], voters[near(2)]);
        let rivals = [Some(plane(&a)), sphere(&a, &b), cylinder(&a, &b), cone(&a, &b, &c)];
        for (kind, rough) in rivals.into_iter().enumerate() {
            let Some(rough) = rough.filter(|r| sized(r, extent_mm)) else { continue };
            let votes = voters.iter().filter(|v| rough.holds(v, settings.within_mm, cosine)).count();
            let weight = votes as f64 / if kind == 0 { 1.0 } else { CURVED_GAIN };
            if votes >= least && best.is_none_or(|(most, _)| weight > most) {
                best = Some((weight, rough));
            }
        }
    }
    best.map(|(_, rough)| rough)
}

/// Refuses curved candidates that are planes in disguise, or needles.
fn sized(rough: &Rough, extent_mm: f64) -> bool {
    let fits = |radius: f64| radius > 1e-3 * extent_mm && radius < LARGEST_RADIUS * extent_mm;
    match rough {
        Rough::Plane { .. } => true,
        Rough::Sphere { radius, .. } | Rough::Cylinder { radius, .. } => fits(*radius),
        Rough::Cone { half_angle, .. } => (0.05..1.45).contains(half_angle),
    }
}

type Oriented = (Vector3<f64>, Vector3<f64>);

fn plane((p, n): &Oriented) -> Rough {
    Rough::Plane { point: *p, normal: *n }
}

/// The middle of the shortest connection of two normals, and on which side the points lie.
fn sphere((p, n): &Oriented, (q, m): &Oriented) -> Option<Rough> {
    let between = q - p;
    let (dot, square) = (n.dot(m), 1.0 - n.dot(m) * n.dot(m));
    if square < 1e-3 {
        return None;
    }
    let s = (between.dot(n) - dot * between.dot(m)) / square;
    let t = (dot * between.dot(n) - between.dot(m)) / square;
    let center = (p + n * s + q + m * t) * 0.5;
    let radius = 0.5 * ((p - center).norm() + (q - center).norm());
    Some(Rough::Sphere { center, radius, outward: if s < 0.0 { 1.0 } else { -1.0 } })
}

fn cylinder((p, n): &Oriented, (q, m): &Oriented) -> Option<Rough> {
    let axis = n.cross(m);
    let length = axis.norm();
    if length < 0.05 {
        return None;
    }
    let axis = axis / length;
    let flat = |v: &Vector3<f64>| v - axis * axis.dot(v);
    let Some(Rough::Sphere { center, radius, outward }) = sphere(&(flat(p), *n), &(flat(q), *m)) else {
        return None;
    };
    Some(Rough::Cylinder { point: center, axis, radius, outward })
}

fn cone(a: &Oriented, b: &Oriented, c: &Oriented) -> Option<Rough> {
    let matrix = Matrix3::from_rows(&[a.1.transpose(), b.1.transpose(), c.1.transpose()]);
    if matrix.determinant().abs() < 0.02 {
        return None;
    }
    let right = Vector3::new(a.1.dot(&a.0), b.1.dot(&b.0), c.1.dot(&c.0));
    let apex = matrix.try_inverse()? * right;
    let arms = [a, b, c].map(|s| (s.0 - apex).normalize());
    let axis = (arms[1] - arms[0]).cross(&(arms[2] - arms[0]));
    if axis.norm() < 1e-3 {
        return None;
    }
    let axis = axis / axis.norm();
    let axis = if axis.dot(&arms[0]) < 0.0 { -axis } else { axis };
    let half_angle = math::acos(axis.dot(&arms[0]).clamp(-1.0, 1.0));
    let free = Rough::Cone { apex, axis, half_angle, outward: 1.0 };
    let outward = if free.see(&a.0).1.dot(&a.1) < 0.0 { -1.0 } else { 1.0 };
    Some(Rough::Cone { apex, axis, half_angle, outward })
}

/// Fit and choice until they stand still, then the element with its extents.
fn refined(
    oriented: &[(Vector3<f64>, Vector3<f64>)],
    rest: &[u32],
    mut rough: Rough,
    extent_mm: f64,
    settings: &DraftSettings,
) -> Option<Found> {
    let cosine = math::cos(settings.normal_rad);
    let mut chosen: Vec<u32> = Vec::new();
    let mut form = None;
    for _ in 0..ROUNDS {
        let holds = |i: &&u32| rough.holds(&oriented[**i as usize], settings.within_mm, cosine);
        let next: Vec<u32> = rest.iter().filter(holds).copied().collect();
        if next.len() < settings.min_points {
            return None;
        }
        let still = next == chosen;
        chosen = next;
        if still {
            break;
        }
        let places: Vec<Point3<f64>> = chosen.iter().map(|i| Point3::from(oriented[*i as usize].0)).collect();
        let (fitted, of) = fitted(&rough, &places)?;
        if !sized(&fitted, extent_mm) {
            return None;
        }
        (rough, form) = (fitted, Some(of));
    }
    let geometry = bounded(&rough, &chosen.iter().map(|i| oriented[*i as usize]).collect::<Vec<_>>())?;
    Some(Found { geometry, form: form?, points: chosen })
}

fn fitted(rough: &Rough, places: &[Point3<f64>]) -> Option<(Rough, Form)> {
    let settings = FitSettings::default();
    Some(match *rough {
        Rough::Plane { normal, .. } => {
            let fit = fit::plane(places, &settings).ok()?.towards(&normal);
            (Rough::Plane { point: Vector3::from(fit.centroid_mm), normal: fit.normal_vector() }, fit.form)
        }
        Rough::Sphere { outward, .. } => {
            let fit = fit::sphere(places, &settings).ok()?;
            (Rough::Sphere { center: fit.center().coords, radius: 0.5 * fit.diameter_mm, outward }, fit.form)
        }
        Rough::Cylinder { outward, .. } => {
            let fit = fit::cylinder(places, &settings).ok()?;
            let (point, axis) = (Vector3::from(fit.axis_point_mm), Vector3::from(fit.axis_direction));
            (Rough::Cylinder { point, axis, radius: 0.5 * fit.diameter_mm, outward }, fit.form)
        }
        Rough::Cone { outward, .. } => {
            let fit = fit::cone(places, &settings).ok()?;
            let (apex, axis) = (Vector3::from(fit.apex_mm), Vector3::from(fit.axis_direction));
            (Rough::Cone { apex, axis, half_angle: fit.half_angle_deg.to_radians(), outward }, fit.form)
        }
    })
}

/// The range of values without the outermost hundredth at each end.
fn span(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_unstable_by(f64::total_cmp);
    let skip = values.len() / 100;
    [values[skip], values[values.len() - 1 - skip]]
}

/// The element with the extents of its points.
fn bounded(rough: &Rough, points: &[Oriented]) -> Option<Geometry> {
    let along = |direction: &Vector3<f64>, from: &Vector3<f64>| {
        span(points.iter().map(|(p, _)| direction.dot(&(p - from))).collect())
    };
    Some(match *rough {
        Rough::Plane { point, normal } => {
            let edges = tangents(&normal);
            let [a, b] = edges.map(|edge| along(&edge, &point));
            let middle = point + edges[0] * (0.5 * (a[0] + a[1])) + edges[1] * (0.5 * (b[0] + b[1]));
            Geometry::Plane {
                point_mm: middle.into(),
                normal,
                edges,
                half_size_mm: [0.5 * (a[1] - a[0]), 0.5 * (b[1] - b[0])],
                exclusions: Vec::new(),
            }
        }
        Rough::Sphere { center, radius, .. } => {
            let mean: Vector3<f64> = points.iter().map(|(p, _)| (p - center) / radius).sum();
            let axis =
                if mean.norm() > 0.1 * points.len() as f64 { mean / mean.norm() } else { Vector3::z() };
            let [low, _] = along(&axis, &center);
            Geometry::Sphere {
                center_mm: center.into(),
                radius_mm: radius,
                axis,
                cos_polar: [(low / radius).clamp(-1.0, 1.0), 1.0],
            }
        }
        Rough::Cylinder { point, axis, radius, outward } => {
            let [low, high] = along(&axis, &point);
            Geometry::Cylinder {
                point_mm: (point + axis * (0.5 * (low + high))).into(),
                axis,
                radius_mm: radius,
                half_length_mm: 0.5 * (high - low),
                internal: outward < 0.0,
                sector: None,
            }
        }
        Rough::Cone { apex, axis, half_angle, outward } => {
            let [low, high] = along(&axis, &apex);
            let middle = 0.5 * (low + high);
            if low <= 0.0 {
                return None;
            }
            Geometry::Cone {
                point_mm: (apex + axis * middle).into(),
                axis,
                radius_mm: middle * math::tan(half_angle),
                half_angle_rad: half_angle,
                half_length_mm: 0.5 * (high - low),
                internal: outward < 0.0,
            }
        }
    })
}
