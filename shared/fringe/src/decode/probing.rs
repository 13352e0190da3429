//! The residuals of one sine set in the probed pixels: samples of the noise, and what the sine model leaves.

use super::block::state;
use super::dirt::Steadied;
use super::limits::MAX_STEPS;
use super::noise_estimate::{FEWEST_STEPS, LEAST_STEPS, Probe, SAMPLES, Unexplained};
use super::noise_line::Sample;
use super::rasters::Rasters;
use super::spectrum::{SIDE, Side, Spectrum};
use super::sums::Sums;
use crate::math::simd::vectorised;
use crate::math::statistics::median;
use fearless_simd::Level;

/// A pixel whose residual variance exceeds the median so many times takes no part in the fit of the harmonics. Between
/// dark and bright pixels shot noise makes a factor of about 5.
const EXPLAINED: f64 = 12.0;

/// Median of the residual variances; infinite without samples.
fn median_variance(samples: &[Sample], scratch: &mut Vec<f64>) -> f64 {
    scratch.clear();
    scratch.extend(samples.iter().map(|s| s.variance_dn2));
    median(scratch).unwrap_or(f64::INFINITY)
}

/// The limits of a set's frames.
#[derive(Debug, Clone, Copy)]
pub struct ProbeLimits {
    /// Pixels with less modulation are dark, DN.
    pub least_modulation_dn: f64,
    /// Grey value from which a pixel is clipped, DN.
    pub clipped_dn: u16,
    /// Instructions that may be used.
    pub level: Level,
}

impl Probe {
    /// About so many of the probed places that are certain in a map, or up to twice as many: more of all places are asked for a part that fills
    /// little of the picture.
    pub(super) fn sure(&self, valid: &[u8], enough: usize) -> impl Iterator<Item = usize> {
        let is_sure = |place: &usize| valid[*place] == state::SURE;
        let places = || self.positions.iter().copied();
        let most = (self.positions.len() / enough / 2).max(1);
        let few = places().step_by(most).filter(is_sure).count();
        places().step_by((most * few / enough).clamp(1, most)).filter(is_sure)
    }

    /// Keeps the grey values of a frame, the given step of its set, as long as the cache still holds it.
    pub fn keep(&mut self, step: usize, raster: usize, rasters: &Rasters) {
        let count = self.positions.len();
        // A set with a carrier has more frames than steps; nobody asks for those.
        let Some(kept) = self.frames.get_mut(step * count..(step + 1) * count) else { return };
        match rasters {
            Rasters::Bytes(frames) => {
                let values = frames.raster(raster).iter().step_by(self.stride);
                kept.iter_mut().zip(values).for_each(|(kept, value)| *kept = u16::from(*value));
            }
            Rasters::Words(frames) => {
                let values = frames.raster(raster).iter().step_by(self.stride);
                kept.iter_mut().zip(values).for_each(|(kept, value)| *kept = *value);
            }
        }
    }

    /// Turns the frames of the complete set `index` into samples of the noise.
    pub fn close_set(&mut self, index: usize, sums: &Sums, limits: ProbeLimits) {
        let spectrum = &self.spectra[index];
        // Uneven steps and carriers have no harmonics of their own: their residuals are left to the other sets.
        if spectrum.steps < FEWEST_STEPS || !spectrum.even || sums.rasters().len() != spectrum.steps {
            return;
        }
        vectorised!(limits.level, self.close(index, limits, (sums.are_lines(), sums.steadied.as_ref())));
    }

    /// Chooses positions by the number of their frames that are black; none of them may be clipped.
    #[inline(always)]
    fn choose(&mut self, steps: usize, black: u16, clipped_dn: u16) {
        let count = self.positions.len();
        self.chosen.clear();
        let mut first = 0;
        while first < count {
            let width = SIDE.min(count - first);
            let (mut most, mut zeros) = ([0_u16; SIDE], [0_u16; SIDE]);
            for step in 0..steps {
                let values = &self.frames[step * count + first..][..width];
                for ((most, zeros), value) in most.iter_mut().zip(&mut zeros).zip(values) {
                    *most = if *value > *most { *value } else { *most };
                    *zeros += u16::from(*value == 0);
                }
            }
            for l in 0..width {
                if zeros[l] == black && most[l] < clipped_dn {
                    self.chosen.push((first + l) as u32);
                }
            }
            first += width;
        }
    }

