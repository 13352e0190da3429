//! What remains between points and fitted element.

use serde::{Deserialize, Serialize};

use super::centred::{BRANCH, tree};

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
    chosen.extend(values.iter().zip(marks).filter(|(_, marked)| **marked).map(|(value, _)| *value));
    chosen
}

impl Residuals {
    /// Residuals of the points used, in their order.
    pub fn of_used(&self) -> Vec<f64> {
        if self.used.iter().all(|used| *used) {
            return self.deviation_mm.clone();
        }
        marked(&self.deviation_mm, &self.used)
    }

    /// Range, standard deviation and quantile of the residuals.
    pub(crate) fn form(&self) -> Form {
        let mut sorted = self.of_used();
        let points = sorted.len();
        let mean = sum(&sorted, |r| r) / points.max(1) as f64;
        let variance = sum(&sorted, |r| (r - mean) * (r - mean)) / points.saturating_sub(1).max(1) as f64;
        let [range_mm, d95_mm] = widths(&mut sorted);
        Form {
            points,
            rejected: self.used.len() - points,
            form_range_mm: range_mm,
            form_sigma_mm: variance.sqrt(),
            form_d95_mm: d95_mm,
        }
    }
}

/// The sum of a function of values.
fn sum(values: &[f64], of: impl Fn(f64) -> f64 + Sync) -> f64 {
    tree(values, &|leaf| leaf.iter().map(|r| of(*r)).sum::<f64>(), &|a: f64, b: f64| a + b)
}

/// Sorts both ends, of many values side by side.
fn sort_both(low: &mut [f64], high: &mut [f64]) {
    let sort = |values: &mut [f64]| values.sort_unstable_by(f64::total_cmp);
    if low.len() > BRANCH {
        rayon::join(|| sort(low), || sort(high));
    } else {
        sort(low);
        sort(high);
    }
}

/// Width of the interval that holds all values, and of the narrowest one that holds ⌈0.95 n⌉ of n values. Only the lowest and the
/// highest twentieth, where intervals begin and end, are sorted.
fn widths(values: &mut [f64]) -> [f64; 2] {
    let held = (95 * values.len()).div_ceil(100);
    let Some(begins) = values.len().checked_sub(held).filter(|_| held > 0) else { return [0.0; 2] };
    if begins + 1 < held - 1 {
        values.select_nth_unstable_by(begins, f64::total_cmp);
        values[begins + 1..].select_nth_unstable_by(held - 2 - begins, f64::total_cmp);
        let (low, rest) = values.split_at_mut(begins + 1);
        sort_both(low, &mut rest[held - 2 - begins..]);
    } else {
        values.sort_unstable_by(f64::total_cmp);
    }
    let ends = &values[held - 1..];
    let narrowest = values.iter().zip(ends).map(|(low, high)| high - low).fold(f64::INFINITY, f64::min);
    [values[values.len() - 1] - values[0], narrowest]
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

    /// Proves: sorting both ends alone gives the widths of sorting all, for every number of values.
    #[test]
    fn both_ends_suffice_for_the_widths() {
        let mut noise = Noise(3);
        for count in (1_usize..90).chain([1000, 1001, 1019]) {
            let mut values: Vec<f64> = (0..count).map(|_| noise.normal()).collect();
            let mut sorted = values.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            let held = (95 * count).div_ceil(100);
            let narrowest = sorted.windows(held).map(|w| w[held - 1] - w[0]).fold(f64::INFINITY, f64::min);
            assert_eq!(widths(&mut values), [sorted[count - 1] - sorted[0], narrowest], "{count} values");
        }
        assert_eq!(widths(&mut []), [0.0; 2]);
    }

    #[test]
    fn rejected_points_do_not_count() {
        let residuals = Residuals { deviation_mm: vec![-1.0, 5.0, 1.0], used: vec![true, false, true] };
        let form = residuals.form();
        assert_eq!((form.points, form.rejected, form.form_range_mm), (2, 1, 2.0));
    }
}
