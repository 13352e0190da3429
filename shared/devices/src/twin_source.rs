//! From the `[twin]` of a configuration to the digital twin.

use crate::error::DeviceError;
use files::config::{Config, TextFile};
use files::document::read_bytes;
use files::error::FileError;
use std::path::Path;
use twin::{Scene, Twin};

/// A mesh beyond this has some twenty million triangles: more than the twin can trace in sensible time.
const MESH_LIMIT_BYTES: u64 = 1 << 30;

/// The scene of a file, with its meshes.
///
/// # Errors
/// A scene that cannot be used; the message names the file.
pub fn scene(file: &TextFile) -> Result<Scene, DeviceError> {
    let folder = file.path.parent().unwrap_or(Path::new("."));
    let mut load = |name: &str| read_bytes(&folder.join(name), MESH_LIMIT_BYTES).map_err(|e| chain(&e));
    Scene::parse(&file.text, &mut load)
        .map_err(|source| DeviceError::Scene { path: file.path.clone(), source })
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

/// The twin.
///
/// # Errors
/// As [`scene`], or a rig without projectors.
pub fn build(config: &Config) -> Result<Twin, DeviceError> {
    let twin = config.twin.as_ref().ok_or(DeviceError::Missing("twin"))?;
    Twin::new(&scene(&twin.scene)?, twin.settings.clone(), &twin.rig)
        .map_err(|source| DeviceError::Configured { path: config.document.path.clone(), source })
}
