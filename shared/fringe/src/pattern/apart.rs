//! Projectors that show sines at the same time, told apart by their temporal frequency.
//!
//! Step i of one projector is 2π k i/N, of the other one 2π l i/N: k and l periods over the N frames. Where both lights meet, a pixel
//! shows A + B cos(φ − 2πki/N) + B' cos(φ' − 2πli/N). The sums at k are blind to the sine at l for every φ' and B' unless k ± l is a
//! multiple of N, so that the other light adds its mean and its noise alone. Codes, lines and even frames have no such frequency.
//!
//! A projector that is not linear shows harmonics: its h-th one has h·k periods, and is seen at l where h·k ± l is a multiple of N.

use super::{Axis, PatternSet};
use crate::math::sincos;
use crate::wrapped::LeastSquares;
use std::f64::consts::TAU;

/// So much of the other sine may come through, as a fraction of its modulation: 0.1 mrad of the phase for equal modulation.
const LEAK: f64 = 1e-4;

/// Most projectors for which all ways to share out the periods are tried.
const MOST: usize = 4;

/// Whether a camera that sees the light of two sequences at once finds the phase of each as if it were alone.
pub fn are_apart(one: &[PatternSet], other: &[PatternSet]) -> bool {
    let blind = |(a, b): (&PatternSet, &PatternSet)| match (steps_rad(a), steps_rad(b)) {
        (Some(a), Some(b)) => a.len() == b.len() && leak(&a, &b).max(leak(&b, &a)) <= LEAK,
        _ => false,
    };
    !one.is_empty() && one.len() == other.len() && one.iter().zip(other).all(blind)
}

/// Phase steps of a set of sines that are shown one after another; none for any other set.
fn steps_rad(set: &PatternSet) -> Option<Vec<f64>> {
    let PatternSet::Sine { steps: 3.., .. } = set else { return None };
    Some((0..set.frames()).map(|step| set.step_rad(step)).collect())
}

/// The largest part of a sine with the steps `seen` that the fit with the steps `own` takes for its own light; infinite where that fit
/// does not exist.
fn leak(own: &[f64], seen: &[f64]) -> f64 {
    let Some(fit) = LeastSquares::new(own) else { return f64::INFINITY };
    let mut came = [[0.0; 2]; 3];
    for (weights, step) in fit.weights.iter().zip(seen) {
        let (s, c) = sincos(*step);
        for (came, weight) in came.iter_mut().zip(weights) {
            *came = [came[0] + weight * c, came[1] + weight * s];
        }
    }
    came.iter().map(|[c, s]| (c * c + s * s).sqrt()).fold(0.0, f64::max)
}

/// Periods over N steps for projectors that light the same surface, one number for each, rising: those whose lowest harmonic that
/// reaches another one is the highest; of equal ones the smallest numbers. None where N steps do not tell so many apart.
pub fn periods_apart(steps: u32, projectors: usize) -> Option<Vec<u32>> {
    if !(1..=MOST).contains(&projectors) || !(3..=64).contains(&steps) {
        return None;
    }
    let mut best = None;
    share_out(steps, projectors, &mut Vec::new(), &mut best);
    best.map(|(_, periods)| periods)
}

/// Tries every further number of periods beside those that are given out.
fn share_out(steps: u32, projectors: usize, given: &mut Vec<u32>, best: &mut Option<(u32, Vec<u32>)>) {
    if given.len() == projectors {
        let reach = first_harmonic(steps, given);
        if best.as_ref().is_none_or(|(most, _)| reach > *most) {
            *best = Some((reach, given.clone()));
        }
        return;
    }
    // Beyond half of the steps the numbers repeat with the sense reversed.
    let first = given.last().map_or(1, |last| last + 1);
    for periods in (first..).take_while(|periods| 2 * periods < steps) {
        given.push(periods);
        share_out(steps, projectors, given, best);
        given.pop();
    }
}

/// The lowest harmonic, from the second on, that one of these numbers of periods shows another or itself.
pub fn first_harmonic(steps: u32, periods: &[u32]) -> u32 {
    let meets = |harmonic: u32| {
        periods.iter().any(|from| {
            periods
                .iter()
                .any(|to| (harmonic * from + to).is_multiple_of(steps) || (harmonic * from) % steps == *to)
        })
    };
    (2..=steps + 1).find(|harmonic| meets(*harmonic)).unwrap_or(steps + 1)
}

