//! Noise of the camera, from the residuals of the N-step fit.
//!
//! A sine set with N steps has N − 3 degrees of freedom beside A, B and φ. They hold the camera's noise and the harmonics
//! of the projector (gamma). The harmonics are coherent: harmonic h of a pixel is ηₕ B e^{ihφ} with one complex ηₕ for
//! the whole image, so they are fitted over the image and removed before the rest is counted as noise. The variance
//! of the rest against the background A is a straight line, read² + gain · A: for equally spaced steps every frame has
//! the same leverage 3/N, so the mean of the residual variance is exact for shot noise too.

use super::report::{NoiseModel, NoiseSource};
use super::roles::SinePlan;
use super::spectrum::{MAX_HARMONICS, Spectrum};
use crate::frame::Pixels;

/// Pixels whose frames are evaluated: the variance is then known to √(2 / (8192 · 7)) = 0.6 % with ten steps.
const SAMPLES: usize = 8192;
/// So many times more are kept, for parts that fill little of the picture: a ball of 20 mm shows on 1 %.
const RESERVE: usize = 4;
/// Fewer pixels with light do not make a noise model.
const LEAST_SAMPLES: usize = 200;
/// So many pixels tell their scatter, to √(2/4096) = 2 %.
const SCATTER_SAMPLES: usize = 4096;
/// Scatter over residuals, as variances, below which the scatter counts: a standard deviation less by a tenth.
const LESS: f64 = 0.81;
/// Bins over the background.
const BINS: usize = 16;
/// Variance of the rounding to whole DN.
pub const QUANTISATION_DN2: f64 = 1.0 / 12.0;
/// Fewest steps whose residuals give the noise: with four there is one residual, and the second harmonic owns it.
const LEAST_STEPS: usize = 5;
/// Fewest steps that leave a residual at all, which shows frames out of order.
const FEWEST_STEPS: usize = 4;

/// A residual variance at a background level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub background_dn: f64,
    pub variance_dn2: f64,
    pub freedom: f64,
}

/// The frames of a sparse, fixed subset of the pixels, for one axis.
#[derive(Debug)]
pub struct Probe {
    positions: Vec<usize>,
    /// Scratch: some of them.
    few: Vec<usize>,
    frames: Vec<u16>,
    steps_max: usize,
    spectra: Vec<Spectrum>,
    samples: Vec<Sample>,
    scratch: Vec<f64>,
    unexplained: Unexplained,
    /// Of sets with four steps.
    unexplained_of_four: Unexplained,
}

/// What the sine model leaves.
#[derive(Debug, Clone, Copy, Default)]
struct Unexplained {
    /// Σ residual variance over the sampled pixels, DN².
    variance_dn2: f64,
    /// Σ B² over the sampled pixels, DN².
    power_dn2: f64,
    pixels: usize,
}

impl Unexplained {
    /// As a fraction of the modulation, if beyond this limit and beyond what a dim part's noise is of full scale.
    fn beyond(&self, limit: f64, full_scale_dn: u16) -> Option<f64> {
        if self.pixels < LEAST_SAMPLES || self.power_dn2 <= 0.0 {
            return None;
        }
        let fraction = (self.variance_dn2 / self.power_dn2).sqrt();
        let residual_dn = (self.variance_dn2 / self.pixels as f64).sqrt();
        let strong = residual_dn > DISORDER_OF_SCALE * f64::from(full_scale_dn);
        (fraction > limit && strong).then_some(fraction)
    }
}

impl Probe {
    /// Chooses the pixels: every k-th with k prime to the width, so that they do not stand in columns.
    pub fn new(width: usize, pixels: usize, sets: &[&SinePlan]) -> Self {
        let mut stride = (pixels / (RESERVE * SAMPLES)).max(1);
        while gcd(stride, width) != 1 {
            stride += 1;
        }
        let positions: Vec<usize> = (0..pixels).step_by(stride).collect();
        let steps_max = sets.iter().map(|s| s.steps as usize).max().unwrap_or(0);
        let capacity = positions.len() * sets.len().max(1);
        Self {
            frames: vec![0; positions.len() * steps_max],
            few: Vec::with_capacity(positions.len()),
            positions,
            steps_max,
            spectra: sets.iter().map(|plan| Spectrum::new(plan)).collect(),
            samples: Vec::with_capacity(capacity),
            scratch: Vec::with_capacity(capacity),
            unexplained: Unexplained::default(),
            unexplained_of_four: Unexplained::default(),
        }
    }

