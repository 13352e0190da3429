//! The order in which each lane works, and whether a trace kept it.

use super::{Lane, Schedule, Stage};
use std::collections::BTreeSet;

/// Where each activation stands in its lane.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Order {
    /// All lanes of the schedule.
    pub lanes: Vec<Lane>,
    /// Lane of each activation.
    pub lane: Vec<usize>,
    /// How many activations its lane does before it in a cycle.
    pub place: Vec<usize>,
    /// The one before it in its lane.
    pub before: Vec<Option<usize>>,
    /// The other stages that may begin when it is done: of the next one in its lane, and of those that take what it gives.
    pub wakes: Vec<Vec<usize>>,
}

/// Start and end of an activation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Interval {
    /// Number in the schedule.
    pub activation: usize,
    /// Start on the machine's monotonic clock, ns.
    pub start_ns: u64,
    /// End on the machine's monotonic clock, ns.
    pub end_ns: u64,
}

impl Order {
    /// The order of a schedule.
    pub fn new(schedule: &Schedule) -> Self {
        let count = schedule.activations.len();
        let lanes = schedule.lanes();
        let of = |stage: &Stage| lanes.iter().position(|lane| lane.has(stage)).unwrap_or_default();
        let lane: Vec<usize> = schedule.activations.iter().map(|a| of(&schedule.stages[a.stage])).collect();
        let (mut place, mut before) = (vec![0; count], vec![None; count]);
        let mut last = vec![None; lanes.len()];
        let mut wakes = vec![BTreeSet::new(); count];
        for number in 0..count {
            before[number] = last[lane[number]].replace(number);
            if let Some(earlier) = before[number] {
                place[number] = place[earlier] + 1;
            }
            let activation = &schedule.activations[number];
            for &earlier in activation.inputs.iter().chain(&before[number]) {
                if schedule.activations[earlier].stage != activation.stage {
                    wakes[earlier].insert(activation.stage);
                }
            }
        }
        let wakes = wakes.into_iter().map(|stages| stages.into_iter().collect()).collect();
        Self { lanes, lane, place, before, wakes }
    }
}

/// The first two activations of a trace that stand against the schedule: an activation that began before the one before
/// it in its lane or one that it takes from had ended.
pub fn violation(schedule: &Schedule, order: &Order, trace: &[Interval]) -> Option<(usize, usize)> {
    let mut done = vec![None; schedule.activations.len()];
    for interval in trace {
        *done.get_mut(interval.activation)? = Some(interval);
    }
    trace.iter().find_map(|interval| {
        let number = interval.activation;
        let before = order.before[number]
            .filter(|&before| done[before].is_none_or(|before| before.end_ns > interval.start_ns));
        let input = schedule.activations[number]
            .inputs
            .iter()
            .copied()
            .find(|&input| done[input].is_none_or(|input| input.end_ns > interval.start_ns));
        before.or(input).map(|earlier| (earlier, number))
    })
}
