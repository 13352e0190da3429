//! When a stage that ended is started again, and when the cell gives up. Pure.

use std::collections::VecDeque;

/// First pause before a restart, ns: long enough for the kernel to free what the dead process held.
const FIRST_PAUSE_NS: u64 = 100_000_000;

/// Longest pause, ns: an operator waits that long at most after the cause is gone.
const LONGEST_PAUSE_NS: u64 = 5_000_000_000;

/// The policy of the config.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// Failures within the window that are answered by a restart; one more holds the stage.
    pub restarts_max: u32,
    /// The window, ns.
    pub window_ns: u64,
}

/// What to do with a stage that failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Start it again at this time.
    RestartAt(u64),
    /// It failed too often; the cell cannot go on.
    Hold,
}

/// The failures of one stage.
#[derive(Debug, Clone)]
pub struct Restarts {
    policy: Policy,
    recent_ns: VecDeque<u64>,
    total: u32,
}

impl Restarts {
    /// No failure yet.
    pub fn new(policy: Policy) -> Self {
        Self { policy, recent_ns: VecDeque::new(), total: 0 }
    }

    /// Counts a failure and decides. The pause doubles with each failure that is still within the window.
    pub fn failed(&mut self, now_ns: u64) -> Verdict {
        let begin_ns = now_ns.saturating_sub(self.policy.window_ns);
        while self.recent_ns.front().is_some_and(|&t| t < begin_ns) {
            self.recent_ns.pop_front();
        }
        self.recent_ns.push_back(now_ns);
        self.total = self.total.saturating_add(1);
        let failures = self.recent_ns.len() as u32;
        if failures > self.policy.restarts_max {
            return Verdict::Hold;
        }
        let pause_ns = FIRST_PAUSE_NS.saturating_mul(1_u64 << (failures - 1).min(32)).min(LONGEST_PAUSE_NS);
        Verdict::RestartAt(now_ns.saturating_add(pause_ns))
    }

    /// Somebody removed the cause: the window begins anew.
    pub fn forgive(&mut self) {
        self.recent_ns.clear();
    }

    /// Failures since the start of the cell.
    pub fn total(&self) -> u32 {
        self.total
    }

    /// Failures within the window, as of the last one.
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
    fn pauses_double_up_to_a_limit_and_then_the_stage_is_held() {
        let mut restarts = Restarts::new(Policy { restarts_max: 8, ..POLICY });
        let pauses: Vec<Verdict> = (0..9).map(|_| restarts.failed(SECOND)).collect();
        let at = |ms: u64| Verdict::RestartAt(SECOND + ms * 1_000_000);
        let doubling = [100, 200, 400, 800, 1600, 3200, 5000, 5000].map(at);
        assert_eq!(pauses[..8], doubling);
        assert_eq!(pauses[8], Verdict::Hold);
    }

    #[test]
    fn failures_outside_of_the_window_are_forgiven() {
        let mut restarts = Restarts::new(POLICY);
        for i in 0..100 {
            let now = i * 20 * SECOND;
            assert!(matches!(restarts.failed(now), Verdict::RestartAt(_)), "{i}");
        }
        assert_eq!(restarts.total(), 100);
    }

    #[test]
    fn without_restarts_the_first_failure_holds() {
        assert_eq!(Restarts::new(Policy { restarts_max: 0, ..POLICY }).failed(7), Verdict::Hold);
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
                    Verdict::Hold => break,
                    Verdict::RestartAt(at) => {
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
