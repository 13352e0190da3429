//! Grey values as f32, smoothed and reduced, for the search of candidates.

use super::error::{MAX_PIXELS, TargetError};
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
        let reach = half_kernel.len() - 1;
        let mut along = vec![0.0_f32; self.values.len()];
        let mut padded = vec![0.0_f32; self.width + 2 * reach];
        for (row, out) in self.values.chunks_exact(self.width).zip(along.chunks_exact_mut(self.width)) {
            padded[..reach].fill(row[0]);
            padded[reach..reach + self.width].copy_from_slice(row);
            padded[reach + self.width..].fill(row[self.width - 1]);
            for (tap, weight) in half_kernel.iter().enumerate() {
                let (low, high) = (&padded[reach - tap..], &padded[reach + tap..]);
                let weight = if tap == 0 { 0.5 * weight } else { *weight };
                for ((sum, a), b) in out.iter_mut().zip(low).zip(high) {
                    *sum += weight * (a + b);
                }
            }
        }
        let mut values = vec![0.0_f32; self.values.len()];
        for (y, out) in values.chunks_exact_mut(self.width).enumerate() {
            for (tap, weight) in half_kernel.iter().enumerate() {
                let row = |line: usize| &along[line * self.width..(line + 1) * self.width];
                let (low, high) = (row(y.saturating_sub(tap)), row((y + tap).min(self.height - 1)));
                let weight = if tap == 0 { 0.5 * weight } else { *weight };
                for ((sum, a), b) in out.iter_mut().zip(low).zip(high) {
                    *sum += weight * (a + b);
                }
            }
        }
        Self { width: self.width, height: self.height, values }
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
