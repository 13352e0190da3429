//! The fast Fourier transform of rows and images of any size.
//!
//! Written here because its bits may not depend on the machine: libraries choose their vector width at run time and take
//! their sines from the system.
//!
//! A length is split into its prime factors (Cooley & Tukey 1965, decimation in time); one with a large prime factor is
//! transformed as a convolution (Bluestein 1970).

use crate::math::sincos;
use std::f64::consts::{PI, TAU};

/// Real and imaginary part.
pub type Complex = (f64, f64);

/// Transforms `values` (row by row, `width` × `height`) in place, kernel e^(−2πi(ux/w + vy/h)).
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

/// Prime factors above this cost more as a transform of their own than as a convolution.
const LARGEST_FACTOR: usize = 31;

/// What transforms of one length share.
pub struct Plan {
    /// e^(−2πik/n), as (cos, −sin).
    roots: Vec<Complex>,
    /// Prime factors of the length, in the order in which their transforms are joined.
    factors: Vec<usize>,
    /// Exchanges of values that bring the input into the order of the first join.
    exchanges: Vec<[u32; 2]>,
    /// For lengths with a prime factor above [`LARGEST_FACTOR`]; the other fields are then empty.
    convolution: Option<Box<Convolution>>,
}

impl Plan {
    /// `length` is at least 1.
    pub fn new(length: usize) -> Self {
        let factors = prime_factors(length);
        if factors.last().is_some_and(|largest| *largest > LARGEST_FACTOR) {
            let convolution = Some(Box::new(Convolution::new(length)));
            return Self { roots: Vec::new(), factors: Vec::new(), exchanges: Vec::new(), convolution };
        }
        let roots = (0..length).map(|k| unit(TAU * k as f64 / length as f64)).collect();
        let exchanges = exchanges(&source_order(length, &factors));
        Self { roots, factors, exchanges, convolution: None }
    }

    /// Transforms `values`, which have the length of the plan.
    pub fn run(&self, values: &mut [Complex]) {
        if let Some(convolution) = &self.convolution {
            return convolution.run(values);
        }
        for [a, b] in &self.exchanges {
            values.swap(*a as usize, *b as usize);
        }
        let mut span = 1;
        for factor in &self.factors {
            match factor {
                2 => self.join_two(values, span),
                // The literals let the compiler unroll the common cases.
                3 => self.join_odd(values, span, 3),
                5 => self.join_odd(values, span, 5),
                _ => self.join_odd(values, span, *factor),
            }
            span *= factor;
        }
    }

    /// Joins each pair of neighbouring transforms of length `span`.
    fn join_two(&self, values: &mut [Complex], span: usize) {
        let stride = values.len() / (2 * span);
        for block in values.chunks_exact_mut(2 * span) {
            let (low, high) = block.split_at_mut(span);
            for (k, (a, b)) in low.iter_mut().zip(high).enumerate() {
                let turned = times(*b, self.roots[k * stride]);
                *b = (a.0 - turned.0, a.1 - turned.1);
                *a = (a.0 + turned.0, a.1 + turned.1);
            }
        }
    }

    /// Joins each `factor` neighbouring transforms of length `span`; conjugate roots are taken together.
    #[inline(always)]
    fn join_odd(&self, values: &mut [Complex], span: usize, factor: usize) {
        const HALF: usize = LARGEST_FACTOR / 2 + 1;
        let (stride, half) = (values.len() / (factor * span), factor / 2);
        let step = values.len() / factor;
        let (mut sums, mut differences) = ([(0.0, 0.0); HALF], [(0.0, 0.0); HALF]);
        for block in values.chunks_exact_mut(factor * span) {
            for k in 0..span {
                let first = block[k];
                let mut total = first;
                for j in 1..=half {
                    let a = times(block[k + j * span], self.roots[j * k * stride]);
                    let mirror = factor - j;
                    let b = times(block[k + mirror * span], self.roots[mirror * k * stride]);
                    sums[j] = (a.0 + b.0, a.1 + b.1);
                    differences[j] = (a.0 - b.0, a.1 - b.1);
                    total = (total.0 + sums[j].0, total.1 + sums[j].1);
                }
                block[k] = total;
                for q in 1..=half {
                    let (mut even, mut odd) = (first, (0.0, 0.0));
                    for j in 1..=half {
                        let (c, s) = self.roots[q * j % factor * step];
                        even = (even.0 + c * sums[j].0, even.1 + c * sums[j].1);
                        odd = (odd.0 - s * differences[j].1, odd.1 + s * differences[j].0);
                    }
                    block[k + q * span] = (even.0 + odd.0, even.1 + odd.1);
                    block[k + (factor - q) * span] = (even.0 - odd.0, even.1 - odd.1);
                }
            }
        }
    }
}

