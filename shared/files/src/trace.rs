//! Chrome traces: what each process did when, for Perfetto (`ui.perfetto.dev`) or `chrome://tracing`.
//!
//! The JSON array format of the Trace Event specification: complete events (`ph` = `X`) with times in µs, one process
//! per stage, one thread for its work and one for its waiting, so that the two do not overlap; above them one process for
//! the cycles, with as many threads as cycles overlap.

use crate::atomic;
use crate::error::FileError;
use crate::result::read_json;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// One piece of work.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TraceSpan {
    /// Number of the stage in [`write_trace`]'s list.
    pub stage: usize,
    /// Label of the activation.
    pub name: String,
    /// Number of the cycle, from 0.
    pub cycle: u64,
    /// Waiting before the start, ns.
    pub wait_ns: u64,
    /// Start on any clock, the same for all spans, ns.
    pub start_ns: u64,
    /// End on the same clock, ns.
    pub end_ns: u64,
    /// Handing over, part of the time between start and end, ns.
    pub send_ns: u64,
}

/// One cycle, from its start to its outcome.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TraceCycle {
    /// Number of the cycle, from 0.
    pub cycle: u64,
    /// `ok` or the reason.
    pub outcome: String,
    /// Part, if there is one.
    pub part: Option<String>,
    /// Recipe, if it is named.
    pub recipe: Option<String>,
    /// Start on the same clock as the spans, ns.
    pub start_ns: u64,
    /// End on the same clock, ns.
    pub end_ns: u64,
}

/// Processes of a trace that is read: no cell has so many, and a number from a file must not make room for itself.
const MAX_PROCESSES: usize = 65_536;

/// Thread of the work.
const WORK: u32 = 1;
/// Thread of the waiting.
const WAIT: u32 = 2;

/// Writes a trace; the file is complete or absent. Times count from the first span or cycle.
///
/// # Errors
/// A place that cannot be written.
pub fn write_trace(
    path: &Path,
    stages: &[&str],
    spans: &[TraceSpan],
    cycles: &[TraceCycle],
) -> Result<(), FileError> {
    atomic::write_with(path, |out| {
        out.write_all(b"{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n")?;
        let mut separator: &[u8] = b"";
        let starts = spans.iter().map(|s| s.start_ns.saturating_sub(s.wait_ns));
        let zero_ns = starts.chain(cycles.iter().map(|c| c.start_ns)).min().unwrap_or(0);
        for event in
            cycle_events(stages.len(), cycles, zero_ns).into_iter().chain(events(stages, spans, zero_ns))
        {
            out.write_all(separator)?;
            serde_json::to_writer(&mut *out, &event)?;
            separator = b",\n";
        }
        out.write_all(b"\n]}\n")
    })
}

/// The cycles: process `pid`, above all others. A cycle goes to the first thread on which the one before it has ended.
fn cycle_events(pid: usize, cycles: &[TraceCycle], zero_ns: u64) -> Vec<Value> {
    let mut sorted: Vec<&TraceCycle> = cycles.iter().collect();
    sorted.sort_by_key(|cycle| (cycle.start_ns, cycle.cycle));
    let mut ends_ns: Vec<u64> = Vec::new();
    let mut events = Vec::new();
    for cycle in sorted {
        let free = ends_ns.iter().position(|&end_ns| end_ns <= cycle.start_ns);
        let thread = free.unwrap_or(ends_ns.len());
        if thread == ends_ns.len() {
            ends_ns.push(0);
        }
        ends_ns[thread] = cycle.end_ns;
        let part = cycle.part.as_ref().map_or_else(String::new, |part| format!(", part {part}"));
        events.push(json!({
            "ph": "X", "pid": pid, "tid": thread + 1, "cat": "cycle",
            "name": format!("cycle {}: {}{part}", cycle.cycle + 1, cycle.outcome),
            "ts": micro(cycle.start_ns.saturating_sub(zero_ns)),
            "dur": micro(cycle.end_ns.saturating_sub(cycle.start_ns)),
            "args": {"cycle": cycle.cycle, "outcome": cycle.outcome, "part": cycle.part, "recipe": cycle.recipe},
        }));
    }
    if !events.is_empty() {
        events.push(
            json!({"ph": "M", "pid": pid, "tid": 0, "name": "process_name", "args": {"name": "cycles"}}),
        );
        events.push(
            json!({"ph": "M", "pid": pid, "tid": 0, "name": "process_sort_index", "args": {"sort_index": -1}}),
        );
    }
    events
}

