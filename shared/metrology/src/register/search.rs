//! The start of an alignment when none is given: poses proposed by features and by principal axes, refined on few points, and the
//! one chosen that most of the cloud's points lie on the reference in; what matches as well is reported.

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use super::features::{Proposal, Proposer, apart_mm, moved};
use super::freedom::{Other, other};
use super::icp::{Level, Refined, refine};
use super::near::Near;
use super::oriented::{Sample, Samples, area_mm2};
use super::result::{Rival, Start};
use super::{RegisterError, RegisterSettings, diagonal_mm};
use crate::fit::eigen;
use crate::reference::Reference;
use crate::spatial::{Moments, Neighbourhood};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;

/// Samples of the cloud: pairs are drawn from all, poses compared on all, counted and refined on a few.
const CLOUD_SAMPLES: usize = 2000;
const COUNTED_SAMPLES: usize = 150;
const REFINED_SAMPLES: usize = 600;

/// Most samples of the reference for features, and how finely they divide the cloud's diagonal.
const REFERENCE_SAMPLES: f64 = 4000.0;
const DIAGONAL_STEPS: f64 = 30.0;

/// Samples of the grid lie so much closer.
const GRID_FINER: f64 = 3.0;

/// Rounds on the grid, and rounds against the reference itself.
const GRID_ROUNDS: i32 = 10;
const TRIAL_ROUNDS: usize = 30;

/// Proposals adjusted on the grid, and poses refined against the reference.
const MOST_ADJUSTED: usize = 400;
const MOST_TRIALS: usize = 24;

/// A pose is another one when it moves the cloud's points by more than this part of its diagonal, on the average.
const ANOTHER_POSE: f64 = 0.02;

/// Points lie on the reference within so many median distances of the best pose: four standard deviations of noise.
const TOLERANCE_MEDIANS: f64 = 6.0;

/// Normals of a point and its place on the reference agree within 60°.
const NORMAL_COSINE: f64 = 0.5;

/// Two poses are distinguished when at least this share of the points, and so many standard deviations of the number of
/// points that lie on the reference in one of the two only, speak for one of them.
const TELLING_SHARE: f64 = 0.01;
const TELLING_SIGMAS: f64 = 4.0;

/// Below this share of matches the signs of the normals are put in doubt.
const DOUBTFUL_SHARE: f64 = 0.5;

/// A pose refined against the reference.
struct Trial {
    start: Start,
    refined: Refined,
}

/// The result of the search.
pub(super) struct SearchResult {
    pub pose: Pose,
    pub start: Start,
    pub rival: Option<Rival>,
    /// Points farther away than this are no matches in the next level, mm.
    pub reach_mm: f64,
}

/// The best start, how it was found, and a rival.
///
/// # Errors
/// The cloud has no surface, or no pose matches.
pub(super) fn start(
    points: &[Point],
    reference: &Reference,
    settings: &RegisterSettings,
) -> Result<SearchResult, RegisterError> {
    let cloud = Samples::of_cloud(points, CLOUD_SAMPLES)?;
    let search = Search { cloud: &cloud, reference, settings, diagonal_mm: cloud.diagonal_mm() };
    let signed = cloud.signed && reference_signed(reference);
    let ranked = search.ranked(signed);
    let doubtful = |r: &Option<Ranked>| r.as_ref().is_none_or(|r| r.share() < DOUBTFUL_SHARE);
    if signed && doubtful(&ranked) {
        let unsigned = search.ranked(false);
        let share = |r: &Option<Ranked>| r.as_ref().map_or(0.0, Ranked::share);
        if share(&unsigned) > 2.0 * share(&ranked) {
            return search.conclude(unsigned);
        }
    }
    search.conclude(ranked)
}

fn reference_signed(reference: &Reference) -> bool {
    match reference {
        Reference::Cloud(cloud) => cloud.has_normals(),
        Reference::Mesh(_) => true,
    }
}

/// The inputs of one search.
struct Search<'a> {
    cloud: &'a Samples,
    reference: &'a Reference,
    settings: &'a RegisterSettings,
    /// Diagonal of the cloud's bounding box, mm.
    diagonal_mm: f64,
}

/// Trials with what lies on the reference in each, the best one first.
struct Ranked {
    trials: Vec<Trial>,
    /// For each trial and sample of the cloud.
    lies: Vec<Vec<bool>>,
    tolerance_mm: f64,
}

impl Ranked {
    fn share(&self) -> f64 {
        self.lies.first().map_or(0.0, |lies| count(lies) as f64 / lies.len().max(1) as f64)
    }
}

fn count(lies: &[bool]) -> usize {
    lies.iter().filter(|l| **l).count()
}

/// Whether the points speak for the first of two poses.
fn told_apart(first: &[bool], second: &[bool]) -> bool {
    let only = |a: &[bool], b: &[bool]| a.iter().zip(b).filter(|(a, b)| **a && !**b).count() as f64;
    let (for_first, for_second) = (only(first, second), only(second, first));
    let needed = (TELLING_SHARE * first.len() as f64).max(TELLING_SIGMAS * (for_first + for_second).sqrt());
    for_first - for_second >= needed
}

