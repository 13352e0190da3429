//! One level of the alignment: rounds of matching and solving.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::motion::{Equations, Principal, orthonormal};
use super::{LEAST_POINTS, RegisterError, RegisterSettings};
use crate::fit::Normal;
use crate::reference::{Match, Reference};
use crate::spatial::{CHUNK, Neighbourhood};
use fringe::geometry::pose::Pose;
use fringe::math::statistics::{SIGMA_OF_MEDIAN, median};

/// The reach of a round, in medians of the matched points' distances along the normal in the round before: far enough to
/// hold a part that is still turned.
const REACH_MEDIANS: f64 = 20.0;

/// The reach is never less than so many spacings of the reference.
const REACH_SPACINGS: f64 = 4.0;

/// After so many rounds, points at the limits may join and leave in turn. Steps are then halved, which averages over the
/// turns, and the alignment has converged when a step is this part of a standard deviation of the pose, for points that
/// count as independent. What is left adds less than one part in a hundred to the uncertainty.
const SETTLING_ROUNDS: usize = 20;
const SETTLED_SIGMAS: f64 = 0.1;

/// What a level works on.
pub(super) struct Level<'a> {
    pub points: &'a [Point3<f64>],
    pub reference: &'a Reference,
    pub reach_mm: f64,
    pub settings: &'a RegisterSettings,
}

/// What a level ends with.
pub(super) struct Refined {
    pub pose: Pose,
    pub rounds: usize,
    pub converged: bool,
    pub moved_mm: f64,
    pub next_reach_mm: f64,
    pub equations: Equations,
    pub principal: Principal,
    /// Points within the reach and above the reference.
    pub overlapping: usize,
    pub points: usize,
    pub median_mm: f64,
    /// The matches of the last round, and up to which distance they were used, mm.
    pub pairs: Vec<Pair>,
    pub limit_mm: f64,
}

/// A point of the cloud with its match.
#[derive(Clone, Copy)]
pub(super) struct Pair {
    pub place: Point3<f64>,
    /// Normal of its match.
    pub normal: Vector3<f64>,
    /// Distance along that normal, mm.
    pub distance_mm: f64,
}

/// Runs rounds until the points stand still.
pub(super) fn refine(level: &Level<'_>, start: Pose) -> Result<Refined, RegisterError> {
    let mut matches = Matches::new(level.points);
    let mut distances = Vec::new();
    let mut pose = start;
    let mut reach_mm = level.reach_mm;
    let least_reach_mm = REACH_SPACINGS * spacing_mm(level.reference);
    let mut rounds = 0;
    loop {
        rounds += 1;
        matches.renew(level, &pose, reach_mm);
        let pairs = &matches.pairs;
        let needed = LEAST_POINTS.max((level.settings.least_overlap * level.points.len() as f64) as usize);
        if pairs.len() < LEAST_POINTS {
            return Err(RegisterError::Few { matched: pairs.len(), needed });
        }
        distances.clear();
        distances.extend(pairs.iter().map(|p| p.distance_mm.abs()));
        let median_mm = median(&mut distances).unwrap_or(0.0);
        let limit_mm = level.settings.trim_sigmas * SIGMA_OF_MEDIAN * median_mm;
        let equations = equations(pairs, limit_mm);
        let principal = equations.principal(level.reference.normal_variance());
        let settling = rounds > SETTLING_ROUNDS;
        let motion = equations.step(&principal) * if settling { 0.5 } else { 1.0 };
        let moved_mm = motion.fixed_rows::<3>(0).norm() + motion.fixed_rows::<3>(3).norm();
        let step = equations.pose(&motion).after(&pose);
        pose = Pose { rotation: orthonormal(&step.rotation), translation: step.translation };
        let within_noise = settling && equations.in_sigmas(&principal, &motion) <= SETTLED_SIGMAS;
        let converged = moved_mm <= level.settings.still_mm || within_noise;
        reach_mm = reach_mm.min((REACH_MEDIANS * median_mm + moved_mm).max(least_reach_mm));
        if converged || rounds >= level.settings.max_rounds {
            let (overlapping, points) = (pairs.len(), level.points.len());
            let next_reach_mm = reach_mm;
            return Ok(Refined {
                pose,
                rounds,
                converged,
                moved_mm,
                next_reach_mm,
                equations,
                principal,
                overlapping,
                points,
                median_mm,
                pairs: matches.pairs,
                limit_mm,
            });
        }
    }
}

