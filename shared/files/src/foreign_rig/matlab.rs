//! MATLAB's `stereoParameters` or `cameraParameters`, as `jsonencode(toStruct(parameters))` writes them.
//!
//! MATLAB counts pixels from 1, its older `IntrinsicMatrix` is the transpose of K, and its older rotations act on rows:
//! X₂ = X₁ R + T. `PoseCamera2` and `K` of newer releases are written as elsewhere.

use super::tree::Tree;
use super::{Found, camera};
use crate::error::{FileError, Problem};
use fringe::geometry::camera::{Camera, Lens};
use nalgebra::Isometry3;

/// One or two cameras; the first is the world.
pub(super) fn cameras(trees: &[Tree], unit_mm: f64) -> Result<Vec<Found>, FileError> {
    let [tree] = trees else {
        let problem = Problem::Unsupported("has both cameras: name one file".into());
        return Err(trees[0].fault("", problem));
    };
    if !tree.has("CameraParameters1") {
        return Ok(vec![(None, one(tree, "")?)]);
    }
    let first = one(tree, "CameraParameters1.")?;
    let mut second = one(tree, "CameraParameters2.")?;
    second.camera_from_world = pose(tree, unit_mm)?;
    Ok(vec![(None, first), (None, second)])
}

fn pose(tree: &Tree, unit_mm: f64) -> Result<Isometry3<f64>, FileError> {
    for key in ["PoseCamera2.A", "PoseCamera2"] {
        if tree.numbers(key).is_ok() {
            return tree.matrix4(key, unit_mm);
        }
    }
    let by_rows = tree.rotation("RotationOfCamera2")?;
    let turned = [0, 1, 2].map(|row| [0, 1, 2].map(|column| by_rows[column][row]));
    let t: [f64; 3] = tree.exactly("TranslationOfCamera2")?;
    tree.motion("RotationOfCamera2", turned, t.map(|v| v * unit_mm))
}

fn one(tree: &Tree, place: &str) -> Result<Camera, FileError> {
    let key = |name: &str| format!("{place}{name}");
    let [height_px, width_px] = tree.size(&key("ImageSize"))?;
    let [fx, s, cx, fy, cy] = if tree.has(&key("K")) {
        let k: [f64; 9] = tree.exactly(&key("K"))?;
        [k[0], k[1], k[2], k[4], k[5]]
    } else {
        let k: [f64; 9] = tree.exactly(&key("IntrinsicMatrix"))?;
        [k[0], k[3], k[6], k[4], k[7]]
    };
    let radial = tree.numbers(&key("RadialDistortion"))?;
    let &[k1, k2] = &radial[..2.min(radial.len())] else {
        let limit = "2 or 3 numbers".into();
        return Err(
            tree.fault(&key("RadialDistortion"), Problem::Value { value: format!("{radial:?}"), limit })
        );
    };
    let k3 = radial.get(2).copied().unwrap_or(0.0);
    let p: [f64; 2] = tree.exactly(&key("TangentialDistortion"))?;
    let lens = Lens::brown_conrady([k1, k2, k3], p);
    // The centre of the first pixel is 1 there, 0 here.
    let mut camera = camera(tree, &key("K"), [width_px, height_px], [fx, fy, cx - 1.0, cy - 1.0], lens)?;
    camera.skew = s;
    camera.check().map_err(|error| tree.fault(&key("K"), Problem::Camera(error)))?;
    Ok(camera)
}
