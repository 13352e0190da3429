//! Fundamental and harmonics of the steps of a sine set, pixel by pixel.

use super::roles::SinePlan;
use crate::math::sincos;

/// Harmonics 2 … N/2 of at most 64 steps.
pub const MAX_HARMONICS: usize = 32;
/// Place of the harmonic N/2 of an even N among the coherent ones; the others end before it.
const ALTERNATING: usize = MAX_HARMONICS - 1;

/// Phasor of the fundamental and what the harmonics left, of one pixel.
#[derive(Debug, Clone, Copy)]
pub struct Fit {
    /// Background A of the pixel, DN.
    pub background_dn: f64,
    /// Modulation B of the pixel, DN.
    pub modulation_dn: f64,
    /// cos φ, sin φ.
    pub phasor: (f64, f64),
}

/// The discrete Fourier transform over the steps of one set.
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

    /// (2/N) Σ I e^{ihδ} = bₕ e^{ihφ}.
    fn bin(&self, stack: &[u16], h: usize) -> (f64, f64) {
        let row = &self.table[h * self.steps..(h + 1) * self.steps];
        let mut sum = (0.0, 0.0);
        for (value, (c, s)) in stack.iter().zip(row) {
            sum.0 += f64::from(*value) * c;
            sum.1 += f64::from(*value) * s;
        }
        let scale = 2.0 / self.steps as f64;
        (sum.0 * scale, sum.1 * scale)
    }

    /// The sine of a pixel.
    pub fn fit(&self, stack: &[u16]) -> Fit {
        let sum: f64 = stack.iter().map(|v| f64::from(*v)).sum();
        let (c, s) = self.bin(stack, 1);
        let modulation_dn = (c * c + s * s).sqrt();
        let inverse = if modulation_dn > 0.0 { 1.0 / modulation_dn } else { 0.0 };
        Fit { background_dn: sum / self.steps as f64, modulation_dn, phasor: (c * inverse, s * inverse) }
    }

    /// Harmonics whose residual has two degrees of freedom: 2 … below N/2.
    fn harmonics(&self) -> std::ops::Range<usize> {
        2..self.steps.div_ceil(2)
    }

    /// Sums Zₕ e^{−ihφ} B, whose mean over B² is ηₕ.
    pub fn add_coherent(&self, stack: &[u16], fit: &Fit, coherent: &mut [(f64, f64); MAX_HARMONICS]) {
        let mut turn = fit.phasor;
        for h in self.harmonics() {
            turn = times(turn, fit.phasor);
            let z = times(self.bin(stack, h), (turn.0, -turn.1));
            coherent[h - 2].0 += z.0 * fit.modulation_dn;
            coherent[h - 2].1 += z.1 * fit.modulation_dn;
        }
        if self.steps.is_multiple_of(2) {
            let (alternating, angle) = self.alternating(stack, times(turn, fit.phasor));
            // Twice, because cos² and sin² are one half in the mean.
            coherent[ALTERNATING].0 += 2.0 * alternating * angle.0 * fit.modulation_dn;
            coherent[ALTERNATING].1 += 2.0 * alternating * angle.1 * fit.modulation_dn;
        }
    }

    /// Harmonic N/2, which is real: Σ (−1)ⁱ Iᵢ / N, and the angle θ = N/2 (φ − δ₀) on whose cosine it stands.
    fn alternating(&self, stack: &[u16], turn: (f64, f64)) -> (f64, (f64, f64)) {
        let first = self.table[self.steps / 2 * self.steps];
        let signed =
            stack.iter().enumerate().map(|(i, v)| if i % 2 == 0 { f64::from(*v) } else { -f64::from(*v) });
        (signed.sum::<f64>() / self.steps as f64, times(turn, (first.0, -first.1)))
    }

    /// Sum of squared residuals without the coherent harmonics, DN² (Parseval).
    pub fn residual(&self, stack: &[u16], fit: &Fit, coherent: &[(f64, f64); MAX_HARMONICS]) -> f64 {
        let half = 0.5 * self.steps as f64;
        let mut sum = 0.0;
        let mut turn = fit.phasor;
        for h in self.harmonics() {
            turn = times(turn, fit.phasor);
            let z = self.bin(stack, h);
            let expected = times(coherent[h - 2], turn);
            let rest = (z.0 - fit.modulation_dn * expected.0, z.1 - fit.modulation_dn * expected.1);
            sum += half * (rest.0 * rest.0 + rest.1 * rest.1);
        }
        if self.steps.is_multiple_of(2) {
            let (alternating, angle) = self.alternating(stack, times(turn, fit.phasor));
            let expected = coherent[ALTERNATING].0 * angle.0 + coherent[ALTERNATING].1 * angle.1;
            let rest = alternating - fit.modulation_dn * expected;
            sum += self.steps as f64 * rest * rest;
        }
        sum
    }
}

fn times(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}
