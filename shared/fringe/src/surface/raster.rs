//! The samples of all pixels of a view.

use super::Cause;
use super::point::Sample;
use super::windows::LANES;

/// Samples of neighbouring pixels, each of their numbers in one piece; see [`Sample`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Samples {
    /// Inverse depths, 1/mm; NaN where there is no point.
    pub inverse_depth: [f64; LANES],
    /// Their standard uncertainties, 1/mm; this and what follows means something for points only.
    pub sigma: [f32; LANES],
    /// Shares of the variances that are the pixels' own.
    pub own_share: [f32; LANES],
    /// Modulations of the pixels, DN.
    pub modulation: [f32; LANES],
    /// In the pictures of which cameras phases end nearby.
    pub limbs: [u8; LANES],
    /// Why there is no point.
    pub cause: [Cause; LANES],
}

impl Samples {
    pub const NONE: Self = Self {
        inverse_depth: [Sample::NONE.inverse_depth; LANES],
        sigma: [Sample::NONE.sigma; LANES],
        own_share: [Sample::NONE.own_share; LANES],
        modulation: [Sample::NONE.modulation; LANES],
        limbs: [Sample::NONE.limbs; LANES],
        cause: [Sample::NONE.cause; LANES],
    };

    /// One of the samples, by its place.
    #[inline(always)]
    pub fn at(&self, l: usize) -> Sample {
        Sample {
            inverse_depth: self.inverse_depth[l],
            sigma: self.sigma[l],
            own_share: self.own_share[l],
            modulation: self.modulation[l],
            limbs: self.limbs[l],
            cause: self.cause[l],
        }
    }

    /// Replaces one of the samples.
    #[inline(always)]
    pub fn set(&mut self, l: usize, sample: &Sample) {
        self.inverse_depth[l] = sample.inverse_depth;
        (self.sigma[l], self.own_share[l]) = (sample.sigma, sample.own_share);
        (self.modulation[l], self.limbs[l], self.cause[l]) = (sample.modulation, sample.limbs, sample.cause);
    }
}

/// Samples on the grid of a view, each of their numbers in one piece.
#[derive(Debug, Clone)]
pub(crate) struct Raster {
    /// Inverse depths, 1/mm; NaN where there is no point.
    pub(super) depths: Vec<f64>,
    /// Their standard uncertainties, 1/mm; only those of points mean something.
    pub(super) sigmas: Vec<f32>,
    /// Shares of the variances that are the pixels' own, of points as well.
    pub(super) own_shares: Vec<f32>,
    /// Modulations of the pixels that are points, DN.
    pub(super) modulations: Vec<f32>,
    /// In the pictures of which cameras phases end near the points.
    pub(super) limbs: Vec<u8>,
}

impl Raster {
    /// So many pixels without a point.
    pub fn new(pixels: usize) -> Self {
        let none = Sample::NONE;
        Self {
            depths: vec![none.inverse_depth; pixels],
            sigmas: vec![none.sigma; pixels],
            own_shares: vec![none.own_share; pixels],
            modulations: vec![none.modulation; pixels],
            limbs: vec![none.limbs; pixels],
        }
    }

    /// Number of its pixels.
    pub fn len(&self) -> usize {
        self.depths.len()
    }

    /// The sample of a pixel.
    #[inline(always)]
    pub fn at(&self, pixel: usize) -> Sample {
        let inverse_depth = self.depths[pixel];
        Sample {
            inverse_depth,
            sigma: self.sigmas[pixel],
            own_share: self.own_shares[pixel],
            modulation: self.modulations[pixel],
            limbs: self.limbs[pixel],
            cause: if inverse_depth.is_finite() { Cause::Point } else { Cause::Dark },
        }
    }

    /// Whether the samples at the corners of a window about a pixel are there; at a rim one of them is not, and no sum over the window is.
    #[inline]
    pub(super) fn has_corners(&self, width: usize, pixel: usize, half: usize) -> bool {
        let (across, down) = (half, half * width);
        let corners =
            [pixel - down - across, pixel - down + across, pixel + down - across, pixel + down + across];
        corners.iter().all(|corner| self.depths[*corner].is_finite())
    }

    /// Whether every sample of a window about a pixel is there, within the picture.
    pub(super) fn is_whole(&self, (width, height): (usize, usize), pixel: usize, half: usize) -> bool {
        let (column, row) = (pixel % width, pixel / width);
        let inside = column >= half && row >= half && column + half < width && row + half < height;
        inside
            && (row - half..=row + half).all(|row| {
                let line = &self.depths[row * width + column - half..][..=2 * half];
                line.iter().all(|depth| depth.is_finite())
            })
    }

    /// Takes the samples of a pixel and of those behind it.
    #[inline(always)]
    pub fn put_beside(&mut self, pixel: usize, samples: &Samples) {
        self.depths[pixel..pixel + LANES].copy_from_slice(&samples.inverse_depth);
        self.sigmas[pixel..pixel + LANES].copy_from_slice(&samples.sigma);
        self.own_shares[pixel..pixel + LANES].copy_from_slice(&samples.own_share);
        self.modulations[pixel..pixel + LANES].copy_from_slice(&samples.modulation);
        self.limbs[pixel..pixel + LANES].copy_from_slice(&samples.limbs);
    }

    /// Takes the sample of a pixel.
    #[inline(always)]
    pub fn put(&mut self, pixel: usize, sample: &Sample) {
        self.depths[pixel] = sample.inverse_depth;
        if sample.inverse_depth.is_nan() {
            return;
        }
        self.sigmas[pixel] = sample.sigma;
        self.own_shares[pixel] = sample.own_share;
        self.modulations[pixel] = sample.modulation;
        self.limbs[pixel] = sample.limbs;
    }
}

#[cfg(test)]
impl From<&[Sample]> for Raster {
    fn from(samples: &[Sample]) -> Self {
        let mut raster = Self::new(samples.len());
        samples.iter().enumerate().for_each(|(pixel, sample)| raster.put(pixel, sample));
        raster
    }
}
