//! Clouds and meshes by whatever file they come in: PLY, STL, OBJ, STEP, E57.

use crate::document::{open_input, read_bytes, refuse_special};
use crate::e57_file;
use crate::error::{FileError, Problem};
use crate::memory;
use crate::ply::{self, Cloud};
use crate::step_file;
use nalgebra::Point3;
use std::io::{Cursor, Read};
use std::path::Path;

/// Largest STL: 50 million triangles in binary form.
const STL_LIMIT_BYTES: u64 = STL_HEADER_BYTES + STL_TRIANGLE_BYTES * 50_000_000;

/// Bytes before the first triangle of a binary STL, and of one triangle.
const STL_HEADER_BYTES: u64 = 84;
const STL_TRIANGLE_BYTES: u64 = 50;

/// A cloud or a mesh.
#[derive(Debug, Clone)]
pub enum Surface {
    /// Points without faces, mm.
    Cloud(Cloud),
    /// Triangles, mm; corners counter-clockwise when seen from outside.
    Mesh(Vec<[Point3<f64>; 3]>),
}

/// The formats that are recognised.
enum Kind {
    Ply,
    Stl,
    Obj,
    Step,
    E57,
}

/// Reads a cloud (PLY, E57) or a mesh (STL, PLY with faces, OBJ, STEP), distinguished by content. The solids of a STEP file become
/// triangles within the default distance of [`step_file::read_part`].
///
/// # Errors
/// Another kind of file, or a damaged one.
pub fn read(path: &Path) -> Result<Surface, FileError> {
    match kind(path)? {
        Kind::Stl => read_stl(path).map(Surface::Mesh),
        Kind::Obj => read_obj(path).map(Surface::Mesh),
        Kind::Step => Ok(Surface::Mesh(step_file::read_part(path, None)?.all_triangles())),
        Kind::E57 => e57_file::read_cloud(path).map(Surface::Cloud),
        Kind::Ply => match ply::read_triangles(path)? {
            Some(triangles) => Ok(Surface::Mesh(triangles)),
            None => ply::read_cloud(path).map(Surface::Cloud),
        },
    }
}

/// Reads a cloud (PLY, E57); of a mesh in PLY its points.
///
/// # Errors
/// A mesh that is not PLY, another kind of file, or a damaged one.
pub fn read_cloud(path: &Path) -> Result<Cloud, FileError> {
    match kind(path)? {
        Kind::Ply => ply::read_cloud(path),
        Kind::E57 => e57_file::read_cloud(path),
        Kind::Stl | Kind::Obj | Kind::Step => Err(FileError::new(
            path,
            Problem::Unsupported("is a surface (STL, OBJ, STEP) where a point cloud is needed".into()),
            "name a cloud in PLY or E57 format; a surface may be the reference",
        )),
    }
}

/// Whether a file is a STEP file, by its content.
///
/// # Errors
/// A file that cannot be read, or of none of the kinds of [`read`].
pub fn is_step(path: &Path) -> Result<bool, FileError> {
    Ok(matches!(kind(path)?, Kind::Step))
}

fn kind(path: &Path) -> Result<Kind, FileError> {
    refuse_special(path)?;
    let (mut file, metadata) = open_input(path)?;
    let bytes = metadata.len();
    let mut start = Vec::new();
    (&mut file)
        .take(STL_HEADER_BYTES)
        .read_to_end(&mut start)
        .map_err(|source| FileError::io(path, "read it", source))?;
    if step_file::begins_as_step(&start) {
        return Ok(Kind::Step);
    }
    let named_stl = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("stl"));
    if start.starts_with(b"ply") {
        return Ok(Kind::Ply);
    }
    if start.starts_with(b"ASTM-E57") {
        return Ok(Kind::E57);
    }
    if named_stl || start.trim_ascii_start().starts_with(b"solid") || is_binary_stl(&start, bytes) {
        return Ok(Kind::Stl);
    }
    // An OBJ has no first word of its own.
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj")) {
        return Ok(Kind::Obj);
    }
    let problem = Problem::Unsupported("is neither PLY nor STL nor OBJ nor STEP nor E57".into());
    Err(FileError::new(
        path,
        problem,
        "name a cloud (PLY, E57), a mesh (STL, PLY with faces, OBJ) or CAD (STEP)",
    ))
}

/// Whether the number of triangles in the header is that of the file. Many binary files begin with "solid" too.
fn is_binary_stl(start: &[u8], bytes: u64) -> bool {
    let Some(Ok(count)) = start.get(80..84).map(<[u8; 4]>::try_from) else { return false };
    let count = u64::from(u32::from_le_bytes(count));
    count > 0 && bytes == STL_HEADER_BYTES + count * STL_TRIANGLE_BYTES
}

fn read_stl(path: &Path) -> Result<Vec<[Point3<f64>; 3]>, FileError> {
    // The file, and a triangle of nine numbers for each of its 50 bytes.
    let length = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    if length <= STL_LIMIT_BYTES {
        let triangles = length / STL_TRIANGLE_BYTES;
        let bytes = length + 2 * triangles * size_of::<[Point3<f64>; 3]>() as u64;
        memory::check(path, &format!("{triangles} triangles"), bytes)?;
    }
    let mut bytes = read_bytes(path, STL_LIMIT_BYTES)?;
    if is_binary_stl(&bytes, bytes.len() as u64) {
        // The reader takes "solid" for text.
        bytes[..80].fill(b' ');
    } else if bytes.trim_ascii_start().starts_with(b"solid") {
        // The reader wants the word at the start and a blank behind it, also where the solid has no name.
        let after = bytes.trim_ascii_start()[5..].to_vec();
        bytes = [b"solid ", after.as_slice()].concat();
    } else {
        let problem = Problem::Syntax(format!(
            "is no complete STL: it does not begin with \"solid\", and its {} bytes are not 84 and 50 for each triangle \
             that it announces",
            bytes.len()
        ));
        return Err(FileError::new(path, problem, "truncated? export or copy it again"));
    }
    let fault = |error: std::io::Error| {
        let problem =
            Problem::Syntax(format!("is no readable STL: {}", error.to_string().replace('\n', " ")));
        FileError::new(path, problem, "truncated? export or copy it again")
    };
    let mut cursor = Cursor::new(bytes);
    let mut triangles = Vec::new();
    for triangle in stl_io::create_stl_reader(&mut cursor).map_err(fault)? {
        let corners = triangle.map_err(fault)?.vertices;
        triangles.push(corners.map(|corner| Point3::from(corner.0.map(f64::from))));
    }
    Ok(triangles)
}

