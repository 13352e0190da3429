//! Clouds: alignment, distances, and the fit of a sphere.

use super::Bench;
use anyhow::{Context, Result};
use bytemuck::Zeroable;
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;
use metrology::fit::{FitSettings, sphere as fit_sphere};
use metrology::reference::{CloudReference, Deviation, Reference};
use metrology::register::{InitialPose, RegisterSettings, register};
use nalgebra::{Matrix3, Matrix4, Point3, Vector3};
use serde_json::{Value, json};

/// Radius of the sphere of the inputs, mm.
const RADIUS_MM: f64 = 12.7;

/// Farthest match of an alignment and largest distance, mm.
const REACH_MM: f64 = 3.0;

/// From so many points on the distances are measured, too.
const MANY_POINTS: usize = 1_000_000;

fn cloud(points: &[Point3<f64>]) -> Vec<Point> {
    points.iter().map(|p| Point { position_mm: (*p).into(), ..Point::zeroed() }).collect()
}

/// Aligns the source with the target from where it lies, and measures distances.
pub(super) fn icp(bench: &mut Bench) -> Result<()> {
    let target = cloud(&bench.points("target")?);
    let source = cloud(&bench.points("source")?);
    let query = cloud(&bench.points("query")?);
    let truth = Matrix4::from_row_slice(&bench.matrix("T", 4, 4)?);
    let from_truth = truth.try_inverse().context("T.npy is no motion: its matrix is singular")?;
    let settings = RegisterSettings { reach_mm: Some(REACH_MM), ..RegisterSettings::default() };
    let start = InitialPose::Given(Pose { rotation: Matrix3::identity(), translation: Vector3::zeros() });
    for threads in [1, 2] {
        let mut reference = None;
        bench.time("kd-tree build", threads, || {
            reference = Some(CloudReference::new(&target, Vector3::z(), None)?);
            Ok(())
        })?;
        let plain = reference.context("the tree was built")?;
        let mut with_normals = None;
        let row = bench.time("normals, k = 20", threads, || {
            with_normals = Some(plain.clone().with_normals());
            Ok(())
        })?;
        row.with(json!({ "note": "tree given" }));
        let reference = Reference::Cloud(with_normals.context("normals were made")?);
        let mut pose = None;
        bench.time("ICP", threads, || {
            pose = Some(register(&source, &reference, &start, &settings)?.pose());
            Ok(())
        })?;
        let error = pose_error(&pose.context("aligned")?, &from_truth);
        let Some(row) = bench.rows.last_mut() else { continue };
        row.with(error);
        row.with(json!({ "note": "tree and normals given; covariance and checks included" }));
        if target.len() >= MANY_POINTS {
            let nearest = || reference.distances_to_nearest(&query, REACH_MM);
            distances(bench, ("cloud distance", "tree given"), threads, nearest)?;
            let surface = || reference.deviations(&query, REACH_MM);
            let note = "tree given; signed distance to the local surface";
            distances(bench, ("cloud distance, to the surface", note), threads, surface)?;
        }
    }
    Ok(())
}

/// A row of distances of many points, with their mean size.
fn distances(
    bench: &mut Bench,
    (name, note): (&str, &str),
    threads: usize,
    measured: impl Fn() -> Vec<Deviation> + Sync,
) -> Result<()> {
    let mut mean_mm = 0.0;
    let row = bench.time(name, threads, || {
        let mm: Vec<f64> = measured().iter().filter_map(|d| d.mm()).map(f64::abs).collect();
        mean_mm = mm.iter().sum::<f64>() / mm.len().max(1) as f64;
        Ok(())
    })?;
    row.with(json!({ "mean_mm": mean_mm, "note": note }));
    Ok(())
}

/// Difference from the true motion, whose inverse is given.
fn pose_error(pose: &Pose, from_truth: &Matrix4<f64>) -> Value {
    let mut found = Matrix4::identity();
    found.fixed_view_mut::<3, 3>(0, 0).copy_from(&pose.rotation);
    found.fixed_view_mut::<3, 1>(0, 3).copy_from(&pose.translation);
    let difference = from_truth * found;
    let shift = difference.fixed_view::<3, 1>(0, 3).norm();
    let rotation = difference.fixed_view::<3, 3>(0, 0).into_owned();
    let turn = (rotation - rotation.transpose()).norm() / 8.0_f64.sqrt();
    json!({ "t_err_um": shift * 1e3, "r_err_urad": turn * 1e6 })
}

/// Fits a sphere by orthogonal distances, with its uncertainty.
pub(super) fn sphere(bench: &mut Bench) -> Result<()> {
    let points = bench.points("points")?;
    let settings = FitSettings::default();
    for threads in [1, 2] {
        let mut diameter_mm = f64::NAN;
        bench.time("sphere fit", threads, || {
            diameter_mm = fit_sphere(&points, &settings)?.diameter_mm;
            Ok(())
        })?;
        let Some(row) = bench.rows.last_mut() else { continue };
        row.with(json!({ "radius_err_nm": (0.5 * diameter_mm - RADIUS_MM) * 1e6 }));
    }
    Ok(())
}
