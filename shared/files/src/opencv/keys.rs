//! Which keys of a calibration are meant, found by the names that programs use.

use super::rig::{ViewKeys, ViewKind, rig_from_opencv};
use super::storage::Storage;
use crate::error::{FileError, Problem, list};
use fringe::geometry::camera::{Camera, pose};
use fringe::geometry::rig::{Pair, Rig};

/// Names of K, without and with the number of the view.
const MATRIX: [&str; 8] =
    ["M", "K", "cameraMatrix", "camera_matrix", "CameraMatrix", "A", "intrinsic_matrix", "mtx"];
/// Names of the distortion coefficients D.
const DISTORTION: [&str; 8] =
    ["D", "distCoeffs", "dist_coeffs", "distortion_coefficients", "DistCoeffs", "kc", "distortion", "dist"];
/// Names of the image size.
const WIDTH: [&str; 3] = ["image_width", "imageWidth", "width"];
const HEIGHT: [&str; 3] = ["image_height", "imageHeight", "height"];

/// What the caller states beyond the file.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationNames {
    /// Names of the views in the rig: one or two.
    pub views: Vec<String>,
    /// Image size for all views, where the file has none.
    pub size_px: Option<(u32, u32)>,
    /// Whether the second view is a projector.
    pub projector: bool,
    /// Whether the lenses are of OpenCV's module `fisheye`; files of `fringetool export` say so themselves.
    pub fisheye: bool,
    /// Millimetres per unit of T.
    pub unit_mm: f64,
}

/// The rig of a calibration with one view (`K D`) or two (`K1 D1 K2 D2 R T`, X_2 = R X_1 + T; also `M1`, `cameraMatrix1` …).
///
/// The world is the first view, unless the file has `R_world T_world` (see [`super::pair_text`]).
///
/// # Errors
/// Keys that are absent, no image size, and all that [`rig_from_opencv`] refuses.
pub fn rig_of_calibration(storage: &Storage, names: &CalibrationNames) -> Result<Rig, FileError> {
    let two = names.views.len() == 2;
    let mut views = Vec::new();
    for (index, name) in names.views.iter().enumerate() {
        let second = index == 1;
        views.push(view_keys(
            storage,
            names,
            name,
            if two { &["1", "2"][index..=index] } else { &["", "1"] },
            second,
        )?);
    }
    let pairs = match names.views.as_slice() {
        [left, right] => {
            let projector = if names.projector { right.clone() } else { String::new() };
            vec![Pair { name: "pair1".into(), left: left.clone(), right: right.clone(), projector }]
        }
        _ => Vec::new(),
    };
    let mut rig = rig_from_opencv(storage, &views, pairs)?;
    if storage.matrices.contains_key("R_world") {
        place(storage, &mut rig)?;
    }
    Ok(rig)
}

/// Puts the rig where its first view stands in the world.
fn place(storage: &Storage, rig: &mut Rig) -> Result<(), FileError> {
    let t = storage.fixed::<3, 1>("T_world")?.map(|row| row[0]);
    let world = pose(storage.fixed("R_world")?, t)
        .map_err(|error| FileError::new(&storage.path, Problem::Camera(error), "").at("R_world"))?;
    let move_to = |camera: &mut Camera| camera.camera_from_world *= world;
    rig.cameras.iter_mut().for_each(|named| move_to(&mut named.camera));
    rig.projectors.iter_mut().for_each(|named| move_to(&mut named.camera));
    Ok(())
}

fn view_keys(
    storage: &Storage,
    names: &CalibrationNames,
    name: &str,
    endings: &[&str],
    second: bool,
) -> Result<ViewKeys, FileError> {
    let find = |bases: &[&str]| {
        let all = endings.iter().flat_map(|ending| bases.iter().map(move |base| format!("{base}{ending}")));
        all.into_iter().find(|key| storage.matrices.contains_key(key))
    };
    let Some(matrix) = find(&MATRIX) else {
        let wanted = format!("{}{}", MATRIX[0], endings[0]);
        let problem = Problem::Missing(format!("the camera matrix of \"{name}\", such as {wanted}"));
        let known = list(storage.matrices.keys().map(String::as_str));
        let remedy = format!("matrices there: {known}; a layout for `fringetool import` can name any key");
        return Err(FileError::new(&storage.path, problem, remedy));
    };
    let (width_px, height_px) = size(storage, names, name, endings)?;
    Ok(ViewKeys {
        name: name.to_owned(),
        kind: if second && names.projector { ViewKind::Projector } else { ViewKind::Camera },
        width_px,
        height_px,
        matrix,
        distortion: find(&DISTORTION),
        fisheye: names.fisheye || marked(storage, endings),
        rotation: second.then(|| "R".into()),
        translation: second.then(|| "T".into()),
        unit_mm: names.unit_mm,
    })
}

/// Whether the file itself says that the view's lens is a fisheye.
fn marked(storage: &Storage, endings: &[&str]) -> bool {
    endings
        .iter()
        .any(|ending| storage.numbers.get(&format!("fisheye{ending}")).is_some_and(|mark| *mark != 0.0))
}

/// Image size: of the view, of all views, or as the caller states.
fn size(
    storage: &Storage,
    names: &CalibrationNames,
    name: &str,
    endings: &[&str],
) -> Result<(u32, u32), FileError> {
    let find = |bases: &[&str]| {
        let endings = endings.iter().chain(&[""]);
        let all = endings.flat_map(|ending| bases.iter().map(move |base| format!("{base}{ending}")));
        all.into_iter().find_map(|key| storage.numbers.get(&key).map(|value| (key, *value)))
    };
    let whole = |(key, value): (String, f64)| {
        if value.fract() == 0.0 && (1.0..=65_535.0).contains(&value) {
            return Ok(value as u32);
        }
        let problem = Problem::Value { value: value.to_string(), limit: "1 … 65535 px".into() };
        Err(FileError::new(&storage.path, problem, "").at(key))
    };
    match (find(&WIDTH), find(&HEIGHT), names.size_px) {
        (Some(width), Some(height), _) => Ok((whole(width)?, whole(height)?)),
        (_, _, Some(size)) => Ok(size),
        _ => {
            let problem =
                Problem::Missing(format!("the image size of \"{name}\" (image_width, image_height)"));
            Err(FileError::new(&storage.path, problem, "give it with --size WIDTHxHEIGHT"))
        }
    }
}
