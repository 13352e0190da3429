//! Which messages belong to the cycle that a stage works on. Pure.
//!
//! Commands and data travel apart, so a frame of the next cycle may arrive before the command that starts it, and a
//! frame of an ended cycle after the command that ended it. Cycle numbers on the wire only grow.

/// So many cycles may start and be aborted while a stage is busy with one activation: as many as commands can wait for it.
pub const AHEAD: u64 = 16;

/// What to do with a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Work on it.
    Now,
    /// Keep it: its start has not come yet.
    Early,
    /// Drop it: its cycle is over.
    Stale,
    /// No sender can be so far ahead: it lies.
    Absurd,
}

/// The cycle that a stage works on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Gate {
    current: Option<u64>,
    /// The last cycle that was started or ended.
    last: u64,
    stale: u32,
}

impl Gate {
    /// A cycle starts; an older one that was not finished is over.
    pub fn start(&mut self, cycle: u64) {
        if cycle > self.last {
            self.current = Some(cycle);
            self.last = cycle;
        }
    }

    /// A cycle is over, whether it was started here or not. Says whether it was the one that runs here: with several in
    /// flight a later one may end before.
    pub fn end(&mut self, cycle: u64) -> bool {
        self.last = self.last.max(cycle);
        self.current.take_if(|current| *current == cycle).is_some()
    }

    /// The cycle that runs.
    pub fn current(&self) -> Option<u64> {
        self.current
    }

    /// Judges a message by its cycle, and counts the stale ones.
    pub fn judge(&mut self, cycle: u64) -> Verdict {
        if self.current == Some(cycle) {
            Verdict::Now
        } else if cycle > self.last.saturating_add(AHEAD) {
            Verdict::Absurd
        } else if cycle > self.last {
            Verdict::Early
        } else {
            self.stale = self.stale.saturating_add(1);
            Verdict::Stale
        }
    }

    /// Stale messages so far.
    pub fn stale(&self) -> u32 {
        self.stale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_early_then_current_then_stale() {
        let mut gate = Gate::default();
        assert_eq!(gate.judge(1), Verdict::Early);
        gate.start(1);
        assert_eq!(gate.judge(1), Verdict::Now);
        assert_eq!(gate.judge(2), Verdict::Early);
        gate.start(2);
        assert_eq!(gate.judge(1), Verdict::Stale);
        assert_eq!(gate.judge(2), Verdict::Now);
        gate.end(2);
        assert_eq!((gate.judge(2), gate.current()), (Verdict::Stale, None));
        assert_eq!((gate.judge(2 + AHEAD), gate.judge(3 + AHEAD)), (Verdict::Early, Verdict::Absurd));
        assert_eq!(gate.stale(), 2);
    }

    #[test]
    fn an_abort_of_a_cycle_that_never_started_here_makes_it_stale() {
        let mut gate = Gate::default();
        gate.end(3);
        assert_eq!(gate.judge(3), Verdict::Stale);
        gate.start(3);
        assert_eq!(gate.current(), None, "an ended cycle does not start again");
        gate.start(4);
        assert!(!gate.end(3));
        assert_eq!(gate.current(), Some(4), "the end of an old cycle does not touch the new one");
        assert!(!gate.end(5));
        assert_eq!((gate.current(), gate.judge(5)), (Some(4), Verdict::Stale), "nor that of one to come");
        assert!(gate.end(4));
    }
}
