//! Noise of the camera, from the residuals of the N-step fit.
//!
//! A sine set with N steps has N − 3 degrees of freedom beside A, B and φ. They hold the camera's noise and the harmonics
//! of the projector (gamma). The harmonics are coherent: harmonic h of a pixel is ηₕ B e^{ihφ} with one complex ηₕ for
//! the whole image, so they are fitted over the image and removed before the rest is counted as noise. The variance
//! of the rest against the background A is a straight line, read² + gain · A: for equally spaced steps every frame has
//! the same leverage 3/N, so the mean of the residual variance is exact for shot noise too.

use super::noise_line::{BINS, Bin, Sample, line, robust_mean};
use super::noise_model::{NoiseModel, NoiseSource};
use super::roles::SinePlan;
use super::spectrum::{SIDE, Side, Spectrum};

/// Pixels whose frames are evaluated: the variance is then known to √(2 / (8192 · 7)) = 0.6 % with ten steps.
pub(super) const SAMPLES: usize = 8192;
/// So many times more are kept, for parts that fill little of the picture: a ball of 20 mm shows on 1 %.
const RESERVE: usize = 4;
/// Fewer pixels with light do not make a noise model.
const LEAST_SAMPLES: usize = 200;
/// So many pixels tell their scatter, to √(2/4096) = 2 %.
const SCATTER_SAMPLES: usize = 4096;
/// Scatter over residuals, as variances, below which the scatter counts: a standard deviation less by a tenth.
const LESS: f64 = 0.81;
/// Standard uncertainties of the scatter that leave no doubt.
const CERTAIN: f64 = 3.0;
/// Fewest steps whose residuals give the noise: with four there is one residual, and the second harmonic owns it.
pub(super) const LEAST_STEPS: usize = 5;
/// Fewest steps that leave a residual at all, which shows frames out of order.
pub(super) const FEWEST_STEPS: usize = 4;

/// A sparse, fixed subset of the pixels, for one axis, and what was found there.
#[derive(Debug)]
pub struct Probe {
    pub(super) positions: Vec<usize>,
    /// Distance from one of them to the next, pixels.
    pub(super) stride: usize,
    /// Scratch: some of them.
    few: Vec<usize>,
    /// Scratch: their grey values, step after step.
    pub(super) frames: Vec<u16>,
    /// Scratch: numbers of the positions that are evaluated.
    pub(super) chosen: Vec<u32>,
    /// Scratch: groups of them as columns of a [`Spectrum`].
    pub(super) columns: Vec<Side>,
    /// Scratch: what is coherent, pixel by pixel of a group, and in all.
    pub(super) coherent: (Vec<Side>, Vec<f64>),
    pub(super) spectra: Vec<Spectrum>,
    pub(super) samples: Vec<Sample>,
    pub(super) scratch: Vec<f64>,
    /// Median background of the samples behind the last model, DN.
    pub(super) background_dn: f64,
    pub(super) unexplained: Unexplained,
    /// Of sets with four steps, and of lines, whose high harmonics stay.
    pub(super) unexplained_of_four: Unexplained,
}

/// What the sine model leaves.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Unexplained {
    /// Σ residual variance over the sampled pixels, DN².
    pub variance_dn2: f64,
    /// Σ B² over the sampled pixels, DN².
    pub power_dn2: f64,
    pub pixels: usize,
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
        let spectra: Vec<Spectrum> = sets.iter().map(|plan| Spectrum::new(plan)).collect();
        let most = |of: fn(&Spectrum) -> usize| spectra.iter().map(of).max().unwrap_or(0);
        let count = positions.len();
        let capacity = count * sets.len().max(1);
        // Every k-th of at most (k + 1) times as many samples as wanted.
        let groups = count.min(2 * SAMPLES).div_ceil(SIDE);
        let parts = most(Spectrum::coherent_parts);
        Self {
            frames: vec![0; count * most(|spectrum| spectrum.steps)],
            chosen: Vec::with_capacity(count),
            columns: vec![[0.0; SIDE]; groups * most(Spectrum::columns)],
            coherent: (vec![[0.0; SIDE]; parts], vec![0.0; parts]),
            few: Vec::with_capacity(count),
            positions,
            stride,
            spectra,
            samples: Vec::with_capacity(capacity),
            scratch: Vec::with_capacity(capacity),
            background_dn: 0.0,
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
        self.ask_few(gather);
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

    /// Whether pixels apart scatter as is stated, or more, beyond doubt: `gather` fills variances over the stated ones.
    pub fn scatters_as_stated(&mut self, gather: impl FnOnce(&[usize], &mut Vec<Sample>)) -> bool {
        self.ask_few(gather);
        let count = self.samples.len();
        let factor = robust_mean(&self.samples, None, &mut self.scratch).variance_dn2;
        count >= LEAST_SAMPLES && factor * (1.0 - CERTAIN * (2.0 / count as f64).sqrt()) >= LESS
    }

    fn ask_few(&mut self, gather: impl FnOnce(&[usize], &mut Vec<Sample>)) {
        let every = (self.positions.len() / SCATTER_SAMPLES).max(1);
        self.few.clear();
        self.few.extend(self.positions.iter().step_by(every));
        self.samples.clear();
        gather(&self.few, &mut self.samples);
    }

    /// Fits the straight line; `None` when there is too little light.
    pub fn model(&mut self) -> Option<NoiseModel> {
        let count = self.samples.len();
        if count < LEAST_SAMPLES {
            return None;
        }
        // Equal backgrounds must not be ordered by variance, or a bin would get the quiet ones and the next the rest.
        self.samples.sort_unstable_by(|a, b| a.background_dn.total_cmp(&b.background_dn));
        self.background_dn = self.samples[count / 2].background_dn;
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

/// Residuals of the sine model that are taken for disorder: beyond this fraction of the modulation and beyond this
/// fraction of full scale. Camera noise on dim parts passes the first, never the second; two neighbouring frames of
/// ten exchanged leave 0.2 of the modulation.
const DISORDER_OF_MODULATION: f64 = 0.15;
const DISORDER_OF_SCALE: f64 = 0.02;
/// The same of the one residual of four steps: steps of 80° instead of 90° leave 0.16, of 70° 0.28; two exchanged frames 1.4, with
/// a gamma of 2.2 still 0.65.
const DISORDER_OF_FOUR: f64 = 0.4;

/// Greatest common divisor of two numbers.
pub(super) fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}
