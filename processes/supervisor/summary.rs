//! The counts of a run, and what is left at its end.

use super::history::History;
use super::ports::Ports;
use super::protocol::LastPart;
use super::snapshot::Snapshot;
use files::result::CycleResult;
use metrology::verdict::Verdict;

/// Counts of a run.
#[derive(Debug, Default)]
pub struct Tally {
    /// Cycles with an outcome.
    pub done: u64,
    /// Cycles that are ok.
    pub ok: u64,
    /// Cycles that are ok and have a plan, but whose verdict is not pass.
    pub not_pass: u64,
    /// Requested cycles that were never started.
    pub not_run: u64,
    /// Whether an operator stopped the run.
    pub stopped: bool,
    /// Whether the run is to begin anew: the host that leads was started again.
    pub renew: bool,
    /// Why the cell gave up, if it did.
    pub gave_up: Option<String>,
    /// The last cycle that is not ok, and the reason.
    pub(super) last_failure: Option<(u64, String)>,
    /// What the last cycle found.
    pub(super) last: Option<LastPart>,
}

impl Tally {
    /// Counts a cycle; `has_plan`: its verdict is to be pass.
    pub(super) fn count(
        &mut self,
        cycle: u64,
        outcome: &Result<(), String>,
        result: &CycleResult,
        has_plan: bool,
    ) {
        self.done += 1;
        self.ok += u64::from(outcome.is_ok());
        if let Err(reason) = outcome {
            self.last_failure = Some((cycle, reason.clone()));
        }
        let pass = result.verdict == Some(Verdict::Pass);
        self.not_pass += u64::from(outcome.is_ok() && has_plan && !pass);
        self.last = Some(LastPart::of(result));
    }
}

/// The end of a run: counts, and the data for its files.
pub struct Summary {
    /// Counts of the run.
    pub tally: Tally,
    /// Times of the last cycles and their activations.
    pub history: History,
    /// Images, phase maps and cloud of the last cycle.
    pub snapshot: Option<Snapshot>,
    /// Why results are missing in the output folder.
    pub unwritten: Option<anyhow::Error>,
    /// Why cycles are missing in the cycle record, or in the recordings.
    pub unrecorded: Option<anyhow::Error>,
    // Dropped last, in this order: the ports above before the node, the node before the folder.
    pub(super) _ports: Ports,
}
