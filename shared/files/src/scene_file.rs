//! Scenes of the digital twin, `fringecell-scene/1`, with the meshes that they name.

use crate::document::{Document, read_bytes};
use crate::error::{FileError, Problem};
use std::path::Path;
use twin::Scene;
use twin::scene_file::{FORMAT, SceneFile};

/// A mesh beyond this has some twenty million triangles: more than the twin can trace in sensible time.
const MESH_LIMIT_BYTES: u64 = 1 << 30;

/// The scene of a file, with its meshes; their paths are relative to the file.
///
/// # Errors
/// Not TOML, another format, unknown or missing keys, numbers out of range, meshes that cannot be read.
pub fn parse_scene(document: &Document) -> Result<Scene, FileError> {
    let folder = document.path.parent().unwrap_or(Path::new("."));
    let mut load = |name: &str| read_bytes(&folder.join(name), MESH_LIMIT_BYTES).map_err(|e| chain(&e));
    Scene::new(&parse_file(document)?, &mut load).map_err(|error| {
        let (kind, name, key) = error.place();
        let [kind, name, key] = [kind, name, key].map(str::to_owned);
        document.fault_of([&kind, &name, &key], Problem::Scene(error), "")
    })
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
