//! Numbers with limits.

use super::raw::{RawConfig, RawLimits, RawResults, RawSchedule};
use super::values::value;
use super::{ResultFormat, ResultRetention};
use crate::document::Document;
use crate::error::{FileError, Problem};
use cell::configuration::{Limits, ScheduleConfig, Settings};
use fringe::decode::DecodeError;
use fringe::fusion::FusionSettings;
use fringe::matching::MatchError;

/// Longest time that a limit may be set to, ms: a day. Longer ones are typing errors.
const TIME_LIMIT_MS: u64 = 86_400_000;

pub(super) fn cycles(document: &Document, cycles: Option<u32>) -> Result<Option<u32>, FileError> {
    match cycles {
        Some(0) => {
            let problem = value(0, "at least 1");
            Err(document.fault("cycles", problem, "leave the key out to run until stopped"))
        }
        other => Ok(other),
    }
}

pub(super) fn limits(document: &Document, raw: &RawLimits) -> Result<Limits, FileError> {
    let time = |key: &str, given: Option<u64>, default: u64| match given.unwrap_or(default) {
        good @ 1..=TIME_LIMIT_MS => Ok(good),
        bad => {
            let problem = value(bad, format!("1 … {TIME_LIMIT_MS} ms"));
            Err(document.fault(&format!("limits.{key}"), problem, format!("the default is {default}")))
        }
    };
    let restarts = raw.restarts_max.unwrap_or(5);
    let Some(restarts_max) = u32::try_from(restarts).ok().filter(|count| *count <= 1000) else {
        return Err(document.fault("limits.restarts_max", value(restarts, "0 … 1000"), "the default is 5"));
    };
    let limits = Limits {
        stage_budget_ms: time("stage_budget_ms", raw.stage_budget_ms, 5_000)?,
        cycle_deadline_ms: time("cycle_deadline_ms", raw.cycle_deadline_ms, 20_000)?,
        start_ms: time("start_ms", raw.start_ms, 20_000)?,
        stop_ms: time("stop_ms", raw.stop_ms, 3_000)?,
        restarts_max,
        restart_window_ms: time("restart_window_ms", raw.restart_window_ms, 60_000)?,
        silence_ms: time("silence_ms", raw.silence_ms, 1_000)?,
    };
    if limits.stage_budget_ms > limits.cycle_deadline_ms {
        let problem = Problem::Disagreement {
            what: "limits",
            here: format!("a stage may take {} ms", limits.stage_budget_ms),
            there: format!("the whole cycle must end within {} ms", limits.cycle_deadline_ms),
        };
        return Err(document.fault("limits.stage_budget_ms", problem, "raise cycle_deadline_ms"));
    }
    Ok(limits)
}

/// The tables `decode`, `matching` and `fusion`: parsed and checked here and nowhere else.
pub(super) fn settings(document: &Document, raw: &RawConfig) -> Result<Settings, FileError> {
    let settings = Settings {
        decode: document.typed("decode", raw.decode.clone())?,
        matching: document.typed("matching", raw.matching.clone())?,
        fusion: document.typed("fusion", raw.fusion.clone())?,
    };
    settings.decode.check().map_err(|error| {
        let key = match &error {
            DecodeError::Setting { key, .. } => format!("decode.{key}"),
            _ => "decode".to_owned(),
        };
        document.fault(&key, Problem::Decode(error), "")
    })?;
    settings.matching.check().map_err(|error| match error {
        MatchError::Setting { key, value: found, limits } => {
            let remedy = "change it, or leave it out for the usual value";
            document.fault(&format!("matching.{key}"), value(found, limits), remedy)
        }
        other => document.fault("matching", Problem::Unsupported(other.to_string()), ""),
    })?;
    fusion(document, &settings.fusion)?;
    Ok(settings)
}

