//! Where to begin when nobody knows: many poses tried on few points, the best one by what it matches.

use nalgebra::{Matrix3, Point3, Quaternion, UnitQuaternion, Vector3};
use rayon::prelude::*;
use std::f64::consts::TAU;

use super::icp::{Level, refine};
use super::result::Start;
use super::{RegisterError, RegisterSettings, diagonal_mm};
use crate::fit::eigen;
use crate::reference::Reference;
use crate::spatial::{Moments, thinned};
use fringe::geometry::pose::Pose;
use fringe::math;

/// Points and rounds of a trial.
const TRIAL_POINTS: usize = 500;
const TRIAL_ROUNDS: usize = 20;

/// Turns when the principal axes do not lead anywhere: a mean distance of 24° between neighbours, which ICP bridges.
const TURNS: usize = 512;

/// Share of matches that makes turning unnecessary.
const GOOD_SHARE: f64 = 0.6;

/// Another pose must match so much more of the cloud than the one in which it lay.
const CLEARLY_BETTER: f64 = 1.05;

/// A pose is another one when it moves the points by more than this part of the reference's diagonal.
const ANOTHER_POSE: f64 = 0.05;

/// A pose that matches at least this share of what the best one matches is reported.
const RIVAL_SHARE: f64 = 0.95;

/// Fineness of the grid that evens out the density of the reference, in parts of its diagonal.
const EVEN_PARTS: f64 = 100.0;

/// A pose after a few rounds.
struct Trial {
    pose: Pose,
    start: Start,
    median_mm: f64,
}

/// The best start, how it was found, and the share of a rival.
pub(super) fn start(
    points: &[Point3<f64>],
    reference: &Reference,
    settings: &RegisterSettings,
) -> Result<(Pose, Start, Option<f64>), RegisterError> {
    let step = points.len().div_ceil(TRIAL_POINTS).max(1);
    let few: Vec<Point3<f64>> = points.iter().copied().step_by(step).collect();
    let mut poses =
        vec![(Pose { rotation: Matrix3::identity(), translation: Vector3::zeros() }, Start::AsItLay)];
    poses.extend(axis_poses(points, reference).into_iter().map(|pose| (pose, Start::PrincipalAxes)));
    let mut trials = run(&few, reference, settings, &poses);
    let mut ranked = rank(&few, reference, &trials);
    if ranked.first().is_none_or(|best| best.1 < GOOD_SHARE) {
        let turns = turn_poses(points, reference).into_iter().map(|pose| (pose, Start::Turns));
        trials.extend(run(&few, reference, settings, &turns.collect::<Vec<_>>()));
        ranked = rank(&few, reference, &trials);
    }
    let Some(&(best, share)) = ranked.first() else {
        return Err(RegisterError::Few { matched: 0, needed: super::LEAST_POINTS });
    };
    let another = |a: &Pose, b: &Pose| {
        let moved: f64 = few.iter().map(|p| (a.point(&p.coords) - b.point(&p.coords)).norm()).sum();
        moved / few.len().max(1) as f64 > ANOTHER_POSE * diagonal_mm(reference)
    };
    let chosen = &trials[best];
    let rival = ranked.iter().find(|(i, _)| another(&trials[*i].pose, &chosen.pose));
    let rival = rival.map(|(_, other)| other / share).filter(|ratio| *ratio >= RIVAL_SHARE);
    Ok((chosen.pose, chosen.start, rival))
}

/// A few rounds from each pose; those that match nothing are gone.
fn run(
    points: &[Point3<f64>],
    reference: &Reference,
    settings: &RegisterSettings,
    poses: &[(Pose, Start)],
) -> Vec<Trial> {
    let settings = RegisterSettings { max_rounds: TRIAL_ROUNDS, ..*settings };
    let reach_mm = settings.reach_mm.unwrap_or_else(|| 0.1 * diagonal_mm(reference));
    let level = Level { points, reference, reach_mm, settings: &settings };
    let trial = |(pose, start): &(Pose, Start)| {
        let found = refine(&level, *pose).ok()?;
        Some(Trial { pose: found.pose, start: *start, median_mm: found.median_mm })
    };
    let tried: Vec<Option<Trial>> = poses.par_iter().map(trial).collect();
    tried.into_iter().flatten().collect()
}