/// The steps of a set of sines that passes so many periods, as `shifts_rad` of a configuration.
pub fn stepping(axis: Axis, period_px: f64, steps: u32, periods: u32) -> PatternSet {
    let shift = |step: u32| TAU * f64::from((periods * step) % steps) / f64::from(steps);
    let mut set = PatternSet::sine(axis, period_px, steps);
    if let PatternSet::Sine { shifts_rad, .. } = &mut set {
        *shifts_rad = (0..steps).map(shift).collect();
    }
    set
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{atan2, cos};

    fn set(steps: u32, periods: u32) -> PatternSet {
        stepping(Axis::X, 16.0, steps, periods)
    }

    /// The phase that the fit of `own` finds in the light of both, of any phases and modulations.
    fn found(own: &PatternSet, other: &PatternSet, phase: f64, beside: f64) -> f64 {
        let steps = steps_rad(own).unwrap();
        let values: Vec<f64> = steps
            .iter()
            .zip(steps_rad(other).unwrap())
            .map(|(a, b)| 100.0 + 40.0 * cos(phase - a) + 55.0 + 50.0 * cos(beside - b))
            .collect();
        let [_, c, s] = LeastSquares::new(&steps).unwrap().fit(&values);
        atan2(s, c)
    }

    /// Proves: for all numbers of steps up to 16 and all periods, two sets count as apart where the phase in the light of both is the
    /// phase of one, for every phase of the other, and nowhere else.
    #[test]
    fn sets_are_apart_where_the_light_of_one_leaves_the_phase_of_the_other_alone() {
        for steps in 3..=16 {
            for own in (1..steps).filter(|k| 2 * k < steps) {
                for other in (1..steps).filter(|k| 2 * k < steps) {
                    let (a, b) = (set(steps, own), set(steps, other));
                    let worst = (0..12)
                        .map(|i| f64::from(i) * TAU / 12.0)
                        .map(|beside| (found(&a, &b, 1.0, beside) - 1.0).abs())
                        .fold(0.0, f64::max);
                    let apart = are_apart(&[a], &[b]);
                    assert_eq!(apart, worst < 1e-9, "{steps} steps, {own} and {other} periods: {worst}");
                    assert_eq!(apart, own != other);
                }
            }
        }
    }

    #[test]
    fn only_sines_set_beside_set_are_apart() {
        let gray = PatternSet::gray(Axis::X, 7, 8.0);
        assert!(are_apart(&[set(12, 1), set(12, 1)], &[set(12, 5), set(12, 2)]));
        assert!(!are_apart(&[set(12, 1), gray.clone()], &[set(12, 5), gray.clone()]));
        assert!(!are_apart(&[set(12, 1)], &[set(12, 5), set(12, 5)]), "other lengths");
        assert!(!are_apart(&[set(12, 1)], &[set(10, 3)]), "other steps");
        assert!(!are_apart(&[set(12, 1)], &[set(12, 1)]));
        assert!(!are_apart(&[], &[]));
        // Even steps from zero are one period; the sense of the steps does not tell two apart.
        let even = PatternSet::sine(Axis::Y, 20.0, 12);
        assert!(are_apart(std::slice::from_ref(&even), &[set(12, 5)]));
        assert!(!are_apart(&[even], &[set(12, 11)]));
        let one = PatternSet::sine(Axis::X, 20.0, 1);
        let one = std::slice::from_ref(&one);
        assert!(!are_apart(one, one));
    }

    #[test]
    fn periods_keep_the_lowest_harmonics_away() {
        // Sums at 5 periods of 12 see the fifth harmonic of 1 and its own eleventh.
        assert_eq!(periods_apart(12, 2), Some(vec![1, 5]));
        assert_eq!((first_harmonic(12, &[1, 5]), first_harmonic(12, &[1, 2])), (5, 2));
        assert_eq!(periods_apart(5, 2), Some(vec![1, 2]));
        assert_eq!(periods_apart(4, 2), None, "four steps have one frequency");
        assert_eq!(periods_apart(12, 5), None);
        assert_eq!(periods_apart(3, 1), Some(vec![1]));
        for (steps, projectors) in [(7, 3), (10, 4), (16, 2), (64, 2)] {
            let periods = periods_apart(steps, projectors).unwrap();
            for (place, own) in periods.iter().enumerate() {
                for other in &periods[place + 1..] {
                    assert!(are_apart(&[set(steps, *own)], &[set(steps, *other)]));
                }
            }
        }
    }

    /// Proves: a harmonic of one projector is seen by the sums of the other at the number that is stated, and none below it.
    #[test]
    fn the_harmonic_that_is_named_is_the_first_that_is_seen() {
        for (steps, periods) in [(12_u32, [1, 5]), (12, [1, 2]), (10, [1, 3]), (7, [2, 3])] {
            let sees = |harmonic: u32| {
                periods.iter().any(|from| {
                    periods.iter().any(|to| {
                        let seen: Vec<f64> = steps_rad(&set(steps, *from)).unwrap();
                        let seen: Vec<f64> = seen.iter().map(|step| f64::from(harmonic) * step).collect();
                        leak(&steps_rad(&set(steps, *to)).unwrap(), &seen) > 1e-9
                    })
                })
            };
            // The leak of a harmonic that every frame shows alike is in the mean, which no phase sees.
            let first = (2..=steps + 1).filter(|h| periods.iter().all(|k| !(h * k).is_multiple_of(steps)));
            assert_eq!(
                first.into_iter().find(|h| sees(*h)),
                Some(first_harmonic(steps, &periods)),
                "{steps}"
            );
        }
    }
}
