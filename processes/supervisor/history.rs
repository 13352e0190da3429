//! Times of the last cycles and their activations, for traces and reports.

use super::collect::Span;
use files::result::CycleResult;
use files::trace::TraceCycle;
use std::collections::VecDeque;

/// Longest history of activations: a run until stopped must not grow.
const KEPT_SPANS: usize = 100_000;

/// Longest history of cycles.
const KEPT_CYCLES: usize = 1_000;

/// The trace entry of a cycle that ended now.
pub(super) fn ended(result: &CycleResult, end_ns: u64, duration_ns: u64) -> TraceCycle {
    TraceCycle {
        cycle: result.cycle,
        outcome: result.outcome.clone(),
        part: result.part.clone(),
        recipe: result.recipe.clone(),
        start_ns: end_ns.saturating_sub(duration_ns),
        end_ns,
    }
}

/// Times of the last cycles and their activations.
#[derive(Debug, Default)]
pub struct History {
    /// Activations, in the order of the outcomes.
    pub spans: VecDeque<Span>,
    /// Cycles, in the order of the outcomes.
    pub cycles: VecDeque<TraceCycle>,
}

impl History {
    /// Adds a cycle with its activations.
    pub(super) fn add(&mut self, cycle: TraceCycle, spans: impl Iterator<Item = Span>) {
        self.spans.extend(spans);
        self.spans.drain(..self.spans.len().saturating_sub(KEPT_SPANS));
        self.cycles.push_back(cycle);
        self.cycles.drain(..self.cycles.len().saturating_sub(KEPT_CYCLES));
    }
}
