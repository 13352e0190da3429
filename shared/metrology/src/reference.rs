//! The reference that a cloud is compared with: another cloud, or a mesh.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use thiserror::Error;

use crate::fit::COORDINATE_LIMIT_MM;
use crate::spatial::{Aabb, Moments, Neighbourhood, Patch, PointTree, TriangleMesh, eigen_normal};
use fringe::cloud::Point;

/// Points that one thread takes at a time; fixed, so that nothing depends on the number of threads.
pub(crate) const CHUNK: usize = 1024;

/// Radius of the surroundings in spacings: 28 points on the average, of which a paraboloid takes its six coefficients.
const RADIUS_SPACINGS: f64 = 3.0;

/// A foot farther from the nearest point of the reference than so many spacings lies beside the reference: among points
/// strewn at random three in a million would be that far from a place of the surface.
const EDGE_SPACINGS: f64 = 2.0;

/// A foot farther from the middle of its surroundings than this part of their radius lies beside the reference. On a
/// straight edge it is 4/3π = 0.42; one spacing beyond it, 0.33 more.
const EDGE_MIDDLE: f64 = 0.75;

/// Surroundings whose normals differ by more than 60° belong to another side of the part: the far side of a thin wall.
const OTHER_SIDE_COSINE: f64 = 0.5;

/// Surroundings that hold fewer points are looked at twice as wide.
const ENOUGH_POINTS: usize = 12;

/// Fewest points of a reference cloud: those of one plane.
pub const LEAST_REFERENCE_POINTS: usize = 4;

/// Why a cloud cannot be a reference, or cannot be compared with one.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum CloudError {
    /// The reference has too few points.
    #[error("has {found} points, at least {needed} are needed; is this the right file?")]
    Few {
        /// Number of points found.
        found: usize,
        /// Smallest number of points.
        needed: usize,
    },
    /// Too large for 32-bit numbers.
    #[error("has {found} points, limit 4294967295; reduce it")]
    Many {
        /// Number of points in the reference.
        found: usize,
    },
    /// A coordinate that is no place in a measuring cell.
    #[error(
        "point {index} has a coordinate that is not within ±{COORDINATE_LIMIT_MM:e} mm; are the units mm, is the file damaged?"
    )]
    Coordinate {
        /// Index of the point, from 0.
        index: usize,
    },
    /// An open surface without normals, seen along its rim.
    #[error(
        "has no normals, and its surface shows no outside towards ({}, {}, {}): its mean normal is along ({:.2}, {:.2}, {:.2}) or against it; give a direction nearer to one of these (--towards)",
        towards[0], towards[1], towards[2], mean[0], mean[1], mean[2]
    )]
    Side {
        /// Direction that was to be outside.
        towards: [f64; 3],
        /// Mean of the normals, of either sign.
        mean: [f64; 3],
    },
    /// All points in one place.
    #[error("most of its points coincide: it has no surface; is this the right file?")]
    Coincident,
}

/// A reference for comparison: a mesh, or a cloud with a local surface.
#[derive(Debug, Clone)]
pub enum Reference {
    /// Points of a surface.
    Cloud(CloudReference),
    /// Triangles of a CAD model.
    Mesh(TriangleMesh),
}

/// Signed distance of a point from the reference, or why it has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Deviation {
    /// Along the normal of the reference, positive outside, mm.
    Mm(f64),
    /// Farther away than the largest distance.
    TooFar,
    /// Beside the reference: its foot lies where the reference has no points or triangles.
    BeyondEdge,
    /// The reference has too few points there for a plane.
    NoSurface,
}

impl Deviation {
    /// The distance, if there is one, mm.
    pub fn mm(self) -> Option<f64> {
        match self {
            Self::Mm(mm) => Some(mm),
            _ => None,
        }
    }
}

/// The point of the reference that belongs to a measured point, for an alignment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    pub normal: Vector3<f64>,
    /// Along the normal, mm.
    pub distance_mm: f64,
    /// Whether the measured point lies beside the reference.
    pub beyond_edge: bool,
}