    /// Forgets the last cycle.
    pub fn begin(&mut self) {
        self.samples.clear();
        self.unexplained = Unexplained::default();
        self.unexplained_of_four = Unexplained::default();
    }

    /// Keeps the subset of a landing frame.
    pub fn keep(&mut self, step: usize, pixels: Pixels) {
        let kept = self.frames.iter_mut().skip(step).step_by(self.steps_max);
        match pixels {
            Pixels::Mono8(v) => kept.zip(&self.positions).for_each(|(kept, p)| *kept = u16::from(v[*p])),
            Pixels::Mono16(v) => kept.zip(&self.positions).for_each(|(kept, p)| *kept = v[*p]),
        }
    }

    /// Turns the frames of the complete set `index` into samples of the noise.
    pub fn close_set(&mut self, index: usize, least_modulation_dn: f64, clipped_dn: u16) {
        let spectrum = &self.spectra[index];
        let steps = spectrum.steps;
        // Uneven steps have no harmonics of their own: their residuals are left to the other sets.
        if steps < FEWEST_STEPS || !spectrum.even {
            return;
        }
        let width = self.steps_max.max(1);
        let lit = |stack: &[u16]| stack.iter().all(|v| *v > 0 && *v < clipped_dn);
        let stacks =
            || self.frames.chunks_exact(width).map(|stack| &stack[..steps]).filter(|stack| lit(stack));
        let every = (stacks().count() / SAMPLES).max(1);
        let first = self.samples.len();
        let mut coherent = [(0.0, 0.0); MAX_HARMONICS];
        // The harmonics are fitted twice, the second time without the pixels that the first fit does not explain.
        let mut limit_dn2 = f64::INFINITY;
        for round in 0..3 {
            let (mut sums, mut power, mut lit_power) = ([(0.0, 0.0); MAX_HARMONICS], 0.0, 0.0);
            self.samples.truncate(first);
            for stack in stacks().step_by(every) {
                let fit = spectrum.fit(stack);
                if fit.modulation_dn < least_modulation_dn || fit.modulation_dn == 0.0 {
                    continue;
                }
                lit_power += fit.modulation_dn * fit.modulation_dn;
                let freedom = steps as f64 - 3.0;
                let variance_dn2 = spectrum.residual(stack, &fit, &coherent) / freedom;
                self.samples.push(Sample { background_dn: fit.background_dn, variance_dn2, freedom });
                if variance_dn2 <= limit_dn2 {
                    power += fit.modulation_dn * fit.modulation_dn;
                    spectrum.add_coherent(stack, &fit, &mut sums);
                }
            }
            if round < 2 && power > 0.0 {
                coherent = sums.map(|sum| (sum.0 / power, sum.1 / power));
            }
            if round == 2 {
                let variance_dn2: f64 = self.samples[first..].iter().map(|s| s.variance_dn2).sum();
                let count = self.samples.len() - first;
                let black = self.blackened(index, least_modulation_dn, clipped_dn, &coherent);
                let unexplained =
                    if steps < LEAST_STEPS { &mut self.unexplained_of_four } else { &mut self.unexplained };
                unexplained.variance_dn2 += variance_dn2 + black.0;
                unexplained.power_dn2 += lit_power + black.1;
                unexplained.pixels += count + black.2;
            }
            limit_dn2 = EXPLAINED * median_variance(&self.samples[first..], &mut self.scratch);
        }
        if steps < LEAST_STEPS {
            self.samples.truncate(first);
        }
    }

    /// Σ residual variance, Σ B² and number of the pixels with one black frame among lit ones. They give no noise, but a
    /// whole frame that stayed black (a trigger that was lost) hides in them; a sine that touches black leaves next to
    /// nothing there.
    fn blackened(
        &self,
        index: usize,
        least_modulation_dn: f64,
        clipped_dn: u16,
        coherent: &[(f64, f64); MAX_HARMONICS],
    ) -> (f64, f64, usize) {
        let spectrum = &self.spectra[index];
        let steps = spectrum.steps;
        let one_black = |stack: &&[u16]| {
            stack.iter().filter(|v| **v == 0).count() == 1 && stack.iter().all(|v| *v < clipped_dn)
        };
        let mut sums = (0.0, 0.0, 0);
        let stacks = self.frames.chunks_exact(self.steps_max.max(1)).map(|stack| &stack[..steps]);
        for stack in stacks.filter(one_black) {
            let fit = spectrum.fit(stack);
            if fit.modulation_dn >= least_modulation_dn && fit.modulation_dn > 0.0 {
                sums.0 += spectrum.residual(stack, &fit, coherent) / (steps as f64 - 3.0);
                sums.1 += fit.modulation_dn * fit.modulation_dn;
                sums.2 += 1;
            }
        }
        sums
    }

