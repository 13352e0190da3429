//! Who fires the cameras: the cell, pattern by pattern, or the projector in its own time.

use super::raw::RawProjector;
use super::values::value;
use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::rig_file::unknown;
use cell::configuration::{Driver, TriggerMode};
use cell::lightcrafter::PatternSource;

/// Times between two patterns, ms.
const PERIOD_MS: [f64; 2] = [0.1, 60_000.0];

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
                || (driver == Driver::LightCrafter
                    && raw.source.as_deref() == Some(PatternSource::Video.name())) =>
        {
            let problem =
                Problem::Unsupported("a screen shows frame by frame, when this computer gets to it".into());
            let remedy = "remove it, or use a board that has the patterns in its memory: source = \"flash\" or \"usb\"";
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
