//! Motion between the frames of a sine set, from what its nominal steps leave.
//!
//! A part or a camera that moves shifts the fringes of frame i by pᵢ, much alike in all pixels of a rigid part. I = A + B cos(φ − δᵢ + pᵢ)
//! leaves −B pᵢ sin(φ − δᵢ), less what A, B and φ of the pixel take up (Q projects it out), so that over the pixels
//!
//! ```text
//! Σ B² sᵢ Qᵢⱼ sⱼ · pⱼ = −Σ B sᵢ rᵢ,     sᵢ = sin(φ − δᵢ)
//! ```
//!
//! gives all pᵢ but their mean, which no residual shows. Thousands of pixels average the noise to a part in fifty of a pixel's. Pixels count
//! by how rare their phase is: over whole fringes harmonics of the projector do not look like a motion. Light that changes from frame to
//! frame is solved along with the shifts.

// The sums of a set live on the stack: a warm decoder allocates nothing.
#![allow(clippy::large_stack_arrays)]

use super::arctan::angle_positive_rad;
use super::dirt::{Samples, Steadied};
use super::limits::MAX_STEPS;
use super::motion::{LEAST_STEPS, Shifts, StepMotion};
use super::roles::SinePlan;
use super::spectrum::{SIDE, Side};
use crate::math::simd::vectorised;
use crate::math::{cos, sincos};
use std::f64::consts::TAU;

/// Bins of the phase; all of them must hold a fair share.
const BINS: usize = 64;
const LEAST_IN_BIN: f64 = 4.0;
/// How far a frame may be thought to stand off before anything is seen of it, rad.
const HELD_RAD: f64 = 0.1;

/// One value for each of the steps.
type Steps = [f64; MAX_STEPS];

/// Sines and cosines of the steps.
type Units = [(f64, f64); MAX_STEPS];

/// The motion that the frames of a complete set show without the changes of the light that were found; `None` where they do not tell.
pub(super) fn between_steps(samples: &Samples, light: &Steadied) -> Option<StepMotion> {
    let plan = samples.plan();
    let steps = plan.steps as usize;
    if !plan.even || !(LEAST_STEPS..=MAX_STEPS).contains(&steps) {
        return None;
    }
    let rarity = rarity(samples, light)?;
    let mut sums = LaneSums::ZERO;
    vectorised!(samples.level(), sums.fill(samples, light, &rarity));
    sums.joined().solve(plan, light.left)
}

/// Sines and cosines of the steps.
fn units(plan: &SinePlan) -> Units {
    let mut units = [(0.0, 0.0); MAX_STEPS];
    for (unit, shift) in units.iter_mut().zip(&plan.shifts_rad) {
        *unit = sincos(*shift);
    }
    units
}

/// How rare the phases of the pixels are, so that whole fringes count alike.
pub(super) struct Rarity {
    unit: Units,
    weights: [f64; BINS],
}

/// That of the pixels; `None` where hardly one has some phase.
pub(super) fn rarity(samples: &Samples, light: &Steadied) -> Option<Rarity> {
    let (unit, mut counts) = (units(samples.plan()), [0.0; BINS]);
    vectorised!(samples.level(), count(samples, light, &unit, &mut counts));
    if counts.iter().any(|count| *count < LEAST_IN_BIN) {
        return None;
    }
    let mean = counts.iter().sum::<f64>() / BINS as f64;
    Some(Rarity { unit, weights: counts.map(|count| mean / count) })
}

impl Rarity {
    /// Weights of the pixels of a group, of so many.
    #[inline(always)]
    pub(super) fn weights(&self, (count, mean_dn, rows): (usize, &Side, &[Side])) -> Side {
        let [_, c, s] = fringe(mean_dn, rows, &self.unit);
        self.of_phases(count, &c, &s)
    }

    #[inline(always)]
    fn of_phases(&self, count: usize, c: &Side, s: &Side) -> Side {
        let mut weights = [0.0; SIDE];
        for (weight, bin) in weights.iter_mut().zip(&bins(c, s)[..count]) {
            *weight = self.weights[*bin as usize];
        }
        weights
    }
}

/// Counts the pixels by their phase.
#[inline(always)]
fn count(samples: &Samples, light: &Steadied, unit: &Units, counts: &mut [f64; BINS]) {
    let mut steady = [[0.0; SIDE]; MAX_STEPS];
    for (chosen, mean_dn, rows) in samples.groups() {
        let [_, c, s] = fringe(mean_dn, light.steady(rows, &mut steady), unit);
        for bin in &bins(&c, &s)[..chosen.len()] {
            counts[*bin as usize] += 1.0;
        }
    }
}