/// Faces of more than three corners become triangles; lines, points, materials and textures are left out.
fn read_obj(path: &Path) -> Result<Vec<[Point3<f64>; 3]>, FileError> {
    let bytes = read_bytes(path, STL_LIMIT_BYTES)?;
    memory::check(path, "the mesh", 8 * bytes.len() as u64)?;
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..Default::default()
    };
    let without_materials = |_: &Path| Ok((Vec::new(), std::collections::HashMap::default()));
    let (models, _) =
        tobj::load_obj_buf(&mut Cursor::new(bytes), &options, without_materials).map_err(|error| {
            let problem =
                Problem::Syntax(format!("is no readable OBJ: {}", error.to_string().replace('\n', " ")));
            FileError::new(path, problem, "truncated? export or copy it again")
        })?;
    let mut triangles = Vec::new();
    for model in &models {
        let (places, _) = model.mesh.positions.as_chunks::<3>();
        let corner = |index: &u32| places.get(*index as usize).map(|place| Point3::from(*place));
        let (faces, _) = model.mesh.indices.as_chunks::<3>();
        for [a, b, c] in faces {
            if let (Some(a), Some(b), Some(c)) = (corner(a), corner(b), corner(c)) {
                triangles.push([a, b, c]);
            }
        }
    }
    if triangles.is_empty() {
        let problem =
            Problem::Unsupported("has no face: \"v x y z\" for corners, \"f 1 2 3\" for faces".into());
        return Err(FileError::new(path, problem, "export the surface again as a mesh"));
    }
    Ok(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tempfile::TempDir;

    const TEXT: &str = "solid\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 0 1 0.5\n  \
         endloop\n endfacet\nendsolid\n";

    fn binary(header: &[u8]) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(80, b' ');
        bytes.extend(1_u32.to_le_bytes());
        for value in [0.0_f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.5] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend([0; 2]);
        bytes
    }

    fn read_as(name: &str, bytes: &[u8]) -> Result<Surface, String> {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        read(&path).map_err(|error| error.to_string())
    }

    fn triangles(name: &str, bytes: &[u8]) -> Vec<[Point3<f64>; 3]> {
        match read_as(name, bytes) {
            Ok(Surface::Mesh(triangles)) => triangles,
            other => panic!("{name}: {other:?}"),
        }
    }

    #[test]
    fn a_triangle_comes_in_five_dresses() {
        let expected = vec![[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]].map(Point3::from)];
        let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0.5\n3 0 1 2\n";
        assert_eq!(triangles("a.stl", TEXT.as_bytes()), expected);
        assert_eq!(triangles("a.stl", &binary(b"made by a CAD system")), expected);
        assert_eq!(triangles("no_ending", &binary(b"solid in its header although binary")), expected);
        assert_eq!(triangles("a.ply", ply.as_bytes()), expected);
        let obj = "# by a CAD system\nmtllib none.mtl\no part\nv 0 0 0\nv 1 0 0\nv 0 1 0.5\nvn 0 0 1\nf 1//1 2//1 -1//1\n";
        assert_eq!(triangles("a.obj", obj.as_bytes()), expected);
        assert_eq!(triangles("a.obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").len(), 2);
        for (text, words) in
            [("f 1 2 3\n", "no readable OBJ"), ("v 0 0 x\n", "no readable OBJ"), ("v 0 0 0\n", "no face")]
        {
            assert!(read_as("a.obj", text.as_bytes()).unwrap_err().contains(words), "{text}");
        }
        let quad = ply.replace("vertex 3", "vertex 4").replace("3 0 1 2", "1 1 1\n4 0 1 3 2");
        assert_eq!(triangles("a.ply", quad.as_bytes()).len(), 2);
        let wrong = read_as("a.ply", ply.replace("3 0 1 2", "3 0 1 7").as_bytes()).unwrap_err();
        assert!(
            wrong.contains("face[0]") && wrong.contains("corner 7") && wrong.contains("0 … 2"),
            "{wrong}"
        );
    }

    #[test]
    fn damaged_and_foreign_files_are_told() {
        for (name, bytes, word) in [
            ("a.stl", &binary(b"")[..120], "truncated"),
            ("a.stl", &TEXT.as_bytes()[..100], "readable STL"),
            ("a.stl", b"".as_slice(), "no complete STL"),
            ("a.xyz", b"v 0 0 0\n".as_slice(), "neither PLY nor STL nor OBJ nor STEP nor E57"),
            ("a.e57", b"ASTM-E57 and then nothing of it".as_slice(), "readable E57"),
            ("a.ply", b"ply\nformat ascii 1.0\n".as_slice(), "end_header"),
        ] {
            let error = read_as(name, bytes).unwrap_err();
            assert!(error.contains(word) && !error.contains('\n'), "{error}");
        }
    }
}
