//! Statistics of a cell: counts since the start, and percentiles of the last cycles. Pure, with constant memory.

use anyhow::Result;
use files::result::{CycleResult, OUTCOME_OK, StageResult};
use hdrhistogram::Histogram;
use metrology::verdict::Verdict;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Percentiles cover at least this many and at most twice as many of the last cycles: enough for the 99th percentile, few
/// enough to follow a change within minutes.
const WINDOW_CYCLES: u64 = 256;

/// The rate covers this many of the last cycles.
const RATE_CYCLES: usize = 32;

/// Upper bounds of the histogram buckets, ns: 0.1 ms to 20 s, three per decade.
pub const BOUNDS_NS: [u64; 17] = [
    100_000,
    200_000,
    500_000,
    1_000_000,
    2_000_000,
    5_000_000,
    10_000_000,
    20_000_000,
    50_000_000,
    100_000_000,
    200_000_000,
    500_000_000,
    1_000_000_000,
    2_000_000_000,
    5_000_000_000,
    10_000_000_000,
    20_000_000_000,
];

/// Percentiles of the last cycles, by nearest rank, each at most 1 % too large; the maximum is exact.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Number of cycles covered.
    pub cycles: u64,
    /// Median of the durations, ms.
    pub p50_ms: f64,
    /// 95th percentile of the durations, ms.
    pub p95_ms: f64,
    /// 99th percentile of the durations, ms.
    pub p99_ms: f64,
    /// Largest of the durations, ms.
    pub max_ms: f64,
}

/// Histogram of durations since the start, and a window of the last ones.
#[derive(Debug, Clone)]
pub struct Timing {
    /// Number of durations up to each of [`BOUNDS_NS`]; the last bucket counts all longer ones.
    pub buckets: [u64; BOUNDS_NS.len() + 1],
    /// Sum of all durations, ns.
    pub sum_ns: u64,
    window: Window,
}

impl Timing {
    fn new() -> Result<Self> {
        Ok(Self { buckets: [0; BOUNDS_NS.len() + 1], sum_ns: 0, window: Window::new()? })
    }

    fn record(&mut self, ns: u64) {
        self.buckets[BOUNDS_NS.partition_point(|&bound| bound < ns)] += 1;
        self.sum_ns = self.sum_ns.saturating_add(ns);
        self.window.record(ns);
    }

    /// Number of durations since the start.
    pub fn count(&self) -> u64 {
        self.buckets.iter().sum()
    }

    /// Percentiles of the last cycles.
    pub fn percentiles(&self) -> Percentiles {
        self.window.percentiles()
    }
}

/// Two histograms; the older one covers one to two windows. Both are allocated once.
#[derive(Debug, Clone)]
struct Window {
    older: (Histogram<u64>, u64),
    younger: (Histogram<u64>, u64),
}

impl Window {
    fn new() -> Result<Self> {
        // 1 µs … 1 h to two digits: 40 kB.
        let histogram = Histogram::new_with_bounds(1000, 3_600_000_000_000, 2)?;
        Ok(Self { older: (histogram.clone(), 0), younger: (histogram, 0) })
    }

    fn record(&mut self, ns: u64) {
        if self.younger.0.len() == WINDOW_CYCLES {
            std::mem::swap(&mut self.older, &mut self.younger);
            self.younger.0.reset();
            self.younger.1 = 0;
        }
        for (histogram, max_ns) in [&mut self.older, &mut self.younger] {
            histogram.saturating_record(ns);
            *max_ns = ns.max(*max_ns);
        }
    }

    fn percentiles(&self) -> Percentiles {
        let (histogram, max_ns) = &self.older;
        let at = |quantile: f64| histogram.value_at_quantile(quantile).min(*max_ns) as f64 / 1e6;
        let (p50_ms, p95_ms, p99_ms) = (at(0.50), at(0.95), at(0.99));
        Percentiles { cycles: histogram.len(), p50_ms, p95_ms, p99_ms, max_ms: *max_ns as f64 / 1e6 }
    }
}

/// Statistics of one stage.
#[derive(Debug, Clone)]
pub struct StageProfile {
    /// Waiting for input, per cycle.
    pub wait: Timing,
    /// Computing time, one duration per cycle.
    pub compute: Timing,
    /// Sending outputs, per cycle.
    pub send: Timing,
    /// Number of cycles, including those that are not ok.
    pub cycles: u64,
    /// Sums over all cycles.
    pub sum: StageResult,
}