/// A, B cos φ and B sin φ of a group of pixels, DN.
#[inline(always)]
fn fringe(mean_dn: &Side, rows: &[Side], unit: &Units) -> [Side; 3] {
    let (mut a, mut c, mut s) = ([0.0; SIDE], [0.0; SIDE], [0.0; SIDE]);
    for (values, (sin, cos)) in rows.iter().zip(unit) {
        for l in 0..SIDE {
            a[l] += values[l];
            c[l] += values[l] * cos;
            s[l] += values[l] * sin;
        }
    }
    let each = 1.0 / rows.len() as f64;
    for l in 0..SIDE {
        let scale = each * mean_dn[l];
        (a[l], c[l], s[l]) = (scale * a[l], 2.0 * scale * c[l], 2.0 * scale * s[l]);
    }
    [a, c, s]
}

/// Bins of the phases of a group.
#[inline(always)]
fn bins(c: &Side, s: &Side) -> [u32; SIDE] {
    let mut bins = [0; SIDE];
    for l in 0..SIDE {
        let turns = angle_positive_rad(s[l] as f32, c[l] as f32) / TAU;
        bins[l] = ((turns * BINS as f64) as u32).min(BINS as u32 - 1);
    }
    bins
}

/// [`Sums`] of pixels side by side.
struct LaneSums {
    power: [Side; 3],
    level: [Side; 3],
    right: [Side; MAX_STEPS],
    light: [Side; MAX_STEPS],
    squares: Side,
    weights: Side,
}

impl LaneSums {
    const ZERO: Self = Self {
        power: [[0.0; SIDE]; 3],
        level: [[0.0; SIDE]; 3],
        right: [[0.0; SIDE]; MAX_STEPS],
        light: [[0.0; SIDE]; MAX_STEPS],
        squares: [0.0; SIDE],
        weights: [0.0; SIDE],
    };

    /// Adds all pixels, each by the weight of its bin.
    #[inline(always)]
    fn fill(&mut self, samples: &Samples, light: &Steadied, rarity: &Rarity) {
        let unit = &rarity.unit;
        let mut steady = [[0.0; SIDE]; MAX_STEPS];
        for (chosen, mean_dn, rows) in samples.groups() {
            let rows = light.steady(rows, &mut steady);
            let [a, c, s] = fringe(mean_dn, rows, unit);
            let weight = rarity.of_phases(chosen.len(), &c, &s);
            for l in 0..SIDE {
                let w = weight[l];
                self.power[0][l] += w * (c[l] * c[l] + s[l] * s[l]);
                self.power[1][l] += w * (c[l] * c[l] - s[l] * s[l]);
                self.power[2][l] += w * (2.0 * s[l] * c[l]);
                self.level[0][l] += w * (a[l] * a[l]);
                self.level[1][l] += w * (a[l] * c[l]);
                self.level[2][l] += w * (a[l] * s[l]);
                self.weights[l] += w;
            }
            let steps = rows.iter().zip(unit).zip(self.right.iter_mut().zip(&mut self.light));
            for ((values, (sin, cos)), (right, light)) in steps {
                for l in 0..SIDE {
                    let told = a[l] + c[l] * cos + s[l] * sin;
                    let rest = values[l] * mean_dn[l] - told;
                    right[l] -= weight[l] * (s[l] * cos - c[l] * sin) * rest;
                    light[l] += weight[l] * told * rest;
                    self.squares[l] += weight[l] * rest * rest;
                }
            }
        }
    }

    fn joined(&self) -> Sums {
        let sum = |values: &Side| values.iter().sum::<f64>();
        Sums {
            power: self.power.each_ref().map(sum),
            level: self.level.each_ref().map(sum),
            right: self.right.each_ref().map(sum),
            light: self.light.each_ref().map(sum),
            squares: sum(&self.squares),
            weights: sum(&self.weights),
        }
    }
}

/// Sums over the pixels.
struct Sums {
    /// Σ B², Σ B² cos 2φ, Σ B² sin 2φ.
    power: [f64; 3],
    /// Σ A², Σ A B cos φ, Σ A B sin φ.
    level: [f64; 3],
    /// Of the shifts, and of the light of the frames.
    right: Steps,
    light: Steps,
    /// Σ of squared residuals, and of the weights.
    squares: f64,
    weights: f64,
}

/// An element of Q: what A, B and φ of a pixel leave of two frames, the same one or two with steps so far apart.
fn beside_the_pixel(is_same: bool, apart_rad: f64, steps: f64) -> f64 {
    f64::from(u8::from(is_same)) - (1.0 + 2.0 * cos(apart_rad)) / steps
}

/// Rows and columns of the steps.
type Square = [Steps; MAX_STEPS];

/// Light of a frame that differs by more, as a part of it, is told as flicker.
const MOST_FLICKER: f64 = 0.1;

