//! What remains between points and fitted element.

use serde::{Deserialize, Serialize};
use std::borrow::Cow;

use super::centred::sum;

/// Standard deviations from the mean beyond which the twentieth of a side is looked for: of normal ones a twelfth lies there.
const FAR: f64 = 1.4;

/// Values that are looked through at once.
const AT_ONCE: usize = 128;

/// So few values are put in order.
const SORTED: usize = 64;

/// Form deviation of the points used, each statistic with its definition in its name.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Form {
    /// Points used in the fit (the rejected ones not counted).
    pub points: usize,
    /// Points rejected by the stated fraction.
    pub rejected: usize,
    /// Largest less smallest residual, mm (the probing form of VDI/VDE 2634 is this range).
    pub form_range_mm: f64,
    /// Sample standard deviation (n − 1) of the residuals, mm.
    pub form_sigma_mm: f64,
    /// Width of the narrowest interval that holds ⌈0.95 n⌉ of the n residuals, mm.
    pub form_d95_mm: f64,
}

/// Residual of each point given to a fit.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Residuals {
    /// Signed orthogonal distance, mm; positive outside (on the side of the normal, of a plane).
    pub deviation_mm: Vec<f64>,
    /// Whether the point was used.
    pub used: Vec<bool>,
}

/// The values that are marked. One allocation: a cell measures at every cycle, and growing lists cost it ten each.
pub(super) fn marked<T: Copy>(values: &[T], marks: &[bool]) -> Vec<T> {
    let mut chosen = Vec::with_capacity(values.len());
    let mut start = 0;
    // As a rule few are left out: what lies between two of them is copied as a whole.
    for (end, _) in marks.iter().enumerate().filter(|(_, marked)| !**marked) {
        chosen.extend_from_slice(&values[start..end]);
        start = end + 1;
    }
    chosen.extend_from_slice(&values[start..]);
    chosen
}

impl Residuals {
    /// Residuals of the points used, in their order.
    pub fn of_used(&self) -> Cow<'_, [f64]> {
        if self.used.iter().all(|used| *used) {
            return Cow::Borrowed(&self.deviation_mm);
        }
        Cow::Owned(marked(&self.deviation_mm, &self.used))
    }

    /// Range, standard deviation and quantile of the residuals.
    pub(crate) fn form(&self) -> Form {
        let values = self.of_used();
        let points = values.len();
        let mean = sum(&values, |r| r) / points.max(1) as f64;
        let variance = sum(&values, |r| (r - mean) * (r - mean)) / points.saturating_sub(1).max(1) as f64;
        let [range_mm, d95_mm] = widths(values, mean, variance.sqrt());
        Form {
            points,
            rejected: self.used.len() - points,
            form_range_mm: range_mm,
            form_sigma_mm: variance.sqrt(),
            form_d95_mm: d95_mm,
        }
    }
}

/// Width of the interval that holds all values, and of the narrowest one that holds ⌈0.95 n⌉ of n values. Only the lowest and the
/// highest twentieth, where intervals begin and end, are looked at. Mean and standard deviation tell where to look for them.
fn widths(values: Cow<[f64]>, mean: f64, sigma: f64) -> [f64; 2] {
    let held = (95 * values.len()).div_ceil(100);
    let Some(begins) = values.len().checked_sub(held).filter(|_| held > 0) else { return [0.0; 2] };
    if let Some((mut low, mut high)) = tails(&values, begins + 1, mean, sigma) {
        return between_ends(&mut low, &mut high);
    }
    let mut values = values.into_owned();
    if begins + 1 < held - 1 {
        values.select_nth_unstable_by(begins, f64::total_cmp);
        values[begins + 1..].select_nth_unstable_by(held - 2 - begins, f64::total_cmp);
        let (low, rest) = values.split_at_mut(begins + 1);
        return between_ends(low, &mut rest[held - 2 - begins..]);
    }
    values.sort_unstable_by(f64::total_cmp);
    between_ends(&mut values[..=begins].to_vec(), &mut values[held - 1..])
}

/// Width of all values, and the least difference of an end and the beginning of the same rank; both in any order, none empty.
fn between_ends(begins: &mut [f64], ends: &mut [f64]) -> [f64; 2] {
    [largest(ends) - smallest(begins), narrowest(begins, ends, f64::INFINITY)]
}

/// The least difference of an end and the beginning of the same rank, or `best` where none is smaller. Only ranks that may have a smaller
/// one are put in order.
fn narrowest(begins: &mut [f64], ends: &mut [f64], best: f64) -> f64 {
    // No difference of these ranks is smaller.
    if begins.is_empty() || smallest(ends) - largest(begins) >= best {
        return best;
    }
    if begins.len() <= SORTED {
        begins.sort_unstable_by(f64::total_cmp);
        ends.sort_unstable_by(f64::total_cmp);
        return begins.iter().zip(ends).map(|(low, high)| *high - low).fold(best, f64::min);
    }
    let middle = begins.len() / 2;
    let (lower_begins, begin, upper_begins) = begins.select_nth_unstable_by(middle, f64::total_cmp);
    let (lower_ends, end, upper_ends) = ends.select_nth_unstable_by(middle, f64::total_cmp);
    let best = narrowest(lower_begins, lower_ends, best.min(*end - *begin));
    narrowest(upper_begins, upper_ends, best)
}

