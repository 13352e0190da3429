//! Kalibr's `camchain.yaml`: cam0, cam1, … with the motion from each camera to the next.

use super::tree::Tree;
use super::{Found, camera, other_lens};
use crate::error::{FileError, Problem};
use fringe::geometry::camera::{Camera, Lens, LensKind};
use nalgebra::Isometry3;
use std::fmt::Write as _;

/// The cameras of a chain; cam0 is the world.
pub(super) fn cameras(trees: &[Tree], unit_mm: f64) -> Result<Vec<Found>, FileError> {
    let [tree] = trees else {
        let problem = Problem::Unsupported("is a chain that has all cameras".into());
        return Err(trees[0].fault("", problem));
    };
    let mut found: Vec<Found> = Vec::new();
    while tree.has(&format!("cam{}", found.len())) {
        let key = |part: &str| format!("cam{}.{part}", found.len());
        let mut own = one(tree, &key)?;
        if let Some((_, before)) = found.last() {
            // X_n = T_cn_cnm1 X_(n−1).
            own.camera_from_world = tree.matrix4(&key("T_cn_cnm1"), unit_mm)? * before.camera_from_world;
        }
        found.push((None, own));
    }
    Ok(found)
}

fn one(tree: &Tree, key: &impl Fn(&str) -> String) -> Result<Camera, FileError> {
    let model = tree.text(&key("camera_model")).unwrap_or_default();
    if model != "pinhole" {
        return Err(other_lens(tree, &key("camera_model"), &model, "pinhole"));
    }
    let lens = tree.text(&key("distortion_model")).unwrap_or_default();
    let distortion = match lens.as_str() {
        "radtan" => tree.lens(&key("distortion_coeffs"), false)?,
        "equidistant" => tree.lens(&key("distortion_coeffs"), true)?,
        "none" => Lens::default(),
        other => return Err(other_lens(tree, &key("distortion_model"), other, "radtan, equidistant, none")),
    };
    camera(
        tree,
        &key("intrinsics"),
        tree.size(&key("resolution"))?,
        tree.exactly(&key("intrinsics"))?,
        distortion,
    )
}

/// A chain of cameras; lengths are metres. `None` with the name of a camera whose k3 or skew the format cannot hold.
///
/// # Errors
/// The name of the camera, and the parameter that would be lost.
pub fn camchain_text(cameras: &[(&str, &Camera)]) -> Result<String, (String, &'static str)> {
    let mut out = String::new();
    let mut before: Option<Isometry3<f64>> = None;
    for (number, (name, camera)) in cameras.iter().enumerate() {
        let lens = &camera.distortion;
        let fisheye = lens.kind == LensKind::Fisheye;
        let lost = [
            ("k3", !fisheye && lens.k[2] != 0.0),
            ("k4 and more", !fisheye && lens.coefficients()[5..].iter().any(|c| *c != 0.0)),
            ("skew", camera.skew != 0.0),
        ];
        if let Some((what, _)) = lost.iter().find(|(_, lost)| *lost) {
            return Err(((*name).to_owned(), what));
        }
        let model = if fisheye { "equidistant" } else { "radtan" };
        let [k1, k2, k3, k4] = if fisheye {
            [lens.k[0], lens.k[1], lens.k[2], lens.more_k[0]]
        } else {
            [lens.k[0], lens.k[1], lens.p[0], lens.p[1]]
        };
        let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.principal_point_px);
        let _ = write!(
            out,
            "# {name}\ncam{number}:\n  camera_model: pinhole\n  intrinsics: [{fx:?}, {fy:?}, {cx:?}, {cy:?}]\n  \
             distortion_model: {model}\n  distortion_coeffs: [{k1:?}, {k2:?}, {k3:?}, {k4:?}]\n  \
             resolution: [{}, {}]\n",
            camera.width_px, camera.height_px
        );
        if let Some(before) = before {
            let mut step = (camera.camera_from_world * before.inverse()).to_homogeneous();
            step.fixed_view_mut::<3, 1>(0, 3).scale_mut(1e-3);
            out.push_str("  T_cn_cnm1:\n");
            for row in step.row_iter() {
                let row: Vec<String> = row.iter().map(|v| format!("{v:?}")).collect();
                let _ = writeln!(out, "  - [{}]", row.join(", "));
            }
        }
        before = Some(camera.camera_from_world);
    }
    Ok(out)
}
