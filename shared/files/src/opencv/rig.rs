//! A rig from the keys of an OpenCV calibration, and back.

use super::storage::{Matrix, Storage};
use crate::error::{FileError, Problem};
use fringe::geometry::camera::{Camera, Lens, LensKind, pose};
use fringe::geometry::rig::{Named, Pair, Rig};
use nalgebra::Isometry3;
use serde::Deserialize;

/// What a calibration describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ViewKind {
    /// The view is a camera.
    #[default]
    Camera,
    /// The view is a projector.
    Projector,
}

/// Which keys of a calibration describe a view.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewKeys {
    /// Its name in the rig.
    pub name: String,
    /// Whether the view is a camera or a projector.
    #[serde(default)]
    pub kind: ViewKind,
    /// Columns of the view, px.
    pub width_px: u32,
    /// Rows of the view, px.
    pub height_px: u32,
    /// Key of the 3 × 3 matrix K.
    pub matrix: String,
    /// Key of the distortion k1 k2 p1 p2 [k3 …]; absent: no distortion.
    pub distortion: Option<String>,
    /// The distortion is that of OpenCV's module `fisheye`: k1 k2 k3 k4.
    #[serde(default)]
    pub fisheye: bool,
    /// Key of the 3 × 3 rotation R of X_view = R X_world + T; absent (with T): the view is the world frame.
    pub rotation: Option<String>,
    /// Key of T, 3 numbers.
    pub translation: Option<String>,
    /// Millimetres per unit of T.
    #[serde(default = "one")]
    pub unit_mm: f64,
}

fn one() -> f64 {
    1.0
}

/// Builds a rig from a calibration.
///
/// # Errors
/// Keys that are absent or of another size, lenses with a tilted sensor, poses that are no rotation, impossible cameras.
pub fn rig_from_opencv(storage: &Storage, views: &[ViewKeys], pairs: Vec<Pair>) -> Result<Rig, FileError> {
    let mut rig = Rig { pairs, ..Rig::default() };
    for keys in views {
        let named = Named { name: keys.name.clone(), camera: view(storage, keys)? };
        match keys.kind {
            ViewKind::Camera => rig.cameras.push(named),
            ViewKind::Projector => rig.projectors.push(named),
        }
    }
    Ok(rig)
}

fn view(storage: &Storage, keys: &ViewKeys) -> Result<Camera, FileError> {
    let at = |key: &str, problem| FileError::new(&storage.path, problem, "").at(key);
    let k: [[f64; 3]; 3] = storage.fixed(&keys.matrix)?;
    if [k[1][0], k[2][0], k[2][1], k[2][2] - 1.0].iter().any(|v| v.abs() > 1e-9) {
        let problem =
            Problem::Value { value: format!("{k:?}"), limit: "K = [fx s cx; 0 fy cy; 0 0 1]".into() };
        return Err(at(&keys.matrix, problem));
    }
    let distortion = match &keys.distortion {
        None => Lens::default(),
        Some(key) => {
            let matrix = storage.matrix(key)?;
            storage.finite(key, matrix)?;
            lens_from_opencv(&matrix.data, keys.fisheye).map_err(|problem| at(key, problem))?
        }
    };
    let camera = Camera {
        width_px: keys.width_px,
        height_px: keys.height_px,
        focal_px: [k[0][0], k[1][1]],
        principal_point_px: [k[0][2], k[1][2]],
        skew: k[0][1],
        distortion,
        camera_from_world: camera_from_world(storage, keys)?,
    };
    camera.check().map_err(|error| at(&keys.matrix, Problem::Camera(error)))?;
    Ok(camera)
}

fn camera_from_world(storage: &Storage, keys: &ViewKeys) -> Result<Isometry3<f64>, FileError> {
    match (&keys.rotation, &keys.translation) {
        (None, None) => Ok(Isometry3::identity()),
        (Some(rotation), Some(translation)) => {
            let r = storage.fixed::<3, 3>(rotation)?;
            let t = three(storage, translation)?.map(|value| value * keys.unit_mm);
            pose(r, t).map_err(|error| {
                FileError::new(&storage.path, Problem::Camera(error), "").at(rotation.as_str())
            })
        }
        _ => {
            let problem = Problem::Missing(format!("one of rotation and translation of \"{}\"", keys.name));
            Err(FileError::new(&storage.path, problem, "name both keys, or none for the world frame"))
        }
    }
}

/// Three numbers, as a column or a row.
fn three(storage: &Storage, key: &str) -> Result<[f64; 3], FileError> {
    let matrix: &Matrix = storage.matrix(key)?;
    if (matrix.rows, matrix.columns) == (1, 3) {
        return Ok(storage.fixed::<1, 3>(key)?[0]);
    }
    Ok(storage.fixed::<3, 1>(key)?.map(|row| row[0]))
}

/// A lens from OpenCV's order k1, k2, p1, p2, k3, k4, k5, k6, s1 … s4, τx, τy; of its module `fisheye` k1, k2, k3, k4.
///
/// The smallest kind that holds all coefficients that are not zero.
///
/// # Errors
/// Fewer than four coefficients, more than four of a fisheye, or a tilted sensor (τ), which no kind has.
pub fn lens_from_opencv(values: &[f64], fisheye: bool) -> Result<Lens, Problem> {
    let wrong =
        |limit: &str| Problem::Value { value: format!("{} coefficients", values.len()), limit: limit.into() };
    if fisheye {
        let &[k1, k2, k3, k4] = values else { return Err(wrong("k1, k2, k3, k4 of a fisheye")) };
        return Ok(fisheye_lens([k1, k2, k3, k4]));
    }
    if values.len() < 4 {
        return Err(wrong("k1, k2, p1, p2 and, if wanted, k3, k4, k5, k6, s1, s2, s3, s4"));
    }
    if let Some((index, value)) = values.iter().enumerate().skip(12).find(|(_, value)| **value != 0.0) {
        return Err(Problem::Value {
            value: format!("coefficient {} = {value}", index + 1),
            limit: "k1 to k6, p1, p2 and s1 to s4 are read; calibrate without the tilt of the sensor".into(),
        });
    }
    let at = |index: usize| values.get(index).copied().unwrap_or(0.0);
    let (more_k, prism) = ([at(5), at(6), at(7)], [at(8), at(9), at(10), at(11)]);
    let kind = if prism != [0.0; 4] {
        LensKind::ThinPrism
    } else if more_k != [0.0; 3] {
        LensKind::Rational
    } else {
        LensKind::BrownConrady
    };
    Ok(Lens { kind, k: [at(0), at(1), at(4)], p: [at(2), at(3)], more_k, prism })
}

/// A fisheye from its four coefficients.
pub(crate) fn fisheye_lens([k1, k2, k3, k4]: [f64; 4]) -> Lens {
    Lens { kind: LensKind::Fisheye, k: [k1, k2, k3], more_k: [k4, 0.0, 0.0], ..Lens::default() }
}

/// The coefficients of a lens in OpenCV's order, as many as its kind needs.
pub(crate) fn opencv_from_lens(lens: &Lens) -> Vec<f64> {
    let [k1, k2, k3, p1, p2, k4, k5, k6, s1, s2, s3, s4] = lens.coefficients();
    let all = [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4];
    match lens.kind {
        LensKind::BrownConrady => all[..5].to_vec(),
        LensKind::Rational => all[..8].to_vec(),
        LensKind::ThinPrism => all.to_vec(),
        LensKind::Fisheye => vec![k1, k2, k3, k4],
    }
}