/// Refuses clouds that cannot be evaluated.
///
/// # Errors
/// See [`CloudError`].
pub fn check(points: &[Point], needed: usize) -> Result<(), CloudError> {
    if points.len() < needed {
        return Err(CloudError::Few { found: points.len(), needed });
    }
    if u32::try_from(points.len()).is_err() {
        return Err(CloudError::Many { found: points.len() });
    }
    // A NaN is not within the limits either.
    let within = |p: &Point| p.position_mm.iter().all(|v| v.abs() <= COORDINATE_LIMIT_MM);
    match points.iter().position(|p| !within(p)) {
        Some(index) => Err(CloudError::Coordinate { index }),
        None => Ok(()),
    }
}

/// Points of a surface, prepared for distance queries.
#[derive(Debug, Clone)]
pub struct CloudReference {
    pub(crate) tree: PointTree,
    /// Normals of the file by slot; empty where the cloud has none.
    given: Vec<[f32; 3]>,
    /// Where the outside is when the cloud has no normals.
    towards: Vector3<f64>,
    spacing_mm: f64,
    radius_mm: f64,
    /// By slot; empty until [`Self::with_normals`].
    pub(crate) normals: Vec<Option<Vector3<f64>>>,
    /// Mean variance of the slope of those normals, from the scatter of the points, rad².
    normal_variance: f64,
}

impl CloudReference {
    /// Sorts a cloud. Distances are signed by its own normals, or, when it has none, so that `towards` is outside.
    /// `radius_mm`: surroundings of which the surface is made; three spacings of the points if `None`.
    ///
    /// # Errors
    /// See [`CloudError`].
    pub fn new(points: &[Point], towards: Vector3<f64>, radius_mm: Option<f64>) -> Result<Self, CloudError> {
        check(points, LEAST_REFERENCE_POINTS)?;
        let positions: Vec<Point3<f64>> = points.iter().map(Point::position).collect();
        let tree = PointTree::new(&positions);
        let spacing_mm = tree.spacing_mm();
        if spacing_mm <= 0.0 {
            return Err(CloudError::Coincident);
        }
        let has_normals = points.iter().any(|p| p.normal != [0.0; 3]);
        let given = if has_normals {
            tree.order().iter().map(|i| points[*i as usize].normal).collect()
        } else {
            Vec::new()
        };
        let radius_mm = radius_mm.unwrap_or(RADIUS_SPACINGS * spacing_mm);
        Ok(Self { tree, given, towards, spacing_mm, radius_mm, normals: Vec::new(), normal_variance: 0.0 })
    }

    /// Typical distance of its points, mm.
    pub fn spacing_mm(&self) -> f64 {
        self.spacing_mm
    }

    /// Where the outside is when the cloud has no normals.
    pub(crate) fn towards(&self) -> Vector3<f64> {
        self.towards
    }

    /// The same cloud with normals by slot as if its file had brought them.
    pub(crate) fn with_given(self, given: Vec<[f32; 3]>) -> Self {
        Self { given, ..self }
    }

    /// The normal that the cloud brought for a slot; zero where it brought none.
    #[cfg(test)]
    pub(crate) fn given_normal(&self, slot: usize) -> Vector3<f64> {
        self.given.get(slot).map_or(Vector3::zeros(), |n| Vector3::from(n.map(f64::from)))
    }

    /// Number of its points.
    pub(crate) fn len(&self) -> usize {
        self.tree.sites().len()
    }

