//! `result.json`: what one cycle measured, with keys that other programs rely on.

use crate::atomic;
use crate::document::read_text;
use crate::error::{FileError, Problem};
use fringe::fusion::Overlap;
use metrology::inspection::{AlignmentResult, ConstructedResult, ElementResult, FeatureResult};
use metrology::verdict::Verdict;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Outcome of a cycle that did all it should; anything else is the reason why not.
pub const OUTCOME_OK: &str = "ok";

/// The outcome of one cycle, from the supervisor to files, socket, console and report.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CycleResult {
    /// Counter of the cycle, from 0; people see [`Self::number`].
    pub cycle: u64,
    /// [`OUTCOME_OK`] or the reason.
    pub outcome: String,
    /// Over all features; absent when no feature has limits.
    pub verdict: Option<Verdict>,
    /// In the order of the inspection plan.
    pub features: Vec<FeatureResult>,
    /// In the order of the schedule.
    pub stages: Vec<StageResult>,
    /// From the last frame to the verdict, ns; absent when there was none.
    pub latency_ns: Option<u64>,
    /// Of each stage's output, hexadecimal.
    pub hashes: BTreeMap<String, String>,
    /// Where the part was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alignment: Option<AlignmentResult>,
    /// Why the part was not found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alignment_failure: Option<String>,
    /// What was fitted, in the order of the inspection plan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub elements: Vec<ElementResult>,
    /// What was made of fitted elements, in the order of the inspection plan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub constructed: Vec<ConstructedResult>,
    /// SHA-256 of the calibration's shares, hexadecimal; absent where the uncertainties hold none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration_shares_sha256: Option<String>,
    /// Name of the cell.
    #[serde(default)]
    pub cell: String,
    /// Git commit that the software was built from; `unknown` without git.
    #[serde(default)]
    pub commit: String,
    /// SHA-256 of the configuration, hexadecimal.
    #[serde(default)]
    pub config_sha256: String,
    /// When the outcome of the cycle was known, UTC (ISO 8601): `2026-01-31T08:00:00Z`.
    #[serde(default)]
    pub date: String,
    /// From the start of the cycle to its outcome, ns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duration_ns: Option<u64>,
    /// Why the files of this cycle are not on the disk; absent when they are, or when none were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kept: Option<String>,
    /// Whether something moved during the cycle by more than the uncertainty of the phase, or than orders bear; absent where no frames tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<bool>,
    /// Number of the cycle as console, report and file names show it: from 1.
    #[serde(default)]
    pub number: u64,
    /// How well pairs agree; `a` and `b` count the pairs of the rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlaps: Option<Vec<Overlap>>,
    /// The part, as the job named it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// SHA-256 of the inspection plan, hexadecimal; absent without a plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan_sha256: Option<String>,
    /// Points of the fused cloud.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<u64>,
    /// The recipe that the part was inspected with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recipe: Option<String>,
    /// Reports of the stages on their outputs, by output; each kind of stage has its own keys.
    #[serde(default)]
    pub reports: BTreeMap<String, Value>,
    /// SHA-256 of the rig file, hexadecimal.
    #[serde(default)]
    pub rig_sha256: String,
    /// Version of the software.
    #[serde(default)]
    pub version: String,
    /// What a person should look at although the cycle has its result: motion, frames that contradict the rig file.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

impl CycleResult {
    /// Whether the cycle did all it should.
    pub fn is_ok(&self) -> bool {
        self.outcome == OUTCOME_OK
    }
}

/// What one stage did and used in one cycle. Waiting, computing and sending do not overlap.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageResult {
    /// As in the schedule.
    pub name: String,
    /// Waiting for input, ns.
    pub wait_ns: u64,
    /// Time spent computing, ns.
    pub compute_ns: u64,
    /// Handing outputs over, waiting for room included, ns.
    #[serde(default)]
    pub send_ns: u64,
    /// Number of activations done.
    #[serde(default)]
    pub activations: u32,
    /// Bytes of the outputs sent.
    #[serde(default)]
    pub bytes: u64,
    /// Messages sent, triggers and reports included.
    #[serde(default)]
    pub messages: u64,
    /// Processor time of all its threads, ns.
    #[serde(default)]
    pub cpu_ns: u64,
    /// Page faults served from memory.
    #[serde(default)]
    pub minor_faults: u64,
    /// Page faults that waited for a disk.
    #[serde(default)]
    pub major_faults: u64,
    /// Context switches by waiting.
    #[serde(default)]
    pub voluntary_switches: u64,
    /// Context switches against its will.
    #[serde(default)]
    pub involuntary_switches: u64,
    /// Heap allocations; only from a build that counts them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub allocations: Option<u64>,
}

/// Writes any machine-readable result as JSON, complete or not at all. A NaN or infinity becomes `null`.
///
/// # Errors
/// A value that JSON cannot hold (a map with keys that are no text), or a place that cannot be written.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), FileError> {
    let mut text = serde_json::to_string_pretty(value)
        .map_err(|error| FileError::new(path, Problem::Syntax(error.to_string()), ""))?;
    text.push('\n');
    atomic::write(path, text.as_bytes())
}

/// Reads JSON.
///
/// # Errors
/// Absent, not JSON, or other keys than meant; the message names the line.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, FileError> {
    parse_json(path, &read_text(path)?)
}

/// Parses a JSON text that was read.
///
/// # Errors
/// Not of this kind, with the line.
pub(crate) fn parse_json<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, FileError> {
    serde_json::from_str(text).map_err(|error| {
        let mut fault = FileError::new(path, Problem::Syntax(error.to_string()), "");
        fault.line = Some(error.line()).filter(|line| *line > 0);
        fault
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use metrology::inspection::Unit;

    fn result() -> CycleResult {
        CycleResult {
            cycle: 3,
            outcome: OUTCOME_OK.into(),
            verdict: Some(Verdict::Indeterminate),
            features: vec![FeatureResult {
                name: "sphere1".into(),
                value: Some(0.1 + 0.2),
                unit: Unit::Mm,
                u: Some(1.0 / 3.0),
                lower: None,
                upper: Some(22.0),
                verdict: Some(Verdict::Pass),
                u_noise: Some(5e-324),
                u_system: 1e308,
                ..FeatureResult::default()
            }],
            stages: vec![StageResult {
                name: "decode cam1".into(),
                wait_ns: 1,
                compute_ns: u64::MAX,
                bytes: 7,
                ..StageResult::default()
            }],
            latency_ns: Some(5),
            hashes: BTreeMap::from([("cloud/fused".into(), "00ff".into())]),
            points: Some(7),
            ..CycleResult::default()
        }
    }

    #[test]
    fn a_result_comes_back_digit_by_digit_with_the_keys_of_the_contract() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("result.json");
        write_json(&path, &result()).unwrap();
        assert_eq!(read_json::<CycleResult>(&path).unwrap(), result());
        let value: serde_json::Value = read_json(&path).unwrap();
        for key in ["cycle", "outcome", "verdict", "features", "stages", "latency_ns", "hashes", "points"] {
            assert!(value.get(key).is_some(), "{key}");
        }
        for key in ["name", "value", "unit", "u", "lower", "upper", "verdict"] {
            assert!(value["features"][0].get(key).is_some(), "{key}");
        }
        assert_eq!(value["verdict"], "indeterminate");
    }

    #[test]
    fn damaged_json_is_reported_with_its_line() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("result.json");
        std::fs::write(&path, "{\n \"cycle\": \n").unwrap();
        let error = read_json::<CycleResult>(&path).unwrap_err().to_string();
        assert!(error.contains("result.json:3: "), "{error}");
    }
}
