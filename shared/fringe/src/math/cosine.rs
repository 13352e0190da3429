//! The cosine transform of rows of any length, two rows at a time: their one complex transform costs as much as one of a
//! single row (Makhoul, IEEE ASSP 28, 1980).

use super::fourier::{Complex, Plan, inverse, unit};
use std::f64::consts::PI;

/// What transforms of one length share.
pub struct CosinePlan {
    plan: Plan,
    /// e^(−iπk/2n) for each k.
    quarters: Vec<Complex>,
}

impl CosinePlan {
    /// `length` is at least 1.
    pub fn new(length: usize) -> Self {
        let quarters = (0..length).map(|k| unit(PI * k as f64 / (2 * length) as f64)).collect();
        Self { plan: Plan::new(length), quarters }
    }

    /// Working memory for [`Self::forward`] and [`Self::backward`].
    pub fn scratch(&self) -> Vec<Complex> {
        vec![(0.0, 0.0); self.quarters.len()]
    }

    /// Replaces x by X_k = Σ x_j cos(πk(2j + 1)/2n) in one or two rows that follow each other.
    pub fn forward(&self, rows: &mut [f64], scratch: &mut [Complex]) {
        let n = self.quarters.len();
        let (a, b) = rows.split_at_mut(n);
        for (j, place) in interleaved(n).enumerate() {
            scratch[place] = (a[j], b.get(j).copied().unwrap_or(0.0));
        }
        self.plan.run(scratch);
        for (k, (c, s)) in self.quarters.iter().enumerate() {
            let (z, mirror) = (scratch[k], scratch[(n - k) % n]);
            // The transforms of two real rows are the even and the odd part of that of a + ib.
            a[k] = 0.5 * (c * (z.0 + mirror.0) - s * (z.1 - mirror.1));
            if let Some(b) = b.get_mut(k) {
                *b = 0.5 * (c * (z.1 + mirror.1) - s * (mirror.0 - z.0));
            }
        }
    }

    /// The inverse of [`Self::forward`].
    pub fn backward(&self, rows: &mut [f64], scratch: &mut [Complex]) {
        let n = self.quarters.len();
        let (a, b) = rows.split_at_mut(n);
        let pair = |row: &[f64], k: usize| {
            let mirror = if k == 0 { 0.0 } else { row.get(n - k).copied().unwrap_or(0.0) };
            (row.get(k).copied().unwrap_or(0.0), mirror)
        };
        for (k, ((c, s), value)) in self.quarters.iter().zip(scratch.iter_mut()).enumerate() {
            let ((a, a_mirror), (b, b_mirror)) = (pair(a, k), pair(b, k));
            // e^(iπk/2n) (X_k − i X_(n−k)) of each row, the second times i.
            let (re, im) = (a + b_mirror, b - a_mirror);
            *value = (c * re + s * im, c * im - s * re);
        }
        inverse(scratch, &self.plan);
        for (j, place) in interleaved(n).enumerate() {
            a[j] = scratch[place].0;
            if let Some(b) = b.get_mut(j) {
                *b = scratch[place].1;
            }
        }
    }
}

/// Place of each value of a row in the complex transform: the even ones rising, then the odd ones falling.
fn interleaved(n: usize) -> impl Iterator<Item = usize> {
    (0..n).map(move |j| if j % 2 == 0 { j / 2 } else { n - 1 - j / 2 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::cos;

    /// One and two rows of every kind of length beside the sum that defines the transform, and back.
    #[test]
    fn rows_agree_with_the_definition() {
        for length in [1, 2, 3, 8, 9, 17, 30, 37, 64, 74] {
            for rows in [1, 2] {
                let input: Vec<f64> = (0..rows * length).map(|i| (i * 37 % 101) as f64 - 50.0).collect();
                let mut found = input.clone();
                let plan = CosinePlan::new(length);
                let mut scratch = plan.scratch();
                plan.forward(&mut found, &mut scratch);
                for (row, found) in input.chunks_exact(length).zip(found.chunks_exact(length)) {
                    for (k, found) in found.iter().enumerate() {
                        let term = |(j, x): (usize, &f64)| {
                            x * cos(PI * (k * (2 * j + 1)) as f64 / (2 * length) as f64)
                        };
                        let defined: f64 = row.iter().enumerate().map(term).sum();
                        assert!(
                            (found - defined).abs() < 1e-11,
                            "{rows} of {length}, {k}: {found}, {defined}"
                        );
                    }
                }
                plan.backward(&mut found, &mut scratch);
                let off = found.iter().zip(&input).fold(0.0, |worst: f64, (a, b)| worst.max((a - b).abs()));
                assert!(off < 1e-12, "{rows} of {length}: {off}");
            }
        }
    }
}
