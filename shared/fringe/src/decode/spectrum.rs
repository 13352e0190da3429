//! Fundamental and harmonics of the steps of a sine set, some pixels side by side.

use super::roles::SinePlan;
use crate::math::sincos;

/// Pixels that are worked on side by side.
pub const SIDE: usize = 16;

/// One value for each of the pixels side by side.
pub type Side = [f64; SIDE];

/// Columns before those of the harmonics: background, modulation.
const FIRST: usize = 2;
/// Columns of the alternating harmonic: its amplitude and the angle on whose cosine it stands.
const ALTERNATING: usize = 3;

/// The discrete Fourier transform over the steps of one set.
///
/// A group of [`SIDE`] pixels becomes columns: background A and modulation B in DN; for each harmonic h = 2 … below N/2 the two parts
/// of bₕ e^{ihφ} e^{−ihφ₁}, turned back by the fundamental's phase φ₁; for an even N the real harmonic Σ (−1)ⁱ Iᵢ / N with
/// cosine and sine of its angle θ = N/2 (φ₁ − δ₀).
#[derive(Debug)]
pub struct Spectrum {
    /// Number of steps N.
    pub steps: usize,
    /// Whether the steps are equal.
    pub even: bool,
    /// (cos hδᵢ, sin hδᵢ) = table[h N + i].
    table: Vec<(f64, f64)>,
}

impl Spectrum {
    /// Builds the table for the steps of a set.
    pub fn new(plan: &SinePlan) -> Self {
        let steps = plan.steps as usize;
        let mut table = vec![(0.0, 0.0); (steps / 2 + 1) * steps];
        for (index, entry) in table.iter_mut().enumerate() {
            let (h, i) = (index / steps, index % steps);
            let (s, c) = sincos(h as f64 * plan.shifts_rad[i]);
            *entry = (c, s);
        }
        Self { steps, even: plan.even, table }
    }

    /// Harmonics whose residual has two degrees of freedom: 2 … below N/2.
    fn harmonics(&self) -> std::ops::Range<usize> {
        2..self.steps.div_ceil(2)
    }

    /// Columns of a group of pixels.
    pub fn columns(&self) -> usize {
        FIRST + 2 * self.harmonics().len() + ALTERNATING
    }

    /// What all pixels have in common, in the order of the columns from the harmonics on: ηₕ by its two parts.
    pub fn coherent_parts(&self) -> usize {
        2 * self.harmonics().len() + 2
    }

    /// (2/N) Σ I e^{ihδ} = bₕ e^{ihφ}.
    #[inline(always)]
    fn bin(&self, stacks: &[Side], h: usize) -> (Side, Side) {
        let row = &self.table[h * self.steps..(h + 1) * self.steps];
        let (mut re, mut im) = ([0.0; SIDE], [0.0; SIDE]);
        for (values, (c, s)) in stacks.iter().zip(row) {
            for l in 0..SIDE {
                re[l] += values[l] * c;
                im[l] += values[l] * s;
            }
        }
        let scale = 2.0 / self.steps as f64;
        (re.map(|v| v * scale), im.map(|v| v * scale))
    }

    /// Transforms the grey values of [`SIDE`] pixels, one element of `stacks` per step, into columns.
    #[inline(always)]
    pub fn transform(&self, stacks: &[Side], columns: &mut [Side]) {
        let n = self.steps as f64;
        let (mut sum, mut signed) = ([0.0; SIDE], [0.0; SIDE]);
        let mut sign = 1.0;
        for values in stacks {
            for l in 0..SIDE {
                sum[l] += values[l];
                signed[l] += sign * values[l];
            }
            sign = -sign;
        }
        let (c, s) = self.bin(stacks, 1);
        let (mut cosine, mut sine) = ([0.0; SIDE], [0.0; SIDE]);
        for l in 0..SIDE {
            let modulation_dn = (c[l] * c[l] + s[l] * s[l]).sqrt();
            let inverse = if modulation_dn > 0.0 { 1.0 / modulation_dn } else { 0.0 };
            columns[0][l] = sum[l] / n;
            columns[1][l] = modulation_dn;
            (cosine[l], sine[l]) = (c[l] * inverse, s[l] * inverse);
        }
        let (mut turn_c, mut turn_s) = (cosine, sine);
        let mut column = FIRST;
        for h in self.harmonics() {
            turn(&mut turn_c, &mut turn_s, &cosine, &sine);
            let (re, im) = self.bin(stacks, h);
            for l in 0..SIDE {
                columns[column][l] = re[l] * turn_c[l] + im[l] * turn_s[l];
                columns[column + 1][l] = im[l] * turn_c[l] - re[l] * turn_s[l];
            }
            column += 2;
        }
        turn(&mut turn_c, &mut turn_s, &cosine, &sine);
        let first = self.table[self.steps / 2 * self.steps];
        for l in 0..SIDE {
            columns[column][l] = signed[l] / n;
            columns[column + 1][l] = turn_c[l] * first.0 + turn_s[l] * first.1;
            columns[column + 2][l] = turn_s[l] * first.0 - turn_c[l] * first.1;
        }
    }

    /// Adds what the pixels tell of the coherent harmonics, those counted by 1 in `counted`: Zₕ e^{−ihφ} B, whose mean over B² is ηₕ.
    #[inline(always)]
    pub fn add_coherent(&self, columns: &[Side], counted: &Side, coherent: &mut [Side]) {
        let modulation = &columns[1];
        let parts = 2 * self.harmonics().len();
        for (sum, column) in coherent[..parts].iter_mut().zip(&columns[FIRST..]) {
            for l in 0..SIDE {
                sum[l] += counted[l] * modulation[l] * column[l];
            }
        }
        if self.steps.is_multiple_of(2) {
            let [signed, cosine, sine] = [0, 1, 2].map(|k| &columns[FIRST + parts + k]);
            for l in 0..SIDE {
                // Twice, because cos² and sin² are one half in the mean.
                let twice = 2.0 * counted[l] * modulation[l] * signed[l];
                coherent[parts][l] += twice * cosine[l];
                coherent[parts + 1][l] += twice * sine[l];
            }
        }
    }

    /// Sum of squared residuals without the coherent harmonics, DN² (Parseval).
    #[inline(always)]
    pub fn residual(&self, columns: &[Side], coherent: &[f64]) -> Side {
        let half = 0.5 * self.steps as f64;
        let modulation = &columns[1];
        let parts = 2 * self.harmonics().len();
        let mut sum = [0.0; SIDE];
        for (column, expected) in columns[FIRST..FIRST + parts].iter().zip(coherent) {
            for l in 0..SIDE {
                let rest = column[l] - modulation[l] * expected;
                sum[l] += half * (rest * rest);
            }
        }
        if self.steps.is_multiple_of(2) {
            let [signed, cosine, sine] = [0, 1, 2].map(|k| &columns[FIRST + parts + k]);
            for l in 0..SIDE {
                let expected = coherent[parts] * cosine[l] + coherent[parts + 1] * sine[l];
                let rest = signed[l] - modulation[l] * expected;
                sum[l] += self.steps as f64 * rest * rest;
            }
        }
        sum
    }
}

/// (c, s) ← (c, s) · (by_c, by_s) as complex numbers.
#[inline(always)]
fn turn(c: &mut Side, s: &mut Side, by_c: &Side, by_s: &Side) {
    for l in 0..SIDE {
        (c[l], s[l]) = (c[l] * by_c[l] - s[l] * by_s[l], c[l] * by_s[l] + s[l] * by_c[l]);
    }
}