    /// What the sine model leaves of the light, as a fraction of the modulation, when it is more than noise and
    /// harmonics can be: frames out of order, another number of steps, a part or a lamp that changed in between.
    pub fn disorder(&self, full_scale_dn: u16) -> Option<f64> {
        let many = self.unexplained.beyond(DISORDER_OF_MODULATION, full_scale_dn);
        many.or_else(|| self.unexplained_of_four.beyond(DISORDER_OF_FOUR, full_scale_dn))
    }

    /// The model from neighbouring pixels (see [`super::spatial`]): `gather` fills the samples of the given positions.
    pub fn model_of_neighbours(
        &mut self,
        gather: impl FnOnce(&[usize], &mut Vec<Sample>),
    ) -> Option<NoiseModel> {
        self.samples.clear();
        gather(&self.positions, &mut self.samples);
        self.model()
    }

    /// The model of the residuals, or less where the scatter of pixels apart is less: residuals also hold harmonics that differ from place
    /// to place and light that flickers.
    pub fn lessen(
        &mut self,
        model: NoiseModel,
        gather: impl FnOnce(&[usize], &mut Vec<Sample>),
    ) -> NoiseModel {
        let every = (self.positions.len() / SCATTER_SAMPLES).max(1);
        self.few.clear();
        self.few.extend(self.positions.iter().step_by(every));
        self.samples.clear();
        gather(&self.few, &mut self.samples);
        if self.samples.len() < LEAST_SAMPLES {
            return model;
        }
        for sample in &mut self.samples {
            sample.variance_dn2 /= model.read_variance_dn2 + model.gain_dn * sample.background_dn;
        }
        let factor = robust_mean(&self.samples, None, &mut self.scratch).variance_dn2;
        if factor >= LESS {
            return model;
        }
        let read_variance_dn2 = factor * model.read_variance_dn2;
        NoiseModel { read_variance_dn2, gain_dn: factor * model.gain_dn, ..model }
    }

    /// Fits the straight line; `None` when there is too little light.
    pub fn model(&mut self) -> Option<NoiseModel> {
        let count = self.samples.len();
        if count < LEAST_SAMPLES {
            return None;
        }
        // Equal backgrounds must not be ordered by variance, or a bin would get the quiet ones and the next the rest.
        self.samples.sort_unstable_by(|a, b| a.background_dn.total_cmp(&b.background_dn));
        let mut model = None;
        // First each bin rejects outliers by its own median, then all bins by the line through them.
        for _ in 0..3 {
            let mut bins = [Bin::default(); BINS];
            for (index, bin) in bins.iter_mut().enumerate() {
                let samples = &self.samples[index * count / BINS..(index + 1) * count / BINS];
                *bin = robust_mean(samples, model, &mut self.scratch);
            }
            model = Some(line(&bins));
        }
        let (read_variance_dn2, gain_dn) = model?;
        Some(NoiseModel { read_variance_dn2, gain_dn, source: NoiseSource::Estimated { pixels: count } })
    }
}

/// A pixel whose residual variance exceeds the median so many times takes no part in the fit of the harmonics. Between
/// dark and bright pixels shot noise makes a factor of about 5.
const EXPLAINED: f64 = 12.0;

