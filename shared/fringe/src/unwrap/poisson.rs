//! Poisson's equation on a rectangle whose border nothing crosses (eq. 2.44), solved exactly.
//!
//! The cosine transform along the rows turns it into one tridiagonal system a column, which elimination solves:
//! (a_k + T) û_k = r̂_k with a_k = 2 − 2 cos(πk/w) and T the second difference down the column. That saves the second
//! transform of Ghiglia & Romero (JOSA A 11, 1994). Sines and cosines come from [`math`] and no code is chosen by the
//! processor, so that no bit depends on it.

use crate::math;
use crate::math::cosine::CosinePlan;
use crate::math::fourier::Complex;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Solves −∆u = r for one size of image.
pub struct Poisson {
    width: usize,
    height: usize,
    transform: CosinePlan,
    /// 1 / pivot of the elimination, row by row; 0 where the constant is free.
    inverse_pivot: Vec<f64>,
}

impl Poisson {
    /// Prepares; both sides at least 1.
    pub fn new(width: usize, height: usize) -> Self {
        let mut inverse_pivot = vec![0.0; width * height];
        for k in 0..width {
            let along = 2.0 - 2.0 * math::cos(PI * k as f64 / width as f64);
            let mut above = 0.0;
            for y in 0..height {
                let neighbours = f64::from(u8::from(y > 0)) + f64::from(u8::from(y + 1 < height));
                let pivot = along + neighbours - above;
                // Only the constant of the whole image has no equation: its last pivot vanishes.
                above = if k == 0 && y + 1 == height { 0.0 } else { 1.0 / pivot };
                inverse_pivot[y * width + k] = above;
            }
        }
        Self { width, height, transform: CosinePlan::new(width), inverse_pivot }
    }

    /// Replaces r, which should sum to zero, by u; the constant of u is free.
    pub fn solve(&self, values: &mut [f64]) {
        self.rows(values, |rows, scratch| self.transform.forward(rows, scratch));
        self.columns(values);
        self.rows(values, |rows, scratch| self.transform.backward(rows, scratch));
    }

    /// Transforms two rows at a time; which two does not depend on the threads.
    fn rows(&self, values: &mut [f64], transform: impl Fn(&mut [f64], &mut [Complex]) + Sync) {
        values
            .par_chunks_mut(2 * self.width)
            .for_each_init(|| self.transform.scratch(), |scratch, rows| transform(rows, scratch));
    }

    fn columns(&self, values: &mut [f64]) {
        let w = self.width;
        for y in 1..self.height {
            let (above, row) = values[(y - 1) * w..(y + 1) * w].split_at_mut(w);
            let pivots = &self.inverse_pivot[(y - 1) * w..y * w];
            for ((value, above), pivot) in row.iter_mut().zip(above).zip(pivots) {
                *value += *above * pivot;
            }
        }
        for (value, pivot) in
            values[(self.height - 1) * w..].iter_mut().zip(&self.inverse_pivot[(self.height - 1) * w..])
        {
            *value *= pivot;
        }
        for y in (0..self.height - 1).rev() {
            let (row, below) = values[y * w..(y + 2) * w].split_at_mut(w);
            let pivots = &self.inverse_pivot[y * w..(y + 1) * w];
            for ((value, below), pivot) in row.iter_mut().zip(below).zip(pivots) {
                *value = (*value + *below) * pivot;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Put back into the equation, on sides of every kind: 1, prime, even.
    #[test]
    fn the_solution_solves() {
        for (width, height) in [(1, 1), (1, 7), (9, 1), (13, 17), (32, 20)] {
            let mut right: Vec<f64> =
                (0..width * height).map(|i| f64::from((i * 37 % 101) as u8) - 50.0).collect();
            let mean = right.iter().sum::<f64>() / right.len() as f64;
            for value in &mut right {
                *value -= mean;
            }
            let mut u = right.clone();
            Poisson::new(width, height).solve(&mut u);
            for (i, right) in right.iter().enumerate() {
                let (x, y) = (i % width, i / width);
                let beside = [
                    (x > 0).then(|| i - 1),
                    (x + 1 < width).then_some(i + 1),
                    (y > 0).then(|| i - width),
                    (y + 1 < height).then_some(i + width),
                ];
                let left: f64 = beside.iter().flatten().map(|j| u[i] - u[*j]).sum();
                assert!((left - right).abs() < 1e-9, "{width} × {height}: {left} and {right}");
            }
        }
    }

    /// Against the closed form: products of cosines are eigenfunctions, with the sum of both directions' eigenvalues.
    #[test]
    fn cosines_are_divided_by_their_eigenvalues() {
        for (width, height) in [(1, 7), (12, 9), (37, 16), (60, 31), (74, 50)] {
            for (across, down) in [(0, 1), (width / 2, 0), (width - 1, height - 1), (width / 3, height / 2)] {
                let cosine = |k: usize, i: usize, n: usize| {
                    math::cos(PI * (k * (2 * i + 1) % (4 * n)) as f64 / (2 * n) as f64)
                };
                let value = |i: usize| cosine(across, i % width, width) * cosine(down, i / width, height);
                let eigenvalue = |k: usize, n: usize| 2.0 - 2.0 * math::cos(PI * k as f64 / n as f64);
                let divisor = eigenvalue(across, width) + eigenvalue(down, height);
                if divisor == 0.0 {
                    continue; // The constant has no equation.
                }
                let mut u: Vec<f64> = (0..width * height).map(value).collect();
                Poisson::new(width, height).solve(&mut u);
                let mean = u.iter().sum::<f64>() / u.len() as f64;
                for (i, u) in u.iter().enumerate() {
                    let off = (u - mean) * divisor - value(i);
                    assert!(off.abs() < 1e-10, "{width} × {height}, ({across}, {down}), {i}: {off}");
                }
            }
        }
    }
}