/// Trials with the share of points that lie on the reference, best first; the pose as it lay wins unless another one
/// is clearly better.
fn rank(points: &[Point3<f64>], reference: &Reference, trials: &[Trial]) -> Vec<(usize, f64)> {
    let tightest = trials.iter().map(|t| t.median_mm).fold(f64::INFINITY, f64::min);
    let tolerance_mm = (6.0 * tightest).max(1e-4 * diagonal_mm(reference));
    let share = |pose: &Pose| {
        let lies_on = |p: &&Point3<f64>| {
            let place = Point3::from(pose.point(&p.coords));
            let matched = reference.closest(&place, diagonal_mm(reference), &mut u32::MAX.clone());
            let near =
                |m: &crate::reference::Match| m.normal.dot(&(place - m.position)).abs() <= tolerance_mm;
            matched.filter(|m| !m.beyond_edge).as_ref().is_some_and(near)
        };
        points.iter().filter(lies_on).count() as f64 / points.len().max(1) as f64
    };
    let shares: Vec<f64> = trials.par_iter().map(|t| share(&t.pose)).collect();
    let mut ranked: Vec<(usize, f64)> = shares.into_iter().enumerate().collect();
    let weight = |(i, share): &(usize, f64)| {
        if trials[*i].start == Start::AsItLay { share * CLEARLY_BETTER } else { *share }
    };
    ranked.sort_by(|a, b| weight(b).total_cmp(&weight(a)).then(a.0.cmp(&b.0)));
    ranked
}

/// Centroid and principal axes (columns, right-handed) of a cloud.
fn axes(points: &[Point3<f64>]) -> (Vector3<f64>, Matrix3<f64>) {
    let mut moments = Moments::about(points.first().copied().unwrap_or_else(Point3::origin));
    moments.extend(points);
    (moments.centroid().coords, right_handed(&moments.covariance()))
}

fn right_handed(covariance: &Matrix3<f64>) -> Matrix3<f64> {
    let (_, mut vectors) = eigen(covariance);
    if vectors.determinant() < 0.0 {
        vectors.set_column(0, &-vectors.column(0));
    }
    vectors
}

/// Centroid and principal axes of the surface of the reference.
fn reference_axes(reference: &Reference) -> (Vector3<f64>, Matrix3<f64>) {
    match reference {
        Reference::Cloud(cloud) => {
            let sites = cloud.tree.sites();
            let even = thinned(sites, diagonal_mm(reference) / EVEN_PARTS);
            axes(&even.into_iter().map(|i| sites[i as usize]).collect::<Vec<_>>())
        }
        Reference::Mesh(mesh) => {
            // Moments of a triangle: area/12 · (Σ vᵢ vᵢᵀ + 9 c cᵀ).
            let (mut area, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
            let about = mesh.bounds().centre();
            for triangle in mesh.triangles() {
                let [a, b, c] = triangle.corners.map(|p| p - about);
                let (own, middle) = (0.5 * (b - a).cross(&(c - a)).norm(), (a + b + c) / 3.0);
                area += own;
                first += middle * own;
                let corners = a * a.transpose() + b * b.transpose() + c * c.transpose();
                second += (corners + middle * middle.transpose() * 9.0) * (own / 12.0);
            }
            let mean = first / area;
            (about.coords + mean, right_handed(&(second / area - mean * mean.transpose())))
        }
    }
}

/// The 24 ways to lay principal axes on principal axes.
fn axis_poses(points: &[Point3<f64>], reference: &Reference) -> Vec<Pose> {
    let ((from, from_axes), (to, to_axes)) = (axes(points), reference_axes(reference));
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
                poses.push(about(to_axes * turn * from_axes.transpose(), &from, &to));
            }
        }
    }
    poses
}

/// Rotation that takes one centre to the other.
fn about(rotation: Matrix3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> Pose {
    Pose { rotation, translation: to - rotation * from }
}

/// Turns about the centre, spread evenly over all rotations: M. Alexa, Super-Fibonacci spirals, CVPR 2022.
fn turn_poses(points: &[Point3<f64>], reference: &Reference) -> Vec<Pose> {
    const PSI: f64 = 1.533_751_168_755_204_3;
    let ((from, _), (to, _)) = (axes(points), reference_axes(reference));
    (0..TURNS)
        .map(|i| {
            let s = i as f64 + 0.5;
            let t = s / TURNS as f64;
            let (a, b) = (math::sincos(TAU * s / std::f64::consts::SQRT_2), math::sincos(TAU * s / PSI));
            let (inner, outer) = (t.sqrt(), (1.0 - t).sqrt());
            let q = Quaternion::new(outer * b.1, inner * a.0, inner * a.1, outer * b.0);
            about(UnitQuaternion::from_quaternion(q).to_rotation_matrix().into_inner(), &from, &to)
        })
        .collect()
}