/// Median of the residual variances; infinite without samples.
fn median_variance(samples: &[Sample], scratch: &mut Vec<f64>) -> f64 {
    scratch.clear();
    scratch.extend(samples.iter().map(|s| s.variance_dn2));
    let middle = scratch.len() / 2;
    if scratch.is_empty() { f64::INFINITY } else { *scratch.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Residuals of the sine model that are taken for disorder: beyond this fraction of the modulation and beyond this
/// fraction of full scale. Camera noise on dim parts passes the first, never the second; two neighbouring frames of
/// ten exchanged leave 0.2 of the modulation.
const DISORDER_OF_MODULATION: f64 = 0.15;
const DISORDER_OF_SCALE: f64 = 0.02;
/// The same of the one residual of four steps: steps of 80° instead of 90° leave 0.16, of 70° 0.28; two exchanged frames 1.4, with
/// a gamma of 2.2 still 0.65.
const DISORDER_OF_FOUR: f64 = 0.4;

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[derive(Debug, Clone, Copy, Default)]
struct Bin {
    background_dn: f64,
    variance_dn2: f64,
    freedom: f64,
}

/// Where samples of a variance are cut off, relative to their mean.
struct Cut {
    /// Median of all samples, relative to their mean.
    median: f64,
    /// Samples above this are cut off, relative to their mean.
    limit: f64,
    /// Mean of those below it.
    mean_below: f64,
}

impl Cut {
    /// Of χ²/ν. One degree of freedom comes from neighbouring pixels, where edges and texture make a long tail: the cut is at
    /// 2.5 standard deviations, and the mean below it is 1 − 2c φ(c)/(2Φ(c) − 1). Otherwise the median is (1 − 2/9ν)³ and the cut the
    /// 99.995 % quantile (both after Wilson and Hilferty), so that noise alone loses nothing that matters.
    fn of(freedom: f64) -> Self {
        if freedom < 1.5 {
            return Self { median: 0.454_936, limit: 6.25, mean_below: 0.911_256 };
        }
        let cube = |x: f64| x * x * x;
        let spread = 2.0 / (9.0 * freedom);
        Self { median: cube(1.0 - spread), limit: cube(1.0 - spread + 3.9 * spread.sqrt()), mean_below: 1.0 }
    }
}

/// Mean of the variances of a bin without the samples that no noise makes: edges that moved, glints, wrong light.
///
/// The scale comes from the model or, without one, from the median of the samples; see [`Cut`].
fn robust_mean(samples: &[Sample], model: Option<(f64, f64)>, scratch: &mut Vec<f64>) -> Bin {
    scratch.clear();
    scratch.extend(samples.iter().map(|s| s.variance_dn2 / Cut::of(s.freedom).median));
    let middle = scratch.len() / 2;
    if scratch.is_empty() {
        return Bin::default();
    }
    let median = *scratch.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut bin = Bin::default();
    for s in samples {
        let scale = model.map_or(median, |(read, gain)| read + gain * s.background_dn);
        let cut = Cut::of(s.freedom);
        if s.variance_dn2 <= scale * cut.limit {
            bin.background_dn += s.freedom * s.background_dn;
            bin.variance_dn2 += s.freedom * s.variance_dn2 / cut.mean_below;
            bin.freedom += s.freedom;
        }
    }
    if bin.freedom > 0.0 {
        bin.background_dn /= bin.freedom;
        bin.variance_dn2 /= bin.freedom;
    }
    bin
}

/// Weighted straight line with read² ≥ 1/12 DN² and gain ≥ 0; the weights are ν / 2 σ⁴, first of the data, then of the fit.
fn line(bins: &[Bin; BINS]) -> (f64, f64) {
    let mut fitted = (0.0, 0.0);
    for round in 0..3 {
        let (mut w, mut wx, mut wy, mut wxx, mut wxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for bin in bins.iter().filter(|b| b.freedom > 0.0) {
            let model = if round == 0 { bin.variance_dn2 } else { fitted.0 + fitted.1 * bin.background_dn };
            let sigma2 = model.max(QUANTISATION_DN2);
            let weight = bin.freedom / (sigma2 * sigma2);
            w += weight;
            wx += weight * bin.background_dn;
            wy += weight * bin.variance_dn2;
            wxx += weight * bin.background_dn * bin.background_dn;
            wxy += weight * bin.background_dn * bin.variance_dn2;
        }
        let determinant = w * wxx - wx * wx;
        let mut gain = if determinant > 1e-12 * w * wxx { (w * wxy - wx * wy) / determinant } else { 0.0 };
        gain = gain.max(0.0);
        let mut read = (wy - gain * wx) / w.max(f64::MIN_POSITIVE);
        if read < QUANTISATION_DN2 {
            read = QUANTISATION_DN2;
            gain = ((wxy - read * wx) / wxx.max(f64::MIN_POSITIVE)).max(0.0);
        }
        fitted = (read, gain);
    }
    fitted
}
