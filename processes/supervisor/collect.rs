//! Collects the reports of the stages into the result of a cycle.

use super::profile;
use crate::software::FRINGECELL;
use cell::Cell;
use cell::schedule::{Interval, Schedule, Work, output};
use devices::{CameraState, LoadedCell};
use files::result::{CycleResult, OUTCOME_OK, StageResult};
use fringe::fusion::{Overlap, disagreement_warning};
use ipc::header::Event;
use ipc::output_hash;
use metrology::inspection::InspectionResult;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

/// Times of one activation.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Span {
    /// Cycle, counted from 0.
    pub cycle: u64,
    /// Index of the activation in the schedule.
    pub activation: usize,
    /// Waiting before the start, ns.
    pub wait_ns: u64,
    /// Start on the machine's monotonic clock, ns.
    pub start_ns: u64,
    /// End on the machine's monotonic clock, ns.
    pub end_ns: u64,
    /// Sending, part of the time between start and end, ns.
    pub send_ns: u64,
}

/// A result as it arrived.
#[derive(Debug)]
struct Inspected {
    /// Absent without a plan.
    inspection: Option<InspectionResult>,
    latency_ns: u64,
    /// xxh3 of the result's text, 128 bits.
    hash: u128,
}

/// The reports of a cycle.
#[derive(Debug, Default)]
pub struct Collector {
    done: BTreeMap<usize, (Event, String)>,
    inspected: Option<Inspected>,
}

impl Collector {
    /// Adds the report of an activation.
    pub fn done(&mut self, event: Event, text: String) {
        self.done.insert(event.activation as usize, (event, text));
    }

    /// Adds the result of the inspection, with its text and the time since the last frame, ns.
    pub fn inspected(&mut self, inspection: Option<InspectionResult>, text: &str, latency_ns: u64) {
        self.inspected = Some(Inspected { inspection, latency_ns, hash: output_hash(text.as_bytes()) });
    }

    /// Refuses a result whose hash differs from the one that the inspection reported.
    pub fn check_result(&self, schedule: &Schedule) -> Result<(), String> {
        // A host that is led inspects nothing, and delivers its clouds.
        let last = schedule.find(Work::Inspect).or_else(|| schedule.find(Work::Deliver));
        let reported = last.and_then(|number| self.done.get(&number));
        let reported = reported.map(|(event, _)| [event.hash_high, event.hash_low]);
        let came = self.inspected.as_ref().map(|j| [(j.hash >> 64) as u64, j.hash as u64]);
        if reported.is_some() && reported == came {
            return Ok(());
        }
        Err("the result received is not the one that the inspection reported".into())
    }

    /// The reports, in the order of the schedule.
    pub fn events(&self) -> impl Iterator<Item = &Event> {
        self.done.values().map(|(event, _)| event)
    }

    /// Start and end of each activation.
    pub fn intervals(&self) -> impl Iterator<Item = Interval> {
        let interval = |(&activation, (event, _)): (&usize, &(Event, String))| Interval {
            activation,
            start_ns: event.start_ns,
            end_ns: event.end_ns,
        };
        self.done.iter().map(interval)
    }

    /// The spans of the cycle, in the order of the schedule.
    pub fn spans(&self, cycle: u64) -> impl Iterator<Item = Span> {
        self.done.iter().map(move |(&activation, (event, _))| Span {
            cycle,
            activation,
            wait_ns: event.wait_ns,
            start_ns: event.start_ns,
            end_ns: event.end_ns,
            send_ns: event.send_ns,
        })
    }

    /// The result of the cycle with its outcome; the caller adds recipe, part and duration.
    pub fn result(&self, cell: &LoadedCell, cycle: u64, outcome: &Result<(), String>) -> CycleResult {
        let ok = outcome.is_ok();
        let inspected = self.inspected.as_ref();
        let inspection = inspected.and_then(|j| j.inspection.as_ref());
        // A part that was not found is reported even of a cycle that failed; its values are not.
        let alignment_failure = inspection.and_then(|i| i.alignment_failure.clone());
        let inspection = inspection.filter(|_| ok);
        let fused = self.fused(cell).filter(|_| ok);
        let joined = fused.and_then(|(_, text)| serde_json::from_str::<Fused>(text).ok());
        let disagreement =
            joined.as_ref().and_then(|joined| disagreement_warning(joined.disagreeing, joined.points));
        let beyond = inspection.map(|i| &i.elements[..]).unwrap_or_default().iter();
        let beyond = beyond.filter_map(|element| element.beyond.clone());
        let reports = self.reports(cell);
        CycleResult {
            cycle,
            outcome: outcome.as_ref().err().map_or_else(|| OUTCOME_OK.to_owned(), Clone::clone),
            verdict: inspection.map(|i| i.verdict),
            features: inspection.map(|i| i.features.clone()).unwrap_or_default(),
            stages: self.stages(&cell.schedule),
            latency_ns: inspected.filter(|_| ok).map(|j| j.latency_ns),
            hashes: self.hashes(cell),
            alignment: inspection.and_then(|i| i.alignment.clone()),
            alignment_failure,
            elements: inspection.map(|i| i.elements.clone()).unwrap_or_default(),
            constructed: inspection.map(|i| i.constructed.clone()).unwrap_or_default(),
            cell: cell.name.clone(),
            commit: FRINGECELL.commit.to_owned(),
            config_sha256: cell.file.sha256.clone(),
            date: files::clock::rfc3339_now(),
            number: cycle + 1,
            overlaps: joined.map(|joined| joined.overlaps),
            points: fused.map(|(event, _)| event.count.into()),
            moved: moved(&reports),
            warnings: warnings(&reports, disagreement.into_iter().chain(beyond)),
            reports,
            rig_sha256: cell.file.rig_sha256.clone(),
            version: FRINGECELL.version.to_owned(),
            ..CycleResult::default()
        }
    }

