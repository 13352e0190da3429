//! Selects the messages of the current cycle of a stage. Pure.
//!
//! Commands and data have separate topics, so a frame of the next cycle may arrive before the command that starts it, and a
//! frame of an ended cycle after the command that ended it. Cycle numbers in messages only increase.

/// Number of cycles that may start and be aborted during one activation of a stage: as many as commands can be queued.
pub const AHEAD: u64 = 16;

/// Whether a message belongs to the current cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Admission {
    /// It belongs to the current cycle.
    Now,
    /// It belongs to a later cycle: keep it.
    Early,
    /// Its cycle has ended: drop it.
    Stale,
    /// No valid sender can be so far ahead.
    Impossible,
}

/// The current cycle of a stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CycleFilter {
    current: Option<u64>,
    /// The last cycle that was started or ended.
    last: u64,
    stale: u32,
}

impl CycleFilter {
    /// Starts a cycle; ends an older one.
    pub fn start(&mut self, cycle: u64) {
        if cycle > self.last {
            self.current = Some(cycle);
            self.last = cycle;
        }
    }

    /// Ends a cycle, whether it was started here or not. Returns whether it was the current one: with several in flight a
    /// later cycle may end first.
    pub fn end(&mut self, cycle: u64) -> bool {
        self.last = self.last.max(cycle);
        self.current.take_if(|current| *current == cycle).is_some()
    }

    /// The current cycle, counted from 0; `None` between cycles.
    pub fn current(&self) -> Option<u64> {
        self.current
    }

    /// Classifies a message by its cycle; counts stale ones.
    pub fn classify(&mut self, cycle: u64) -> Admission {
        if self.current == Some(cycle) {
            Admission::Now
        } else if cycle > self.last.saturating_add(AHEAD) {
            Admission::Impossible
        } else if cycle > self.last {
            Admission::Early
        } else {
            self.stale = self.stale.saturating_add(1);
            Admission::Stale
        }
    }

    /// Number of stale messages so far.
    pub fn stale(&self) -> u32 {
        self.stale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_early_then_current_then_stale() {
        let mut filter = CycleFilter::default();
        assert_eq!(filter.classify(1), Admission::Early);
        filter.start(1);
        assert_eq!(filter.classify(1), Admission::Now);
        assert_eq!(filter.classify(2), Admission::Early);
        filter.start(2);
        assert_eq!(filter.classify(1), Admission::Stale);
        assert_eq!(filter.classify(2), Admission::Now);
        filter.end(2);
        assert_eq!((filter.classify(2), filter.current()), (Admission::Stale, None));
        assert_eq!(
            (filter.classify(2 + AHEAD), filter.classify(3 + AHEAD)),
            (Admission::Early, Admission::Impossible)
        );
        assert_eq!(filter.stale(), 2);
    }

    #[test]
    fn an_abort_of_a_cycle_that_never_started_here_makes_it_stale() {
        let mut filter = CycleFilter::default();
        filter.end(3);
        assert_eq!(filter.classify(3), Admission::Stale);
        filter.start(3);
        assert_eq!(filter.current(), None, "an ended cycle does not start again");
        filter.start(4);
        assert!(!filter.end(3));
        assert_eq!(filter.current(), Some(4), "the end of an old cycle does not touch the new one");
        assert!(!filter.end(5));
        assert_eq!(
            (filter.current(), filter.classify(5)),
            (Some(4), Admission::Stale),
            "nor that of one to come"
        );
        assert!(filter.end(4));
    }
}