/// Checks the numbers of the table `fusion`.
fn fusion(document: &Document, settings: &FusionSettings) -> Result<(), FileError> {
    let (radius_mm, angle_deg) = (settings.radius_mm, settings.max_normal_angle_deg);
    if let Some(bad) = radius_mm.filter(|radius| !(1e-6..=1e3).contains(radius)) {
        let remedy = "leave it out to take it from the spacing of the points";
        return Err(document.fault("fusion.radius_mm", value(bad, "0.000001 … 1000 mm"), remedy));
    }
    if !(0.0..=180.0).contains(&angle_deg) {
        let problem = value(angle_deg, "0 … 180 degrees");
        return Err(document.fault("fusion.max_normal_angle_deg", problem, "the default is 30"));
    }
    Ok(())
}

/// Largest numbers of results, parts and MB that are a limit at all.
const RESULTS_LIMIT: u64 = 10_000_000;
const PARTS_LIMIT: u64 = 1_000_000;
const MB_LIMIT: u64 = 1_000_000_000;

pub(super) fn results(document: &Document, raw: &RawResults) -> Result<ResultRetention, FileError> {
    let results = raw.results.unwrap_or(100_000);
    let (parts, size_mb) = (raw.parts.unwrap_or(1_000), raw.size_mb.unwrap_or(10_000));
    if !(1..=RESULTS_LIMIT).contains(&results) {
        let problem = value(results, "1 … 10 000 000");
        return Err(document.fault("results.keep_results", problem, "the default is 100000"));
    }
    if parts > PARTS_LIMIT {
        let remedy = "the default is 1000; 0 keeps results without clouds and reports";
        return Err(document.fault("results.keep_parts", value(parts, "0 … 1 000 000"), remedy));
    }
    if !(1..=MB_LIMIT).contains(&size_mb) {
        let problem = value(size_mb, "1 … 1 000 000 000 MB");
        return Err(document.fault("results.keep_mb", problem, "the default is 10000"));
    }
    Ok(ResultRetention { results, parts, size_mb })
}

/// The formats of results, each once.
pub(super) fn formats(document: &Document, names: &[String]) -> Result<Vec<ResultFormat>, FileError> {
    let known = || ResultFormat::ALL.map(ResultFormat::name).join(", ");
    let one = |name: &String| {
        let found = ResultFormat::ALL.into_iter().find(|format| format.name() == name);
        let problem = || value(format!("{name:?}"), "names of formats");
        found.ok_or_else(|| document.fault("results.formats", problem(), format!("there are {}", known())))
    };
    let mut all = names.iter().map(one).collect::<Result<Vec<_>, _>>()?;
    all.sort_unstable();
    all.dedup();
    Ok(all)
}

pub(super) fn schedule(document: &Document, raw: &RawSchedule) -> Result<ScheduleConfig, FileError> {
    let cores = raw.cores.unwrap_or(2);
    if !(1..=1024).contains(&cores) {
        return Err(document.fault("schedule.cores", value(cores, "1 … 1024"), "the default is 2"));
    }
    if let Some(bad) = raw.realtime_priority.filter(|priority| !(1..=98).contains(priority)) {
        let remedy = "leave it out to share the processors as usual; the supervisor takes the priority above";
        return Err(document.fault("schedule.realtime_priority", value(bad, "1 … 98"), remedy));
    }
    let cycles_in_flight = raw.cycles_in_flight.unwrap_or(1);
    if !(1..=4).contains(&cycles_in_flight) {
        let remedy =
            "1, the default, ends each cycle before the next begins; 2 acquires the next one meanwhile";
        return Err(document.fault("schedule.cycles_in_flight", value(cycles_in_flight, "1 … 4"), remedy));
    }
    Ok(ScheduleConfig {
        cores,
        cycles_in_flight,
        pin: raw.pin.unwrap_or(false),
        realtime_priority: raw.realtime_priority,
        lock_memory: raw.lock_memory.unwrap_or(false),
    })
}
