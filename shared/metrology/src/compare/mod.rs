//! Comparison of a cloud with a reference: signed distances and their statistics.
//!
//! Against a mesh the distance is that from the nearest triangle, exactly. Against a cloud it is that from the surface
//! which the reference's points around the nearest one make (a paraboloid), along its normal: not from the nearest
//! point, whose distance grows with the spacing of the points. [`m3c2`] compares means in cylinders instead and reports
//! which changes the scatter leaves significant.

pub mod m3c2;
mod statistics;
#[cfg(test)]
mod tests;
mod tolerance;

pub use statistics::{Histogram, PERCENTS, Percentile, Statistics};
pub use tolerance::{Conformity, GUARD_FACTOR, Tolerance};

use crate::reference::{Deviation, Reference};
use fringe::cloud::Point;
use serde::Serialize;

/// Distances of a cloud from a reference.
#[derive(Debug, Clone)]
pub struct Comparison {
    /// Of each point, in the order of the cloud.
    pub deviations: Vec<Deviation>,
    /// Points of each fate.
    pub counts: Counts,
    /// Over all points with a distance; `None` without any.
    pub statistics: Option<Statistics>,
}

/// How many points were compared, and why others were not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Counts {
    /// Number of points of the cloud.
    pub points: usize,
    /// Points with a distance: the count of the statistics, therefore not written again.
    #[serde(skip)]
    pub count: usize,
    /// Farther from the reference than the limit.
    pub cut_too_far: usize,
    /// Number of points whose foot is outside of the reference's border.
    pub cut_beyond_edge: usize,
    /// Where the reference has too few points for a plane.
    pub cut_no_surface: usize,
}

impl Counts {
    fn of(deviations: &[Deviation]) -> Self {
        let mut counts = Self { points: deviations.len(), ..Self::default() };
        for deviation in deviations {
            *match deviation {
                Deviation::Mm(_) => &mut counts.count,
                Deviation::TooFar => &mut counts.cut_too_far,
                Deviation::BeyondEdge => &mut counts.cut_beyond_edge,
                Deviation::NoSurface => &mut counts.cut_no_surface,
            } += 1;
        }
        counts
    }
}

/// Compares a cloud with the surface of a reference; points farther away than `limit_mm` are counted and left out.
pub fn compare(points: &[Point], reference: &Reference, limit_mm: f64) -> Comparison {
    summarised(reference.deviations(points, limit_mm))
}

/// Compares a cloud with the nearest points of a reference, without a sign; points farther away than `limit_mm` are counted and left out.
pub fn compare_with_nearest(points: &[Point], reference: &Reference, limit_mm: f64) -> Comparison {
    summarised(reference.distances_to_nearest(points, limit_mm))
}

fn summarised(deviations: Vec<Deviation>) -> Comparison {
    let values: Vec<f64> = deviations.iter().filter_map(|d| d.mm()).collect();
    Comparison { counts: Counts::of(&deviations), statistics: Statistics::of(&values), deviations }
}