/// Typical distance of the reference's points; of a mesh a thousandth of its size, which only bounds the reach.
fn spacing_mm(reference: &Reference) -> f64 {
    match reference {
        Reference::Cloud(cloud) => cloud.spacing_mm(),
        Reference::Mesh(_) => 1e-3 * super::diagonal_mm(reference),
    }
}

/// The matches of all points, and what is known of each point's surroundings from the rounds before.
struct Matches {
    known: Vec<Neighbourhood>,
    /// Those of each part of the points.
    parts: Vec<Vec<Pair>>,
    /// All of them, in the order of the points.
    pairs: Vec<Pair>,
}

impl Matches {
    fn new(points: &[Point3<f64>]) -> Self {
        let parts = points.chunks(CHUNK).map(|part| Vec::with_capacity(part.len())).collect();
        let known = vec![Neighbourhood::unknown(); points.len()];
        Self { known, parts, pairs: Vec::with_capacity(points.len()) }
    }

    /// Matches all points; those beside the reference or beyond the reach have no pair.
    fn renew(&mut self, level: &Level<'_>, pose: &Pose, reach_mm: f64) {
        let known = self.known.par_chunks_mut(CHUNK);
        let parts = level.points.par_chunks(CHUNK).zip(known).zip(&mut self.parts);
        parts.for_each(|((points, known), pairs)| {
            let pair = |(point, known): (&Point3<f64>, &mut Neighbourhood)| {
                let place = Point3::from(pose.point(&point.coords));
                let found = level.reference.closest(&place, reach_mm, known)?;
                let Match { normal, distance_mm, beyond_edge } = found;
                (!beyond_edge).then_some(Pair { place, normal, distance_mm })
            };
            pairs.clear();
            pairs.extend(points.iter().zip(known).filter_map(pair));
        });
        self.pairs.clear();
        for part in &self.parts {
            self.pairs.extend_from_slice(part);
        }
    }
}

/// Sums the equations of the pairs up to a distance, in fixed parts.
fn equations(pairs: &[Pair], limit_mm: f64) -> Equations {
    // Half of the pairs lie within the median; a median of zero keeps the exact ones.
    let used = |pair: &&Pair| pair.distance_mm.abs() <= limit_mm;
    let parts: Vec<(Vector3<f64>, usize)> = pairs
        .par_chunks(CHUNK)
        .map(|part| {
            part.iter().filter(used).fold((Vector3::zeros(), 0), |(sum, n), p| (sum + p.place.coords, n + 1))
        })
        .collect();
    let count: usize = parts.iter().map(|p| p.1).sum();
    let centre = Point3::from(parts.iter().map(|p| p.0).sum::<Vector3<f64>>() / count.max(1) as f64);
    let squares: Vec<f64> = pairs
        .par_chunks(CHUNK)
        .map(|part| part.iter().filter(used).map(|p| (p.place - centre).norm_squared()).sum())
        .collect();
    let arm_mm = (squares.iter().sum::<f64>() / count.max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
    let sums: Vec<Normal<6>> = pairs
        .par_chunks(CHUNK)
        .map(|part| {
            let mut normal = Normal::zero();
            for p in part.iter().filter(used) {
                let derivatives = Equations::derivatives(&centre, arm_mm, &p.place, &p.normal);
                normal.add(p.distance_mm, &derivatives);
            }
            normal
        })
        .collect();
    let normal = sums.iter().fold(Normal::zero(), |sum, part| sum.join(part));
    Equations { normal, centre, arm_mm }
}