/// Prime factors in rising order.
fn prime_factors(mut length: usize) -> Vec<usize> {
    let mut factors = Vec::new();
    let mut candidate = 2;
    while candidate * candidate <= length {
        if length.is_multiple_of(candidate) {
            factors.push(candidate);
            length /= candidate;
        } else {
            candidate += 1;
        }
    }
    if length > 1 {
        factors.push(length);
    }
    factors
}

/// Which value of the input stands at each place before the first join: digits reversed, in base of the factors.
fn source_order(length: usize, factors: &[usize]) -> Vec<usize> {
    let source = |place: usize| {
        let (mut rest, mut size, mut weight, mut source) = (place, length, 1, 0);
        for factor in factors.iter().rev() {
            size /= factor;
            source += rest / size * weight;
            rest %= size;
            weight *= factor;
        }
        source
    };
    (0..length).map(source).collect()
}

/// The exchanges, one after the other, that bring value `order[i]` to place i.
fn exchanges(order: &[usize]) -> Vec<[u32; 2]> {
    let mut value_at: Vec<usize> = (0..order.len()).collect();
    let mut place_of = value_at.clone();
    let mut exchanges = Vec::new();
    for (place, wanted) in order.iter().enumerate() {
        let other = place_of[*wanted];
        if other != place {
            exchanges.push([place as u32, other as u32]);
            value_at.swap(place, other);
            place_of[value_at[other]] = other;
        }
    }
    exchanges
}

/// A transform of any length as a convolution with e^(iπk²/n), by transforms whose length is a power of two.
struct Convolution {
    plan: Plan,
    /// e^(−iπk²/n) for each k.
    chirp: Vec<Complex>,
    /// Transform of the conjugate chirp at both signs of k, over the length of the plan.
    kernel: Vec<Complex>,
}

impl Convolution {
    fn new(length: usize) -> Self {
        // k² modulo 2n keeps the argument of the sine small and exact.
        let angle = |k: usize| PI * (k * k % (2 * length)) as f64 / length as f64;
        let chirp: Vec<Complex> = (0..length).map(|k| unit(angle(k))).collect();
        let size = (2 * length - 1).next_power_of_two();
        let plan = Plan::new(size);
        let mut kernel = vec![(0.0, 0.0); size];
        for (k, (re, im)) in chirp.iter().enumerate() {
            kernel[k] = (*re, -im);
            kernel[(size - k) % size] = (*re, -im);
        }
        plan.run(&mut kernel);
        Self { plan, chirp, kernel }
    }

    fn run(&self, values: &mut [Complex]) {
        let mut work = vec![(0.0, 0.0); self.kernel.len()];
        for ((work, value), chirp) in work.iter_mut().zip(values.iter()).zip(&self.chirp) {
            *work = times(*value, *chirp);
        }
        self.plan.run(&mut work);
        for (work, kernel) in work.iter_mut().zip(&self.kernel) {
            *work = times(*work, *kernel);
        }
        inverse(&mut work, &self.plan);
        for ((value, work), chirp) in values.iter_mut().zip(work).zip(&self.chirp) {
            *value = times(work, *chirp);
        }
    }
}

/// The complex number e^(−i angle).
pub(super) fn unit(angle_rad: f64) -> Complex {
    let (sin, cos) = sincos(angle_rad);
    (cos, -sin)
}

/// The product of two complex numbers.
#[inline]
fn times(a: Complex, b: Complex) -> Complex {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
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

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(length: usize) -> Vec<Complex> {
        (0..length).map(|i| ((i * 37 % 101) as f64 - 50.0, (i * 53 % 97) as f64 - 48.0)).collect()
    }

    /// Every kind of length beside the sum that defines the transform: 1, powers, products, primes below and above the
    /// limit, and products of both.
    #[test]
    fn any_length_agrees_with_the_definition() {
        for length in [1, 2, 3, 4, 5, 6, 7, 8, 15, 29, 31, 32, 37, 60, 62, 74, 97, 121, 153, 210, 256, 411] {
            let input = noise(length);
            let mut found = input.clone();
            let plan = Plan::new(length);
            plan.run(&mut found);
            for (u, found) in found.iter().enumerate() {
                let defined = input.iter().enumerate().fold((0.0, 0.0), |sum: Complex, (i, value)| {
                    let term = times(*value, unit(TAU * (u * i % length) as f64 / length as f64));
                    (sum.0 + term.0, sum.1 + term.1)
                });
                let off = (found.0 - defined.0).abs().max((found.1 - defined.1).abs());
                assert!(off < 1e-13 * 50.0 * length as f64, "{length}, {u}: {found:?} for {defined:?}");
            }
            inverse(&mut found, &plan);
            let off = found.iter().zip(&input).map(|(a, b)| (a.0 - b.0).abs().max((a.1 - b.1).abs()));
            assert!(off.fold(0.0, f64::max) < 1e-12, "{length}: the inverse does not return the input");
        }
    }
}
