//! A pair as OpenCV writes it: `M1 D1 M2 D2 R T E F R1 R2 P1 P2 Q`, in YAML or XML.

use super::rig::opencv_from_lens;
use characterise::calibration::StereoGeometry;
use characterise::rectified_images::RectifiedImages;
use fringe::geometry::camera::{Camera, LensKind};
use fringe::rectify::RectifyError;
use nalgebra::{Isometry3, Matrix};
use std::fmt::Write as _;

/// Language of a FileStorage file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Language {
    /// YAML with the first line `%YAML:1.0`.
    Yaml,
    /// XML with the root element `<opencv_storage>`.
    Xml,
}

/// An entry of a FileStorage file.
enum Entry {
    Number(u32),
    /// Rows, columns, numbers row by row.
    Matrix(usize, usize, Vec<f64>),
}

/// Two views in OpenCV's keys. Lengths are mm.
///
/// `image_width1 image_height1 M1 D1` and the same with 2: size, K and k1 k2 p1 p2 k3 …, of a fisheye `fisheye1: 1`; `R T`: X_2 = R X_1 + T; `E F`, F with
/// its last entry 1; `R1 R2 P1 P2 Q` as `stereoRectify` gives them with its defaults. Beyond what OpenCV knows, `R_world
/// T_world`: X_1 = R_world X + T_world, the place of the first view in the rig's world.
///
/// # Errors
/// Views at one place have no rectified images.
pub fn pair_text(first: &Camera, second: &Camera, language: Language) -> Result<String, RectifyError> {
    let geometry = StereoGeometry::new(first, second);
    let images = RectifiedImages::new(first, second)?;
    let mut entries = Vec::new();
    for (number, camera) in [(1, first), (2, second)] {
        entries.push((format!("image_width{number}"), Entry::Number(camera.width_px)));
        entries.push((format!("image_height{number}"), Entry::Number(camera.height_px)));
        entries.push((format!("M{number}"), matrix(&camera.matrix())));
        let lens = opencv_from_lens(&camera.distortion);
        entries.push((format!("D{number}"), Entry::Matrix(1, lens.len(), lens)));
        // Four numbers alone would be k1, k2, p1, p2.
        if camera.distortion.kind == LensKind::Fisheye {
            entries.push((format!("fisheye{number}"), Entry::Number(1)));
        }
    }
    let mut motion = |names: [&str; 2], pose: &Isometry3<f64>| {
        entries.push((names[0].to_owned(), matrix(pose.rotation.to_rotation_matrix().matrix())));
        entries.push((names[1].to_owned(), matrix(&pose.translation.vector)));
    };
    motion(["R", "T"], &geometry.right_from_left);
    motion(["R_world", "T_world"], &first.camera_from_world);
    let [r1, r2] = &images.rectified_from_view;
    let [p1, p2] = &images.projection;
    for (key, value) in [
        ("E", matrix(&geometry.essential)),
        ("F", matrix(&geometry.fundamental_scaled())),
        ("R1", matrix(r1)),
        ("R2", matrix(r2)),
        ("P1", matrix(p1)),
        ("P2", matrix(p2)),
        ("Q", matrix(&images.q)),
    ] {
        entries.push((key.to_owned(), value));
    }
    Ok(match language {
        Language::Yaml => yaml(&entries),
        Language::Xml => xml(&entries),
    })
}

/// An entry with the values of a matrix, row by row.
fn matrix<R, C, S>(matrix: &Matrix<f64, R, C, S>) -> Entry
where
    R: nalgebra::Dim,
    C: nalgebra::Dim,
    S: nalgebra::RawStorage<f64, R, C>,
{
    let rows = matrix.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<f64>>());
    Entry::Matrix(matrix.nrows(), matrix.ncols(), rows.collect())
}

/// Shortest digits that read back as the same number.
fn numbers(data: &[f64], between: &str) -> String {
    data.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(between)
}

fn yaml(entries: &[(String, Entry)]) -> String {
    let mut out = String::from("%YAML:1.0\n---\n");
    for (key, entry) in entries {
        let _ = match entry {
            Entry::Number(value) => writeln!(out, "{key}: {value}"),
            Entry::Matrix(rows, columns, data) => writeln!(
                out,
                "{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {} ]",
                numbers(data, ", ")
            ),
        };
    }
    out
}

fn xml(entries: &[(String, Entry)]) -> String {
    let mut out = String::from("<?xml version=\"1.0\"?>\n<opencv_storage>\n");
    for (key, entry) in entries {
        let _ = match entry {
            Entry::Number(value) => writeln!(out, "<{key}>{value}</{key}>"),
            Entry::Matrix(rows, columns, data) => writeln!(
                out,
                "<{key} type_id=\"opencv-matrix\">\n  <rows>{rows}</rows>\n  <cols>{columns}</cols>\n  <dt>d</dt>\n  \
                 <data>\n    {}</data></{key}>",
                numbers(data, " ")
            ),
        };
    }
    out.push_str("</opencv_storage>\n");
    out
}