impl Search<'_> {
    /// Proposes, refines, ranks. `None` without any pose that matches.
    fn ranked(&self, signed: bool) -> Option<Ranked> {
        let spacing_mm = (self.diagonal_mm.min(diagonal_mm(self.reference)) / DIAGONAL_STEPS)
            .max((area_mm2(self.reference) / REFERENCE_SAMPLES).sqrt());
        let fine = Samples::of_reference(self.reference, spacing_mm / GRID_FINER);
        let coarse = fine.thinned(spacing_mm);
        let near = Near::new(&fine.list, signed, 1.5 * spacing_mm);
        let few = self.cloud.few(COUNTED_SAMPLES);
        let proposer =
            Proposer { cloud: self.cloud, few: &few, reference: &coarse, spacing_mm, near: &near, signed };
        let mut proposals = proposer.propose();
        proposals.truncate(MOST_ADJUSTED);
        let axes = axis_poses(&self.cloud.list, &coarse.list);
        proposals.extend(axes.into_iter().map(|pose| Proposal { pose, count: 0 }));
        let chosen = self.adjusted(&proposals, &near, &few, spacing_mm);
        let mut starts: Vec<(Pose, Start, f64)> =
            chosen.into_iter().map(|pose| (pose, Start::Search, spacing_mm)).collect();
        let as_it_lay = Pose { rotation: Matrix3::identity(), translation: Vector3::zeros() };
        starts.insert(0, (as_it_lay, Start::AsItLay, 0.1 * diagonal_mm(self.reference)));
        self.rank(self.trials(&starts), signed)
    }

    /// Proposals adjusted on the grid: the best ones that are different.
    fn adjusted(
        &self,
        proposals: &[Proposal],
        near: &Near<'_>,
        few: &[Sample],
        spacing_mm: f64,
    ) -> Vec<Pose> {
        let limits_mm = [1.5 * spacing_mm, 0.5 * spacing_mm];
        let adjust = |proposal: &Proposal| {
            let pose = near.settled(few, &proposal.pose, limits_mm, GRID_ROUNDS);
            Proposal { pose, count: near.count(&self.cloud.list, &pose, 0.25 * spacing_mm, 1) }
        };
        let mut adjusted: Vec<Proposal> = proposals.par_iter().map(adjust).collect();
        adjusted.sort_by_key(|p| std::cmp::Reverse(p.count));
        let mut chosen: Vec<Pose> = Vec::new();
        for proposal in adjusted {
            let another = |pose: &Pose| apart_mm(few, pose, &proposal.pose) > ANOTHER_POSE * self.diagonal_mm;
            if chosen.iter().all(another) {
                chosen.push(proposal.pose);
            }
            if chosen.len() == MOST_TRIALS {
                break;
            }
        }
        chosen
    }

    /// Some rounds against the reference from each start; those that match nothing are gone.
    fn trials(&self, starts: &[(Pose, Start, f64)]) -> Vec<Trial> {
        let settings = RegisterSettings { max_rounds: TRIAL_ROUNDS, ..*self.settings };
        let few: Vec<Point3<f64>> =
            self.cloud.few(REFINED_SAMPLES).iter().map(|s| Point3::from(s.place)).collect();
        let trial = |(pose, start, reach_mm): &(Pose, Start, f64)| {
            let reach_mm = settings.reach_mm.unwrap_or(*reach_mm);
            let level = Level { points: &few, reference: self.reference, reach_mm, settings: &settings };
            Some(Trial { start: *start, refined: refine(&level, *pose).ok()? })
        };
        let tried: Vec<Option<Trial>> = starts.par_iter().map(trial).collect();
        tried.into_iter().flatten().collect()
    }

    /// Puts the trial first that most points lie on the reference in; the pose as it lay, where no other is better.
    fn rank(&self, mut trials: Vec<Trial>, signed: bool) -> Option<Ranked> {
        let medians = trials.iter().map(|t| t.refined.median_mm);
        let floor_mm = 1e-4 * diagonal_mm(self.reference);
        let tolerance = |median_mm: f64| (TOLERANCE_MEDIANS * median_mm).max(floor_mm);
        let all = |tolerance_mm: f64| -> Vec<Vec<bool>> {
            trials.par_iter().map(|t| self.lies(&t.refined.pose, tolerance_mm, signed)).collect()
        };
        let most =
            |lies: &[Vec<bool>]| (0..lies.len()).max_by_key(|i| (count(&lies[*i]), std::cmp::Reverse(*i)));
        // A pose that a few points match may have the tightest residuals; what counts are those of the best one.
        let mut tolerance_mm = tolerance(medians.fold(f64::INFINITY, f64::min));
        let mut lies = all(tolerance_mm);
        let own_mm = tolerance(trials[most(&lies)?].refined.median_mm);
        if own_mm > tolerance_mm {
            (tolerance_mm, lies) = (own_mm, all(own_mm));
        }
        let best = most(&lies)?;
        let as_it_lay = trials.iter().position(|t| t.start == Start::AsItLay);
        let first = as_it_lay.filter(|i| !told_apart(&lies[best], &lies[*i])).unwrap_or(best);
        trials.swap(0, first);
        lies.swap(0, first);
        Some(Ranked { trials, lies, tolerance_mm })
    }

    /// Which samples lie on the reference.
    fn lies(&self, pose: &Pose, tolerance_mm: f64, signed: bool) -> Vec<bool> {
        let on = |sample: &Sample| {
            let (place, normal) = moved(sample, pose);
            let place = Point3::from(place);
            let matched = self.reference.closest(&place, 20.0 * tolerance_mm, &mut Neighbourhood::unknown());
            matched.filter(|m| !m.beyond_edge).is_some_and(|m| {
                let cosine = m.normal.dot(&normal);
                let agree = if signed { cosine } else { cosine.abs() } >= NORMAL_COSINE;
                agree && m.distance_mm.abs() <= tolerance_mm
            })
        };
        self.cloud.list.iter().map(on).collect()
    }

    /// The first trial with the rivals that the points do not distinguish from it.
    fn conclude(&self, ranked: Option<Ranked>) -> Result<SearchResult, RegisterError> {
        let few = RegisterError::Few { matched: 0, needed: super::LEAST_POINTS };
        let Some(ranked) = ranked.filter(|r| r.share() > 0.0) else { return Err(few) };
        let (chosen, lies) = (&ranked.trials[0], &ranked.lies[0]);
        let samples = self.cloud.few(COUNTED_SAMPLES);
        let limit_mm = ANOTHER_POSE * self.diagonal_mm;
        let mut rival: Option<Rival> = None;
        for (trial, matches) in ranked.trials.iter().zip(&ranked.lies).skip(1) {
            if told_apart(lies, matches) {
                continue;
            }
            let share = count(matches) as f64 / count(lies).max(1) as f64;
            let kind = other(&samples, &chosen.refined, &trial.refined.pose, limit_mm, || {
                self.symmetric(&trial.refined.pose.after(&chosen.refined.pose.inverse()), ranked.tolerance_mm)
            });
            let symmetric = match kind {
                Other::Same => continue,
                Other::Symmetric => true,
                Other::Different => false,
            };
            // The most telling one: a rival that is no symmetry before one that is, then the one that matches more.
            let rank = |r: &Rival| (!r.symmetric, r.share);
            let this = Rival { share, symmetric, pose: trial.refined.pose };
            if rival.as_ref().is_none_or(|old| rank(&this) > rank(old)) {
                rival = Some(this);
            }
        }
        let refined = &chosen.refined;
        Ok(SearchResult { pose: refined.pose, start: chosen.start, rival, reach_mm: refined.next_reach_mm })
    }

    /// Whether a motion brings the reference onto itself.
    fn symmetric(&self, motion: &Pose, tolerance_mm: f64) -> bool {
        let samples = Samples::of_reference(self.reference, diagonal_mm(self.reference) / DIAGONAL_STEPS);
        let lies = |sample: &Sample| {
            let (place, normal) = moved(sample, motion);
            let place = Point3::from(place);
            let matched = self.reference.closest(&place, 20.0 * tolerance_mm, &mut Neighbourhood::unknown());
            matched.is_some_and(|m| {
                m.normal.dot(&normal).abs() >= NORMAL_COSINE && m.distance_mm.abs() <= 2.0 * tolerance_mm
            })
        };
        let found = samples.list.iter().filter(|s| lies(s)).count();
        found as f64 >= 0.98 * samples.list.len() as f64
    }
}

