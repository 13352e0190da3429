//! Calibrations of other programs as a rig, and rigs as their files: ROS, Kalibr, mrcal, MATLAB.
//!
//! All are read as YAML, of which JSON and mrcal's Python dictionaries are a part. A camera of a lens model that
//! [`Lens`] lacks is refused by name.

mod kalibr;
mod matlab;
mod mrcal;
mod ros;
#[cfg(test)]
mod tests;
mod tree;

pub use kalibr::camchain_text;
pub use ros::camera_info_texts;

use crate::document::read_text;
use crate::error::{FileError, Problem};
use fringe::geometry::camera::{Camera, Lens};
use fringe::geometry::rig::{Named, Pair, Rig};
use nalgebra::Isometry3;
use std::path::Path;
use tree::Tree;

/// Programs whose calibrations are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Program {
    /// `camera_info` as `camera_calibration` writes it: one file a camera.
    Ros,
    /// `camchain.yaml`: all cameras in one file.
    Kalibr,
    /// `.cameramodel`: one file a camera.
    Mrcal,
    /// `jsonencode(toStruct(parameters))` of `stereoParameters` or `cameraParameters`.
    Matlab,
}

impl Program {
    /// The program that wrote a file, by its keys; `None` of OpenCV's and other files.
    ///
    /// # Errors
    /// A file that cannot be read; YAML that refers to itself or is nested deeper than any calibration.
    pub fn of_file(path: &Path) -> Result<Option<Self>, FileError> {
        let text = read_text(path)?;
        let start = text.trim_start();
        if start.starts_with("%YAML") || start.starts_with('<') {
            return Ok(None);
        }
        let tree = Tree::parse(path, &text)?;
        let marks: [(&str, Self); 6] = [
            ("camera_matrix", Self::Ros),
            ("cam0", Self::Kalibr),
            ("lensmodel", Self::Mrcal),
            ("CameraParameters1", Self::Matlab),
            ("IntrinsicMatrix", Self::Matlab),
            ("RadialDistortion", Self::Matlab),
        ];
        Ok(marks.iter().find(|(key, _)| tree.has(key)).map(|(_, program)| *program))
    }

    /// Millimetres per unit of length that the program writes.
    pub fn unit_mm(self) -> f64 {
        // Targets are given in metres to the first three, in millimetres to MATLAB.
        if self == Self::Matlab { 1.0 } else { 1000.0 }
    }
}

/// The rig of one or more calibration files of a program; the first camera is the world, of mrcal its reference frame.
///
/// `views` names the cameras; absent names are those of the files, or cam1, cam2 … . Neighbours become pairs.
///
/// # Errors
/// Keys that are absent, matrices of another size, other lens models, impossible cameras, another number of names.
pub fn read(program: Program, files: &[&Path], views: &[String], unit_mm: f64) -> Result<Rig, FileError> {
    let trees =
        files.iter().map(|path| Tree::parse(path, &read_text(path)?)).collect::<Result<Vec<_>, _>>()?;
    let found = match program {
        Program::Ros => ros::cameras(&trees, unit_mm)?,
        Program::Kalibr => kalibr::cameras(&trees, unit_mm)?,
        Program::Mrcal => mrcal::cameras(&trees, unit_mm)?,
        Program::Matlab => matlab::cameras(&trees, unit_mm)?,
    };
    if !views.is_empty() && views.len() != found.len() {
        let problem = Problem::Disagreement {
            what: "names and cameras",
            here: format!("{} names are given", views.len()),
            there: format!("{} cameras are there", found.len()),
        };
        return Err(FileError::new(files[0], problem, "name each camera with --views, or none"));
    }
    let mut rig = Rig::default();
    for (index, (own, camera)) in found.into_iter().enumerate() {
        let name = views.get(index).cloned().or(own).unwrap_or_else(|| format!("cam{}", index + 1));
        rig.cameras.push(Named { name, camera });
    }
    let pairs = rig.cameras.windows(2).enumerate().map(|(index, both)| Pair {
        name: format!("pair{}", index + 1),
        left: both[0].name.clone(),
        right: both[1].name.clone(),
        projector: String::new(),
    });
    rig.pairs = pairs.collect();
    Ok(rig)
}

/// A camera with its name in the file.
type Found = (Option<String>, Camera);

/// A camera from its numbers, checked.
fn camera(
    tree: &Tree,
    key: &str,
    [width_px, height_px]: [u32; 2],
    [fx, fy, cx, cy]: [f64; 4],
    distortion: Lens,
) -> Result<Camera, FileError> {
    let camera = Camera {
        width_px,
        height_px,
        focal_px: [fx, fy],
        principal_point_px: [cx, cy],
        skew: 0.0,
        distortion,
        camera_from_world: Isometry3::identity(),
    };
    camera.check().map_err(|error| tree.fault(key, Problem::Camera(error)))?;
    Ok(camera)
}

/// Refuses a lens model by name.
fn other_lens(tree: &Tree, key: &str, found: &str, known: &str) -> FileError {
    let problem = Problem::Value {
        value: format!("\"{found}\""),
        limit: format!("lens models that are read: {known}"),
    };
    let mut fault = tree.fault(key, problem);
    fault.remedy = "calibrate again with one of them".into();
    fault
}
