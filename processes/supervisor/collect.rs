//! Collects the reports of the stages into the result of a cycle.

use super::profile;
use cell::Cell;
use cell::judgement::Judgement;
use cell::schedule::{Interval, Schedule, Work, output};
use devices::LoadedCell;
use files::result::{CycleResult, OUTCOME_OK, StageResult};
use ipc::header::Event;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use xxhash_rust::xxh3::xxh3_128;

/// Times of one activation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Span {
    /// Cycle, counted from 0.
    pub cycle: u64,
    /// Index of the activation in the schedule.
    pub activation: usize,
    /// Waiting before the start, ns.
    pub wait_ns: u64,
    /// Start, ns.
    pub start_ns: u64,
    /// End, ns.
    pub end_ns: u64,
    /// Sending, part of the time between start and end, ns.
    pub send_ns: u64,
}

/// A result as it arrived.
#[derive(Debug)]
struct Judged {
    judgement: Judgement,
    latency_ns: u64,
    /// Of its text.
    hash: u128,
}

/// The reports of a cycle.
#[derive(Debug, Default)]
pub struct Collector {
    done: BTreeMap<usize, (Event, String)>,
    judgement: Option<Judged>,
}

impl Collector {
    /// Adds the report of an activation.
    pub fn done(&mut self, event: Event, text: String) {
        self.done.insert(event.activation as usize, (event, text));
    }

    /// Adds the result of the inspection, with its text and the time since the last frame, ns.
    pub fn judged(&mut self, judgement: Judgement, text: &str, latency_ns: u64) {
        self.judgement = Some(Judged { judgement, latency_ns, hash: xxh3_128(text.as_bytes()) });
    }

    /// Refuses a result whose hash differs from the one that the inspection reported.
    pub fn check_result(&self, schedule: &Schedule) -> Result<(), String> {
        let reported = schedule.find(Work::Inspect).and_then(|number| self.done.get(&number));
        let reported = reported.map(|(event, _)| [event.hash_high, event.hash_low]);
        let came = self.judgement.as_ref().map(|j| [(j.hash >> 64) as u64, j.hash as u64]);
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

    /// The result of the cycle with its outcome.
    pub fn result(&self, cell: &LoadedCell, cycle: u64, outcome: &Result<(), String>) -> CycleResult {
        let ok = outcome.is_ok();
        let judged = self.judgement.as_ref().filter(|_| ok);
        CycleResult {
            cycle,
            outcome: outcome.as_ref().err().map_or_else(|| OUTCOME_OK.to_owned(), Clone::clone),
            verdict: judged.and_then(|j| j.judgement.verdict),
            features: judged.map(|j| j.judgement.features.clone()).unwrap_or_default(),
            stages: self.stages(&cell.schedule),
            latency_ns: judged.map(|j| j.latency_ns),
            hashes: self.hashes(cell),
            more: self.more(cell, ok),
        }
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
                format!("{:032x}", xxh3_128(&bytes))
            }
        };
        parts.iter().map(|(key, hashes)| (key.clone(), join(hashes))).collect()
    }

    fn more(&self, cell: &LoadedCell, ok: bool) -> BTreeMap<String, Value> {
        let mut more = BTreeMap::from([
            ("cell".to_owned(), json!(cell.name)),
            ("version".to_owned(), json!(env!("CARGO_PKG_VERSION"))),
            ("config_sha256".to_owned(), json!(cell.file.sha256)),
            ("rig_sha256".to_owned(), json!(cell.file.rig_sha256)),
        ]);
        let mut reports = BTreeMap::new();
        for (activation, (event, text)) in &self.done {
            let Some(activation) = cell.schedule.activations.get(*activation) else { continue };
            let report: Value = serde_json::from_str(text).unwrap_or(Value::Null);
            if activation.work == Work::Fuse && ok {
                more.insert("points".into(), json!(event.count));
                more.insert("overlaps".into(), report.get("overlaps").cloned().unwrap_or(Value::Null));
            }
            if let (Some(key), false) = (output(&cell.graph, activation.work), report.is_null()) {
                reports.insert(key, report);
            }
        }
        more.insert("reports".into(), json!(reports));
        if let Some(reason) = self.judgement.as_ref().and_then(|j| j.judgement.alignment_failure.as_ref()) {
            more.insert("alignment_failure".into(), json!(reason));
        }
        more
    }
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
