//! Least-squares unwrapping, weighted or not (eq. 2.40–2.48; Ghiglia & Romero, JOSA A 11, 1994).
//!
//! Minimised is Σ w (ψ_b − ψ_a − ξ(φ_b − φ_a))² over the edges between valid pixels. The normal equations Z ψ = μ are
//! solved by conjugate gradients, preconditioned with the unweighted solution on the whole rectangle ([`Poisson`]). On
//! a full rectangle without weights that is exact in the first step: the direct method; a mask counts as weight zero.

use super::angle::{Angles, turns};
use super::edges::Grid;
use super::forest::Labels;
use super::poisson::Poisson;
use super::report::Convergence;
use super::rows::along_rows;
use super::{NO_COMPONENT, UnwrapSettings};
use rayon::prelude::*;

/// Values summed at a time; fixed, so that no sum depends on the number of threads.
const CHUNK: usize = 16_384;

/// Result of least-squares unwrapping.
pub struct Solved {
    /// Components, and the whole turns of the wrapped phase nearest to the solution.
    pub labels: Labels,
    /// The solution, turns; at the first pixel of each component that pixel's wrapped phase.
    pub smooth_turns: Vec<f64>,
    /// How the iteration ended.
    pub convergence: Convergence,
}

/// Weights of the edges; 0 where there is none.
struct System {
    width: usize,
    right: Vec<f64>,
    down: Vec<f64>,
}

/// Solves, and takes the nearest congruent phase.
pub fn solve(
    angles: &Angles<'_>,
    grid: &Grid<'_>,
    quality: Option<&[f32]>,
    settings: &UnwrapSettings,
) -> Solved {
    let system = System::new(grid, quality);
    let (mut smooth_turns, convergence) = system.solve(system.right_side(angles), grid, settings);
    let labels = congruent(angles, grid, &mut smooth_turns);
    Solved { labels, smooth_turns, convergence }
}

impl System {
    fn new(grid: &Grid<'_>, quality: Option<&[f32]>) -> Self {
        let weight = |(a, b): (usize, usize)| {
            quality.map_or(1.0, |quality| {
                let worse = f64::from(quality[a].min(quality[b]).max(LEAST_QUALITY));
                worse * worse
            })
        };
        let n = grid.valid.len();
        let right = (0..n).into_par_iter().map(|i| grid.right(i).map_or(0.0, weight)).collect();
        let down = (0..n).into_par_iter().map(|i| grid.down(i).map_or(0.0, weight)).collect();
        Self { width: grid.width, right, down }
    }

    /// Σ of what flows into each pixel when `flow(a, b)` flows along each edge from a to b, per weight.
    fn divergence(&self, flow: impl Fn(usize, usize) -> f64 + Sync) -> Vec<f64> {
        let w = self.width;
        let into = |i: usize| {
            let mut sum = 0.0;
            if !i.is_multiple_of(w) && self.right[i - 1] > 0.0 {
                sum += self.right[i - 1] * flow(i - 1, i);
            }
            if self.right[i] > 0.0 {
                sum -= self.right[i] * flow(i, i + 1);
            }
            if i >= w && self.down[i - w] > 0.0 {
                sum += self.down[i - w] * flow(i - w, i);
            }
            if self.down[i] > 0.0 {
                sum -= self.down[i] * flow(i, i + w);
            }
            sum
        };
        (0..self.right.len()).into_par_iter().with_min_len(CHUNK).map(into).collect()
    }

    /// μ of eq. 2.47, with the sign that makes Z positive.
    fn right_side(&self, angles: &Angles<'_>) -> Vec<f64> {
        self.divergence(|a, b| f64::from(turns(angles.difference(a, b))))
    }

