//! The memory of a surface builder, and its parts of rows.

use super::patches::Patches;
use super::raster::{Raster, Samples};
use super::{Cause, Sample, SurfaceSettings};
use crate::math::simd::best_level;
use fearless_simd::Level;
use rayon::prelude::*;

/// Rows per part of parallel work; fixed, so that no result depends on the number of threads.
const PART_ROWS: usize = 16;

/// Pixels per part of what is done to each pixel alone.
const CHUNK: usize = 16_384;

/// The scatter of points is estimated in so many windows at most.
pub(super) const SCATTER_WINDOWS: usize = 4096;

/// Settings and buffers of the surface builder, allocated once.
#[derive(Debug, Clone)]
pub(crate) struct SurfaceBuilder {
    pub(super) settings: SurfaceSettings,
    /// Largest relative change of q per pixel on one surface, over the pitch.
    pub(super) max_tangent: f64,
    /// Smallest cosine between normal and lines of sight.
    pub(super) min_cosine: f64,
    /// First pixel of each part.
    pub(super) row_parts: Vec<usize>,
    pub(super) counts: Vec<PartCount>,
    pub(super) point_parts: Vec<usize>,
    pub(super) keep: Vec<u8>,
    /// Pixels at which surfaces end.
    pub(super) ends: Vec<u8>,
    /// What the view knows of its pixels.
    pub(super) raster: Raster,
    /// Instructions that may be used.
    pub(crate) level: Level,
    pub(super) patches: Patches,
    /// What became of each pixel.
    pub(super) causes: Vec<Cause>,
    /// Scratch for the scatter of windows: their middles, and what was found there.
    pub(super) asked: Vec<u32>,
    pub(super) ratios: Vec<f64>,
}

/// What was counted in a part.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PartCount {
    pub(super) spikes: u32,
    pub(super) steep: u32,
    pub(super) rims: u32,
    pub(super) uncertain: u32,
    pub(super) points: u32,
    pub(super) without_normal: u32,
}

impl PartCount {
    pub(super) fn add(&mut self, cause: Cause) {
        match cause {
            Cause::Steep => self.steep += 1,
            Cause::Rim => self.rims += 1,
            Cause::Uncertain => self.uncertain += 1,
            _ => self.points += 1,
        }
    }
}

impl SurfaceBuilder {
    /// What became of each pixel in the last run.
    pub fn causes(&self) -> &[Cause] {
        &self.causes
    }

    /// Bytes of the scratch memory for so many pixels.
    pub fn scratch_bytes(pixels: usize) -> usize {
        pixels * size_of::<f64>()
    }

    /// Memory that holds nothing until the samples of all pixels are put.
    pub fn scratch(&mut self) -> &mut [u8] {
        bytemuck::cast_slice_mut(&mut self.raster.depths)
    }

    /// Forgets what was put: no pixel is lit.
    pub fn clear(&mut self) {
        let parts = self.raster.depths.par_chunks_mut(CHUNK).zip(self.causes.par_chunks_mut(CHUNK));
        parts.for_each(|(depths, causes)| {
            depths.fill(Sample::NONE.inverse_depth);
            causes.fill(Sample::NONE.cause);
        });
    }

    /// Takes what all samples say of their pixels.
    pub fn load(&mut self, samples: &[Sample]) {
        let Raster { depths, sigmas, own_shares, modulations, limbs } = &mut self.raster;
        let parts = depths.par_chunks_mut(CHUNK).zip(sigmas.par_chunks_mut(CHUNK));
        let parts = parts.zip(own_shares.par_chunks_mut(CHUNK)).zip(modulations.par_chunks_mut(CHUNK));
        let parts = parts.zip(limbs.par_chunks_mut(CHUNK));
        let parts = parts.zip(self.causes.par_chunks_mut(CHUNK)).zip(samples.par_chunks(CHUNK));
        parts.for_each(|((((((depths, sigmas), own_shares), modulations), limbs), causes), samples)| {
            for (i, sample) in samples.iter().enumerate() {
                (depths[i], sigmas[i], causes[i]) = (sample.inverse_depth, sample.sigma, sample.cause);
                (own_shares[i], modulations[i]) = (sample.own_share, sample.modulation);
                limbs[i] = sample.limbs;
            }
        });
    }

    /// Takes what one sample says of its pixel.
    #[inline(always)]
    pub fn put(&mut self, pixel: usize, sample: &Sample) {
        self.raster.put(pixel, sample);
        self.causes[pixel] = sample.cause;
    }

    /// Takes what samples say of a pixel and of those behind it.
    #[inline(always)]
    pub fn put_beside(&mut self, pixel: usize, samples: &Samples) {
        self.raster.put_beside(pixel, samples);
        self.causes[pixel..pixel + samples.cause.len()].copy_from_slice(&samples.cause);
    }

    pub fn new(width: usize, height: usize, settings: SurfaceSettings) -> Self {
        let parts = height.div_ceil(PART_ROWS);
        let pixels = width * height;
        Self {
            settings,
            max_tangent: crate::math::tan(settings.max_slope_deg.to_radians()),
            min_cosine: crate::math::cos(settings.max_incidence_deg.to_radians()),
            row_parts: (0..=parts).map(|part| (part * PART_ROWS).min(height) * width).collect(),
            counts: vec![PartCount::default(); parts],
            point_parts: vec![0; parts + 1],
            keep: vec![0; pixels],
            ends: vec![0; pixels],
            raster: Raster::new(pixels),
            level: best_level(),
            patches: Patches::new(pixels),
            causes: vec![Cause::Dark; pixels],
            asked: Vec::with_capacity(SCATTER_WINDOWS + 1),
            ratios: Vec::with_capacity(SCATTER_WINDOWS + 1),
        }
    }
}
