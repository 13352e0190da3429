//! Aligns a cloud with a reference: point-to-plane ICP from coarse to fine, with a report of how well it is determined.
//!
//! P. J. Besl, N. D. McKay, A method for registration of 3-D shapes, IEEE PAMI 14(2), 1992; Y. Chen, G. Medioni, Object
//! modelling by registration of multiple range images, IVC 10(3), 1992 (distances along the reference's normal). Each
//! round matches points with the nearest places of the reference, drops those beside it and those whose distance lies
//! beyond three robust standard deviations, and solves the linear equations of the small motion. Directions in which the
//! surfaces slide on each other (a plane on a plane) are found from the normal matrix, left as they were, and reported.
//!
//! Points near an edge of a mesh see both of its faces and stay out of the last rounds ([`creases`]).
//!
//! Without a given start, poses are proposed from pairs of oriented points, refined, and compared by the share of the
//! cloud that lies on the reference in each. A second pose that the points do not distinguish from the first makes the result
//! ambiguous.

mod covariance;
mod creases;
mod error;
mod features;
mod freedom;
mod icp;
mod motion;
mod near;
mod oriented;
mod result;
mod search;
#[cfg(test)]
mod tests;

pub use error::RegisterError;
pub use result::{Freedom, Outcome, Registration, Rival, Start};

use icp::{Level, refine};
use nalgebra::Point3;
use search::SearchResult;
use serde::{Deserialize, Serialize};

use crate::reference::{Reference, check};
use crate::spatial::thin_to;
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;

/// Fewest points: one more than the six unknowns.
const LEAST_POINTS: usize = 7;

/// Points of the first levels; the last one takes all. A tenth each time: the coarse ones cost next to nothing.
const LEVEL_POINTS: [usize; 2] = [2000, 20_000];

/// Settings of the iterative closest point alignment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RegisterSettings {
    /// Farthest match, mm; if `None`, a tenth of the reference's diagonal at first. Narrowed with the residuals.
    pub reach_mm: Option<f64>,
    /// Matches are dropped beyond so many robust standard deviations of their distances.
    pub trim_sigmas: f64,
    /// Rounds of each level at most.
    pub max_rounds: usize,
    /// The alignment stands still when no point moves by more than this, mm.
    pub still_mm: f64,
    /// Fewest points, as a share of the cloud, that must match.
    pub least_overlap: f64,
}

impl Default for RegisterSettings {
    fn default() -> Self {
        Self { reach_mm: None, trim_sigmas: 3.0, max_rounds: 60, still_mm: 1e-5, least_overlap: 0.1 }
    }
}

/// Where the alignment begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InitialPose {
    /// At this pose: reference frame from cloud frame.
    Given(Pose),
    /// Anywhere: the pose is searched; where several match alike, the one nearest to how the cloud lies is preferred.
    Search,
}

/// Finds the motion that brings a cloud onto a reference.
///
/// # Errors
/// See [`RegisterError`].
pub fn register(
    points: &[Point],
    reference: &Reference,
    initial: &InitialPose,
    settings: &RegisterSettings,
) -> Result<Registration, RegisterError> {
    check(points, LEAST_POINTS)?;
    let positions: Vec<Point3<f64>> = points.iter().map(Point::position).collect();
    let levels = levels(&positions);
    let widest_mm = settings.reach_mm.unwrap_or_else(|| 0.1 * diagonal_mm(reference));
    let found = match initial {
        InitialPose::Given(pose) => {
            SearchResult { pose: *pose, start: Start::Given, rival: None, reach_mm: widest_mm }
        }
        InitialPose::Search => search::start(points, reference, settings)?,
    };
    let (mut pose, mut reach_mm) = (found.pose, found.reach_mm);
    let mut rounds = Vec::new();
    let mut last = None;
    for points in &levels {
        let level = refine(&Level { points, reference, reach_mm, settings }, pose)?;
        // Finer levels begin where the coarser one ended: within its residuals.
        reach_mm = reach_mm.min(level.next_reach_mm);
        pose = level.pose;
        rounds.push(level.rounds);
        last = Some(level);
    }
    let Some(mut last) = last else { return Err(RegisterError::Few { matched: 0, needed: LEAST_POINTS }) };
    let mut at_edges = 0;
    if let Reference::Mesh(mesh) = reference
        && let Some(apart) = creases::apart(&positions, mesh, &last)
    {
        let level = Level { points: &apart, reference, reach_mm, settings };
        if let Some(better) = creases::refined(&level, &last) {
            rounds.push(better.rounds);
            at_edges = positions.len() - apart.len();
            last = better;
        }
    }
    result::conclude(&last, rounds, found.start, (found.rival, at_edges), settings)
}

fn diagonal_mm(reference: &Reference) -> f64 {
    let bounds = reference.bounds();
    (bounds.high - bounds.low).norm()
}

/// The cloud thinned evenly over its surface, coarse to fine, and last as it is.
fn levels(positions: &[Point3<f64>]) -> Vec<Vec<Point3<f64>>> {
    let thin = |n: &usize| thin_to(positions, *n).into_iter().map(|i| positions[i as usize]).collect();
    let mut levels: Vec<Vec<Point3<f64>>> =
        LEVEL_POINTS.iter().filter(|n| positions.len() > 2 * **n).map(thin).collect();
    levels.push(positions.to_vec());
    levels
}
