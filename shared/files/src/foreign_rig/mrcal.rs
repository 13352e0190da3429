//! mrcal's `.cameramodel`: a Python dictionary a camera, which is YAML in flow style.

use super::tree::Tree;
use super::{Found, camera, other_lens};
use crate::error::{FileError, Problem};
use fringe::geometry::camera::Lens;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// The cameras of some files, in the reference frame that they share.
pub(super) fn cameras(trees: &[Tree], unit_mm: f64) -> Result<Vec<Found>, FileError> {
    trees.iter().map(|tree| one(tree, unit_mm)).collect()
}

fn one(tree: &Tree, unit_mm: f64) -> Result<Found, FileError> {
    let model = tree.text("lensmodel").unwrap_or_default();
    let coefficients = match model.strip_prefix("LENSMODEL_") {
        Some("PINHOLE") => 0,
        Some("OPENCV4") => 4,
        Some("OPENCV5") => 5,
        Some("OPENCV8") => 8,
        Some("OPENCV12") => 12,
        _ => {
            let known = "LENSMODEL_PINHOLE, LENSMODEL_OPENCV4, 5, 8 and 12";
            return Err(other_lens(tree, "lensmodel", &model, known));
        }
    };
    let numbers = tree.numbers("intrinsics")?;
    if numbers.len() != 4 + coefficients {
        let limit = format!("{} numbers of {model}", 4 + coefficients);
        return Err(
            tree.fault("intrinsics", Problem::Value { value: format!("{} numbers", numbers.len()), limit })
        );
    }
    let lens = match &numbers[4..] {
        [] => Lens::default(),
        lens => crate::opencv::lens_from_opencv(lens, false)
            .map_err(|problem| tree.fault("intrinsics", problem))?,
    };
    let pinhole = [numbers[0], numbers[1], numbers[2], numbers[3]];
    let mut camera = camera(tree, "intrinsics", tree.size("imagersize")?, pinhole, lens)?;
    // Rotation vector and translation of X_camera = R X_reference + t.
    let [rx, ry, rz, x, y, z]: [f64; 6] = tree.exactly("extrinsics")?;
    let [x, y, z] = [x, y, z].map(|v| v * unit_mm);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(rx, ry, rz));
    camera.camera_from_world = Isometry3::from_parts(Translation3::new(x, y, z), turn);
    camera.check().map_err(|error| tree.fault("extrinsics", Problem::Camera(error)))?;
    Ok((None, camera))
}
