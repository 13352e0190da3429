//! A cloud as a reference: its tree, its normals, its nearest points.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{CloudError, LEAST_REFERENCE_POINTS, Match, check};
use crate::spatial::{CHUNK, Neighbourhood, Place, PointTree, Vicinity, eigen_normal, groups};
use fringe::cloud::Point;

/// Radius of the surroundings in spacings: 28 points on the average, of which a paraboloid takes its six coefficients.
pub(super) const RADIUS_SPACINGS: f64 = 3.0;

/// A foot farther from the nearest point of the reference than so many spacings lies beside the reference: among points
/// strewn at random three in a million would be that far from a place of the surface.
pub(super) const EDGE_SPACINGS: f64 = 2.0;

/// Points of a surface, prepared for distance queries.
#[derive(Debug, Clone)]
pub struct CloudReference {
    pub(crate) tree: PointTree,
    /// Normals of the file by slot; empty where the cloud has none.
    pub(super) given: Vec<[f32; 3]>,
    /// Standard uncertainties of the file by slot, mm; empty where the cloud states none.
    pub(super) sigmas_mm: Vec<f32>,
    /// Where the outside is when the cloud has no normals.
    towards: Vector3<f64>,
    pub(super) spacing_mm: f64,
    pub(super) radius_mm: f64,
    /// By slot; empty until [`Self::with_normals`].
    pub(crate) normals: Vec<Option<Vector3<f64>>>,
    /// Mean variance of the slope of those normals, from the scatter of the points, rad².
    pub(super) normal_variance: f64,
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
        let by_slot = || tree.order().iter().map(|i| &points[*i as usize]);
        let has_normals = points.iter().any(|p| p.normal != [0.0; 3]);
        let given = if has_normals { by_slot().map(|p| p.normal).collect() } else { Vec::new() };
        let states_sigmas = points.iter().any(|p| p.sigma_mm != 0.0);
        let sigmas_mm = if states_sigmas { by_slot().map(|p| p.sigma_mm).collect() } else { Vec::new() };
        let radius_mm = radius_mm.unwrap_or(RADIUS_SPACINGS * spacing_mm);
        let normals = Vec::new();
        Ok(Self { tree, given, sigmas_mm, towards, spacing_mm, radius_mm, normals, normal_variance: 0.0 })
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

    /// The place of a slot and its normal.
    pub(super) fn place(&self, slot: usize) -> Place {
        (self.tree.sites()[slot], self.given.get(slot).copied().unwrap_or_default())
    }

    /// 1 when a normal points outside, else −1.
    pub(super) fn outside(&self, normal: &Vector3<f64>, given: &Vector3<f64>) -> f64 {
        let side = normal.dot(given);
        let side = if side == 0.0 { normal.dot(&self.towards) } else { side };
        if side < 0.0 { -1.0 } else { 1.0 }
    }

    /// A normal of the surface around a slot, turned outside.
    pub(crate) fn towards_outside(&self, slot: usize, normal: &Vector3<f64>) -> Vector3<f64> {
        let mut vicinity = Vicinity::new();
        vicinity.gather(&self.tree, &self.given, &[self.place(slot)], self.radius_mm);
        normal * self.outside(normal, &vicinity.normal(0))
    }

    /// Gives each point a normal from the plane of its surroundings, as an alignment needs them.
    #[must_use]
    pub fn with_normals(mut self) -> Self {
        let slots: Vec<usize> = (0..self.len()).collect();
        let parts: Vec<(Vec<Option<Sloped>>, f64)> = slots
            .par_chunks(CHUNK)
            .map(|chunk| {
                let normals = self.normals_of(chunk);
                let variance = normals.iter().flatten().map(|n| n.variance).sum();
                (normals, variance)
            })
            .collect();
        let count = parts.iter().flat_map(|p| &p.0).flatten().count();
        self.normal_variance = parts.iter().map(|p| p.1).sum::<f64>() / count.max(1) as f64;
        self.normals = parts.into_iter().flat_map(|p| p.0).map(|n| Some(n?.normal)).collect();
        self
    }

    /// Normals at slots; surroundings with too few points are looked at twice as wide.
    fn normals_of(&self, slots: &[usize]) -> Vec<Option<Sloped>> {
        let (mut vicinity, mut alone) = (Vicinity::new(), Vicinity::new());
        let mut normals = Vec::with_capacity(slots.len());
        let places: Vec<Place> = slots.iter().map(|slot| self.place(*slot)).collect();
        for group in groups(places.iter().map(|p| p.0), self.spacing_mm) {
            vicinity.gather(&self.tree, &self.given, &places[group.clone()], self.radius_mm);
            for (lane, place) in places[group].iter().enumerate() {
                if vicinity.count(lane) < LEAST_REFERENCE_POINTS {
                    alone.gather(&self.tree, &self.given, &[*place], 2.0 * self.radius_mm);
                    normals.push(self.normal(&alone, 0));
                } else {
                    normals.push(self.normal(&vicinity, lane));
                }
            }
        }
        normals
    }

    /// Normal at a place, and the variance of its slope: that of a regression on n points is σ²/(n · mean square).
    fn normal(&self, vicinity: &Vicinity, lane: usize) -> Option<Sloped> {
        let moments = vicinity.moments(lane);
        if moments.count() < LEAST_REFERENCE_POINTS {
            return None;
        }
        let (normal, [least, middle, _]) = eigen_normal(&moments.covariance())?;
        let variance = least.max(0.0) / (moments.count() as f64 * middle);
        Some(Sloped { normal: normal * self.outside(&normal, &vicinity.normal(lane)), variance })
    }

    /// The matching point, and what is then known of the points around.
    pub(super) fn closest(&self, p: &Point3<f64>, limit_mm: f64, known: &mut Neighbourhood) -> Option<Match> {
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