    /// What each camera told of itself in this cycle.
    pub fn camera_states(&self, cell: &Cell) -> Vec<(String, CameraState)> {
        let reports = self.reports(cell);
        let state = |(output, report): (String, Value)| {
            let camera = output.strip_prefix("frame/")?.to_owned();
            Some((camera, serde_json::from_value(report).ok()?))
        };
        reports.into_iter().filter_map(state).collect()
    }

    fn stages(&self, schedule: &Schedule) -> Vec<StageResult> {
        let mut stages: Vec<StageResult> = schedule
            .stages
            .iter()
            .map(|s| StageResult { name: s.name.clone(), ..StageResult::default() })
            .collect();
        for (activation, (event, _)) in &self.done {
            let Some(activation) = schedule.activations.get(*activation) else { continue };
            profile::add(&mut stages[activation.stage], &stage_result(event));
        }
        stages
    }

    /// One hash per output; of many frames of one camera, the hash of their hashes in the order of the schedule.
    fn hashes(&self, cell: &Cell) -> BTreeMap<String, String> {
        let mut parts: BTreeMap<String, Vec<[u64; 2]>> = BTreeMap::new();
        for (activation, (event, _)) in &self.done {
            let Some(activation) = cell.schedule.activations.get(*activation) else { continue };
            if let Some(key) = output(&cell.graph, activation.work) {
                parts.entry(key).or_default().push([event.hash_high, event.hash_low]);
            }
        }
        let join = |hashes: &[[u64; 2]]| match hashes {
            [[high, low]] => format!("{high:016x}{low:016x}"),
            many => {
                let bytes: Vec<u8> = many.iter().flatten().flat_map(|half| half.to_be_bytes()).collect();
                format!("{:032x}", output_hash(&bytes))
            }
        };
        parts.iter().map(|(key, hashes)| (key.clone(), join(hashes))).collect()
    }

    /// What the fusion reported.
    fn fused(&self, cell: &Cell) -> Option<&(Event, String)> {
        self.done.get(&cell.schedule.find(Work::Fuse)?)
    }

    /// Reports of the stages on their outputs, by output.
    fn reports(&self, cell: &Cell) -> BTreeMap<String, Value> {
        let report = |(activation, (_, text)): (&usize, &(Event, String))| {
            let activation = cell.schedule.activations.get(*activation)?;
            let report: Value = serde_json::from_str(text).ok()?;
            Some((output(&cell.graph, activation.work)?, report))
        };
        self.done.iter().filter_map(report).filter(|(_, report)| !report.is_null()).collect()
    }
}

/// Whether a camera saw a motion beyond the uncertainty, between the fringes or from these to the code; `None` where none could tell.
fn moved(reports: &BTreeMap<String, Value>) -> Option<bool> {
    let told = |report: &Value| ["motion", "code_shift"].map(|of| report[of]["moved"].as_bool());
    let told: Vec<bool> = reports.values().flat_map(told).flatten().collect();
    (!told.is_empty()).then(|| told.contains(&true))
}

/// The warnings of all reports and others, each once.
fn warnings(reports: &BTreeMap<String, Value>, others: impl Iterator<Item = String>) -> Vec<String> {
    let all = reports.values().filter_map(|report| report["warnings"].as_array()).flatten();
    let mut texts: Vec<String> =
        all.filter_map(|text| Some(text.as_str()?.to_owned())).chain(others).collect();
    texts.sort_unstable();
    texts.dedup();
    texts
}

/// What is read of the fusion's report.
#[derive(Deserialize)]
struct Fused {
    points: u32,
    overlaps: Vec<Overlap>,
    disagreeing: u32,
}

/// The share of one activation in the result of its stage.
fn stage_result(event: &Event) -> StageResult {
    StageResult {
        name: String::new(),
        wait_ns: event.wait_ns,
        compute_ns: event.end_ns.saturating_sub(event.start_ns).saturating_sub(event.send_ns),
        send_ns: event.send_ns,
        activations: 1,
        bytes: event.bytes,
        messages: event.messages.into(),
        cpu_ns: event.cpu_ns,
        minor_faults: event.minor_faults.into(),
        major_faults: event.major_faults.into(),
        voluntary_switches: event.voluntary_switches.into(),
        involuntary_switches: event.involuntary_switches.into(),
        allocations: cfg!(feature = "count-allocations").then_some(event.allocations.into()),
    }
}
