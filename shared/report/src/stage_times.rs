//! The times of the stages, gathered from the cycles.

use files::result::CycleResult;

/// All times of one stage, a value for each cycle.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct StageTimes {
    /// Name of the stage.
    pub name: String,
    /// Time waiting for input of each cycle, ns.
    pub wait_ns: Vec<u64>,
    /// Time computing of each cycle, ns.
    pub compute_ns: Vec<u64>,
}

/// The times of each stage over all cycles, stages in order of their first appearance.
pub(crate) fn stage_times(cycles: &[CycleResult]) -> Vec<StageTimes> {
    let mut all: Vec<StageTimes> = Vec::new();
    for stage in cycles.iter().flat_map(|c| &c.stages) {
        let place = all.iter().position(|s| s.name == stage.name).unwrap_or_else(|| {
            all.push(StageTimes { name: stage.name.clone(), ..StageTimes::default() });
            all.len() - 1
        });
        all[place].wait_ns.push(stage.wait_ns);
        all[place].compute_ns.push(stage.compute_ns);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use files::result::StageResult;

    fn cycle(number: u64, stages: &[(&str, u64)]) -> CycleResult {
        let stage = |(name, compute_ns): &(&str, u64)| StageResult {
            name: (*name).to_owned(),
            wait_ns: 1,
            compute_ns: *compute_ns,
            ..StageResult::default()
        };
        CycleResult { cycle: number, stages: stages.iter().map(stage).collect(), ..CycleResult::default() }
    }

    #[test]
    fn a_cycle_that_lost_a_stage_does_not_shift_the_others() {
        let cycles = [cycle(0, &[("decode", 10), ("fusion", 20)]), cycle(1, &[("fusion", 21)])];
        let times = stage_times(&cycles);
        assert_eq!(times[0].compute_ns, [10]);
        assert_eq!((times[1].name.as_str(), &times[1].compute_ns[..]), ("fusion", &[20, 21][..]));
    }
}
