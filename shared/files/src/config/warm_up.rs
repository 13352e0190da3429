//! When the temperature of the cameras counts as settled.

use super::raw::RawWarmUp;
use super::values::value;
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
    let within = |key: &str, found: f64, [least, most]: [f64; 2], unit: &str| {
        if (least..=most).contains(&found) {
            return Ok(found);
        }
        Err(document.fault(&format!("warm_up.{key}"), value(found, format!("{least} … {most} {unit}")), ""))
    };
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
    Ok(Some(WarmUp {
        max_change_k: within("max_change_k", raw.max_change_k, CHANGE_K, "K")?,
        window_s: within("window_s", raw.window_s, WINDOW_S, "s")?,
    }))
}
