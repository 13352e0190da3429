//! Which share of a cycle handing over takes, from the trace of a run.
//!
//! From the verdict back to the first pattern there is one chain of work in which each piece began when the last thing
//! that it needed was done: an input, or the work before it in its lane. Between the two lies the hand-over: report, notification,
//! waking up, taking. With it counts the time that the chain's own work spent on sending, and the ways from the
//! supervisor and back to it. The rest of the chain is work. What a stage did apart from the schedule before it waited
//! (the twin moves its part) is neither.

use anyhow::{Context, Result, ensure};
use cell::Cell;
use cell::schedule::{Order, Work, label};
use files::result::OUTCOME_OK;
use files::trace::{Trace, TraceCycle, TraceSpan};
use serde::Serialize;
use std::collections::BTreeMap;

/// What handing over takes of the cycles of a trace.
#[derive(Debug, Serialize)]
pub struct Share {
    /// Cycles that were ok.
    pub cycles: usize,
    /// Hand-overs from the start of a cycle to its outcome, of the median cycle.
    pub hops: usize,
    /// Length of the chain, of the median cycle, ms.
    pub chain_ms: f64,
    /// Handing over, of the median cycle, ms.
    pub handing_over_ms: f64,
    /// Of it sending, ms.
    pub sending_ms: f64,
    /// Handing over over the chain: that of the median cycle.
    pub fraction: f64,
    /// The largest of all cycles.
    pub largest_fraction: f64,
    /// Where: from what to what, all cycles together.
    pub between: Vec<Between>,
}

/// Hand-overs of one kind.
#[derive(Debug, Serialize)]
pub struct Between {
    /// What was done before.
    pub from: String,
    /// The work that began.
    pub to: String,
    /// How often in all cycles.
    pub count: usize,
    /// Median of the gaps, µs.
    pub median_us: f64,
    /// Sum of the gaps, ms.
    pub sum_ms: f64,
}

/// Work and gaps of one cycle.
#[derive(Debug, Clone, Default, PartialEq)]
struct Chain {
    work_ns: u64,
    sending_ns: u64,
    /// From what to what, and how long.
    gaps: Vec<(&'static str, &'static str, u64)>,
}

impl Chain {
    fn handing_over_ns(&self) -> u64 {
        self.sending_ns + self.gaps.iter().map(|gap| gap.2).sum::<u64>()
    }

    fn length_ns(&self) -> u64 {
        self.work_ns + self.handing_over_ns()
    }

    fn fraction(&self) -> f64 {
        self.handing_over_ns() as f64 / self.length_ns().max(1) as f64
    }
}

/// Evaluates a trace of a cell.
///
/// # Errors
/// A trace of another cell, or one without a cycle that was ok.
pub fn share(cell: &Cell, trace: &Trace) -> Result<Share> {
    let done = Done::new(cell, trace)?;
    let ok = trace.cycles.iter().filter(|cycle| cycle.outcome == OUTCOME_OK);
    let mut chains = ok.filter_map(|cycle| done.chain(cycle)).collect::<Vec<_>>();
    ensure!(!chains.is_empty(), "the trace holds no whole cycle that was ok");
    chains.sort_by(|a, b| a.fraction().total_cmp(&b.fraction()));
    let (median, last) = (&chains[chains.len() / 2], &chains[chains.len() - 1]);
    let ms = |ns: u64| ns as f64 / 1e6;
    Ok(Share {
        cycles: chains.len(),
        hops: median.gaps.len(),
        chain_ms: ms(median.length_ns()),
        handing_over_ms: ms(median.handing_over_ns()),
        sending_ms: ms(median.sending_ns),
        fraction: median.fraction(),
        largest_fraction: last.fraction(),
        between: between(&chains),
    })
}

fn between(chains: &[Chain]) -> Vec<Between> {
    let mut kinds: BTreeMap<(&str, &str), Vec<u64>> = BTreeMap::new();
    for (from, to, ns) in chains.iter().flat_map(|chain| &chain.gaps) {
        kinds.entry((from, to)).or_default().push(*ns);
    }
    let mut all: Vec<Between> = kinds
        .into_iter()
        .map(|((from, to), mut gaps)| {
            gaps.sort_unstable();
            Between {
                from: from.to_owned(),
                to: to.to_owned(),
                count: gaps.len(),
                median_us: gaps[gaps.len() / 2] as f64 / 1e3,
                sum_ms: gaps.iter().sum::<u64>() as f64 / 1e6,
            }
        })
        .collect();
    all.sort_by(|a, b| b.sum_ms.total_cmp(&a.sum_ms));
    all
}