    #[inline(always)]
    fn close(&mut self, index: usize, limits: ProbeLimits, (lines, light): (bool, Option<&Steadied>)) {
        let steps = self.spectra[index].steps;
        self.choose(steps, 0, limits.clipped_dn);
        let every = (self.chosen.len() / SAMPLES).max(1);
        let mut kept = 0;
        for from in (0..self.chosen.len()).step_by(every) {
            self.chosen[kept] = self.chosen[from];
            kept += 1;
        }
        self.chosen.truncate(kept);
        let spectrum = &self.spectra[index];
        let width = spectrum.columns();
        for (group, columns) in self.chosen.chunks(SIDE).zip(self.columns.chunks_exact_mut(width)) {
            transform(spectrum, (&self.frames, light), self.positions.len(), group, columns);
        }
        let first = self.samples.len();
        self.coherent.1.fill(0.0);
        // The harmonics are fitted twice, the second time without the pixels that the first fit does not explain.
        let mut limit_dn2 = f64::INFINITY;
        for round in 0..3 {
            self.samples.truncate(first);
            let (power, lit_power) = self.round(index, limits.least_modulation_dn, limit_dn2);
            if round < 2 && power > 0.0 {
                let (sums, coherent) = &mut self.coherent;
                for (value, sum) in coherent.iter_mut().zip(sums) {
                    *value = sum.iter().sum::<f64>() / power;
                }
            }
            if round == 2 {
                let variance_dn2: f64 = self.samples[first..].iter().map(|s| s.variance_dn2).sum();
                let count = self.samples.len() - first;
                let black = self.blackened(index, limits, light);
                let unexplained = if steps < LEAST_STEPS || lines {
                    &mut self.unexplained_of_four
                } else {
                    &mut self.unexplained
                };
                unexplained.variance_dn2 += variance_dn2 + black.variance_dn2;
                unexplained.power_dn2 += lit_power + black.power_dn2;
                unexplained.pixels += count + black.pixels;
            }
            limit_dn2 = EXPLAINED * median_variance(&self.samples[first..], &mut self.scratch);
        }
        // Lines are sharp: what their high harmonics leave is not noise.
        if steps < LEAST_STEPS || lines {
            self.samples.truncate(first);
        }
    }

    /// One pass over the chosen pixels: their samples, the sums of what is coherent in those within the limit, Σ B² of these and of all.
    #[inline(always)]
    fn round(&mut self, index: usize, least_modulation_dn: f64, limit_dn2: f64) -> (f64, f64) {
        let spectrum = &self.spectra[index];
        let (sums, coherent) = &mut self.coherent;
        sums.fill([0.0; SIDE]);
        let freedom = spectrum.steps as f64 - 3.0;
        let (mut power, mut lit_power) = ([0.0; SIDE], [0.0; SIDE]);
        for (group, columns) in self.chosen.chunks(SIDE).zip(self.columns.chunks_exact(spectrum.columns())) {
            let rest = spectrum.residual(columns, coherent);
            let (mut counted, mut variance_dn2) = ([0.0; SIDE], [0.0; SIDE]);
            for l in 0..SIDE {
                let modulation_dn = columns[1][l];
                variance_dn2[l] = rest[l] / freedom;
                let lit = l < group.len() && modulation_dn >= least_modulation_dn && modulation_dn != 0.0;
                counted[l] = if lit && variance_dn2[l] <= limit_dn2 { 1.0 } else { 0.0 };
                let square = if lit { modulation_dn * modulation_dn } else { 0.0 };
                lit_power[l] += square;
                power[l] += counted[l] * square;
            }
            spectrum.add_coherent(columns, &counted, sums);
            for l in 0..group.len() {
                if columns[1][l] >= least_modulation_dn && columns[1][l] != 0.0 {
                    self.samples.push(Sample {
                        background_dn: columns[0][l],
                        variance_dn2: variance_dn2[l],
                        freedom,
                    });
                }
            }
        }
        (power.iter().sum(), lit_power.iter().sum())
    }

    /// Σ residual variance, Σ B² and number of the pixels with one black frame among lit ones. They give no noise, but a
    /// whole frame that stayed black (a trigger that was lost) hides in them; a sine that touches black leaves next to
    /// nothing there.
    #[inline(always)]
    fn blackened(&mut self, index: usize, limits: ProbeLimits, light: Option<&Steadied>) -> Unexplained {
        self.choose(self.spectra[index].steps, 1, limits.clipped_dn);
        let spectrum = &self.spectra[index];
        let mut sums = Unexplained::default();
        let columns = &mut self.columns[..spectrum.columns()];
        for group in self.chosen.chunks(SIDE) {
            transform(spectrum, (&self.frames, light), self.positions.len(), group, columns);
            let rest = spectrum.residual(columns, &self.coherent.1);
            for l in 0..group.len() {
                let modulation_dn = columns[1][l];
                if modulation_dn >= limits.least_modulation_dn && modulation_dn > 0.0 {
                    sums.variance_dn2 += rest[l] / (spectrum.steps as f64 - 3.0);
                    sums.power_dn2 += modulation_dn * modulation_dn;
                    sums.pixels += 1;
                }
            }
        }
        sums
    }
}

/// The columns of up to [`SIDE`] probed pixels; `frames` holds `count` values for each step.
#[inline(always)]
fn transform(
    spectrum: &Spectrum,
    (frames, light): (&[u16], Option<&Steadied>),
    count: usize,
    group: &[u32],
    columns: &mut [Side],
) {
    let mut stacks = [[0.0; SIDE]; MAX_STEPS];
    for (step, values) in stacks[..spectrum.steps].iter_mut().enumerate() {
        let frame = &frames[step * count..(step + 1) * count];
        for (value, place) in values.iter_mut().zip(group) {
            *value = f64::from(frame[*place as usize]);
        }
    }
    if let Some(light) = light {
        light.unscale(&mut stacks[..spectrum.steps]);
    }
    spectrum.transform(&stacks[..spectrum.steps], columns);
}
