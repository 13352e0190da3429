//! From the `[twin]` of a configuration to the digital twin.

use crate::error::DeviceError;
use files::config::Config;
use files::scene_file::parse_unchanged_scene;
use twin::Twin;

/// The twin.
///
/// # Errors
/// A scene that cannot be used, a mesh that was changed since the configuration was read, or a rig without projectors.
pub fn build(config: &Config) -> Result<Twin, DeviceError> {
    let twin = config.twin.as_ref().ok_or(DeviceError::Missing("twin"))?;
    Twin::new(&parse_unchanged_scene(&twin.scene, &twin.meshes)?, twin.settings.clone(), &twin.rig)
        .map_err(|source| DeviceError::Configured { path: config.document.path.clone(), source })
}
