//! When the temperature of the cameras counts as settled.

use super::devices::within;
use super::raw::RawWarmUp;
use crate::document::Document;
use crate::error::{FileError, Problem};
use cell::configuration::{CameraConfig, WarmUp};

/// Changes of temperature that may be allowed, K.
const CHANGE_K: [f64; 2] = [0.01, 50.0];

/// Times over which the change counts, s.
const WINDOW_S: [f64; 2] = [1.0, 86_400.0];

/// The table `[warm_up]`; its cameras must be able to tell their temperature.
pub(super) fn warm_up(
    document: &Document,
    raw: Option<&RawWarmUp>,
    cameras: &[CameraConfig],
) -> Result<Option<WarmUp>, FileError> {
    let Some(raw) = raw else { return Ok(None) };
    if let Some(camera) = cameras.iter().find(|camera| camera.genicam.is_none()) {
        let (name, driver) = (&camera.name, camera.driver.name());
        let problem = Problem::Unsupported(format!(
            "camera \"{name}\" with the driver \"{driver}\" has no temperature"
        ));
        return Err(document.fault(
            "warm_up",
            problem,
            "remove the table, or use cameras with the driver \"genicam\"",
        ));
    }
    let checked = |key: &str, found: f64, limits: [f64; 2], unit: &str| {
        within(document, &format!("warm_up.{key}"), found, limits, unit)
    };
    Ok(Some(WarmUp {
        max_change_k: checked("max_change_k", raw.max_change_k, CHANGE_K, "K")?,
        window_s: checked("window_s", raw.window_s, WINDOW_S, "s")?,
    }))
}
