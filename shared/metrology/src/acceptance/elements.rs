//! The points of an artefact at a position: of each pair, of each view, of all views in one frame.

use nalgebra::{Matrix3, Point3, Vector3};

use super::plan::{Artefact, PositionPlan, RegisterBy, TestPlan, ViewPlan};
use super::register::register;
use super::rules::{CloudOf, Kind};
use super::segment::{ElementShape, Excluded, LEAST_POINTS, Segment, Segments, find, positions};
use super::{AcceptanceError, at};
use crate::fit::{FitSettings, SphereFit, sphere};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;

/// Points that are evaluated together.
#[derive(Debug, Clone)]
pub(super) struct Group {
    /// Kind of cloud that the points come from.
    pub cloud: CloudOf,
    /// Views in it, with the pair where it is only one.
    pub views: Vec<String>,
    /// Points of each element.
    pub elements: Vec<Vec<Point3<f64>>>,
    /// How many of the first element's points are those of its first view.
    pub first_view: usize,
    /// Points in the zones of the elements that the plan excludes.
    pub excluded: usize,
    /// Largest share of an element's points on its surface that the plan excludes.
    pub excluded_share: f64,
}

/// The points of the artefact at a position.
#[derive(Debug, Clone)]
pub(super) struct PositionElements {
    /// Pairs, views, and all together.
    pub groups: Vec<Group>,
    /// Points of other bodies, in no zone of the artefact.
    pub elsewhere: usize,
    /// Worst root mean square of reference spheres, mm.
    pub registration_rms_mm: Option<f64>,
}

/// Finds the elements in each view and puts them together.
pub(super) fn groups(
    plan: &TestPlan,
    position: &PositionPlan,
    artefact: &Artefact,
    clouds: &[Vec<Point>],
) -> Result<PositionElements, AcceptanceError> {
    let place = |view: &ViewPlan| format!("position \"{}\", view \"{}\"", position.name, view.name);
    if clouds.len() != position.views.len() {
        let message = format!("{} clouds for {} views", clouds.len(), position.views.len());
        return Err(AcceptanceError::Plan { place: format!("position \"{}\"", position.name), message });
    }
    let by_references = position.register == RegisterBy::References;
    let mut wanted = elements(artefact);
    let own = wanted.len();
    let mut found = PositionElements { groups: Vec::new(), elsewhere: 0, registration_rms_mm: None };
    if by_references {
        wanted.extend(plan.references.iter().map(|r| ElementShape::Sphere(r.diameter_mm)));
    }
    let mut all = vec![Vec::new(); own];
    let mut seen = Vec::new();
    let mut references = Vec::new();
    for (view, cloud) in position.views.iter().zip(clouds) {
        let place = place(view);
        let left_out = Excluded { balls_mm: &view.exclude_mm, rod_diameter_mm: artefact.rod_diameter_mm };
        let Segments { mut elements, elsewhere } =
            find(&place, cloud, (&wanted, own), &view.near_mm, &left_out, &plan.segmentation)?;
        found.elsewhere += elsewhere;
        references.push(spheres(&place, &elements.split_off(own))?);
        seen.push(elements);
    }
    let registered = if by_references {
        let (poses, rms) = register(&references).ok_or_else(|| AcceptanceError::Plan {
            place: format!("position \"{}\"", position.name),
            message: "its reference spheres lie on a line and fix no motion; place them in a triangle".into(),
        })?;
        found.registration_rms_mm = Some(rms);
        Some(poses)
    } else {
        None
    };
    for (index, (view, segments)) in position.views.iter().zip(&seen).enumerate() {
        let pose = match &registered {
            Some(poses) => poses.get(index).copied(),
            None => view.transform.map(pose_of),
        };
        for (element, segment) in all.iter_mut().zip(segments) {
            let moved = segment.points.iter().map(|p| match pose {
                Some(pose) => Point3::from(pose.point(&p.position().coords)),
                None => p.position(),
            });
            element.extend(moved);
        }
        found.groups.extend(of_pairs(&view.name, segments));
        found.groups.push(of_view(&view.name, segments));
    }
    let views = position.views.iter().map(|view| view.name.clone()).collect();
    let first_view = seen.first().map_or(0, |segments| first(segments));
    let excluded = seen.iter().map(|segments| excluded(segments)).sum();
    let (cloud, elements, excluded_share) = (CloudOf::Registered, all, 0.0);
    found.groups.push(Group { cloud, views, elements, first_view, excluded, excluded_share });
    Ok(found)
}

/// The points of one view alone.
fn of_view(view: &str, segments: &[Segment]) -> Group {
    Group {
        cloud: CloudOf::View,
        views: vec![view.to_owned()],
        elements: segments.iter().map(|s| positions(&s.points)).collect(),
        first_view: first(segments),
        excluded: excluded(segments),
        excluded_share: segments.iter().map(Segment::excluded_share).fold(0.0, f64::max),
    }
}

fn first(segments: &[Segment]) -> usize {
    segments.first().map_or(0, |segment| segment.points.len())
}

fn excluded(segments: &[Segment]) -> usize {
    segments.iter().map(|segment| segment.excluded).sum()
}

fn elements(artefact: &Artefact) -> Vec<ElementShape> {
    match artefact.kind {
        Kind::Plane => vec![ElementShape::Plane],
        Kind::Sphere | Kind::BallBar => {
            artefact.diameters_mm.iter().map(|d| ElementShape::Sphere(*d)).collect()
        }
    }
}

fn spheres(place: &str, references: &[Segment]) -> Result<Vec<SphereFit>, AcceptanceError> {
    let one = |segment: &Segment| {
        sphere(&positions(&segment.points), &FitSettings::default()).map_err(|source| at(place, source))
    };
    references.iter().map(one).collect()
}

fn pose_of(rows: [[f64; 4]; 3]) -> Pose {
    Pose { rotation: Matrix3::from_fn(|r, c| rows[r][c]), translation: Vector3::from_fn(|r, _| rows[r][3]) }
}

/// The pairs that see enough of every element.
fn of_pairs(view: &str, segments: &[Segment]) -> Vec<Group> {
    let mut pairs: Vec<u32> = segments.iter().flat_map(|s| &s.points).map(|p| p.pair).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let of_pair = |pair: u32| {
        let only = |s: &Segment| s.points.iter().filter(|p| p.pair == pair).map(Point::position).collect();
        let elements: Vec<Vec<Point3<f64>>> = segments.iter().map(only).collect();
        let enough = elements.iter().all(|points| points.len() >= LEAST_POINTS);
        let first_view = elements.first().map_or(0, Vec::len);
        enough.then(|| Group {
            cloud: CloudOf::Pair,
            views: vec![format!("{view}, pair {}", pair + 1)],
            elements,
            first_view,
            excluded: 0,
            excluded_share: 0.0,
        })
    };
    pairs.into_iter().filter_map(of_pair).collect()
}