impl Sums {
    /// The normal equations of shifts, of shifts with light, and of light.
    fn normal(&self, shifts_rad: &[f64]) -> [Square; 3] {
        let steps = shifts_rad.len() as f64;
        let ([s0, c2, s2], [a2, c1, s1]) = (self.power, self.level);
        let mut out = [[[0.0; MAX_STEPS]; MAX_STEPS]; 3];
        for (i, a) in shifts_rad.iter().enumerate() {
            for (j, b) in shifts_rad.iter().enumerate() {
                let taken = beside_the_pixel(i == j, a - b, steps);
                let ((sa, ca), (sb, cb)) = (sincos(*a), sincos(*b));
                let ((sum_sin, sum_cos), (sin, cosine)) = (sincos(a + b), sincos(a - b));
                let along = c2 * sum_cos + s2 * sum_sin;
                let across = s2 * sum_cos - c2 * sum_sin - s0 * sin;
                out[0][i][j] = 0.5 * taken * (s0 * cosine - along);
                out[1][i][j] = -taken * (0.5 * across + s1 * ca - c1 * sa);
                out[2][i][j] = taken * (a2 + c1 * (ca + cb) + s1 * (sa + sb) + 0.5 * (s0 * cosine + along));
            }
        }
        out
    }

    /// The shifts of the frames and what they are worth. Light that changes from frame to frame is solved along with them.
    fn solve(&self, plan: &SinePlan, left: f64) -> Option<StepMotion> {
        let n = plan.steps as usize;
        let steps = n as f64;
        let [mut matrix, cross, mut light] = self.normal(&plan.shifts_rad[..n]);
        let noise_dn2 = self.squares / (self.weights * (steps - 3.0)).max(1.0);
        for (i, row) in light.iter_mut().enumerate().take(n) {
            row[i] += noise_dn2 / (MOST_FLICKER * MOST_FLICKER);
        }
        let light = lower(&mut light, n)?;
        let mut right = self.right;
        let known = solved(light, n, &self.light);
        for i in 0..n {
            let own = solved(light, n, &cross[i]);
            right[i] -= (0..n).map(|k| cross[i][k] * known[k]).sum::<f64>();
            for (j, other) in cross.iter().enumerate().take(n) {
                matrix[i][j] -= (0..n).map(|k| own[k] * other[k]).sum::<f64>();
            }
        }
        self.judge(&matrix, &right, (plan, noise_dn2, left))
    }

    fn judge(
        &self,
        matrix: &Square,
        right: &Steps,
        (plan, noise_dn2, left): (&SinePlan, f64, f64),
    ) -> Option<StepMotion> {
        let n = plan.steps as usize;
        let steps = n as f64;
        // What the steps do not show, the mean above all, is held near zero: a tenth of a radian.
        let mut held = *matrix;
        for (i, row) in held.iter_mut().enumerate().take(n) {
            row[i] += noise_dn2 / (HELD_RAD * HELD_RAD);
        }
        let lower = lower(&mut held, n)?;
        let shifts = solved(lower, n, right);
        let explained: f64 = (0..n).map(|i| shifts[i] * right[i]).sum();
        let noise_dn2 = (self.squares - explained).max(0.0) / (self.weights * (steps - 3.0)).max(1.0);
        // The variance of a shift, H⁻¹ M H⁻¹, but for what looks like light: of N shifts that leaves N − 3.
        let noise: f64 = (0..n)
            .map(|i| {
                let mut one = [0.0; MAX_STEPS];
                for (j, value) in one[..n].iter_mut().enumerate() {
                    *value = beside_the_pixel(i == j, plan.shifts_rad[i] - plan.shifts_rad[j], steps);
                }
                let own = solved(lower, n, &one);
                (0..n).map(|j| own[j] * (0..n).map(|k| matrix[j][k] * own[k]).sum::<f64>()).sum::<f64>()
            })
            .sum::<f64>()
            * noise_dn2
            / steps;
        let shifts = Shifts {
            rad: &shifts[..n],
            noise_rad: noise.max(0.0).sqrt(),
            explained: explained / noise_dn2,
            without_light: true,
            // Whole fringes count alike.
            response: 0.0,
        };
        Some(StepMotion::of_shifts(plan, &shifts, left))
    }
}

/// The Cholesky factor of the first n rows, in place.
pub(super) fn lower(matrix: &mut Square, n: usize) -> Option<&Square> {
    for j in 0..n {
        for i in j..n {
            let product: f64 = (0..j).map(|k| matrix[i][k] * matrix[j][k]).sum();
            let rest = matrix[i][j] - product;
            if i == j {
                if rest.is_nan() || rest <= 1e-12 * matrix[j][j].abs() {
                    return None;
                }
                matrix[j][j] = rest.sqrt();
            } else {
                matrix[i][j] = rest / matrix[j][j];
            }
        }
    }
    Some(matrix)
}

pub(super) fn solved(lower: &Square, n: usize, right: &Steps) -> Steps {
    let mut x = *right;
    for i in 0..n {
        let product: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
        x[i] = (x[i] - product) / lower[i][i];
    }
    for i in (0..n).rev() {
        let product: f64 = (i + 1..n).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - product) / lower[i][i];
    }
    x
}
