//! The decision rule of ISO 14253-1.

use serde::{Deserialize, Serialize};

/// What is decided about a feature or a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Conformity is proven: the value lies inside the limits by at least the guard band.
    Pass,
    /// Neither conformity nor non-conformity is proven: the value lies within the guard band of a limit.
    Indeterminate,
    /// Non-conformity is proven: the value lies outside a limit, lower or upper, by more than the guard band.
    Fail,
    /// There is no value; the reason stands beside it.
    NotMeasured,
}

/// Decides about a value with standard uncertainty `u` and guard band k·u.
///
/// `lower` is `None` where no value can fall below it (a flatness): there is nothing to prove then.
pub fn decide(value: f64, u: f64, guard_factor: f64, lower: Option<f64>, upper: f64) -> Verdict {
    let guard = guard_factor * u;
    if !value.is_finite() || !guard.is_finite() {
        return Verdict::NotMeasured;
    }
    if value > upper + guard || lower.is_some_and(|l| value < l - guard) {
        return Verdict::Fail;
    }
    if value <= upper - guard && lower.is_none_or(|l| value >= l + guard) {
        return Verdict::Pass;
    }
    Verdict::Indeterminate
}

/// The verdict over all features: one fail fails the part; it passes when every feature passes.
pub(super) fn overall(verdicts: impl Iterator<Item = Verdict>) -> Verdict {
    verdicts.fold(Verdict::Pass, |so_far, verdict| match (so_far, verdict) {
        (Verdict::Fail, _) | (_, Verdict::Fail) => Verdict::Fail,
        (Verdict::Pass, Verdict::Pass) => Verdict::Pass,
        _ => Verdict::Indeterminate,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn guard_bands_narrow_pass_and_fail() {
        use Verdict::{Fail, Indeterminate, NotMeasured, Pass};
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
            (f64::NAN, NotMeasured),
        ] {
            assert_eq!(decide(value, 0.1, 2.0, Some(-1.0), 1.0), verdict, "{value}");
        }
        // A guard band wider than the tolerance can prove nothing inside.
        assert_eq!(decide(0.0, 1.0, 2.0, Some(-1.0), 1.0), Indeterminate);
        assert_eq!(decide(0.0, 0.1, 2.0, None, 1.0), Pass);
        assert_eq!(decide(0.0, f64::INFINITY, 2.0, None, 1.0), NotMeasured);
    }

    #[test]
    fn one_fail_fails_the_part_and_a_gap_never_passes() {
        use Verdict::{Fail, Indeterminate, NotMeasured, Pass};
        let over = |list: &[Verdict]| overall(list.iter().copied());
        assert_eq!(over(&[Pass, Pass]), Pass);
        assert_eq!(over(&[Pass, NotMeasured]), Indeterminate);
        assert_eq!(over(&[NotMeasured, NotMeasured]), Indeterminate);
        assert_eq!(over(&[Pass, Indeterminate]), Indeterminate);
        assert_eq!(over(&[NotMeasured, Fail, Pass]), Fail);
    }
}