    /// Its points with the normals of [`Self::with_normals`].
    pub(crate) fn oriented(&self) -> impl Iterator<Item = (Point3<f64>, Vector3<f64>)> + '_ {
        self.tree.sites().iter().zip(&self.normals).filter_map(|(site, normal)| Some((*site, (*normal)?)))
    }

    /// Radius of the surroundings of which the surface is made, mm.
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// Whether the cloud brought normals.
    pub fn has_normals(&self) -> bool {
        !self.given.is_empty()
    }

    /// Signed distance of a point, mm; `surroundings` is scratch.
    fn deviation(&self, p: &Point3<f64>, limit_mm: f64, surroundings: &mut Surroundings) -> Deviation {
        let lateral = EDGE_SPACINGS * self.spacing_mm.max(self.radius_mm / RADIUS_SPACINGS);
        let reach_mm = (limit_mm * limit_mm + lateral * lateral).sqrt();
        let Some((nearest, _)) = self.tree.nearest(p, reach_mm) else {
            return Deviation::TooFar;
        };
        let mut radius_mm = self.radius_mm;
        self.gather(nearest, radius_mm, surroundings);
        if surroundings.points.len() < ENOUGH_POINTS {
            radius_mm *= 2.0;
            self.gather(nearest, radius_mm, surroundings);
        }
        let origin = self.tree.sites()[nearest];
        let Some(patch) = Patch::through(&surroundings.points, origin, radius_mm) else {
            return Deviation::NoSurface;
        };
        let (from_nearest, from_middle) = patch.offsets_mm(p);
        if from_nearest > lateral * radius_mm / self.radius_mm || from_middle > EDGE_MIDDLE * radius_mm {
            return Deviation::BeyondEdge;
        }
        let outside = self.outside(&patch.normal(), &surroundings.normal);
        let mm = outside * patch.distance_mm(p);
        if mm.abs() > limit_mm { Deviation::TooFar } else { Deviation::Mm(mm) }
    }

    /// 1 when a normal points outside, else −1.
    fn outside(&self, normal: &Vector3<f64>, given: &Vector3<f64>) -> f64 {
        let side = normal.dot(given);
        let side = if side == 0.0 { normal.dot(&self.towards) } else { side };
        if side < 0.0 { -1.0 } else { 1.0 }
    }

    /// A normal of the surface around a slot, turned outside.
    pub(crate) fn towards_outside(&self, slot: usize, normal: &Vector3<f64>) -> Vector3<f64> {
        let mut surroundings = Surroundings::default();
        self.gather(slot, self.radius_mm, &mut surroundings);
        normal * self.outside(normal, &surroundings.normal)
    }

    /// The points around a slot that belong to the same side of the part, and the sum of their normals.
    fn gather(&self, slot: usize, radius_mm: f64, surroundings: &mut Surroundings) {
        let normal_of =
            |slot: usize| self.given.get(slot).map_or(Vector3::zeros(), |n| Vector3::from(n.map(f64::from)));
        let own = normal_of(slot);
        let least = OTHER_SIDE_COSINE * own.norm();
        surroundings.points.clear();
        surroundings.normal = Vector3::zeros();
        self.tree.within(&self.tree.sites()[slot], radius_mm, |near| {
            let normal = normal_of(near);
            // Points without a normal pass: their cosine is zero, and so is the limit.
            if own.dot(&normal) >= least * normal.norm() {
                surroundings.points.push(self.tree.sites()[near]);
                surroundings.normal += normal;
            }
        });
    }

    /// Gives each point a normal from the plane of its surroundings, as an alignment needs them.
    #[must_use]
    pub fn with_normals(mut self) -> Self {
        let slots: Vec<usize> = (0..self.tree.sites().len()).collect();
        let parts: Vec<(Vec<Option<Sloped>>, f64)> = slots
            .par_chunks(CHUNK)
            .map(|chunk| {
                let mut surroundings = Surroundings::default();
                let normals: Vec<_> =
                    chunk.iter().map(|slot| self.normal(*slot, &mut surroundings)).collect();
                let variance = normals.iter().flatten().map(|n| n.variance).sum();
                (normals, variance)
            })
            .collect();
        let count = parts.iter().flat_map(|p| &p.0).flatten().count();
        self.normal_variance = parts.iter().map(|p| p.1).sum::<f64>() / count.max(1) as f64;
        self.normals = parts.into_iter().flat_map(|p| p.0).map(|n| Some(n?.normal)).collect();
        self
    }

    /// Normal at a slot, and the variance of its slope: that of a regression on n points is σ²/(n · mean square).
    fn normal(&self, slot: usize, surroundings: &mut Surroundings) -> Option<Sloped> {
        self.gather(slot, self.radius_mm, surroundings);
        if surroundings.points.len() < LEAST_REFERENCE_POINTS {
            self.gather(slot, 2.0 * self.radius_mm, surroundings);
        }
        let mut moments = Moments::about(self.tree.sites()[slot]);
        moments.extend(&surroundings.points);
        if moments.count() < LEAST_REFERENCE_POINTS {
            return None;
        }
        let (normal, [least, middle, _]) = eigen_normal(&moments.covariance())?;
        let variance = least.max(0.0) / (moments.count() as f64 * middle);
        Some(Sloped { normal: normal * self.outside(&normal, &surroundings.normal), variance })
    }

    /// The matching point, and what is then known of the points around.
    fn closest(&self, p: &Point3<f64>, limit_mm: f64, known: &mut Neighbourhood) -> Option<Match> {
        let slot = self.tree.nearest_again(p, limit_mm, known)?;
        let normal = (*self.normals.get(slot)?)?;
        let away = p - self.tree.sites()[slot];
        let distance_mm = normal.dot(&away);
        let lateral2 = (away.norm_squared() - distance_mm * distance_mm).max(0.0);
        let edge = EDGE_SPACINGS * self.spacing_mm;
        Some(Match { normal, distance_mm, beyond_edge: lateral2 > edge * edge })
    }
}

