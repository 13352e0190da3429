//! ROS `camera_info`: one YAML file a camera (REP 104, package `camera_calibration_parsers`).
//!
//! A stereo pair stands in its rectification: X_rect = R_i X_i, and the right rectified camera is moved by
//! P_right[0][3] / P_right[0][0] along x.

use super::tree::Tree;
use super::{Found, camera, other_lens};
use crate::error::FileError;
use crate::opencv::opencv_from_lens;
use characterise::rectified_images::RectifiedImages;
use fringe::geometry::camera::{Camera, Lens, LensKind};
use fringe::rectify::RectifyError;
use nalgebra::{Isometry3, Matrix3, Matrix3x4, Translation3, UnitQuaternion};
use std::fmt::Write as _;

/// Names of the lenses of ROS: k1, k2, p1, p2, k3; with k4, k5, k6 as OpenCV has them; the fisheye k1, k2, k3, k4.
const LENSES: [&str; 3] = ["plumb_bob", "rational_polynomial", "equidistant"];

/// The cameras of some files; the first is the world.
pub(super) fn cameras(trees: &[Tree], unit_mm: f64) -> Result<Vec<Found>, FileError> {
    let mut found: Vec<Found> = Vec::new();
    for (index, tree) in trees.iter().enumerate() {
        let mut own = one(tree)?;
        if index > 0 {
            own.camera_from_world = between(&trees[0], tree, unit_mm)?;
        }
        found.push((tree.text("camera_name").filter(|name| !name.is_empty()), own));
    }
    Ok(found)
}

fn one(tree: &Tree) -> Result<Camera, FileError> {
    let model = tree.text("distortion_model").unwrap_or_else(|| LENSES[0].to_owned());
    if !LENSES.contains(&model.as_str()) {
        return Err(other_lens(tree, "distortion_model", &model, &LENSES.join(", ")));
    }
    let size_px = [tree.pixels("image_width")?, tree.pixels("image_height")?];
    let k: [f64; 9] = tree.exactly("camera_matrix.data")?;
    let distortion = if tree.has("distortion_coefficients.data")
        && !tree.numbers("distortion_coefficients.data")?.is_empty()
    {
        tree.lens("distortion_coefficients.data", model == LENSES[2])?
    } else {
        Lens::default()
    };
    camera(tree, "camera_matrix.data", size_px, [k[0], k[4], k[2], k[5]], distortion)
}

/// Right camera from left camera.
fn between(left: &Tree, right: &Tree, unit_mm: f64) -> Result<Isometry3<f64>, FileError> {
    let turn = |tree: &Tree| {
        let key = "rectification_matrix.data";
        Ok::<_, FileError>(tree.motion(key, tree.rotation(key)?, [0.0; 3])?.rotation)
    };
    let shift = |tree: &Tree| {
        let p: [f64; 12] = tree.exactly("projection_matrix.data")?;
        Ok::<_, FileError>([p[3] / p[0] * unit_mm, p[7] / p[5] * unit_mm])
    };
    let (a, b) = (shift(left)?, shift(right)?);
    let moved = Translation3::new(b[0] - a[0], b[1] - a[1], 0.0);
    Ok(turn(right)?.inverse() * Isometry3::from_parts(moved, UnitQuaternion::identity()) * turn(left)?)
}

/// The two files of a pair, by camera name; lengths are metres.
///
/// # Errors
/// Views at one place have no rectified images.
pub fn camera_info_texts(left: (&str, &Camera), right: (&str, &Camera)) -> Result<[String; 2], RectifyError> {
    let images = RectifiedImages::new(left.1, right.1)?;
    let text = |(name, camera): (&str, &Camera), turn: &Matrix3<f64>, projection: &Matrix3x4<f64>| {
        let mut in_metres = *projection;
        in_metres.column_mut(3).scale_mut(1e-3);
        let lens = opencv_from_lens(&camera.distortion);
        let model = match camera.distortion.kind {
            LensKind::BrownConrady => LENSES[0],
            LensKind::Rational | LensKind::ThinPrism => LENSES[1],
            LensKind::Fisheye => LENSES[2],
        };
        let mut out = format!(
            "image_width: {}\nimage_height: {}\ncamera_name: {name:?}\ndistortion_model: {}\n",
            camera.width_px, camera.height_px, model
        );
        let rows = |m: &[f64]| m.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(", ");
        let mut matrix = |key: &str, rows_of: usize, columns: usize, data: String| {
            let _ = write!(out, "{key}:\n  rows: {rows_of}\n  cols: {columns}\n  data: [{data}]\n");
        };
        matrix("camera_matrix", 3, 3, rows(camera.matrix().transpose().as_slice()));
        matrix("distortion_coefficients", 1, lens.len(), rows(&lens));
        matrix("rectification_matrix", 3, 3, rows(turn.transpose().as_slice()));
        matrix("projection_matrix", 3, 4, rows(in_metres.transpose().as_slice()));
        out
    };
    let ([r1, r2], [p1, p2]) = (&images.rectified_from_view, &images.projection);
    Ok([text(left, r1, p1), text(right, r2, p2)])
}
