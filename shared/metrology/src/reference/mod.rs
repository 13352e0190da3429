//! The reference that a cloud is compared with: another cloud, or a mesh.

mod cloud;
mod distances;

pub use cloud::CloudReference;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use thiserror::Error;

use crate::fit::COORDINATE_LIMIT_MM;
use crate::spatial::{Aabb, CHUNK, Neighbourhood, TriangleMesh};
use fringe::cloud::Point;

/// Fewest points of a reference cloud: those of one plane.
pub const LEAST_REFERENCE_POINTS: usize = 4;

/// Why a cloud cannot be a reference, or cannot be compared with one.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum CloudError {
    /// The reference has too few points.
    #[error("has {found} point{}, at least {needed} are needed; is this the right file?", if *.found == 1 { "" } else { "s" })]
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
    /// Hardly any point has a plane of neighbours.
    #[error(
        "shows no surface: its points lie on a line, or too far apart for their number; is this the right file?"
    )]
    NoSurface,
}

/// A reference for comparison: a mesh, or a cloud with a local surface.
#[derive(Debug, Clone)]
pub enum Reference {
    /// Points of a surface.
    Cloud(CloudReference),
    /// Triangles of a CAD model.
    Mesh(TriangleMesh),
}

/// Distance of a point from the reference, or why it has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Deviation {
    /// Along the normal of the reference, positive outside; without a sign where it is that from the nearest point. In mm.
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
        match self {
            Self::Cloud(cloud) => cloud.deviations(points, limit_mm),
            Self::Mesh(mesh) => points
                .par_iter()
                .with_min_len(CHUNK)
                .map(|p| from_mesh(mesh, &p.position(), limit_mm))
                .collect(),
        }
    }

    /// Standard uncertainties of the reference where points have their deviation, in their order, mm: that which the nearest point of a measured
    /// cloud states, 0 of a mesh and of a cloud without any. The surface through the points around has hardly ever a larger one.
    pub fn sigmas_mm(&self, points: &[Point], limit_mm: f64) -> Vec<f32> {
        match self {
            Self::Cloud(cloud) if !cloud.sigmas_mm.is_empty() => cloud.sigmas_of_nearest(points, limit_mm),
            Self::Cloud(_) | Self::Mesh(_) => vec![0.0; points.len()],
        }
    }

    /// Distances of points, without a sign, from the nearest point of a cloud or place of a mesh up to a limit, in their order. That from a
    /// cloud grows with the spacing of its points; also what lies beside the reference has one.
    pub fn distances_to_nearest(&self, points: &[Point], limit_mm: f64) -> Vec<Deviation> {
        let from_mesh = |mesh: &TriangleMesh, p: &Point3<f64>| {
            let foot = mesh.nearest(p, limit_mm);
            foot.map_or(Deviation::TooFar, |foot| Deviation::Mm((p - foot.position).norm()))
        };
        match self {
            Self::Cloud(cloud) => cloud.to_nearest(points, limit_mm),
            Self::Mesh(mesh) => {
                points.par_iter().with_min_len(CHUNK).map(|p| from_mesh(mesh, &p.position())).collect()
            }
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

/// Signed distance of a point from the nearest triangle.
fn from_mesh(mesh: &TriangleMesh, p: &Point3<f64>, limit_mm: f64) -> Deviation {
    match mesh.nearest(p, limit_mm) {
        None => Deviation::TooFar,
        Some(foot) if foot.at_border && beside(p, &foot.position, &foot.normal) => Deviation::BeyondEdge,
        Some(foot) => Deviation::Mm(foot.signed_mm),
    }
}

/// Whether a foot on a border belongs to a point beside the surface: more than rounding away from its normal.
fn beside(p: &Point3<f64>, foot: &Point3<f64>, normal: &Vector3<f64>) -> bool {
    let away = p - foot;
    (away - normal * normal.dot(&away)).norm() > 1e-9 * (1.0 + p.coords.norm())
}