/// An activation of a cycle.
type Place = (u64, usize);

/// All that was done, by cycle and activation, and by lane.
struct Done<'a> {
    cell: &'a Cell,
    spans: BTreeMap<Place, &'a TraceSpan>,
    order: Order,
    /// Of each lane, in the order of the ends.
    lanes: Vec<Vec<(u64, Place)>>,
}

impl<'a> Done<'a> {
    fn new(cell: &'a Cell, trace: &'a Trace) -> Result<Self> {
        let schedule = &cell.schedule;
        let named = schedule.activations.iter().enumerate().map(|(number, activation)| {
            let stage = schedule.stages[activation.stage].name.as_str();
            ((stage, label(&cell.graph, activation.work)), number)
        });
        let numbers: BTreeMap<(&str, String), usize> = named.collect();
        let order = Order::new(schedule);
        let lanes = vec![Vec::new(); order.lanes.len()];
        let mut done = Self { cell, spans: BTreeMap::new(), order, lanes };
        for span in &trace.spans {
            let stage = trace.stages.get(span.stage).map_or("", String::as_str);
            // What writes a recording runs beside the measurement.
            if stage == "record" {
                continue;
            }
            let number = numbers.get(&(stage, span.name.clone())).with_context(|| {
                format!(
                    "the trace has \"{}\" of stage \"{stage}\", which the configuration does not plan; is it that of the run?",
                    span.name
                )
            })?;
            done.lanes[done.order.lane[*number]].push((span.end_ns, (span.cycle, *number)));
            done.spans.insert((span.cycle, *number), span);
        }
        done.lanes.iter_mut().for_each(|lane| lane.sort_unstable());
        Ok(done)
    }

    /// The chain of a cycle; `None` if the trace holds only a part of it.
    fn chain(&self, cycle: &TraceCycle) -> Option<Chain> {
        let mut activations = 0..self.cell.schedule.activations.len();
        if activations.any(|number| !self.spans.contains_key(&(cycle.cycle, number))) {
            return None;
        }
        let mut at = (cycle.cycle, self.cell.schedule.find(Work::Inspect)?);
        let inspected = self.spans.get(&at)?;
        let mut chain = Chain::default();
        chain.gaps.push(("inspect", "outcome", cycle.end_ns.saturating_sub(inspected.end_ns)));
        loop {
            let span = self.spans.get(&at)?;
            let sending_ns = span.send_ns.min(span.end_ns.saturating_sub(span.start_ns));
            chain.sending_ns += sending_ns;
            chain.work_ns += span.end_ns.saturating_sub(span.start_ns) - sending_ns;
            let before = self.before(at, span.start_ns).filter(|(end_ns, _)| *end_ns > cycle.start_ns);
            let (ready_ns, from) = match before {
                Some((end_ns, place)) => (end_ns, self.kind(place.1)),
                None => (cycle.start_ns, "start"),
            };
            // A stage that was not waiting was at something else.
            let gap_ns = span.start_ns.saturating_sub(ready_ns).min(span.wait_ns);
            chain.gaps.push((from, self.kind(at.1), if self.keeps_a_pace(at.1) { 0 } else { gap_ns }));
            match before {
                Some((_, place)) => at = place,
                None => return Some(chain),
            }
        }
    }

    /// What an activation had to wait for last: an input, or what its lane did before it, be it of another cycle.
    fn before(&self, (cycle, number): Place, start_ns: u64) -> Option<(u64, Place)> {
        let activation = &self.cell.schedule.activations[number];
        let lane = &self.lanes[self.order.lane[number]];
        let in_lane = lane[..lane.partition_point(|(end_ns, _)| *end_ns <= start_ns)].last().copied();
        let places = activation.inputs.iter().map(|&input| (cycle, input));
        let inputs = places.filter_map(|place| Some((self.spans.get(&place)?.end_ns, place)));
        inputs.max().max(in_lane)
    }

    /// Patterns at a given rate wait for their time, not for another stage.
    fn keeps_a_pace(&self, number: usize) -> bool {
        matches!(self.cell.schedule.activations[number].work, Work::Project { .. })
            && self.cell.graph.rate_hz.is_some_and(|rate_hz| rate_hz > 0.0)
    }

