//! Signed distances of many points from a cloud: from the paraboloid around the nearest of its points. A paraboloid belongs to a point
//! of the reference, so those whose nearest it is share it, and neighbours find the points around them together.

use nalgebra::Point3;
use rayon::prelude::*;

use super::cloud::{EDGE_SPACINGS, RADIUS_SPACINGS};
use super::{CloudReference, Deviation};
use crate::counted_order::counted_order;
use crate::spatial::{CHUNK, Patch, Place, Vicinity, groups};
use fringe::cloud::Point;

/// A foot farther from the middle of its surroundings than this part of their radius lies beside the reference. On a
/// straight edge it is 4/3π = 0.42; one spacing beyond it, 0.33 more.
const EDGE_MIDDLE: f64 = 0.75;

/// Surroundings that hold fewer points are looked at twice as wide.
const ENOUGH_POINTS: usize = 12;

/// A surface, the side of it that is outside, and the radius of the surroundings that it was made of, mm.
struct Surface {
    patch: Option<Patch>,
    outside: f64,
    radius_mm: f64,
}

fn places(points: &[Point]) -> Vec<Point3<f64>> {
    points.par_iter().with_min_len(CHUNK).map(Point::position).collect()
}

impl CloudReference {
    /// Signed distances of points up to a limit, in their order.
    pub(super) fn deviations(&self, points: &[Point], limit_mm: f64) -> Vec<Deviation> {
        let places = places(points);
        let nearest = self.nearest(&places, limit_mm);
        // Those without a nearest point come last.
        let order = counted_order(&nearest, self.len() + 1);
        let near = order.partition_point(|index| (nearest[*index as usize] as usize) < self.len());
        let parts: Vec<Vec<Deviation>> = order[..near]
            .par_chunks(CHUNK)
            .map(|part| self.deviations_of(part, &places, &nearest, limit_mm))
            .collect();
        let mut deviations = vec![Deviation::TooFar; places.len()];
        for (index, deviation) in order.iter().zip(parts.into_iter().flatten()) {
            deviations[*index as usize] = deviation;
        }
        deviations
    }

    /// The nearest slot of each place whose deviation may be within a limit; none of the slots where there is none.
    fn nearest(&self, places: &[Point3<f64>], limit_mm: f64) -> Vec<u32> {
        let lateral = self.lateral_mm();
        let reach_mm = (limit_mm * limit_mm + lateral * lateral).sqrt();
        self.tree.nearest_of_all(places, reach_mm, self.spacing_mm)
    }

    /// What the nearest points of the reference state as their standard uncertainty, mm; 0 where none is near.
    pub(super) fn sigmas_of_nearest(&self, points: &[Point], limit_mm: f64) -> Vec<f32> {
        let nearest = self.nearest(&places(points), limit_mm);
        nearest.iter().map(|slot| self.sigmas_mm.get(*slot as usize).copied().unwrap_or(0.0)).collect()
    }

    /// Distances of points from the nearest point of the reference up to a limit, in their order.
    pub(super) fn to_nearest(&self, points: &[Point], limit_mm: f64) -> Vec<Deviation> {
        let places = places(points);
        let nearest = self.tree.nearest_of_all(&places, limit_mm, self.spacing_mm);
        let sites = self.tree.sites();
        let distance = |(place, slot): (&Point3<f64>, &u32)| {
            sites.get(*slot as usize).map_or(Deviation::TooFar, |site| Deviation::Mm((place - site).norm()))
        };
        places.par_iter().zip(&nearest).with_min_len(CHUNK).map(distance).collect()
    }

    /// Distances of places, which come in the order of their nearest slots.
    fn deviations_of(
        &self,
        part: &[u32],
        places: &[Point3<f64>],
        nearest: &[u32],
        limit_mm: f64,
    ) -> Vec<Deviation> {
        let slot_of = |index: &u32| nearest[*index as usize] as usize;
        let shared: Vec<&[u32]> = part.chunk_by(|a, b| slot_of(a) == slot_of(b)).collect();
        let at: Vec<Place> = shared.iter().map(|same| self.place(slot_of(&same[0]))).collect();
        let mut vicinity = Vicinity::new();
        let mut deviations = Vec::with_capacity(part.len());
        for group in groups(at.iter().map(|p| p.0), self.spacing_mm) {
            let surfaces = self.surfaces(&at[group.clone()], &mut vicinity);
            for (surface, same) in surfaces.iter().zip(&shared[group]) {
                let from = |index: &u32| self.deviation(&places[*index as usize], surface, limit_mm);
                deviations.extend(same.iter().map(from));
            }
        }
        deviations
    }

    /// The surfaces around some places; surroundings with few points are looked at twice as wide.
    fn surfaces(&self, at: &[Place], vicinity: &mut Vicinity) -> Vec<Surface> {
        let mut surfaces = self.surfaces_within(at, self.radius_mm, vicinity);
        let few: Vec<usize> = (0..at.len()).filter(|lane| vicinity.count(*lane) < ENOUGH_POINTS).collect();
        for lane in few {
            let wide = self.surfaces_within(&at[lane..=lane], 2.0 * self.radius_mm, vicinity);
            surfaces.splice(lane..=lane, wide);
        }
        surfaces
    }

    fn surfaces_within(&self, at: &[Place], radius_mm: f64, vicinity: &mut Vicinity) -> Vec<Surface> {
        vicinity.gather(&self.tree, &self.given, at, radius_mm);
        let surface = |(lane, patch): (usize, Option<Patch>)| {
            let outside = patch.map_or(1.0, |p| self.outside(&p.normal(), &vicinity.normal(lane)));
            Surface { patch, outside, radius_mm }
        };
        vicinity.patches(at.len()).into_iter().take(at.len()).enumerate().map(surface).collect()
    }

    /// How far a foot may lie from the nearest point of the reference, mm.
    fn lateral_mm(&self) -> f64 {
        EDGE_SPACINGS * self.spacing_mm.max(self.radius_mm / RADIUS_SPACINGS)
    }

    /// Signed distance of a point, mm.
    fn deviation(&self, p: &Point3<f64>, surface: &Surface, limit_mm: f64) -> Deviation {
        let Some(patch) = &surface.patch else { return Deviation::NoSurface };
        let radius_mm = surface.radius_mm;
        let (from_nearest, from_middle) = patch.offsets_mm(p);
        let farthest = self.lateral_mm() * radius_mm / self.radius_mm;
        if from_nearest > farthest || from_middle > EDGE_MIDDLE * radius_mm {
            return Deviation::BeyondEdge;
        }
        let mm = surface.outside * patch.distance_mm(p);
        if mm.abs() > limit_mm { Deviation::TooFar } else { Deviation::Mm(mm) }
    }
}