fn events(stages: &[&str], spans: &[TraceSpan], zero_ns: u64) -> impl Iterator<Item = Value> {
    let names = stages.iter().enumerate().flat_map(|(stage, name)| {
        let meta = move |kind: &str, tid: u32, args: Value| {
            json!({"ph": "M", "pid": stage, "tid": tid, "name": kind, "args": args})
        };
        [
            meta("process_name", 0, json!({"name": name})),
            meta("process_sort_index", 0, json!({"sort_index": stage})),
            meta("thread_name", WORK, json!({"name": "work"})),
            meta("thread_name", WAIT, json!({"name": "wait"})),
        ]
    });
    let work = spans.iter().flat_map(move |span| {
        let event = |name: &str, tid: u32, from_ns: u64, to_ns: u64| {
            json!({
                "ph": "X", "pid": span.stage, "tid": tid, "name": name, "cat": if tid == WORK { "work" } else { "wait" },
                "ts": micro(from_ns.saturating_sub(zero_ns)), "dur": micro(to_ns.saturating_sub(from_ns)),
                "args": {"cycle": span.cycle, "wait_ns": span.wait_ns, "send_ns": span.send_ns},
            })
        };
        let waited = (span.wait_ns > 0)
            .then(|| event("wait", WAIT, span.start_ns.saturating_sub(span.wait_ns), span.start_ns));
        [Some(event(&span.name, WORK, span.start_ns, span.end_ns)), waited]
    });
    names.chain(work.flatten())
}

fn micro(ns: u64) -> f64 {
    ns as f64 / 1e3
}

/// A trace that was read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Trace {
    /// Names of the stages, as their numbers in the spans count them.
    pub stages: Vec<String>,
    /// Times of the activations.
    pub spans: Vec<TraceSpan>,
    /// Start, end and outcome of the cycles.
    pub cycles: Vec<TraceCycle>,
}

/// An event of the file, as far as it is of use here.
#[derive(Deserialize)]
struct RawEvent {
    ph: String,
    pid: usize,
    #[serde(default)]
    cat: String,
    name: String,
    #[serde(default)]
    ts: f64,
    #[serde(default)]
    dur: f64,
    #[serde(default)]
    args: RawArgs,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct RawArgs {
    name: Option<String>,
    cycle: u64,
    wait_ns: u64,
    send_ns: u64,
    outcome: Option<String>,
    part: Option<String>,
    recipe: Option<String>,
}

#[derive(Deserialize)]
struct RawTrace {
    #[serde(rename = "traceEvents")]
    events: Vec<RawEvent>,
}

/// Reads what [`write_trace`] wrote; its times count from the first span or cycle, in whole ns.
///
/// # Errors
/// Absent, or not such a trace; the message names the line.
pub fn read_trace(path: &Path) -> Result<Trace, FileError> {
    let raw: RawTrace = read_json(path)?;
    let mut trace = Trace::default();
    for event in raw.events {
        let ns = |micro: f64| (micro * 1e3).round() as u64;
        let (start_ns, end_ns) = (ns(event.ts), ns(event.ts).saturating_add(ns(event.dur)));
        let RawArgs { name, cycle, wait_ns, send_ns, outcome, part, recipe } = event.args;
        match (event.ph.as_str(), event.cat.as_str()) {
            ("M", _) if event.name == "process_name" && event.pid < MAX_PROCESSES => {
                trace.stages.resize(trace.stages.len().max(event.pid + 1), String::new());
                trace.stages[event.pid] = name.unwrap_or_default();
            }
            ("X", "work") => {
                let (stage, name) = (event.pid, event.name);
                trace.spans.push(TraceSpan { stage, name, cycle, wait_ns, start_ns, end_ns, send_ns });
            }
            ("X", "cycle") => {
                let outcome = outcome.unwrap_or_default();
                trace.cycles.push(TraceCycle { cycle, outcome, part, recipe, start_ns, end_ns });
            }
            _ => {}
        }
    }
    Ok(trace)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trace_is_json_with_times_from_its_first_span() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace.json");
        let span = |stage, wait_ns, start_ns, end_ns| TraceSpan {
            stage,
            name: "push \"1\"".into(),
            cycle: 4,
            wait_ns,
            start_ns,
            end_ns,
            send_ns: 0,
        };
        write_trace(
            &path,
            &["capture/cam1", "decode/cam1"],
            &[span(0, 0, 9000, 9500), span(1, 500, 9500, 12_000)],
            &[],
        )
        .unwrap();
        let value: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        let events = value["traceEvents"].as_array().unwrap();
        let complete: Vec<&Value> = events.iter().filter(|e| e["ph"] == "X").collect();
        assert_eq!(events.len(), 2 * 4 + 3);
        assert_eq!((complete[0]["ts"].as_f64(), complete[0]["dur"].as_f64()), (Some(0.0), Some(0.5)));
        assert_eq!((complete[1]["pid"].as_u64(), complete[1]["ts"].as_f64()), (Some(1), Some(0.5)));
        assert_eq!((&complete[2]["name"], complete[2]["ts"].as_f64()), (&json!("wait"), Some(0.0)));
        assert_eq!(complete[1]["args"]["cycle"], 4);
    }