    fn kind(&self, number: usize) -> &'static str {
        match self.cell.schedule.activations[number].work {
            Work::Project { .. } => "project",
            Work::Expose { .. } => "expose",
            Work::Accumulate { .. } => "accumulate",
            Work::Phase { .. } => "phase",
            Work::Match { .. } => "match",
            Work::Take { .. } => "take",
            Work::Fuse => "fuse",
            Work::Inspect => "inspect",
            Work::Store => "store",
            Work::Remote { .. } | Work::Receive { .. } | Work::HandOver | Work::Deliver => "other hosts",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cell::Options;
    use devices::load;

    /// A run in which every piece of work takes 1000 ns, of which 100 are sending, and every hand-over 50.
    fn trace(cell: &Cell, cycles: u64) -> Trace {
        let schedule = &cell.schedule;
        let order = Order::new(schedule);
        let (mut spans, mut rows): (Vec<TraceSpan>, Vec<TraceCycle>) = (Vec::new(), Vec::new());
        let mut now_ns = 10_000;
        for cycle in 0..cycles {
            let start_ns = now_ns;
            let mut lane_ns = vec![start_ns; order.lanes.len()];
            let mut end_ns = vec![0; schedule.activations.len()];
            for (number, activation) in schedule.activations.iter().enumerate() {
                let lane = order.lane[number];
                let inputs = activation.inputs.iter().map(|&input| end_ns[input]);
                let begin = inputs.fold(lane_ns[lane], u64::max) + 50;
                (end_ns[number], lane_ns[lane]) = (begin + 1000, begin + 1000);
                spans.push(TraceSpan {
                    stage: activation.stage,
                    name: label(&cell.graph, activation.work),
                    cycle,
                    wait_ns: 5000,
                    start_ns: begin,
                    end_ns: begin + 1000,
                    send_ns: 100,
                });
            }
            let last = end_ns[schedule.find(Work::Inspect).unwrap()];
            now_ns = last + 50;
            let outcome = OUTCOME_OK.to_owned();
            rows.push(TraceCycle { cycle, outcome, part: None, recipe: None, start_ns, end_ns: now_ns });
        }
        let stages = schedule.stages.iter().map(|stage| stage.name.clone()).collect();
        Trace { stages, spans, cycles: rows }
    }

    fn demo() -> Cell {
        load("configs/demo.toml".as_ref(), &Options::default()).unwrap().cell
    }

    /// Proves: each piece of the chain counts once, so the chain is as long as the cycle and its share as made.
    #[test]
    fn the_share_of_a_run_that_was_made_up_is_found() {
        let cell = demo();
        let share = share(&cell, &trace(&cell, 3)).unwrap();
        let lasted = trace(&cell, 1).cycles[0].end_ns - 10_000;
        assert_eq!((share.chain_ms * 1e6).round() as u64, lasted);
        // So many pieces, one hand-over before each and one after the last.
        let pieces = (lasted - 50) / 1050;
        assert_eq!((share.cycles, share.hops as u64), (3, pieces + 1));
        let handed = 150 * pieces + 50;
        assert!((share.fraction - handed as f64 / lasted as f64).abs() < 1e-12, "{share:?}");
        assert_eq!(share.fraction, share.largest_fraction);
    }

    /// Proves: what a stage did before it waited is not handing over, and a slow hand-over off the chain costs nothing.
    #[test]
    fn only_waiting_on_the_chain_counts() {
        let cell = demo();
        let even = share(&cell, &trace(&cell, 1)).unwrap();
        let mut moved = trace(&cell, 1);
        // The first exposure comes late, after 50 ns of waiting: the part was being moved.
        let first = moved.spans.iter().position(|s| s.name == "expose proj1 000").unwrap();
        for span in &mut moved.spans {
            if span.start_ns >= moved.cycles[0].start_ns + 1100 {
                span.start_ns += 7_000_000;
                span.end_ns += 7_000_000;
            }
        }
        moved.spans[first].wait_ns = 50;
        moved.cycles[0].end_ns += 7_000_000;
        for span in moved.spans.iter_mut().filter(|s| s.name == "expose proj1 000") {
            span.wait_ns = 50;
        }
        assert_eq!(share(&cell, &moved).unwrap().chain_ms, even.chain_ms);
    }

    #[test]
    fn a_trace_of_another_cell_is_refused() {
        let cell = demo();
        let mut other = trace(&cell, 1);
        other.spans[3].name = "expose proj9 000".into();
        let message = share(&cell, &other).unwrap_err().to_string();
        assert!(
            message.contains("expose proj9 000") && message.contains("is it that of the run?"),
            "{message}"
        );
        let none = Trace { cycles: Vec::new(), ..trace(&cell, 1) };
        assert!(share(&cell, &none).unwrap_err().to_string().contains("no whole cycle"));
    }
}