/// Number of cycles by outcome.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Outcomes {
    /// Ok, all features pass.
    pub pass: u64,
    /// Ok, but a limit is within the uncertainty of a feature.
    pub indeterminate: u64,
    /// Ok, but a feature is out of tolerance.
    pub fail: u64,
    /// Ok, without a verdict.
    pub no_verdict: u64,
    /// Cycles that are not ok.
    pub not_ok: u64,
}

/// Statistics of a cell.
#[derive(Debug, Clone)]
pub struct Profile {
    /// Statistics of the stages, in the order of the schedule.
    pub stages: Vec<StageProfile>,
    /// Durations from start to outcome of cycles that are ok.
    pub cycle: Timing,
    /// Durations from the last frame to the verdict.
    pub latency: Timing,
    /// Number of cycles by outcome.
    pub outcomes: Outcomes,
    /// Number of cycles that exceeded their deadline.
    pub deadline_misses: u64,
    deadline_ns: u64,
    /// Cycles in progress with their start times, ns.
    running: Vec<(u64, u64)>,
    ends_ns: VecDeque<u64>,
}

impl Profile {
    /// Empty statistics. `deadline_ns`: deadline of a cycle.
    pub fn new(stages: &[String], deadline_ns: u64) -> Result<Self> {
        let stage = |name: &String| {
            let sum = StageResult { name: name.clone(), ..StageResult::default() };
            Ok(StageProfile {
                wait: Timing::new()?,
                compute: Timing::new()?,
                send: Timing::new()?,
                cycles: 0,
                sum,
            })
        };
        Ok(Self {
            stages: stages.iter().map(stage).collect::<Result<_>>()?,
            cycle: Timing::new()?,
            latency: Timing::new()?,
            outcomes: Outcomes::default(),
            deadline_misses: 0,
            deadline_ns,
            running: Vec::new(),
            ends_ns: VecDeque::with_capacity(RATE_CYCLES),
        })
    }

    /// Notes the start of a cycle.
    pub fn begin(&mut self, cycle: u64, now_ns: u64) {
        self.running.push((cycle, now_ns));
    }

    /// Ends a cycle; returns its duration, ns. A cycle that was never started counts as an outcome without a duration.
    pub fn end(&mut self, result: &CycleResult, now_ns: u64) -> Option<u64> {
        let ok = result.outcome == OUTCOME_OK;
        let place = match result.verdict {
            _ if !ok => &mut self.outcomes.not_ok,
            Some(Verdict::Pass) => &mut self.outcomes.pass,
            Some(Verdict::Indeterminate) => &mut self.outcomes.indeterminate,
            Some(Verdict::Fail) => &mut self.outcomes.fail,
            None => &mut self.outcomes.no_verdict,
        };
        *place += 1;
        let place = self.running.iter().position(|(cycle, _)| *cycle == result.cycle)?;
        let (_, start_ns) = self.running.remove(place);
        let lasted_ns = now_ns.saturating_sub(start_ns);
        self.deadline_misses += u64::from(lasted_ns > self.deadline_ns);
        if self.ends_ns.len() == RATE_CYCLES {
            self.ends_ns.pop_front();
        }
        self.ends_ns.push_back(now_ns);
        for (profile, stage) in self.stages.iter_mut().zip(&result.stages) {
            profile.add(stage, ok);
        }
        // The durations of an incomplete cycle mean nothing.
        if ok {
            self.cycle.record(lasted_ns);
            if let Some(latency_ns) = result.latency_ns {
                self.latency.record(latency_ns);
            }
        }
        Some(lasted_ns)
    }

    /// Rate of the last cycles, cycles per minute; absent before the second one.
    pub fn cycles_per_minute(&self) -> Option<f64> {
        let span_ns = self.ends_ns.back()?.checked_sub(*self.ends_ns.front()?)?;
        (span_ns > 0).then(|| 60e9 * (self.ends_ns.len() - 1) as f64 / span_ns as f64)
    }
}

impl StageProfile {
    fn add(&mut self, stage: &StageResult, ok: bool) {
        if ok {
            self.wait.record(stage.wait_ns);
            self.compute.record(stage.compute_ns);
            self.send.record(stage.send_ns);
        }
        self.cycles += 1;
        add(&mut self.sum, stage);
    }
}