    /// Preconditioned conjugate gradients (Ghiglia & Romero 1994, section 4).
    fn solve(
        &self,
        mut residual: Vec<f64>,
        grid: &Grid<'_>,
        settings: &UnwrapSettings,
    ) -> (Vec<f64>, Convergence) {
        let mut solution = vec![0.0; residual.len()];
        let first = dot(&residual, &residual).sqrt();
        let mut convergence = Convergence { converged: first == 0.0, iterations: 0, residual: 0.0 };
        if convergence.converged {
            return (solution, convergence);
        }
        let poisson = Poisson::new(grid.width, grid.height);
        let mut direction = vec![0.0; residual.len()];
        let mut energy = 0.0;
        while !convergence.converged && convergence.iterations < settings.max_iterations {
            let mut better = residual.clone();
            poisson.solve(&mut better);
            let next = dot(&residual, &better);
            let keep = if energy > 0.0 { next / energy } else { 0.0 };
            energy = next;
            combine(&mut direction, keep, &better, 1.0);
            let image = self.divergence(|a, b| direction[b] - direction[a]);
            let curvature = dot(&direction, &image);
            if !(curvature > 0.0 && energy > 0.0) {
                break; // Rounding is all that is left.
            }
            let step = energy / curvature;
            combine(&mut solution, 1.0, &direction, step);
            combine(&mut residual, 1.0, &image, -step);
            convergence.iterations += 1;
            convergence.residual = dot(&residual, &residual).sqrt() / first;
            convergence.converged = convergence.residual <= settings.tolerance;
        }
        (solution, convergence)
    }
}

/// A quality below this would cut pixels off; their component would have no constant.
const LEAST_QUALITY: f32 = 1e-3;

fn dot(a: &[f64], b: &[f64]) -> f64 {
    let partial = |(a, b): (&[f64], &[f64])| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let parts: Vec<f64> = a.par_chunks(CHUNK).zip(b.par_chunks(CHUNK)).map(partial).collect();
    parts.iter().sum()
}

/// a ← a · keep + b · add.
fn combine(a: &mut [f64], keep: f64, b: &[f64], add: f64) {
    a.par_chunks_mut(CHUNK).zip(b.par_chunks(CHUNK)).for_each(|(a, b)| {
        for (a, b) in a.iter_mut().zip(b) {
            *a = *a * keep + *b * add;
        }
    });
}

/// Adds the constant of each component that brings the solution nearest to the wrapped phase, then rounds.
fn congruent(angles: &Angles<'_>, grid: &Grid<'_>, smooth: &mut [f64]) -> Labels {
    let mut labels = along_rows(angles, grid, &[]);
    let numbered = |i: &usize| labels.component[*i] != NO_COMPONENT;
    let mut first: Vec<usize> = Vec::new();
    for i in (0..smooth.len()).filter(numbered) {
        if labels.component[i] as usize == first.len() {
            first.push(i);
        }
    }
    let mut constant: Vec<f64> = first.iter().map(|i| angles.on_grid(*i) - smooth[*i]).collect();
    // The mean about the last constant, twice: the first pixel alone may be a bad one.
    for _ in 0..2 {
        let mut sums = vec![(0.0_f64, 0.0_f64); first.len()];
        for i in (0..smooth.len()).filter(numbered) {
            let c = labels.component[i] as usize;
            let off = angles.on_grid(i) - smooth[i] - constant[c];
            sums[c].0 += off - off.round();
            sums[c].1 += 1.0;
        }
        for (constant, (sum, count)) in constant.iter_mut().zip(sums) {
            *constant += sum / count;
        }
    }
    let above = |smooth: f64, i: usize, c: usize| (smooth + constant[c] - angles.on_grid(i)).round();
    let base: Vec<f64> = first.iter().enumerate().map(|(c, i)| above(smooth[*i], *i, c)).collect();
    for (i, smooth) in smooth.iter_mut().enumerate().filter(|(i, _)| labels.component[*i] != NO_COMPONENT) {
        let c = labels.component[i] as usize;
        labels.turns[i] = (above(*smooth, i, c) - base[c]) as i32;
        *smooth += constant[c] - base[c];
    }
    labels
}