    /// Proves: cycles have a track of their own, and those that overlap lie on different threads of it.
    #[test]
    fn cycles_lie_side_by_side_where_they_overlap() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace.json");
        let cycle = |cycle, outcome: &str, part: Option<&str>, start_ns, end_ns| TraceCycle {
            cycle,
            outcome: outcome.into(),
            part: part.map(str::to_owned),
            recipe: None,
            start_ns,
            end_ns,
        };
        // The second one overlaps the first, the third begins where the first ends; in the order of their outcomes.
        let cycles = [
            cycle(0, "ok", Some("4711"), 1000, 3000),
            cycle(2, "ok", None, 3000, 4000),
            cycle(1, "stopped", None, 2000, 5000),
        ];
        write_trace(&path, &["fusion"], &[], &cycles).unwrap();
        let value: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        let events = value["traceEvents"].as_array().unwrap();
        let row = |e: &Value| (e["name"].as_str().unwrap().to_owned(), e["tid"].as_u64().unwrap());
        let rows: Vec<_> = events.iter().filter(|e| e["ph"] == "X" && e["pid"] == 1).map(row).collect();
        let expected = [("cycle 1: ok, part 4711", 1), ("cycle 2: stopped", 2), ("cycle 3: ok", 1)];
        assert_eq!(rows, expected.map(|(name, thread)| (name.to_owned(), thread)));
        assert_eq!((&events[0]["ts"], &events[0]["dur"]), (&json!(0.0), &json!(2.0)));
        assert!(events.iter().any(|e| e["pid"] == 1 && e["args"]["name"] == "cycles"), "{events:?}");
    }

    #[test]
    fn what_was_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace.json");
        let name = "expose proj1 003".to_owned();
        let span = TraceSpan {
            stage: 1,
            name,
            cycle: 7,
            wait_ns: 11,
            start_ns: 123_456_789_012,
            end_ns: 123_456_789_999,
            send_ns: 13,
        };
        let cycle = TraceCycle {
            cycle: 7,
            outcome: "ok".into(),
            part: Some("4711".into()),
            recipe: Some("default".into()),
            start_ns: 123_456_789_000,
            end_ns: 123_456_790_001,
        };
        write_trace(&path, &["a", "b"], std::slice::from_ref(&span), std::slice::from_ref(&cycle)).unwrap();
        let zero_ns = 123_456_789_000;
        let read = read_trace(&path).unwrap();
        assert_eq!(read.stages[..2], ["a", "b"]);
        assert_eq!(read.spans, [TraceSpan { start_ns: 12, end_ns: 999, ..span }]);
        assert_eq!(read.cycles, [TraceCycle { start_ns: 0, end_ns: cycle.end_ns - zero_ns, ..cycle }]);
        std::fs::write(&path, "{\"traceEvents\": [{\"ph\": 3}]}").unwrap();
        assert!(read_trace(&path).unwrap_err().to_string().contains("line 1"));
    }

    #[test]
    fn no_spans_make_an_empty_trace() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace.json");
        write_trace(&path, &[], &[], &[]).unwrap();
        let value: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        assert_eq!(value["traceEvents"], json!([]));
    }
}
