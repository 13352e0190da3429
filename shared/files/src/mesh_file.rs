//! Meshes as they are written: PLY with common corners, STL with corners of their own.

use crate::atomic;
use crate::error::FileError;
use crate::ply::comment_line;
use nalgebra::{Point3, Vector3};
use std::io::Write as _;
use std::path::Path;

/// The 80 bytes before the triangles; it must not begin with "solid", which is text.
const STL_TITLE: &[u8] = b"STL by fringecell, lengths in mm";

/// Writes a mesh as binary PLY, mm, complete or not at all. Each comment becomes a line `comment key: value`.
///
/// # Errors
/// A place that cannot be written.
pub fn write_ply(
    path: &Path,
    corners: &[Point3<f64>],
    triangles: &[[u32; 3]],
    comments: &[(&str, &str)],
) -> Result<(), FileError> {
    atomic::write_with(path, |out| {
        writeln!(out, "ply\nformat binary_little_endian 1.0\ncomment unit: mm")?;
        for comment in comments {
            out.write_all(comment_line(comment).as_bytes())?;
        }
        writeln!(out, "element vertex {}", corners.len())?;
        writeln!(out, "property double x\nproperty double y\nproperty double z")?;
        writeln!(out, "element face {}", triangles.len())?;
        writeln!(out, "property list uchar uint vertex_indices\nend_header")?;
        for value in corners.iter().flat_map(|corner| corner.iter()) {
            out.write_all(&value.to_le_bytes())?;
        }
        for triangle in triangles {
            out.write_all(&[3])?;
            for corner in triangle {
                out.write_all(&corner.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

/// Writes a mesh as binary STL, mm, in single precision, complete or not at all.
///
/// # Errors
/// A place that cannot be written.
pub fn write_stl(path: &Path, corners: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<(), FileError> {
    let triangles = triangles.iter().map(|triangle| triangle.map(|corner| corners[corner as usize]));
    atomic::write_with(path, |out| stl(out, triangles))
}

/// A mesh as the bytes of a binary STL, in single precision.
pub(crate) fn stl_bytes(triangles: &[[Point3<f64>; 3]]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(84 + 50 * triangles.len());
    // Writing into memory does not fail.
    let _ = stl(&mut bytes, triangles.iter().copied());
    bytes
}

fn stl(
    out: &mut dyn std::io::Write,
    triangles: impl ExactSizeIterator<Item = [Point3<f64>; 3]>,
) -> std::io::Result<()> {
    let mut title = STL_TITLE.to_vec();
    title.resize(80, b' ');
    out.write_all(&title)?;
    out.write_all(&(triangles.len() as u32).to_le_bytes())?;
    for [a, b, c] in triangles {
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        for value in [normal, a.coords, b.coords, c.coords].iter().flat_map(|v| v.iter()) {
            out.write_all(&(*value as f32).to_le_bytes())?;
        }
        out.write_all(&[0; 2])?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface_file::{Surface, read};

    #[test]
    fn a_mesh_comes_back_from_both_formats_and_replaces_its_own_kind_only() {
        let folder = tempfile::TempDir::new().unwrap();
        let corners =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.25], [0.0, 1.0, 0.5], [1.0, 1.0, -2.0]].map(Point3::from);
        let triangles = [[0, 1, 2], [2, 1, 3]];
        let expected: Vec<_> = triangles.iter().map(|t| t.map(|c: u32| corners[c as usize])).collect();
        let [ply, stl] = ["a.ply", "a.stl"].map(|name| folder.path().join(name));
        for _ in 0..2 {
            write_ply(&ply, &corners, &triangles, &[("source", "a\nb")]).unwrap();
            write_stl(&stl, &corners, &triangles).unwrap();
        }
        for path in [&ply, &stl] {
            let Surface::Mesh(back) = read(path).unwrap() else { panic!("{}", path.display()) };
            assert_eq!(back, expected, "{}", path.display());
        }
        let foreign = folder.path().join("b.ply");
        std::fs::copy(&ply, &foreign).unwrap();
        assert!(write_stl(&foreign, &corners, &triangles).is_err(), "a mesh in PLY stays");
    }
}