fn smallest(values: &[f64]) -> f64 {
    values.iter().fold(f64::INFINITY, |least, value| if *value < least { *value } else { least })
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(f64::NEG_INFINITY, |most, value| if *value > most { *value } else { most })
}

/// So many of the lowest values, and of the highest, in any order; `None` where too few lie far from the mean.
fn tails(values: &[f64], count: usize, mean: f64, sigma: f64) -> Option<(Vec<f64>, Vec<f64>)> {
    let [below, above] = [mean - FAR * sigma, mean + FAR * sigma];
    let room = || Vec::with_capacity(values.len() / 8);
    let (mut low, mut high) = (room(), room());
    for some in values.chunks(AT_ONCE) {
        // Each value is written, and kept by counting on: a branch that is seldom taken costs more.
        let (mut lows, mut highs, mut counts) = ([0.0; AT_ONCE], [0.0; AT_ONCE], [0; 2]);
        for value in some {
            (lows[counts[0]], highs[counts[1]]) = (*value, *value);
            counts[0] += usize::from(*value < below);
            counts[1] += usize::from(*value > above);
        }
        low.extend_from_slice(&lows[..counts[0]]);
        high.extend_from_slice(&highs[..counts[1]]);
    }
    if low.len().min(high.len()) < count {
        return None;
    }
    low.select_nth_unstable_by(count - 1, f64::total_cmp);
    low.truncate(count);
    let others = high.len() - count;
    high.select_nth_unstable_by(others, f64::total_cmp);
    high.drain(..others);
    Some((low, high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::tests::Noise;

    #[test]
    fn form_statistics_follow_their_definitions() {
        // 19 residuals 0 … 18 and one far away: ⌈0.95 · 20⌉ = 19 points, so the interval leaves the far one out.
        let mut deviation_mm: Vec<f64> = (0..19).map(f64::from).collect();
        deviation_mm.push(1000.0);
        let form = Residuals { used: vec![true; 20], deviation_mm }.form();
        assert_eq!((form.points, form.rejected), (20, 0));
        assert_eq!(form.form_range_mm, 1000.0);
        assert_eq!(form.form_d95_mm, 18.0);
        let mean = 1171.0 / 20.0;
        let squares: f64 =
            (0..19).map(|i| (f64::from(i) - mean).powi(2)).sum::<f64>() + (1000.0f64 - mean).powi(2);
        assert!((form.form_sigma_mm - (squares / 19.0).sqrt()).abs() < 1e-12);
    }

    /// Proves: sorting both ends alone gives the widths of sorting all, for every number of values, whether they lie far from the mean or
    /// not, and among equals.
    #[test]
    fn both_ends_suffice_for_the_widths() {
        let mut noise = Noise(3);
        for count in (1_usize..90).chain([1000, 1001, 1019, 6001, 20_000]) {
            let gauss: Vec<f64> = (0..count).map(|_| noise.normal()).collect();
            let stepped = gauss.iter().map(|v| v.round()).collect();
            let one_sided = gauss.iter().map(|v| v.abs()).collect();
            let two = (0..count).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
            for values in [gauss, stepped, one_sided, two] {
                let mut sorted = values.clone();
                sorted.sort_unstable_by(f64::total_cmp);
                let held = (95 * count).div_ceil(100);
                let narrowest =
                    sorted.windows(held).map(|w| w[held - 1] - w[0]).fold(f64::INFINITY, f64::min);
                let form = Residuals { used: vec![true; count], deviation_mm: values }.form();
                let widths = [form.form_range_mm, form.form_d95_mm];
                assert_eq!(widths, [sorted[count - 1] - sorted[0], narrowest], "{count} values");
            }
        }
        assert_eq!(widths(Cow::Owned(Vec::new()), 0.0, 0.0), [0.0; 2]);
    }

    /// Proves: what is marked is copied, wherever the gaps lie.
    #[test]
    fn marked_values_are_those_marked_one_by_one() {
        let mut noise = Noise(5);
        for count in 0..70 {
            let marks: Vec<bool> = (0..count).map(|_| noise.uniform() < 0.7).collect();
            let expected: Vec<usize> = (0..count).filter(|i| marks[*i]).collect();
            let values: Vec<usize> = (0..count).collect();
            assert_eq!(marked(&values, &marks), expected);
        }
    }

    #[test]
    fn rejected_points_do_not_count() {
        let residuals = Residuals { deviation_mm: vec![-1.0, 5.0, 1.0], used: vec![true, false, true] };
        let form = residuals.form();
        assert_eq!((form.points, form.rejected, form.form_range_mm), (2, 1, 2.0));
    }
}
