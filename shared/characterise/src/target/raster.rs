//! Grey values as f32, smoothed and reduced, for the search of candidates.

use super::error::{MAX_PIXELS, TargetError};
use fearless_simd::{Level, dispatch};
use fringe::frame::{FrameView, Pixels};
use nalgebra::Point2;

/// Grey values, row by row.
#[derive(Debug, Clone)]
pub(crate) struct Raster {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl Raster {
    /// Copies a frame into a raster.
    pub fn of_frame(frame: &FrameView) -> Result<Self, TargetError> {
        let (width, height) = (frame.width_px as usize, frame.height_px as usize);
        let sides = 16..=65_535;
        let values = frame.pixels.len();
        if !sides.contains(&width)
            || !sides.contains(&height)
            || width * height > MAX_PIXELS
            || values != width * height
        {
            return Err(TargetError::Size { width_px: frame.width_px, height_px: frame.height_px, values });
        }
        let values = match frame.pixels {
            Pixels::Mono8(values) => values.iter().map(|v| f32::from(*v)).collect(),
            Pixels::Mono16(values) => values.iter().map(|v| f32::from(*v)).collect(),
        };
        Ok(Self { width, height, values })
    }

    pub fn get(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Bilinear value; `None` outside.
    pub fn sample(&self, at: Point2<f64>) -> Option<f32> {
        if !(at.x >= 0.0 && at.y >= 0.0) {
            return None;
        }
        let (x, y) = (at.x as usize, at.y as usize);
        if x + 1 >= self.width || y + 1 >= self.height {
            return None;
        }
        let (u, v) = ((at.x - x as f64) as f32, (at.y - y as f64) as f32);
        let top = self.get(x, y) * (1.0 - u) + self.get(x + 1, y) * u;
        let bottom = self.get(x, y + 1) * (1.0 - u) + self.get(x + 1, y + 1) * u;
        Some(top * (1.0 - v) + bottom * v)
    }

    /// Means of blocks of factor × factor pixels; a remainder at the right and bottom is cut.
    pub fn reduced(&self, factor: usize) -> Self {
        let (width, height) = (self.width / factor, self.height / factor);
        let mut values = vec![0.0_f32; width * height];
        let scale = 1.0 / (factor * factor) as f32;
        for (y, row) in values.chunks_exact_mut(width.max(1)).enumerate() {
            for line in 0..factor {
                let start = (y * factor + line) * self.width;
                let source = &self.values[start..start + width * factor];
                for (sum, block) in row.iter_mut().zip(source.chunks_exact(factor)) {
                    *sum += block.iter().sum::<f32>() * scale;
                }
            }
        }
        Self { width, height, values }
    }

    /// Convolved with a Gaussian, given by one half of its kernel (centre first); the border is repeated.
    pub fn smoothed(&self, half_kernel: &[f32]) -> Self {
        let mut values = vec![0.0_f32; self.values.len()];
        dispatch!(Level::new(), _level => self.smooth(half_kernel, &mut values));
        Self { width: self.width, height: self.height, values }
    }

    /// Rows are smoothed along themselves as they are needed; those in reach stay in the cache.
    #[inline(always)]
    fn smooth(&self, half_kernel: &[f32], out: &mut [f32]) {
        let reach = half_kernel.len() - 1;
        let ring = 2 * reach + 1;
        let mut along = vec![0.0_f32; ring * self.width];
        let mut padded = vec![0.0_f32; self.width + 2 * reach];
        let weight = |tap: usize| if tap == 0 { 0.5 * half_kernel[0] } else { half_kernel[tap] };
        let mut done = 0;
        for (y, out) in out.chunks_exact_mut(self.width).enumerate() {
            while done < (y + reach + 1).min(self.height) {
                let row = &self.values[done * self.width..(done + 1) * self.width];
                padded[..reach].fill(row[0]);
                padded[reach..reach + self.width].copy_from_slice(row);
                padded[reach + self.width..].fill(row[self.width - 1]);
                let taps: Vec<Tap> = (0..=reach)
                    .map(|tap| (weight(tap), &padded[reach - tap..], &padded[reach + tap..]))
                    .collect();
                weigh(&taps, &mut along[done % ring * self.width..][..self.width]);
                done += 1;
            }
            let row = |line: usize| &along[line % ring * self.width..][..self.width];
            let taps: Vec<Tap> = (0..=reach)
                .map(|tap| (weight(tap), row(y.saturating_sub(tap)), row((y + tap).min(self.height - 1))))
                .collect();
            weigh(&taps, out);
        }
    }
}

/// A weight, and two rows that it counts for.
type Tap<'a> = (f32, &'a [f32], &'a [f32]);

/// Pixels that are summed side by side.
const TOGETHER: usize = 32;

/// Weighted sums of the rows.
#[inline(always)]
fn weigh(taps: &[Tap], out: &mut [f32]) {
    let (blocks, rest) = out.as_chunks_mut::<TOGETHER>();
    let beyond = blocks.len() * TOGETHER;
    for (block, out) in blocks.iter_mut().enumerate() {
        let mut sums = [0.0; TOGETHER];
        for (weight, low, high) in taps {
            let (low, high) = (&low[block * TOGETHER..][..TOGETHER], &high[block * TOGETHER..][..TOGETHER]);
            for k in 0..TOGETHER {
                sums[k] += weight * (low[k] + high[k]);
            }
        }
        *out = sums;
    }
    for (k, out) in rest.iter_mut().enumerate() {
        *out = taps
            .iter()
            .fold(0.0, |sum, (weight, low, high)| sum + weight * (low[beyond + k] + high[beyond + k]));
    }
}

/// One half of a Gaussian kernel of the given sigma, centre first, summing to 1 over both halves.
pub(crate) fn half_gaussian(sigma_px: f64) -> Vec<f32> {
    let reach = (3.0 * sigma_px).ceil() as usize;
    let weights: Vec<f64> = (0..=reach)
        .map(|i| {
            let t = i as f64 / sigma_px;
            fringe::math::exp(-0.5 * t * t)
        })
        .collect();
    let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    weights.iter().map(|w| (w / sum) as f32).collect()
}
