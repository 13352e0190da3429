//! The axis from overlapping views of any object, and its uncertainty.

use super::input::{View, middle, onto};
use crate::progress::Progress;
use anyhow::{Context, Result, bail};
use characterise::rotation_stage::{StageAxis, StageCalibration, axis_from_motions, jackknife};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;
use fringe::math::statistics::median;
use metrology::register::InitialPose;
use nalgebra::{Point3, Vector3};

/// Blocks of the object that are left out in turn: two along each of its three extents.
const BLOCKS: usize = 8;

/// Each view onto the one before, all motions chained to the first; then, with the axis so found, again from there. The uncertainty
/// comes from repeating it without each block of the object in turn: neighbouring points share noise and other errors,
/// so that their number means little.
pub fn axis_of_object(views: &[View], rough: Option<StageAxis>) -> Result<StageCalibration> {
    let [first, others @ ..] = views else { bail!("no --view") };
    let mut progress = Progress::new((2 + BLOCKS) * others.len(), "aligning");
    let mut step = || progress.step();
    let start = align(views, rough, &mut step)?;
    let found = align(views, Some(start.axis()), &mut step)?;
    let centre_mm = middle(&first.points);
    let parts = blocks(&first.points, &centre_mm);
    let axis = found.axis();
    let without = |block: usize| -> Result<StageCalibration> {
        let kept = |view: &View| {
            let back = axis.back(view.angle_rad - first.angle_rad);
            let stays = |p: &&Point| parts.of(&Point3::from(back.point(&p.position().coords))) != block;
            let points = view.points.iter().filter(stays).copied().collect();
            View { name: view.name.clone(), points, ..*view }
        };
        let rest: Vec<View> = views.iter().map(kept).collect();
        align(&rest, Some(axis), &mut step)
    };
    let others: Vec<StageCalibration> =
        (0..BLOCKS).map(without).collect::<Result<_>>().context("without a part of the object")?;
    Ok(jackknife(&found, &others)?)
}

fn align(views: &[View], rough: Option<StageAxis>, step: &mut impl FnMut()) -> Result<StageCalibration> {
    let [first, others @ ..] = views else { bail!("no --view") };
    let centre_mm = middle(&first.points);
    let size_mm = first.points.iter().map(|p| (p.position() - centre_mm).norm()).fold(0.0, f64::max);
    let mut motions: Vec<(f64, Pose)> = Vec::new();
    let mut total = Pose::new(&nalgebra::Isometry3::identity());
    let mut before = first;
    for view in others {
        let step_rad = view.angle_rad - before.angle_rad;
        let start = rough.map_or(InitialPose::Search, |axis| InitialPose::Given(axis.back(step_rad)));
        let registration = onto(view, &before.points, start, None)?;
        if !registration.undetermined.is_empty() {
            bail!(
                "{}: is free to slide on the view before it ({}); use an object with more shape, or a sphere with --artefact sphere",
                view.name,
                registration.undetermined[0].describe()
            );
        }
        total = total.after(&registration.pose());
        motions.push((view.angle_rad - first.angle_rad, total));
        before = view;
        step();
    }
    Ok(axis_from_motions(&motions, &centre_mm, size_mm)?)
}

/// Parts of space with about as many points each: halves along x, quarters along y within them, eighths along z.
#[allow(clippy::struct_field_names, reason = "units stand in names")]
struct Blocks {
    x_mm: f64,
    y_mm: [f64; 2],
    z_mm: [f64; 4],
}

impl Blocks {
    fn of(&self, p: &Point3<f64>) -> usize {
        let x = usize::from(p.x > self.x_mm);
        let y = 2 * x + usize::from(p.y > self.y_mm[x]);
        2 * y + usize::from(p.z > self.z_mm[y])
    }
}

fn blocks(points: &[Point], centre_mm: &Point3<f64>) -> Blocks {
    let all: Vec<Vector3<f64>> = points.iter().map(|p| p.position().coords).collect();
    let middle = |axis: usize, held: &dyn Fn(&Vector3<f64>) -> bool| {
        let mut values: Vec<f64> = all.iter().filter(|p| held(p)).map(|p| p[axis]).collect();
        median(&mut values).unwrap_or(centre_mm[axis])
    };
    let x_mm = middle(0, &|_| true);
    let half = move |p: &Vector3<f64>| usize::from(p.x > x_mm);
    let y_mm = [0, 1].map(|x| middle(1, &|p| half(p) == x));
    let quarter = move |p: &Vector3<f64>| 2 * half(p) + usize::from(p.y > y_mm[half(p)]);
    let z_mm = [0, 1, 2, 3].map(|y| middle(2, &|p| quarter(p) == y));
    Blocks { x_mm, y_mm, z_mm }
}