/// Centroid and principal axes (columns, right-handed) of samples.
fn axes(samples: &[Sample]) -> (Vector3<f64>, Matrix3<f64>) {
    let mut moments = Moments::about(samples.first().map_or_else(Point3::origin, |s| Point3::from(s.place)));
    for sample in samples {
        moments.add(&Point3::from(sample.place));
    }
    let (_, mut vectors) = eigen(&moments.covariance());
    if vectors.determinant() < 0.0 {
        vectors.set_column(0, &-vectors.column(0));
    }
    (moments.centroid().coords, vectors)
}

/// The 24 ways to lay principal axes on principal axes: what serves surfaces too smooth for features.
fn axis_poses(cloud: &[Sample], reference: &[Sample]) -> Vec<Pose> {
    let ((from, from_axes), (to, to_axes)) = (axes(cloud), axes(reference));
    // Eigenvalues in order first: the other orders matter only where two are nearly equal.
    let orders = [[0, 1, 2], [1, 0, 2], [0, 2, 1], [2, 1, 0], [1, 2, 0], [2, 0, 1]];
    let mut poses = Vec::new();
    for order in orders {
        for signs in 0..8 {
            let mut turn = Matrix3::zeros();
            for (column, row) in order.into_iter().enumerate() {
                turn[(row, column)] = if signs >> column & 1 == 1 { -1.0 } else { 1.0 };
            }
            if turn.determinant() > 0.0 {
                let rotation = to_axes * turn * from_axes.transpose();
                poses.push(Pose { rotation, translation: to - rotation * from });
            }
        }
    }
    poses
}
