//! Scenes of the digital twin, `fringecell-scene/1`, with the meshes that they name.

use crate::document::{Document, read_bytes};
use crate::error::{FileError, Problem};
use crate::mesh_file::stl_bytes;
use crate::step_file;
use std::path::{Path, PathBuf};
use twin::Scene;
use twin::scene_file::{FORMAT, GeometryFile, SceneFile};
use twox_hash::XxHash3_128;

/// A mesh beyond this has some twenty million triangles: more than the twin can trace in sensible time.
const MESH_LIMIT_BYTES: u64 = 1 << 30;

/// A mesh that a scene names, as it was when the scene was read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeshFile {
    /// Path of the mesh.
    pub path: PathBuf,
    /// Hash of its bytes (xxh3, 128 bits); 0 if they could not be read.
    pub hash: u128,
}

/// The scene of a file, with its meshes; their paths are relative to the file.
///
/// # Errors
/// Not TOML, another format, unknown or missing keys, numbers out of range, meshes that cannot be read.
pub fn parse_scene(document: &Document) -> Result<Scene, FileError> {
    parse_unchanged_scene(document, &[])
}

/// As [`parse_scene`], where each of these meshes must still be what it was.
///
/// # Errors
/// As [`parse_scene`], and a mesh that was changed since.
pub fn parse_unchanged_scene(document: &Document, known: &[MeshFile]) -> Result<Scene, FileError> {
    let mut load = |name: &str| {
        let path = mesh_path(document, name);
        let bytes = read_bytes(&path, MESH_LIMIT_BYTES).map_err(|e| chain(&e))?;
        match known.iter().find(|mesh| mesh.path == path) {
            Some(mesh) if mesh.hash != XxHash3_128::oneshot(&bytes) => {
                Err(format!("{}: was changed while it was read; start again", path.display()))
            }
            _ if step_file::begins_as_step(&bytes) => {
                let part = step_file::part_of(&path, &bytes, None).map_err(|e| chain(&e))?;
                Ok(stl_bytes(&part.all_triangles()))
            }
            _ => Ok(bytes),
        }
    };
    Scene::new(&parse_file(document)?, &mut load).map_err(|error| {
        let (kind, name, key) = error.place();
        let [kind, name, key] = [kind, name, key].map(str::to_owned);
        document.fault_of([&kind, &name, &key], Problem::Scene(error), "")
    })
}

/// The meshes that a scene names. A scene that cannot be read has none: [`parse_scene`] refuses it.
pub fn mesh_files(document: &Document) -> Vec<MeshFile> {
    let Ok(scene) = parse_file(document) else { return Vec::new() };
    let names = scene.bodies.into_iter().filter_map(|body| match body.geometry {
        GeometryFile::Mesh { file, .. } => Some(file),
        _ => None,
    });
    let mesh = |name: String| {
        let path = mesh_path(document, &name);
        let hash = read_bytes(&path, MESH_LIMIT_BYTES).map_or(0, |bytes| XxHash3_128::oneshot(&bytes));
        MeshFile { path, hash }
    };
    names.map(mesh).collect()
}

fn mesh_path(document: &Document, name: &str) -> PathBuf {
    document.path.parent().unwrap_or(Path::new(".")).join(name)
}

/// A scene as it is written, before it is checked.
///
/// # Errors
/// Not TOML, another format, unknown or missing keys.
pub fn parse_file(document: &Document) -> Result<SceneFile, FileError> {
    document.parse(FORMAT)
}

/// An error with its causes on one line.
fn chain(error: &FileError) -> String {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(next) = cause {
        text.push_str(": ");
        text.push_str(&next.to_string());
        cause = next.source();
    }
    text
}