/// A normal and the variance of its slope, rad².
struct Sloped {
    normal: Vector3<f64>,
    variance: f64,
}

/// Scratch of one thread.
#[derive(Default)]
struct Surroundings {
    points: Vec<Point3<f64>>,
    normal: Vector3<f64>,
}

impl Reference {
    /// Bounding box of the reference, mm.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Cloud(cloud) => cloud.tree.bounds().unwrap_or(Aabb::of(&[])),
            Self::Mesh(mesh) => mesh.bounds(),
        }
    }

    /// Signed distances of points up to a limit, in their order.
    pub fn deviations(&self, points: &[Point], limit_mm: f64) -> Vec<Deviation> {
        let chunk = |part: &[Point]| -> Vec<Deviation> {
            let mut scratch = Surroundings::default();
            part.iter().map(|p| self.deviation(&p.position(), limit_mm, &mut scratch)).collect()
        };
        points.par_chunks(CHUNK).flat_map_iter(chunk).collect()
    }

    fn deviation(&self, p: &Point3<f64>, limit_mm: f64, scratch: &mut Surroundings) -> Deviation {
        match self {
            Self::Cloud(cloud) => cloud.deviation(p, limit_mm, scratch),
            Self::Mesh(mesh) => match mesh.nearest(p, limit_mm) {
                None => Deviation::TooFar,
                Some(foot) if foot.at_border && beside(p, &foot.position, &foot.normal) => {
                    Deviation::BeyondEdge
                }
                Some(foot) => Deviation::Mm(foot.signed_mm),
            },
        }
    }

    /// The matching point for an alignment, `None` beyond the limit or without a normal. `known`: what the same point found
    /// the last time.
    pub(crate) fn closest(&self, p: &Point3<f64>, limit_mm: f64, known: &mut Neighbourhood) -> Option<Match> {
        match self {
            Self::Cloud(cloud) => cloud.closest(p, limit_mm, known),
            Self::Mesh(mesh) => mesh.nearest(p, limit_mm).map(|foot| Match {
                normal: foot.normal,
                distance_mm: foot.normal.dot(&(p - foot.position)),
                beyond_edge: foot.at_border && beside(p, &foot.position, &foot.normal),
            }),
        }
    }

    /// Mean variance of the slope of its normals, rad².
    pub(crate) fn normal_variance(&self) -> f64 {
        match self {
            Self::Cloud(cloud) => cloud.normal_variance,
            Self::Mesh(_) => 0.0,
        }
    }
}

/// Whether a foot on a border belongs to a point beside the surface: more than rounding away from its normal.
fn beside(p: &Point3<f64>, foot: &Point3<f64>, normal: &Vector3<f64>) -> bool {
    let away = p - foot;
    (away - normal * normal.dot(&away)).norm() > 1e-9 * (1.0 + p.coords.norm())
}
