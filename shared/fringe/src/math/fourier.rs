//! The fast Fourier transform of lines and pictures whose sides are powers of two.
//!
//! Written here because its bits may not depend on the machine: libraries choose their vector width at run time and take
//! their sines from the system.

use crate::math::sincos;
use std::f64::consts::TAU;

/// Real and imaginary part.
pub type Complex = (f64, f64);

/// Transforms `values` (row by row, `width` × `height`, both powers of two) in place, kernel e^(−2πi(ux/w + vy/h)).
pub fn transform_2d(values: &mut [Complex], width: usize, height: usize) {
    let along_rows = Plan::new(width);
    values.chunks_exact_mut(width).for_each(|row| along_rows.run(row));
    let along_columns = Plan::new(height);
    let mut column = vec![(0.0, 0.0); height];
    for x in 0..width {
        for (y, value) in column.iter_mut().enumerate() {
            *value = values[y * width + x];
        }
        along_columns.run(&mut column);
        for (y, value) in column.iter().enumerate() {
            values[y * width + x] = *value;
        }
    }
}

/// The turns of one length.
pub struct Plan {
    /// e^(−2πik/n) for the first half of k, as (cos, −sin).
    turns: Vec<Complex>,
    bits: u32,
}

impl Plan {
    /// `length` is a power of two.
    pub fn new(length: usize) -> Self {
        let turn = |k: usize| {
            let (sin, cos) = sincos(TAU * k as f64 / length as f64);
            (cos, -sin)
        };
        Self { turns: (0..length / 2).map(turn).collect(), bits: length.trailing_zeros() }
    }

    /// Decimation in time: bits reversed, then butterflies of rising span.
    pub fn run(&self, values: &mut [Complex]) {
        let n = values.len();
        for i in 0..n {
            let j = i.reverse_bits() >> (usize::BITS - self.bits).min(usize::BITS - 1);
            if n > 1 && i < j {
                values.swap(i, j);
            }
        }
        let mut half = 1;
        while half < n {
            let stride = n / (2 * half);
            for block in values.chunks_exact_mut(2 * half) {
                let (low, high) = block.split_at_mut(half);
                for (k, (a, b)) in low.iter_mut().zip(high).enumerate() {
                    let (c, s) = self.turns[k * stride];
                    let turned = (b.0 * c - b.1 * s, b.0 * s + b.1 * c);
                    *b = (a.0 - turned.0, a.1 - turned.1);
                    *a = (a.0 + turned.0, a.1 + turned.1);
                }
            }
            half *= 2;
        }
    }
}

/// The inverse of [`Plan::run`], by conjugation.
pub fn inverse(values: &mut [Complex], plan: &Plan) {
    conjugate(values, 1.0);
    plan.run(values);
    conjugate(values, 1.0 / values.len().max(1) as f64);
}

/// The inverse of [`transform_2d`].
pub fn inverse_2d(values: &mut [Complex], width: usize, height: usize) {
    conjugate(values, 1.0);
    transform_2d(values, width, height);
    conjugate(values, 1.0 / values.len().max(1) as f64);
}

fn conjugate(values: &mut [Complex], scale: f64) {
    for value in values {
        *value = (value.0 * scale, -value.1 * scale);
    }
}
