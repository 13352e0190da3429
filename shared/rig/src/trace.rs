//! Chrome traces: what each process did when, for Perfetto (`ui.perfetto.dev`) or `chrome://tracing`.
//!
//! The JSON array format of the Trace Event specification: complete events (`ph` = `X`) with times in µs, one process
//! per stage, one thread for its work and one for its waiting, so that the two do not overlap.

use crate::atomic;
use crate::error::FileError;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// One piece of work.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TraceSpan {
    /// Number of the stage in [`write_trace`]'s list.
    pub stage: usize,
    /// What was done.
    pub name: String,
    /// In which cycle.
    pub cycle: u64,
    /// Waiting before the start, ns.
    pub wait_ns: u64,
    /// Start on any clock, the same for all spans, ns.
    pub start_ns: u64,
    /// End, ns.
    pub end_ns: u64,
}

/// Thread of the work.
const WORK: u32 = 1;
/// Thread of the waiting.
const WAIT: u32 = 2;

/// Writes a trace; the file is complete or absent. Times count from the first span.
///
/// # Errors
/// A place that cannot be written.
pub fn write_trace(path: &Path, stages: &[&str], spans: &[TraceSpan]) -> Result<(), FileError> {
    atomic::write_with(path, |out| {
        out.write_all(b"{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n")?;
        let mut separator: &[u8] = b"";
        for event in events(stages, spans) {
            out.write_all(separator)?;
            serde_json::to_writer(&mut *out, &event)?;
            separator = b",\n";
        }
        out.write_all(b"\n]}\n")
    })
}

fn events(stages: &[&str], spans: &[TraceSpan]) -> impl Iterator<Item = Value> {
    let zero_ns = spans.iter().map(|s| s.start_ns.saturating_sub(s.wait_ns)).min().unwrap_or(0);
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
                "args": {"cycle": span.cycle},
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
        };
        write_trace(
            &path,
            &["capture/cam1", "decode/cam1"],
            &[span(0, 0, 9000, 9500), span(1, 500, 9500, 12_000)],
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

    #[test]
    fn no_spans_make_an_empty_trace() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace.json");
        write_trace(&path, &[], &[]).unwrap();
        let value: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        assert_eq!(value["traceEvents"], json!([]));
    }
}
