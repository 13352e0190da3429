//! From the `[twin]` of a configuration to the digital twin.

use crate::error::DeviceError;
use files::config::{Config, TextFile, TwinConfig};
use files::document::read_bytes;
use files::error::{FileError, Problem};
use std::path::Path;
use twin::{Scene, Twin, TwinSettings};

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

/// `[twin.settings]` as written, each value within its range.
///
/// # Errors
/// Unknown keys or values out of range, with file, line and key.
pub fn written_settings(config: &Config) -> Result<TwinSettings, DeviceError> {
    let written: TwinSettings = config.document.typed("twin.settings", twin(config)?.settings.clone())?;
    written.check().map_err(|error| {
        let problem = Problem::Value { value: error.value.to_string(), limit: error.limit.into() };
        let remedy = "change it, or leave it out for the usual value";
        config.document.fault(&format!("twin.settings.{}", error.key), problem, remedy)
    })?;
    Ok(written)
}

/// Settings of the twin, with the seed of the configuration.
///
/// # Errors
/// As [`written_settings`].
pub fn settings(config: &Config) -> Result<TwinSettings, DeviceError> {
    Ok(TwinSettings { seed: twin(config)?.seed, ..written_settings(config)? })
}

/// The twin.
///
/// # Errors
/// As [`scene`] and [`settings`], or a rig without projectors.
pub fn build(config: &Config) -> Result<Twin, DeviceError> {
    let TwinConfig { scene: file, rig, .. } = twin(config)?;
    Twin::new(&scene(file)?, settings(config)?, rig)
        .map_err(|source| DeviceError::Configured { path: config.document.path.clone(), source })
}

fn twin(config: &Config) -> Result<&TwinConfig, DeviceError> {
    config.twin.as_ref().ok_or(DeviceError::Missing("twin"))
}