/// Adds a stage result to a sum.
pub fn add(sum: &mut StageResult, more: &StageResult) {
    sum.wait_ns += more.wait_ns;
    sum.compute_ns += more.compute_ns;
    sum.send_ns += more.send_ns;
    sum.activations += more.activations;
    sum.bytes += more.bytes;
    sum.messages += more.messages;
    sum.cpu_ns += more.cpu_ns;
    sum.minor_faults += more.minor_faults;
    sum.major_faults += more.major_faults;
    sum.voluntary_switches += more.voluntary_switches;
    sum.involuntary_switches += more.involuntary_switches;
    if let Some(allocations) = more.allocations {
        *sum.allocations.get_or_insert(0) += allocations;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn result(cycle: u64, outcome: &str, verdict: Option<Verdict>) -> CycleResult {
        let stage =
            StageResult { name: "fusion".into(), wait_ns: 3_000_000, bytes: 7, ..StageResult::default() };
        CycleResult {
            cycle,
            outcome: outcome.into(),
            verdict,
            stages: vec![stage],
            latency_ns: Some(2_000_000),
            ..CycleResult::default()
        }
    }

    #[test]
    fn cycles_are_counted_by_outcome_and_only_ok_ones_are_timed() {
        let mut profile = Profile::new(&["fusion".into()], 10_000_000).unwrap();
        for (cycle, outcome, verdict) in [
            (0, "ok", Some(Verdict::Pass)),
            (1, "ok", Some(Verdict::Fail)),
            (2, "stage fusion died (signal 9)", None),
            (3, "ok", None),
            (4, "ok", Some(Verdict::Indeterminate)),
        ] {
            profile.begin(cycle, cycle * 1_000_000_000);
            // The one that is not ok is also the one that takes too long.
            let lasted_ns = if outcome == "ok" { 4_000_000 } else { 10_000_001 };
            profile.end(&result(cycle, outcome, verdict), cycle * 1_000_000_000 + lasted_ns);
        }
        profile.end(&result(5, "not started: stopped", None), 9_000_000_000);
        let counted = Outcomes { pass: 1, indeterminate: 1, fail: 1, no_verdict: 1, not_ok: 2 };
        assert_eq!((profile.outcomes, profile.deadline_misses), (counted, 1));
        assert_eq!((profile.cycle.count(), profile.latency.count()), (4, 4));
        assert_eq!(profile.cycle.percentiles().max_ms, 4.0);
        assert_eq!((profile.stages[0].wait.count(), profile.stages[0].sum.bytes), (4, 35));
        assert_eq!(profile.cycles_per_minute().map(f64::round), Some(60.0));
    }

    #[test]
    fn old_cycles_leave_the_window_and_stay_in_the_buckets() {
        let mut timing = Timing::new().unwrap();
        timing.record(9_000_000_000);
        for _ in 0..2 * WINDOW_CYCLES {
            timing.record(1_000_000);
        }
        assert_eq!(timing.percentiles().max_ms, 1.0);
        assert_eq!(timing.count(), 2 * WINDOW_CYCLES + 1);
        assert_eq!(timing.sum_ns, 9_000_000_000 + 2 * WINDOW_CYCLES * 1_000_000);
    }

    proptest! {
        /// Proves: percentiles are those of sorting, up to 1 %, and every duration lies in the bucket of its bounds.
        #[test]
        fn percentiles_agree_with_sorting(durations in proptest::collection::vec(1000_u64..50_000_000_000, 1..200)) {
            let mut timing = Timing::new().unwrap();
            for &ns in &durations {
                timing.record(ns);
            }
            let mut sorted = durations.clone();
            sorted.sort_unstable();
            let shown = timing.percentiles();
            for (quantile, shown_ms) in [(0.5, shown.p50_ms), (0.95, shown.p95_ms), (0.99, shown.p99_ms)] {
                let rank = (quantile * sorted.len() as f64).ceil() as usize;
                let exact_ms = sorted[rank - 1] as f64 / 1e6;
                prop_assert!(shown_ms >= exact_ms && shown_ms <= 1.01 * exact_ms, "{shown_ms} {exact_ms}");
            }
            prop_assert_eq!(shown.max_ms, sorted[sorted.len() - 1] as f64 / 1e6);
            let mut below = 0;
            for (bound, count) in BOUNDS_NS.iter().zip(timing.buckets) {
                below += count;
                prop_assert_eq!(below as usize, durations.iter().filter(|ns| *ns <= bound).count());
            }
        }
    }
}
