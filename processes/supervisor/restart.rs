//! Restart policy: when a failed stage is started again, and when the cell gives up. Pure.

use std::collections::VecDeque;

/// First pause before a restart, ns: the kernel needs time to release the resources of the dead process.
const FIRST_PAUSE_NS: u64 = 100_000_000;

/// Longest pause before a restart, ns.
const LONGEST_PAUSE_NS: u64 = 5_000_000_000;

/// Restart policy of the configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// Failures within the window that lead to a restart; one more and the cell gives up.
    pub restarts_max: u32,
    /// Length of the window, ns.
    pub window_ns: u64,
}

/// What to do about a failed stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decision {
    /// Start it again at this time, ns.
    RestartAt(u64),
    /// It failed too often.
    GiveUp,
}

/// Failures of one stage.
#[derive(Debug, Clone)]
pub struct Restarts {
    policy: Policy,
    recent_ns: VecDeque<u64>,
    total: u32,
}

impl Restarts {
    /// A stage without failures.
    pub fn new(policy: Policy) -> Self {
        Self { policy, recent_ns: VecDeque::new(), total: 0 }
    }

    /// Counts a failure and decides. The pause doubles with each failure within the window.
    pub fn failed(&mut self, now_ns: u64) -> Decision {
        let begin_ns = now_ns.saturating_sub(self.policy.window_ns);
        while self.recent_ns.front().is_some_and(|&t| t < begin_ns) {
            self.recent_ns.pop_front();
        }
        self.recent_ns.push_back(now_ns);
        self.total = self.total.saturating_add(1);
        let failures = self.recent_ns.len() as u32;
        if failures > self.policy.restarts_max {
            return Decision::GiveUp;
        }
        let pause_ns = FIRST_PAUSE_NS.saturating_mul(1_u64 << (failures - 1).min(32)).min(LONGEST_PAUSE_NS);
        Decision::RestartAt(now_ns.saturating_add(pause_ns))
    }

    /// Decides about a restart that an operator requested: it is no failure.
    pub fn requested(&mut self, now_ns: u64) -> Decision {
        self.total = self.total.saturating_add(1);
        Decision::RestartAt(now_ns.saturating_add(FIRST_PAUSE_NS))
    }

    /// Clears the failures of the window, after an operator removed the cause.
    pub fn clear(&mut self) {
        self.recent_ns.clear();
    }

    /// Number of restarts since the start of the cell, requested ones included.
    pub fn total(&self) -> u32 {
        self.total
    }

    /// Number of failures within the window at the last failure.
    pub fn recent(&self) -> usize {
        self.recent_ns.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SECOND: u64 = 1_000_000_000;
    const POLICY: Policy = Policy { restarts_max: 5, window_ns: 60 * SECOND };

    #[test]
    fn pauses_double_up_to_a_limit_and_then_the_cell_gives_up() {
        let mut restarts = Restarts::new(Policy { restarts_max: 8, ..POLICY });
        let pauses: Vec<Decision> = (0..9).map(|_| restarts.failed(SECOND)).collect();
        let at = |ms: u64| Decision::RestartAt(SECOND + ms * 1_000_000);
        let doubling = [100, 200, 400, 800, 1600, 3200, 5000, 5000].map(at);
        assert_eq!(pauses[..8], doubling);
        assert_eq!(pauses[8], Decision::GiveUp);
    }

    #[test]
    fn failures_outside_of_the_window_do_not_count() {
        let mut restarts = Restarts::new(POLICY);
        for i in 0..100 {
            let now = i * 20 * SECOND;
            assert!(matches!(restarts.failed(now), Decision::RestartAt(_)), "{i}");
        }
        assert_eq!(restarts.total(), 100);
    }

    #[test]
    fn requested_restarts_are_no_failures() {
        let mut restarts = Restarts::new(Policy { restarts_max: 1, ..POLICY });
        for _ in 0..100 {
            assert_eq!(restarts.requested(SECOND), Decision::RestartAt(SECOND + FIRST_PAUSE_NS));
        }
        assert_eq!((restarts.total(), restarts.recent()), (100, 0));
        assert!(matches!(restarts.failed(SECOND), Decision::RestartAt(_)));
        assert_eq!(restarts.failed(SECOND), Decision::GiveUp);
    }

    #[test]
    fn without_restarts_the_cell_gives_up_at_the_first_failure() {
        assert_eq!(Restarts::new(Policy { restarts_max: 0, ..POLICY }).failed(7), Decision::GiveUp);
    }

    proptest! {
        /// Proves: never more than the allowed number of restarts in any window, and no restart in the past.
        #[test]
        fn restarts_are_bounded_in_every_window(
            gaps in proptest::collection::vec(0_u64..40 * SECOND, 1..60),
            restarts_max in 0_u32..7,
        ) {
            let policy = Policy { restarts_max, ..POLICY };
            let mut restarts = Restarts::new(policy);
            let mut now_ns = 0;
            let mut granted: Vec<u64> = Vec::new();
            for gap in gaps {
                now_ns += gap;
                match restarts.failed(now_ns) {
                    Decision::GiveUp => break,
                    Decision::RestartAt(at) => {
                        prop_assert!(at > now_ns && at <= now_ns + LONGEST_PAUSE_NS);
                        granted.push(now_ns);
                        let in_window =
                            granted.iter().filter(|&&t| t + policy.window_ns >= now_ns).count();
                        prop_assert!(in_window <= restarts_max as usize);
                    }
                }
            }
        }
    }
}
