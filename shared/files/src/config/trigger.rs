//! Who fires the cameras: the cell, pattern by pattern, or the projector in its own time.

use super::raw::RawProjector;
use super::values::value;
use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::rig_file::unknown;
use cell::configuration::{CameraConfig, Driver, ProjectorConfig, TriggerMode};

/// Times between two patterns, ms.
const PERIOD_MS: [f64; 2] = [0.1, 60_000.0];

/// Refresh rates of projectors, Hz.
const REFRESH_HZ: [f64; 2] = [1.0, 20_000.0];

/// An exposure may miss a whole number of refreshes by this share of one: cameras round to their clock.
const OFF: f64 = 0.01;

/// The trigger mode of a projector; `period_ms` belongs to "sequenced", which only devices have that show patterns by themselves.
pub(super) fn trigger(
    document: &Document,
    key: &str,
    raw: &RawProjector,
    driver: Driver,
) -> Result<TriggerMode, FileError> {
    let period_key = format!("{key}.period_ms");
    let trigger_key = format!("{key}.trigger");
    match (raw.trigger.as_deref().unwrap_or("stepped"), raw.period_ms) {
        ("stepped", None) => Ok(TriggerMode::Stepped),
        ("stepped", Some(_)) => {
            let problem =
                Problem::Unsupported("a stepped projector waits for its cameras and has no period".into());
            Err(document.fault(&period_key, problem, "remove it, or add trigger = \"sequenced\""))
        }
        ("sequenced", _) if !driver.is_live() => {
            let problem = Problem::Unsupported(format!("driver \"{}\" fires no cameras", driver.name()));
            Err(document.fault(
                &trigger_key,
                problem,
                "remove it, or use a projector that shows sequences by itself",
            ))
        }
        ("sequenced", _)
            if driver == Driver::Screen
                || (driver == Driver::LightCrafter && raw.controller.as_deref() != Some("dlpc900")) =>
        {
            let problem = Problem::Unsupported(format!("this \"{}\" shows frame by frame", driver.name()));
            let remedy = "remove it, or use a board with the controller \"dlpc900\"";
            Err(document.fault(&trigger_key, problem, remedy))
        }
        ("sequenced", None) => {
            let problem = Problem::Missing(format!("period_ms of projector \"{}\"", raw.name));
            Err(document.fault(key, problem, "add period_ms = 20.0, the time from one pattern to the next"))
        }
        ("sequenced", Some(period_ms)) if (PERIOD_MS[0]..=PERIOD_MS[1]).contains(&period_ms) => {
            Ok(TriggerMode::Sequenced { period_ms })
        }
        ("sequenced", Some(period_ms)) => {
            let limit = format!("{} … {} ms", PERIOD_MS[0], PERIOD_MS[1]);
            Err(document.fault(&period_key, value(period_ms, limit), ""))
        }
        (other, _) => Err(unknown(document, &trigger_key, "trigger", other, ["stepped", "sequenced"])),
    }
}

/// Exposures end before the next pattern, and last a whole number of refreshes where the rate is stated.
pub(super) fn check_exposures(
    document: &Document,
    key: &str,
    raw: &RawProjector,
    projector: &ProjectorConfig,
    cameras: &[CameraConfig],
) -> Result<(), FileError> {
    let lookers = cameras.iter().enumerate().filter(|(_, camera)| projector.cameras.contains(&camera.name));
    let exposed = lookers.filter_map(|(index, camera)| Some((index, camera.genicam.as_ref()?.exposure_us?)));
    let exposed: Vec<(usize, f64)> = exposed.collect();
    if let TriggerMode::Sequenced { period_ms } = projector.trigger
        && let Some((index, exposure_us)) = exposed.iter().find(|(_, us)| *us >= period_ms * 1e3)
    {
        let limit =
            format!("below {} µs, the period_ms of projector \"{}\"", period_ms * 1e3, projector.name);
        return Err(document.fault(&format!("camera[{index}].exposure_us"), value(exposure_us, limit), ""));
    }
    let Some(refresh_hz) = raw.refresh_hz else { return Ok(()) };
    if !(REFRESH_HZ[0]..=REFRESH_HZ[1]).contains(&refresh_hz) {
        let limit = format!("{} … {} Hz", REFRESH_HZ[0], REFRESH_HZ[1]);
        return Err(document.fault(&format!("{key}.refresh_hz"), value(refresh_hz, limit), ""));
    }
    let whole = |ms: f64| {
        let refreshes = ms * 1e-3 * refresh_hz;
        refreshes.round() >= 1.0 && (refreshes - refreshes.round()).abs() <= OFF
    };
    let limit = |unit_ms: f64, unit: &str| {
        format!(
            "a multiple of {:.3} {unit}, one refresh of projector \"{}\"",
            1e3 / refresh_hz / unit_ms,
            projector.name
        )
    };
    if let TriggerMode::Sequenced { period_ms } = projector.trigger
        && !whole(period_ms)
    {
        return Err(document.fault(&format!("{key}.period_ms"), value(period_ms, limit(1.0, "ms")), ""));
    }
    match exposed.iter().find(|(_, us)| !whole(us * 1e-3)) {
        Some((index, us)) => {
            let key = format!("camera[{index}].exposure_us");
            Err(document.fault(&key, value(us, limit(1e-3, "µs")), "the light of a refresh is not even"))
        }
        None => Ok(()),
    }
}
