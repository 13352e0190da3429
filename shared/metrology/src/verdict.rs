//! The verdict on a feature, a part or a test, and the decision rule of ISO 14253-1 behind it.

use serde::{Deserialize, Serialize};
use std::fmt;

/// What is decided about a feature, a part, a characteristic or a test, from the best to the worst. Where there is no
/// value there is no verdict: it is an `Option<Verdict>`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Conformity is proven: the value lies inside the limits by at least the guard band.
    Pass,
    /// Neither conformity nor non-conformity is proven: the value lies within the guard band of a limit.
    Indeterminate,
    /// Non-conformity is proven: the value lies outside a limit, lower or upper, by more than the guard band.
    Fail,
}

impl Verdict {
    /// As it stands in files.
    pub fn key(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Indeterminate => "indeterminate",
            Self::Fail => "fail",
        }
    }

    /// As it is printed in reports.
    pub fn word(self) -> &'static str {
        match self {
            Self::Pass => "PASS",
            Self::Indeterminate => "INDETERMINATE",
            Self::Fail => "FAIL",
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.key())
    }
}

/// Decides about a value with standard uncertainty `u` and guard band k·u; `None` where either is not finite.
///
/// `lower` is `None` where no value can fall below it (a flatness): there is nothing to prove then.
pub fn decide(value: f64, u: f64, guard_factor: f64, lower: Option<f64>, upper: f64) -> Option<Verdict> {
    let guard = guard_factor * u;
    if !value.is_finite() || !guard.is_finite() {
        return None;
    }
    if value > upper + guard || lower.is_some_and(|l| value < l - guard) {
        return Some(Verdict::Fail);
    }
    if value <= upper - guard && lower.is_none_or(|l| value >= l + guard) {
        return Some(Verdict::Pass);
    }
    Some(Verdict::Indeterminate)
}

/// The verdict over all features: one fail fails the part; it passes when every feature passes. A feature without a
/// verdict proves nothing.
pub(crate) fn overall(verdicts: impl Iterator<Item = Option<Verdict>>) -> Verdict {
    verdicts.map(|verdict| verdict.unwrap_or(Verdict::Indeterminate)).max().unwrap_or(Verdict::Pass)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn guard_bands_narrow_pass_and_fail() {
        use Verdict::{Fail, Indeterminate, Pass};
        // Limits −1 … 1, u = 0.1, k = 2: pass within ±0.8, fail beyond ±1.2.
        for (value, verdict) in [
            (0.0, Pass),
            (0.8, Pass),
            (-0.8, Pass),
            (0.81, Indeterminate),
            (-0.81, Indeterminate),
            (1.0, Indeterminate),
            (-1.19, Indeterminate),
            (1.21, Fail),
            (-1.21, Fail),
            (-99.0, Fail),
        ] {
            assert_eq!(decide(value, 0.1, 2.0, Some(-1.0), 1.0), Some(verdict), "{value}");
        }
        // A guard band wider than the tolerance can prove nothing inside.
        assert_eq!(decide(0.0, 1.0, 2.0, Some(-1.0), 1.0), Some(Indeterminate));
        assert_eq!(decide(0.0, 0.1, 2.0, None, 1.0), Some(Pass));
        assert_eq!(decide(f64::NAN, 0.1, 2.0, Some(-1.0), 1.0), None);
        assert_eq!(decide(0.0, f64::INFINITY, 2.0, None, 1.0), None);
    }

    #[test]
    fn one_fail_fails_the_part_and_a_gap_never_passes() {
        use Verdict::{Fail, Indeterminate, Pass};
        let over = |list: &[Option<Verdict>]| overall(list.iter().copied());
        assert_eq!(over(&[Some(Pass), Some(Pass)]), Pass);
        assert_eq!(over(&[Some(Pass), None]), Indeterminate);
        assert_eq!(over(&[None, None]), Indeterminate);
        assert_eq!(over(&[Some(Pass), Some(Indeterminate)]), Indeterminate);
        assert_eq!(over(&[None, Some(Fail), Some(Pass)]), Fail);
    }
}
